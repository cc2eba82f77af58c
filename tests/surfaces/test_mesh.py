"""Meshes as they come: what is mended, what is said, and where normals are shared."""

from pathlib import Path

import numpy as np
import pytest

from palpate.errors import GeometryError, PalpateError
from palpate.surfaces import Mesh, plane
from palpate_lab.simulation.phantom.probes import probe
from palpate_lab.simulation.shapes import EllipsoidBody
from tests.support.bodies import BODIES, R, box, cylinder


def volume(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


@pytest.mark.parametrize("at", [0.0, 0.03, 3.0])
def test_vertices_one_step_of_float32_apart_are_merged_on_whatever_grid(at: float) -> None:
    """An exporter rounds each facet's corners on its own: to either neighbour in float32, in each coordinate."""
    vertices, faces = EllipsoidBody((R, 0.7 * R, 0.5 * R)).mesh(2000)
    rng = np.random.default_rng(3)
    soup = (1e3 * (vertices + at))[faces].reshape(-1, 3).astype(np.float32)
    soup = np.where(rng.random(soup.shape) < 0.5, np.nextafter(soup, np.float32(np.inf)), soup)
    mesh = Mesh.from_arrays(soup.astype(np.float64) * 1e-3, np.arange(len(soup)).reshape(-1, 3))
    assert len(mesh.vertices) == len(vertices)
    assert (mesh.open_edges, mesh.notes) == (0, ())


def test_features_larger_than_the_rounding_stay() -> None:
    """A box as thin as a millionth of its length keeps its eight corners."""
    mesh = Mesh.from_arrays(*box((R, R, 1e-6 * R)))
    assert len(mesh.vertices) == 8


def test_facets_without_area_and_doubles_are_dropped_and_counted() -> None:
    vertices, faces = box()
    spoilt = np.concatenate([faces, faces[3:5], faces[7:8, [1, 2, 0]], [[0, 0, 1], [2, 2, 2]]])
    middle = 0.5 * (vertices[0] + vertices[1])
    mesh = Mesh.from_arrays(np.concatenate([vertices, [middle]]), np.concatenate([spoilt, [[0, 8, 1]]]))
    assert len(mesh.faces) == 12
    assert "3 facets without area were dropped" in mesh.notes
    assert "3 doubled facets were dropped" in mesh.notes


@pytest.mark.parametrize("turned", [[5], [0, 1, 2, 7], list(range(12)), list(range(3, 12))])
def test_flipped_facets_and_bodies_point_outward_again(turned: list[int]) -> None:
    vertices, faces = box()
    faces = faces.copy()
    faces[turned] = faces[turned][:, ::-1]
    mesh = Mesh.from_arrays(vertices, faces)
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    assert np.all(np.einsum("ij,ij->i", middles, mesh.normals) > 0)  # a box about the origin: outward is away from it
    assert any(note.startswith(f"{len(turned)} facets were turned over") for note in mesh.notes)


def test_each_of_two_bodies_is_turned_on_its_own() -> None:
    vertices, faces = box()
    both = np.concatenate([vertices, vertices + 5 * R])
    mesh = Mesh.from_arrays(both, np.concatenate([faces[:, ::-1], faces + 8]))
    assert volume(mesh) == pytest.approx(2 * 2.8 * R**3, rel=1e-12)
    assert any(note.startswith("12 facets were turned over") for note in mesh.notes)


def test_an_open_mesh_says_so() -> None:
    vertices, faces = box()
    mesh = Mesh.from_arrays(vertices, faces[:-1])
    assert any("not closed: 3 sides" in note for note in mesh.notes)
    assert (mesh.bodies, mesh.open_edges) == (1, 3)


def test_a_sheet_that_is_open_is_not_doubted_and_a_tube_is() -> None:
    """A plane and a dome face one side: what comes in from behind presses on nothing. A tube has an inside."""
    assert plane((0, 0, 0), (0, 0, 1)).notes == ()
    assert BODIES["open patch"].mesh.notes == ()
    vertices, faces = cylinder(around=32)
    assert any("not closed: 64 sides" in note for note in Mesh.from_arrays(vertices, faces[:64]).notes)


def test_what_is_no_mesh_is_refused_with_a_sentence() -> None:
    vertices, faces = box()
    for points, triangles, word in (
        (vertices, np.empty((0, 3), dtype=int), "no facets"),
        (vertices, [[0, 1, 99]], "vertex 99"),
        (vertices, [[0, 1, -1]], "faces name vertex -1, but there are 8"),
        (vertices[:, :2], faces, r"\(n, 3\)"),
        (vertices, faces * 1.0, "whole numbers"),
        (vertices, faces[:, :2], r"\(f, 3\)"),
        (vertices, [[0, 0, 1]], "area"),
        (np.full((8, 3), np.nan), faces, "no facets"),
        (np.zeros((8, 3)), faces, "area"),
    ):
        with pytest.raises(PalpateError, match=word):
            Mesh.from_arrays(points, triangles)


def test_one_facet_is_a_mesh() -> None:
    mesh = Mesh.from_arrays([[0, 0, 0], [R, 0, 0], [0, R, 0]], [[0, 1, 2]])
    closest, normal, facet = mesh.project(np.array([[0.2 * R, 0.2 * R, R], [2 * R, 0.0, -R]]))
    assert np.allclose(closest, [[0.2 * R, 0.2 * R, 0], [R, 0, 0]], rtol=0, atol=1e-15)
    assert np.allclose(normal, [[0, 0, 1], [0, 0, 1]])
    assert facet.tolist() == [0, 0]


def distinct_normals_at(mesh: Mesh, vertex: int) -> int:
    here = mesh.corner_normals[mesh.faces == vertex]
    return len(np.unique(np.round(here, 9), axis=0))


def test_a_cylinder_is_split_at_its_rims_and_smooth_around() -> None:
    vertices, faces = cylinder(around=32)
    mesh = Mesh.from_arrays(vertices, faces)
    assert {distinct_normals_at(mesh, vertex) for vertex in range(64)} == {2}  # one of the side, one of the lid
    side = np.abs(mesh.corner_normals[..., 2]) < 0.5
    radial = mesh.vertices[mesh.faces][side] * (1, 1, 0)
    radial /= np.linalg.norm(radial, axis=1, keepdims=True)
    apart = np.arccos(np.clip(np.einsum("ij,ij->i", radial, mesh.corner_normals[side]), -1, 1))
    assert apart.max() < 1e-7  # by symmetry the angle-weighted mean is radial: at each corner two facets left and right


@pytest.mark.parametrize("name", ["linear", "t-shaped"])
def test_walls_that_end_in_a_fillet_stay_upright(name: str) -> None:
    """An angle-weighted mean leans by half of a step of the fillet, 5.6 degrees, all the way down the wall.

    At its corners the wall is 100 times as large as the fillet's facets and more: what is left is far below a tenth.
    """
    made = probe(name)
    mesh = Mesh.from_arrays(made.vertices, made.faces)
    walls = np.abs(mesh.normals[:, 2]) < 1e-9
    assert walls.sum() > 100
    assert np.degrees(np.abs(mesh.corner_normals[walls][..., 2])).max() < 0.2


def test_crease_angle_decides_and_zero_is_faceted() -> None:
    vertices, faces = cylinder(around=32)  # 11.25 degrees from side to side
    assert {distinct_normals_at(Mesh.from_arrays(vertices, faces, crease=np.radians(11)), v) for v in range(64)} == {3}
    assert {distinct_normals_at(Mesh.from_arrays(vertices, faces, crease=np.radians(12)), v) for v in range(64)} == {2}
    assert {distinct_normals_at(Mesh.from_arrays(vertices, faces, crease=np.radians(91)), v) for v in range(64)} == {1}
    flat = (Mesh.from_arrays(vertices, faces, crease=0.0), Mesh.from_arrays(vertices, faces, smooth=False))
    for mesh in (*flat, Mesh.from_arrays(*box())):
        assert np.allclose(mesh.corner_normals, mesh.normals[:, None, :], rtol=0, atol=1e-15)


def test_a_region_by_box_and_by_list_keeps_facets_and_normals() -> None:
    vertices, faces = EllipsoidBody((R, 0.7 * R, 0.5 * R)).mesh(500)
    whole = Mesh.from_arrays(vertices, faces)
    upper = whole.vertices[whole.faces].mean(axis=1)[:, 2] >= 0
    by_box = Mesh.from_arrays(vertices, faces, region=((-1, -1, 0), (1, 1, 1)))
    by_list = Mesh.from_arrays(vertices, faces, region=np.flatnonzero(upper))
    for part in (by_box, by_list):
        assert np.array_equal(part.vertices[part.faces], whole.vertices[whole.faces[upper]])
        assert np.array_equal(part.corner_normals, whole.corner_normals[upper])  # the rim is as smooth as it was
        assert any(f"{upper.sum()} of {len(faces)} facets" in note for note in part.notes)
        assert part.bounds[0, 2] > -0.2 * R  # size and middle are those of what is used
    for wrong, word in (
        (((1, 1, 1), (2, 2, 2)), "no facet is in the region"),
        ([len(faces)], f"facet {len(faces)}"),
        ([0.5, 1.5], "region must be"),
        (np.array([], dtype=int), "no facet is in the region"),
    ):
        with pytest.raises(GeometryError, match=word):
            Mesh.from_arrays(vertices, faces, region=wrong)


def test_nobody_can_change_a_mesh() -> None:
    mesh = Mesh.from_arrays(*box())
    for array in (mesh.vertices, mesh.faces, mesh.corner_normals):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_a_plane_is_where_it_was_said_to_be() -> None:
    point, normal = np.array([0.1, -0.2, 0.3]), np.array([1.0, 2.0, -2.0])
    square = plane(point, normal, half_width=0.5)
    assert np.allclose(square.normals, normal / 3, rtol=0, atol=1e-15)
    assert np.allclose((square.vertices - point) @ normal, 0, atol=1e-15)
    assert square.areas.sum() == pytest.approx(1.0, rel=1e-12)
    assert np.allclose(square.centre, square.vertices.mean(axis=0), atol=0.5)
    with pytest.raises(GeometryError, match="must not be zero"):
        plane(point, np.zeros(3))
    with pytest.raises(GeometryError, match="half-width"):
        plane(point, normal, half_width=-0.5)


def test_vertices_beyond_reason_take_their_facets_with_them() -> None:
    """Squares of 1e200 overflow, and the grid on which vertices are merged has no cell for one far off."""
    vertices, facets = box()
    far = np.vstack([vertices, [[1e200, 0.0, 0.0], [0.0, np.inf, 0.0], [0.0, 0.0, np.nan], [1e11, 0.0, 0.0]]])
    faces = np.vstack([facets, [[0, 1, 8], [1, 2, 9], [10, 2, 3]]])
    mesh = Mesh.from_arrays(far, faces)  # the last vertex is in no facet
    assert len(mesh.faces) == 12
    assert "3 facets with vertices that are NaN, infinite or beyond 1e12 were dropped" in mesh.notes
    assert np.isfinite(mesh.vertices).all()


def test_a_mesh_that_cannot_be_read_is_said_once(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Trimesh logs a traceback beside the error that it raises, which Python prints where nobody listens."""
    path = tmp_path / "bad.stl"
    path.write_bytes(b"solid of text" + bytes(67) + b"\xff\xff\xff\x7f" + bytes(500))
    with pytest.raises(PalpateError, match=r"bad\.stl"):
        Mesh.load(path, "mm")
    assert not capfd.readouterr().err
