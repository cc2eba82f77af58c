"""Where cells sit: developable shapes unroll, sections take soup, bad calls are refused with the reason."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from claims.evidence.skin_general import general
from claims.evidence.skin_hard import box_link, holed, soup
from claims.evidence.skin_map import HEADING, LINK, ORIGIN, unrolled
from claims.evidence.skin_shapes import Cone, Elliptic, Sphere, Torus, march, round_mesh, wristlike
from palpate.cli import main
from palpate.errors import GeometryError, InputError
from palpate.sensors.taxels.skin_map import Planes, Sheet, fit_stretch, map_skin
from palpate.sensors.taxels.skin_map.chart import round_chart
from palpate.sensors.taxels.skin_map.files import read_skin_map, write_skin_map
from palpate.sensors.taxels.skin_map.layout import lay
from palpate.sensors.taxels.skin_map.model import SkinMap
from palpate.sensors.taxels.skin_map.paper import paper_map
from palpate.sensors.taxels.skin_map.sections import cut
from palpate.surfaces import Mesh

SMALL = Sheet(4, 10, (0.01, 0.01))
START, AHEAD = wristlike(np.array(-0.02), np.array(0.4)), np.array([0.0, 1.0, 0.0])


@pytest.fixture(scope="module")
def wrist_like() -> Mesh:
    return round_mesh(wristlike, 24, np.linspace(-0.04, 0.04, 9))


@pytest.fixture(scope="module")
def found(wrist_like: Mesh) -> SkinMap:
    return map_skin(wrist_like, SMALL, origin=START, heading=AHEAD)


@pytest.mark.parametrize(
    "shape",
    [Cone(0.035, 0), Elliptic(0.037, 0.032), Cone(0.035, 1.67), Cone(0.035, 10)],
    ids=lambda s: repr(vars(s))[:40],
)
@pytest.mark.parametrize("heading", [0.0, 35.0, 160.0])
def test_a_sheet_unrolls_exactly_where_the_surface_is_developable(shape: Cone | Elliptic, heading: float) -> None:
    start, ahead, points, normals = unrolled(shape, heading)
    sheet = Sheet(points.shape[0], points.shape[1], (0.01, 0.01))
    layout = lay(shape, start, ahead, sheet)
    place = shape.derivatives(layout.uv[1::2, 1::2])
    assert np.abs(place[..., 0, :] - points).max() < 1e-7  # Runge-Kutta of 2 mm steps: (2/35)^5 of 35 mm, summed
    assert layout.rms < 1e-6
    mesh = round_mesh(shape.point, 24, np.linspace(-0.15, 0.15, 11))
    cells = map_skin(mesh, sheet, origin=shape.derivatives(start)[0], heading=ahead, mode="vertices")
    assert np.linalg.norm(cells.centres - points, axis=-1).max() < 5e-6  # quintics through 24 vertices
    assert np.linalg.norm(np.cross(cells.normals, normals), axis=-1).max() < np.radians(0.02)
    assert np.allclose(cells.areas, 1e-4, rtol=1e-3)  # what does not stretch keeps its area


@pytest.mark.parametrize("shape", [Sphere(0.1), Torus(0.08, 0.06)])
def test_strain_is_the_least_that_a_general_optimiser_finds(shape: Sphere | Torus) -> None:
    where, sheet = (shape, np.array([-0.02, 0.0]), np.array([0.0, -1.0, 0.0])), Sheet(4, 6, (0.01, 0.01))
    ours = lay(*where, sheet)
    assert ours.rms == pytest.approx(general(*where, (0.04, 0.06), (4, 6), per_cell=2, degree=3), rel=0.02)
    assert lay(*where, sheet, elements=24).rms == pytest.approx(ours.rms, rel=0.01)  # finer elements change little


def test_the_exact_surface_and_the_compiled_geodesics_agree(wrist_like: Mesh, found: SkinMap) -> None:
    """The loop in Python is the oracle of the compiled one."""
    assert found.surface is not None
    begin = np.array([[0.01, 0.2, 0.8, 9.0, 1.0, 0.0], [0.02, 3.1, -0.5, 20.0, 1.0, 0.0]])
    states, slopes = found.surface.geodesics(begin, 1e-3, 20)
    ought, rising = march(found.surface.derivatives, begin, 1e-3, 20)
    assert np.allclose(states, ought, rtol=1e-9, atol=1e-12)
    assert np.allclose(slopes, rising, rtol=1e-7, atol=1e-9)


def test_vertices_are_samples_of_a_smooth_shape(found: SkinMap) -> None:
    """On the smooth truth, which only 24 x 8 facets show, cells lie and face as on it."""
    assert "vertices" in " ".join(found.notes)  # the mode that the mesh chose, said
    angle = np.linspace(-np.pi, np.pi, 4001)
    for centre in found.centres[::2, ::3].reshape(-1, 3):
        ring = wristlike(np.full_like(angle, centre[2]), angle)
        assert np.linalg.norm(ring - centre, axis=1).min() < 4e-5  # 0.02 mm, and the ring's own step


def test_facets_follow_the_mesh_as_it_is(wrist_like: Mesh) -> None:
    cells = map_skin(wrist_like, SMALL, origin=START, heading=AHEAD, mode="facets")
    foot, _, _ = wrist_like.project(cells.centres.reshape(-1, 3))
    assert (
        np.linalg.norm(foot - cells.centres.reshape(-1, 3), axis=1).mean() < 1.5e-4
    )  # half of the 0.3 mm of 24 chords
    assert cells.surface is not None
    assert cells.surface.points <= 200


def test_a_cut_is_the_outermost_whatever_lies_inside() -> None:
    outer, inner = trimesh.creation.cylinder(0.03, 0.1, sections=64), trimesh.creation.box((0.02, 0.02, 0.05))
    both = trimesh.util.concatenate([inner, outer])
    link = Mesh.from_arrays(outer.vertices, outer.faces)
    side = np.abs(link.normals[:, 2]) < 0.5
    chart = round_chart(
        link.vertices[link.faces[side]].mean(axis=1), link.normals[side], link.areas[side], np.array([0.03, 0, 0]), None
    )
    assert abs(chart.axes[2, 2]) == pytest.approx(1.0)  # the axis that normals show
    assert np.allclose(chart.centre[:2], 0.0, atol=1e-9)
    met = cut(chart, np.asarray(both.triangles), np.linspace(-0.04, 0.04, 9), np.linspace(-3, 3, 50))
    assert np.all(met.offset <= 0.03 + 1e-12)
    assert np.all(met.offset >= 0.03 * np.cos(np.pi / 64) - 1e-12)  # between chord and arc


def test_soup_gives_the_same_map(found: SkinMap, wrist_like: Mesh) -> None:
    again = map_skin(soup(wrist_like), SMALL, origin=START, heading=AHEAD)
    assert np.allclose(again.centres, found.centres, rtol=0, atol=1e-9)


def test_a_rigid_motion_moves_the_map_by_itself(found: SkinMap, wrist_like: Mesh) -> None:
    from scipy.spatial.transform import Rotation

    turn, shift = Rotation.from_rotvec([0.3, -0.7, 1.1]).as_matrix(), np.array([0.2, -0.1, 0.4])
    moved = Mesh.from_arrays(wrist_like.vertices @ turn.T + shift, wrist_like.faces)
    again = map_skin(moved, SMALL, origin=turn @ START + shift, heading=turn @ AHEAD)
    assert np.allclose(again.centres, found.centres @ turn.T + shift, rtol=0, atol=1e-7)
    assert np.allclose(again.normals, found.normals @ turn.T, rtol=0, atol=1e-5)


def test_the_origin_is_the_corner_and_columns_rise_along_the_heading(found: SkinMap) -> None:
    corner = found.at(-0.5, -0.5)[0]
    assert np.linalg.norm(corner - START) < 2e-4  # half a cell of extrapolation between centres
    ahead = found.centres[0, 1] - found.centres[0, 0]
    assert ahead @ AHEAD > 0.5 * np.linalg.norm(ahead)  # the sheet bends away from it
    up = found.centres[1, 0] - found.centres[0, 0]
    assert np.cross(ahead, up) @ found.normals[0, 0] > 0  # rows to the left of the heading, seen from outside


def test_flip_mirrors_rows_and_thickness_lifts(wrist_like: Mesh) -> None:
    high = wristlike(np.array(0.025), np.array(0.4))
    flat = map_skin(wrist_like, Sheet(4, 6, (0.01, 0.01), flip=True), origin=high, heading=AHEAD)
    ahead, down = flat.centres[0, 1] - flat.centres[0, 0], flat.centres[1, 0] - flat.centres[0, 0]
    assert np.cross(ahead, down) @ flat.normals[0, 0] < 0
    thick = map_skin(wrist_like, Sheet(4, 6, (0.01, 0.01), 0.002, flip=True), origin=high, heading=AHEAD)
    assert np.allclose(thick.centres - flat.centres, 0.002 * flat.normals, atol=1e-12)


def test_cells_that_meet_again_round_a_link_are_flagged() -> None:
    mesh = round_mesh(Cone(0.03, 0).point, 36, np.linspace(-0.05, 0.05, 5))  # 188.5 mm round
    cells = map_skin(mesh, Sheet(3, 20, (0.01, 0.01)), origin=(0.03, 0, -0.02), heading=(0, 1, 0))
    assert cells.overlap[:, [0, 1, 18, 19]].all()  # 11.5 mm over themselves: one cell, and a part of the next
    assert not cells.overlap[:, 2:18].any()


def test_a_flat_patch_needs_no_axis() -> None:
    plate = trimesh.creation.box((0.2, 0.2, 0.03))
    mesh = Mesh.from_arrays(plate.vertices, plate.faces)
    cells = map_skin(mesh, Sheet(3, 5, (0.01, 0.02)), origin=(-0.05, -0.03, 0.015), heading=(1, 0, 0))
    x, y = np.meshgrid(-0.05 + 0.02 * (np.arange(5) + 0.5), -0.03 + 0.01 * (np.arange(3) + 0.5))
    assert np.allclose(cells.centres, np.stack([x, y, np.full_like(x, 0.015)], -1), atol=1e-9)
    assert np.allclose(cells.normals, [0, 0, 1], atol=1e-9)
    assert np.allclose(cells.areas, 2e-4, rtol=1e-9)


def test_a_sheet_smaller_than_a_facet_is_laid(tmp_path: Path, wrist_like: Mesh) -> None:
    alone = map_skin(wrist_like, Sheet(1, 1, (0.005, 0.005)), origin=START, heading=AHEAD)
    assert np.linalg.norm(wrist_like.project(alone.centres[0])[0] - alone.centres[0]) < 0.3e-3
    assert np.allclose(alone.areas, 25e-6, rtol=1e-3)
    write_skin_map(tmp_path / "one.csv", alone)
    assert read_skin_map(tmp_path / "one.csv").pitch == pytest.approx((0.005, 0.005), rel=1e-3)


def test_stretch_is_found_from_a_few_known_cells() -> None:
    mesh = round_mesh(Cone(0.03, 0).point, 36, np.linspace(-0.05, 0.05, 5))
    start, along = {"origin": (0.03, 0, -0.02), "heading": (0, 1, 0)}, Sheet(3, 10, (0.01, 0.01), stretch=(1.05, 1.12))
    truth = map_skin(mesh, along, mode="vertices", **start)
    known = {cell: truth.centres[cell] for cell in ((0, 9), (2, 4), (2, 9))}
    ought = 0.03 * np.array([np.cos(1.12 * 0.095 / 0.03), np.sin(1.12 * 0.095 / 0.03)])
    assert np.allclose(truth.centres[0, 9, :2], ought, atol=1e-6)  # on the arc that a stretched sheet covers
    fitted = fit_stretch(mesh, Sheet(3, 10, (0.01, 0.01)), known, mode="vertices", **start)
    assert fitted.stretch == pytest.approx((1.05, 1.12), abs=1e-5)


def test_planes_of_the_users_own_are_taken(wrist_like: Mesh, found: SkinMap) -> None:
    planes = Planes(axis=(np.zeros(3), np.array([0.0, 0.0, 1.0])))
    again = map_skin(wrist_like, SMALL, origin=START, heading=AHEAD, planes=planes)
    assert np.linalg.norm(again.centres - found.centres, axis=-1).max() < 1e-4  # the same shape by other planes


def test_where_the_users_planes_stand_pieces_of_the_spline_meet(wrist_like: Mesh, found: SkinMap) -> None:
    heights, angles = np.array([-0.04, -0.02, 0.0, 0.02, 0.04]), np.radians(np.arange(-180, 180, 15.0))
    planes = Planes((np.zeros(3), np.array([0.0, 0.0, 1.0])), heights, angles)
    again = map_skin(wrist_like, SMALL, origin=START, heading=AHEAD, planes=planes)
    assert again.surface is not None
    assert np.allclose(np.diff(np.unique(again.surface.knots_v)), np.radians(15.0))
    assert again.surface.points == (5 + 2) * 24
    assert np.linalg.norm(again.centres - found.centres, axis=-1).max() < 3e-4  # the facets' curvature is estimated


def test_the_papers_way_is_there_by_name(wrist_like: Mesh) -> None:
    cells = paper_map(wrist_like, Sheet(6, 22, (0.01, 0.01)), origin=START, heading=AHEAD)
    assert "paper's way, literal" in cells.notes[0]
    assert np.all(np.einsum("rci,rci->rc", cells.normals, cells.centres * [1, 1, 0]) > 0)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"sheet": Sheet(30, 60, (0.01, 0.01))}, "have no surface under them"),
        ({"origin": (0.0, 0.0, 0.2)}, "off the surface"),
        ({"origin": (np.nan, 0.0, 0.0)}, "three finite numbers"),
        ({"heading": (0.0, 0.0, 0.0)}, "points along the normal"),
        ({"planes": Planes(heights=np.array([0.5, 0.6]))}, "no two of the planes across the axis meet the link"),
    ],
)
def test_what_cannot_be_mapped_is_refused_with_the_reason(
    wrist_like: Mesh, change: dict[str, object], said: str
) -> None:
    call: dict[str, object] = {"sheet": SMALL, "origin": START, "heading": AHEAD, **change}
    with pytest.raises((InputError, GeometryError), match=said):
        map_skin(wrist_like, call.pop("sheet"), **call)


def test_a_hole_smaller_than_a_cell_is_bridged_and_a_larger_one_refused() -> None:
    mesh = round_mesh(wristlike, 48, np.linspace(-0.04, 0.04, 33))
    whole = map_skin(mesh, SMALL, origin=START, heading=AHEAD)
    small = map_skin(holed(mesh, 0.004), SMALL, origin=START, heading=AHEAD)
    assert np.linalg.norm(small.centres - whole.centres, axis=-1).max() < 2e-4
    with pytest.raises(InputError, match=r"no surface under them.*Move"):
        map_skin(holed(mesh, 0.03), SMALL, origin=START, heading=AHEAD)


def test_a_sharp_edge_is_mapped_along_its_facets() -> None:
    cells = map_skin(box_link(), Sheet(4, 3, (0.01, 0.01)), origin=(0.03, -0.015, -0.02), heading=(0, 1, 0))
    assert np.allclose(cells.centres[..., 0], 0.03, atol=1e-6)
    assert np.allclose(cells.normals, [1, 0, 0], atol=1e-6)


def test_the_real_wrist_is_followed(shared: Path) -> None:
    link = Mesh.load(shared / "data/hrp4c/R_WRIST_Y_LINK_mesh.dae").transformed(LINK)
    cells = map_skin(link, Sheet(6, 22, (0.01, 0.01)), origin=ORIGIN, heading=HEADING, mode="facets")
    assert cells.surface is not None
    assert cells.surface.points <= 200
    assert cells.distance[0] < 1e-4  # the paper 0.854 mm
    assert cells.distance[1] < 6e-4
    assert cells.overlap.any()  # 208 to 219 mm round, under 220


def test_a_map_is_written_as_a_table_as_taxels_and_as_frames(tmp_path: Path, found: SkinMap) -> None:
    write_skin_map(tmp_path / "map.csv", found)
    assert np.array_equal(read_skin_map(tmp_path / "map.csv").centres, found.centres)
    write_skin_map(tmp_path / "map.txt", found)
    taxels = np.array(
        [row.split() for row in (tmp_path / "map.txt").read_text().split("[calibration]\n")[1].splitlines()]
    )
    assert np.allclose(taxels.astype(float)[:, :3], found.centres.reshape(-1, 3), atol=5e-7)  # six decimals
    write_skin_map(tmp_path / "map.urdf", found)
    assert (tmp_path / "map.urdf").read_text().count("<joint") == 40


def test_the_command_writes_a_map_and_refuses_in_a_sentence(
    tmp_path: Path, wrist_like: Mesh, found: SkinMap, capsys: pytest.CaptureFixture[str]
) -> None:
    link = tmp_path / "wrist.stl"
    trimesh.Trimesh(1e3 * wrist_like.vertices, wrist_like.faces, process=False).export(link)
    origin = ",".join(f"{1e3 * value:.6f}" for value in START)
    call = ["map", "skin", str(link), "--unit", "mm", "--sheet", "4x10", "--cell", "10", f"--origin={origin}"]
    out = tmp_path / "map.toml"
    assert main([*call, "--heading=0,1,0", "-o", str(out)]) == 0
    assert "strain" in capsys.readouterr().out
    assert np.allclose(read_skin_map(out).centres, found.centres, atol=1e-6)  # STL keeps seven digits
    assert read_skin_map(out).provenance["origin"] == origin
    for change in (["--heading=a,b"], ["--heading=0,1,0", "--sheet", "40x60"], ["--heading=0,1,0", "--cell", "-1"]):
        assert main([*call, *change, "-o", str(tmp_path / "other.toml")]) == 1
        said = capsys.readouterr().err
        assert said.startswith("palpate: ")
        assert said.count("\n") == 1
    assert not (tmp_path / "other.toml").exists()
