"""The compiled loops that prepare a mesh, against slow twins by NumPy and SciPy: the same to the last bit."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components
from scipy.spatial import KDTree

from palpate.surfaces import Mesh, _topology
from palpate.surfaces._normals import facet_normals, next_corner, sort_half_edges
from palpate.surfaces._patches import Split, build_patches, patch_rows
from palpate.surfaces._tree import build_tree
from tests.support.bodies import BODIES, box


def moebius() -> np.ndarray:
    """Facets of a strip of which no choice of sides is right."""
    faces = [[a, a + 1, a + 2][:: 1 if a % 2 else -1] for a in range(19)]
    return np.array([*faces, [19, 20, 1], [20, 0, 1]])


def broken(name: str) -> np.ndarray:
    """Facets of a body of which some are turned over, missing and double, in another order."""
    faces, rng = BODIES[name].mesh.faces, np.random.default_rng(7)
    faces = np.where(rng.random((len(faces), 1)) < 0.3, faces[:, ::-1], faces)
    return np.concatenate([faces, faces[:9]])[
        rng.permutation(len(faces) + min(len(faces), 9))[: max(9 * len(faces) // 10, 3)]
    ]


CASES = {
    **{name: body.mesh.faces for name, body in BODIES.items()},
    **{f"broken {name}": broken(name) for name in BODIES},
    "moebius": moebius(),
    "fins": np.array([[0, 1, 2 + k] for k in range(9)]),
    "none": np.array([[0, 0, 1], [2, 2, 2], [3, 4, 5]]),
}


def twins_by_search(faces: np.ndarray) -> np.ndarray:
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    forward, backward = start * (faces.max() + 1) + end, end * (faces.max() + 1) + start
    found = [np.flatnonzero(forward == key) for key in backward]
    return np.array(
        [
            other[0] if len(other) == 1 and np.count_nonzero(forward == key) == 1 else -1
            for key, other in zip(forward, found, strict=True)
        ]
    )


@pytest.mark.parametrize("name", CASES)
def test_twins_are_the_only_half_edges_that_run_the_other_way(name: str) -> None:
    faces = CASES[name].astype(np.int64)
    order, twins = sort_half_edges(faces)
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    assert np.array_equal(order, np.lexsort(ends.T[::-1]))
    assert np.array_equal(twins, twins_by_search(faces))


@pytest.mark.parametrize("name", CASES)
def test_facets_are_turned_along_a_walk_in_breadth_as_scipys(name: str) -> None:
    faces = CASES[name].astype(np.int64)
    order, _ = sort_half_edges(faces)
    flipped, body = np.zeros(len(faces), dtype=np.bool_), np.empty(len(faces), dtype=np.int64)
    count = _topology.walk_facets(faces, order, flipped, body)

    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    key = np.minimum(start, end) * (faces.max() + 1) + np.maximum(start, end)
    _, begin, counts = np.unique(key[order], return_index=True, return_counts=True)
    one, two = order[begin[counts == 2]], order[begin[counts == 2] + 1]
    pairs, shape = (one // 3, two // 3), (len(faces), len(faces))
    graph = coo_array((np.ones(len(one)), pairs), shape=shape).tocsr()
    against = coo_array(((start[one] == start[two]) * 1.0, pairs), shape=shape).tocsr()
    against, expected = against + against.T, np.zeros(len(faces), dtype=np.bool_)
    bodies, labels = connected_components(graph, directed=False)
    for first in np.unique(labels, return_index=True)[1]:
        walk, before = breadth_first_order(graph, int(first), directed=False)
        for facet in walk[1:]:
            expected[facet] = expected[before[facet]] ^ bool(against[facet, before[facet]])
    assert count == bodies
    assert np.array_equal(body, labels)
    assert np.array_equal(flipped, expected)


@pytest.mark.parametrize("name", BODIES)
def test_corners_share_a_normal_where_scipy_finds_them_connected(name: str) -> None:
    mesh = BODIES[name].mesh
    normals, (_, twins) = facet_normals(mesh.vertices, mesh.faces)[0], sort_half_edges(mesh.faces)
    groups = np.empty(mesh.faces.size, dtype=np.int64)
    count = _topology.group_corners(normals, twins, 0.9, groups)
    half = np.flatnonzero(twins >= 0)
    half = half[np.einsum("ij,ij->i", normals[half // 3], normals[twins[half] // 3]) >= 0.9]
    graph = coo_array((np.ones(len(half)), (half, next_corner(twins[half]))), shape=(len(groups),) * 2)
    expected, labels = connected_components(graph, directed=False)
    assert count == expected
    assert np.array_equal(groups, labels)


@pytest.mark.parametrize("radius", [0.01, 0.03, 0.1])
def test_points_are_joined_as_by_scipys_tree(radius: float) -> None:
    """From hardly any to long chains, across the borders of the cells, which are 16 radii wide."""
    points = np.random.default_rng(4).uniform(-1.0, 1.0, (3000, 3)) * [1.0, 0.5, 0.2]
    groups = np.empty(len(points), dtype=np.int64)
    count = _topology.join_near(points, radius, groups)
    near = KDTree(points).query_pairs(radius, output_type="ndarray")
    graph = coo_array((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(points),) * 2)
    expected, labels = connected_components(graph, directed=False)
    assert 1 < count == expected < len(points)
    assert np.array_equal(groups, labels)


def test_rows_are_numbered_as_they_come() -> None:
    rows = np.random.default_rng(5).integers(-3, 3, (2000, 3)) * 2**40
    number, first = np.empty(2000, dtype=np.int64), np.empty(2000, dtype=np.int64)
    count = _topology.number_rows(rows, number, first)
    _, places = np.unique(rows, axis=0, return_index=True)
    assert np.array_equal(first[:count], np.sort(places))
    assert np.array_equal(rows[first[number]], rows)


@pytest.mark.parametrize("name", BODIES)
def test_a_ring_has_the_normals_around_a_vertex_in_their_order(name: str) -> None:
    """The twin walks over the corners one by one."""
    mesh = Mesh.from_arrays(BODIES[name].mesh.vertices, BODIES[name].mesh.faces, smooth=False)
    split = Split.of(mesh.vertices, mesh.faces, mesh.corner_normals)
    members, sizes = np.empty_like(split.twins), np.empty_like(split.twins)
    sizes = sizes[: _topology.walk_rings(split.twins, split.changes, members, sizes)]
    onward = np.where(split.twins >= 0, next_corner(split.twins), -1)
    cosines = np.einsum("ij,ij->i", split.flat, split.flat[onward])
    changes = (onward >= 0) & (cosines < 1.0 - 1e-12)
    assert np.array_equal(split.changes == 2, changes)
    seen: set[int] = set()
    rings: list[list[int]] = []
    for start in np.flatnonzero(changes):
        at, ring = int(start), list[int]()
        if at in seen:
            continue
        while at >= 0 and at not in seen:
            seen.add(at)
            ring += [int(onward[at])] if changes[at] else []
            at = int(onward[at])
        rings.append(ring)
    assert [len(ring) for ring in rings] == sizes.tolist()
    assert [corner for ring in rings for corner in ring] == members[: sizes.sum()].tolist()


def test_a_tree_holds_each_patch_once_in_unit_size() -> None:
    mesh = Mesh.from_arrays(*box(), smooth=False)
    split = Split.of(mesh.vertices, mesh.faces, mesh.corner_normals)
    rows = build_patches(mesh.faces, split)
    tree = build_tree(rows.copy())
    expected = rows.copy()
    for corner in (0, 6, 12):
        expected[:, corner : corner + 3] = (rows[:, corner : corner + 3] - tree.centre) / tree.scale
    assert np.array_equal(tree.corners[np.lexsort(tree.corners.T)], expected[np.lexsort(expected.T)])
    assert len(build_tree(patch_rows(rows[:1, :18].reshape(1, 3, 6), 0, np.zeros(1, dtype=np.int64))).nodes) == 2
