"""The map of touched places: its ways against SciPy's Dijkstra on the same cells, and what is remembered how long."""

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from palpate.control._touch_map import fill, find_way
from palpate.control.touch_map import MOST, TouchMap, TouchMapSettings


def _cheapest(cost: np.ndarray, start: tuple[int, int]) -> np.ndarray:
    """Cost from a cell to all others: a graph of eight neighbours, solved by SciPy."""
    rows, columns = cost.shape
    number = np.arange(cost.size).reshape(cost.shape)
    graph = sparse.lil_matrix((cost.size, cost.size))
    for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = number[: rows - dr, max(0, -dc) : columns - max(0, dc)]
        b = number[dr:, max(0, dc) : columns + min(0, dc)]
        graph[a.ravel(), b.ravel()] = (
            np.hypot(dr, dc) * 0.5 * (cost[np.divmod(a, columns)] + cost[np.divmod(b, columns)]).ravel()
        )
    return dijkstra(graph.tocsr(), directed=False, indices=number[start])


@pytest.mark.parametrize("seed", range(3))
def test_no_way_is_cheaper(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cost = 1.0 + 20.0 * (rng.random((17, 23)) < 0.3)
    every = _cheapest(cost, (2, 3))
    way = np.empty((64, 2))
    for goal in rng.integers((17, 23), size=(8, 2)):
        _, price = find_way(cost, np.array([2, 3]), goal, way)
        assert price == pytest.approx(every[goal[0] * 23 + goal[1]], rel=1e-12)


def test_corners_cost_no_more_than_the_cells_between_them() -> None:
    cost = np.ones((40, 60))
    cost[5:35, 30] = 50.0
    way = np.empty((64, 2))
    count, price = find_way(cost, np.array([20, 2]), np.array([20, 57]), way)
    corners = np.vstack([[20, 2], way[:count]])
    assert np.hypot(*np.diff(corners, axis=0).T).sum() <= price + 1e-9
    assert tuple(way[count - 1]) == (20, 57)
    assert count <= 6  # round a wall: not a staircase of cells


def test_cost_of_a_mark_is_a_disc_with_a_skirt() -> None:
    cost = np.empty((41, 41))
    fill(np.array([[0.41, 0.41, 30.0]]), np.zeros(2), 0.02, 0.1, 0.2, 0.5, cost)
    middle = (np.arange(41) + 0.5) * 0.02
    off = np.hypot(middle[:, None] - 0.41, middle[None] - 0.41)
    expected = np.where(off < 0.1, 31.0, np.where(off < 0.2, 1.0 + 15.0 * (0.2 - off) / 0.1, 1.0))
    np.testing.assert_allclose(cost, expected, rtol=1e-12)


def test_a_wall_is_gone_round_and_in_time_gone_through() -> None:
    known = TouchMap(0.055, TouchMapSettings(fade=60.0))
    for y in np.arange(-0.6, 0.61, 0.02):
        known.touch(0.0, 0.5, float(y))
    way, fresh = known.way(0.0, (0.0, 0.0), (1.0, 0.0))
    assert np.abs(way[:, 1]).max() > 0.6
    _, faded = known.way(600.0, (0.0, 0.0), (1.0, 0.0))
    assert 1.0 <= faded < 1.02 < fresh  # e^-10 of the belief is left


def test_free_ways_are_straight_and_touches_nearby_are_one() -> None:
    known = TouchMap(0.055)
    way, cost = known.way(0.0, (0.1, 0.2), (1.1, 0.9))
    np.testing.assert_allclose(way, [[1.1, 0.9]])
    assert cost == pytest.approx(np.hypot(1.0, 0.7), rel=0.09)  # eight neighbours make a way longer by 8 % at most
    known.touch(0.0, 0.5, 0.5)
    known.touch(3.0, 0.505, 0.5)
    assert len(known) == 1
    np.testing.assert_allclose(known._places[0, :3], [0.5, 0.5, 3.0])
    assert known.nearest(0.5, 0.6) == pytest.approx(0.1)
    known.clear(0.5, 0.52, 0.03)
    assert len(known) == 0
    assert known.nearest(0.0, 0.0) == np.inf


def test_the_oldest_places_make_room() -> None:
    known = TouchMap(0.055)
    for k in range(MOST + 3):
        known.touch(float(k), 0.1 * k, 0.0)
    assert len(known) == MOST
    assert known._places[:, 2].min() == 3.0
