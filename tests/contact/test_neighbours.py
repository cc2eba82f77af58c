"""The order in space against its NumPy form, and what has no place."""

import numpy as np

from palpate.contact import _neighbours
from palpate.contact.locate import in_space

BITS = np.arange(5)
SPREAD = (((np.arange(_neighbours.CELLS)[:, None] >> BITS) & 1) << (3 * BITS)).sum(axis=1)


def twin(wrenches: np.ndarray, centre: np.ndarray, scale: float) -> np.ndarray:
    """Keys by arrays: foot of the axis, back along it to the ball, the cell there, its bits spread."""
    force = wrenches[:, :3]
    size = np.linalg.norm(force, axis=1)[:, None]
    along, moment = force / size, (wrenches[:, 3:] - np.cross(centre, force)) / (scale * size)
    foot = np.cross(along, moment)
    height = np.sqrt(np.maximum(0.0, 1.0 - np.einsum("ni,ni->n", foot, foot)))
    cells = 0.5 * _neighbours.CELLS * (foot - along * height[:, None] + 1.0)
    x, y, z = np.clip(cells, 0, _neighbours.CELLS - 1).astype(int).T
    return SPREAD[x] << 2 | SPREAD[y] << 1 | SPREAD[z]


def test_keys_are_those_of_arrays() -> None:
    """Random lines through, beside and far from the ball; rounding may move one that lies on the border of a cell."""
    rng, centre = np.random.default_rng(7), np.array([0.1, -0.2, 0.05])
    wrenches = rng.normal(size=(20_000, 6)) * [1, 1, 1, 0.3, 0.3, 0.3]
    keys = np.empty(len(wrenches), dtype=np.uint16)
    _neighbours.keys(wrenches, centre, 0.15, keys)
    assert np.count_nonzero(keys != twin(wrenches, centre, 0.15)) <= 2


def test_what_has_no_place_comes_anywhere() -> None:
    wrenches = np.random.default_rng(8).normal(size=(50, 6))
    wrenches[3], wrenches[7, 0], wrenches[9, 4], wrenches[11, :3] = 0.0, np.nan, np.inf, 1e200
    assert np.sort(in_space(wrenches, np.zeros(3), 1.0)).tolist() == list(range(50))
