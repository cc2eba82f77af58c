"""Probes: a closed mesh, cells that cover it, the face that was asked for."""

import numpy as np
import pytest
import trimesh

from palpate.errors import InputError
from palpate_lab.simulation.phantom.probes import PROBES, probe


@pytest.mark.parametrize("name", PROBES)
def test_the_mesh_is_closed_and_of_the_stated_size(name: str) -> None:
    found, shape = probe(name), PROBES[name]
    mesh = trimesh.Trimesh(found.vertices, found.faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0.0
    np.testing.assert_allclose(mesh.extents, [shape.length, shape.width, 0.130], atol=1e-9)
    np.testing.assert_allclose(mesh.bounds[1, 2], found.tip[2], atol=1e-9)


@pytest.mark.parametrize("name", PROBES)
def test_cells_cover_the_outline_once(name: str) -> None:
    """The cells' areas times their normals sum to the outline's area upwards and to nothing sideways (Gauss).

    0.3 %: round edges are cut into chords of 22 degrees, whose rounding-off in the corners' outline is the largest.
    """
    found, shape = probe(name), PROBES[name]
    outline = shape.length * shape.width - (4 - np.pi) * shape.edge**2
    total = (found.areas[:, None] * found.normals).sum(axis=0)
    np.testing.assert_allclose(total, [0.0, 0.0, outline], atol=0.003 * outline)
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1.0, atol=1e-12)


def test_the_convex_face_is_a_torus_and_the_mesh_keeps_to_it() -> None:
    """On the torus (hypot(x, z - a) - (R - r))^2 + y^2 = r^2: cells exactly, chords to 20 um."""
    found, shape = probe("convex"), PROBES["convex"]
    big, small = shape.in_plane, shape.out_of_plane
    centre = found.tip[2] - big

    def off(points: np.ndarray) -> np.ndarray:
        ring = np.hypot(points[:, 0], points[:, 2] - centre) - (big - small)
        return np.hypot(ring, points[:, 1]) - small

    face = (np.abs(found.points[:, 0]) < 0.025) & (np.abs(found.points[:, 1]) < 0.009) & (found.points[:, 2] > 0.1)
    assert np.abs(off(found.points[face])).max() < 1e-12
    slope = found.points[face] + 1e-6 * found.normals[face]
    np.testing.assert_allclose(off(slope), 1e-6, rtol=1e-6)
    middles = found.vertices[found.faces].mean(axis=1)
    face = (np.abs(middles[:, 0]) < 0.025) & (np.abs(middles[:, 1]) < 0.009) & (middles[:, 2] > 0.1)
    assert np.abs(off(middles[face])).max() < 20e-6


def test_an_unknown_probe_is_refused() -> None:
    with pytest.raises(InputError, match="the probe 'round'"):
        probe("round")
