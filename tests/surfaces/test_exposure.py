"""Which facets can be touched: against rays traced one by one, and on bodies of which it is plain."""

import numpy as np
import pytest
import trimesh

from claims.evidence.bodies import prism
from palpate import Locator, Pose, Status
from palpate.errors import GeometryError, InputError
from palpate.surfaces import Mesh, _rays, plane
from palpate.surfaces._patches import patch_rows
from palpate.surfaces._tree import build_tree
from tests.support.bodies import BODIES, R, box, pressing


def joined(*parts: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Bodies in one mesh, as a file holds them."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    return np.concatenate([v for v, _ in parts]), np.concatenate(
        [f + s for (_, f), s in zip(parts, starts, strict=False)]
    )


def moved(part: tuple[np.ndarray, np.ndarray], *by: float) -> tuple[np.ndarray, np.ndarray]:
    return part[0] + np.array(by), part[1]


def ball(radius: float) -> tuple[np.ndarray, np.ndarray]:
    body = trimesh.creation.icosphere(3, radius)
    return np.array(body.vertices), np.array(body.faces)


def turned(profile: list[tuple[float, float]]) -> Mesh:
    """A body of revolution about z from its outline (radius, height), in facets of at most R/2."""
    body = trimesh.creation.revolve(np.array(profile) * R, sections=32).subdivide_to_size(R / 2)
    return Mesh.from_arrays(np.array(body.vertices), np.array(body.faces))


def middles(mesh: Mesh) -> np.ndarray:
    return mesh.vertices[mesh.faces].mean(axis=1)


def test_rays_stop_where_each_facet_solved_by_itself_says() -> None:
    """The twin: p + t d = a + u (b - a) + v (c - a) by numpy.linalg, facet by facet."""
    rng = np.random.default_rng(2)
    corners = np.zeros((60, 3, 6))
    corners[:, :, :3] = rng.normal(size=(60, 1, 3)) + 0.5 * rng.normal(size=(60, 3, 3))
    corners[:, :, 5] = 1.0
    tree = build_tree(patch_rows(corners, 0, np.arange(60)))
    origins, directions = 0.3 * rng.normal(size=(200, 3)), rng.normal(size=(200, 3))
    directions[:20] = np.eye(3)[np.arange(20) % 3]  # along the axes, where a box has no slope
    found, expected = np.empty(200), np.full(200, np.inf)
    _rays.first_hits(origins, directions, tree.nodes, tree.corners, found)
    for row in tree.corners:
        a, b, c = row[:3], row[6:9], row[12:15]
        for i, (o, d) in enumerate(zip(origins, directions, strict=True)):
            t, u, v = np.linalg.solve(np.stack([-d, b - a, c - a], axis=1), o - a)
            if t > 0 and u >= 0 and v >= 0 and u + v <= 1:
                expected[i] = min(expected[i], t)
    assert np.isfinite(expected).sum() > 20
    assert np.allclose(found, expected, rtol=1e-9, atol=0)


@pytest.mark.parametrize("name", BODIES)
def test_bodies_of_one_shell_are_open_all_over(name: str) -> None:
    assert not BODIES[name].mesh.covered.any()


@pytest.mark.parametrize("inner_radius", [0.8 * R, 0.15 * R])  # in the second gap there is room for the ball
def test_a_shell_inside_another_is_covered_and_gives_no_candidates(inner_radius: float) -> None:
    vertices, faces = joined(ball(R), ball(inner_radius))
    mesh = Mesh.from_arrays(vertices, faces)
    inner = np.linalg.norm(middles(mesh), axis=1) < 0.9 * R
    assert np.array_equal(mesh.covered, inner)
    assert mesh.bodies == 2
    wrench = pressing(np.array([0.0, 0.0, R]), np.array([0.0, 0.0, 1.0]), np.array([0.3, 0.2, -5.0]), 1e-4)
    assert len(Locator(mesh).candidates(wrench).point) == 1
    whole = Mesh.from_arrays(vertices, faces, covered=True)
    assert not whole.covered.any()
    assert Locator(whole).run(wrench).status == Status.AMBIGUOUS
    assert Locator(mesh).run(wrench).status == Status.CONTACT
    assert mesh.coverage == f"1,280 of 2,560 facets ({mesh.areas[inner].sum() / mesh.areas.sum():.0%} of the area)"


def test_sides_at_which_two_bodies_touch_are_covered() -> None:
    """Two cubes side by side: the two facets of each at x = 0."""
    cube = box((R, R, R))
    mesh = Mesh.from_arrays(*joined(moved(cube, -R / 2, 0, 0), moved(cube, R / 2, 0, 0)))
    assert np.array_equal(mesh.covered, np.abs(middles(mesh)[:, 0]) < 1e-9)
    assert mesh.covered.sum() == 4


def test_a_facet_of_which_a_part_is_open_stays() -> None:
    """A small cube on a large one hides the middle of its lid, and its own foot."""
    large, small = box((4 * R, 4 * R, R)), moved(box((R, R, R)), 0, 0, 0.9 * R)
    mesh = Mesh.from_arrays(*joined(large, small))
    foot = middles(mesh)[:, 2]
    assert np.array_equal(mesh.covered, np.isclose(foot, 0.4 * R))


def test_inner_walls_with_room_before_them_stay() -> None:
    mug = turned([(0, 0), (4, 0), (4, 9), (3.5, 9), (3.5, 0.6), (0, 0.6)])
    assert not mug.covered.any()
    finger = box((2 * R, 2 * R, 8 * R))  # two of them stand in a palm, 4 R apart
    palm = moved(box((8 * R, 2 * R, 2 * R)), 0, 0, -4 * R)
    gripper = Mesh.from_arrays(*joined(palm, moved(finger, -3 * R, 0, 0), moved(finger, 3 * R, 0, 0)))
    assert not gripper.covered[np.isclose(np.abs(middles(gripper)[:, 0]), 2 * R)].any()


@pytest.mark.parametrize(
    ("profile", "begin"),
    [
        ([(1, 0), (1.2, 0), (1.2, 20), (1, 20), (1, 0)], 2.0),  # of a tube, open at both ends
        ([(0, 0), (1.2, 0), (1.2, 20), (1, 20), (1, 0.2), (0, 0.2)], 0.5),  # of a cup
    ],
)
def test_inner_walls_of_what_is_narrow_are_covered(profile: list[tuple[float, float]], begin: float) -> None:
    body = turned(profile)
    middle, height = np.linalg.norm(middles(body)[:, :2], axis=1), middles(body)[:, 2]
    deep = (middle < 1.1 * R) & (height > begin * R) & (height < 18 * R)
    assert deep.sum() > 500
    assert body.covered[deep].all()
    assert not body.covered[middle > 1.1 * R].any()


def fingers(gap: float, facet: float = 0.5 * R) -> tuple[np.ndarray, np.ndarray]:
    """Three fingers of R x 2 R x 7 R on a palm, with gaps between them."""
    parts = [moved(box((R, 2 * R, 7 * R)), k * (R + gap), 0, 3.5 * R) for k in (-1, 0, 1)]
    body = trimesh.Trimesh(*joined(moved(box((6 * R, 2 * R, 8 * R)), 0, 0, -3.9 * R), *parts), process=False)
    fine = body.subdivide_to_size(facet)
    return np.array(fine.vertices), np.array(fine.faces)


@pytest.mark.parametrize("turned_by", [0.0, 0.7])
def test_sides_of_a_gap_that_is_open_at_both_ends_can_be_touched(turned_by: float) -> None:
    """A ball of a fifth of the body's size, 3.3 R wide, does not fit in."""
    vertices, faces = fingers(1.2 * R)
    turn = Pose.from_rotation_vector(turned_by * np.array([1.0, -0.6, 0.3]), (0.0, 0.0, 0.0))
    mesh = Mesh.from_arrays(turn.apply(vertices), faces)
    at = turn.inverse().apply(middles(mesh))
    sides = (np.abs(turn.inverse().rotate(mesh.normals)[:, 0]) > 0.9) & (at[:, 2] > 0.6 * R)
    assert sides.sum() > 500
    assert not mesh.covered[sides].any()


def test_a_press_in_a_gap_competes_with_those_on_the_next_fingers() -> None:
    mesh = Mesh.from_arrays(*fingers(1.2 * R))
    point, normal = np.array([0.5 * R, 0.1 * R, 3.1 * R]), np.array([1.0, 0.0, 0.0])
    noise = np.array([0.02] * 3 + [1e-4] * 3)
    locator = Locator(mesh, noise=noise)
    wrench = pressing(point, normal, -3.0 * normal, 0.0)
    assert np.linalg.norm(locator.candidates(wrench).point - point, axis=1).min() < 1e-6
    assert locator.run(wrench).status == Status.AMBIGUOUS


def test_an_open_sheet_is_open_and_a_mesh_inside_out_is_taken_as_it_is() -> None:
    assert not plane((0, 0, 0), (0.3, -0.2, 1.0)).covered.any()
    vertices, faces = ball(R)
    inward = faces[1:, ::-1]  # not closed, so its sense is the file's word
    mesh = Mesh.from_arrays(vertices, inward)
    assert np.einsum("ij,ij->i", middles(mesh), mesh.normals).max() < 0
    assert not mesh.covered.any()


def test_regions_by_list_are_taken_at_their_word_and_boxes_are_not() -> None:
    vertices, faces = joined(ball(R), ball(0.8 * R))
    inner = np.arange(len(faces) // 2, len(faces))
    assert not Mesh.from_arrays(vertices, faces, region=inner).covered.any()
    edge = 0.85 * R / np.sqrt(3)
    with pytest.raises(GeometryError, match="can be reached from outside: set covered = true"):
        Mesh.from_arrays(vertices, faces, region=((-edge,) * 3, (edge,) * 3))
    upper = Mesh.from_arrays(vertices, faces, region=((-1, -1, 0), (1, 1, 1)))
    assert np.array_equal(upper.covered, np.linalg.norm(middles(upper), axis=1) < 0.9 * R)


def test_a_mesh_in_another_frame_covers_the_same_facets() -> None:
    mesh = Mesh.from_arrays(*joined(ball(R), ball(0.8 * R)))
    pose = Pose.from_quaternion((0.5, 0.5, 0.5, 0.5), (0.1, 0.2, 0.3))
    assert np.array_equal(mesh.transformed(pose).covered, mesh.covered)


def test_an_edge_between_an_open_and_a_covered_facet_is_open() -> None:
    """The lid of a closed prism, its sides declared covered: the rim's edges, and smooth strips, stay searched."""
    vertices, faces = prism(np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * R, R)
    whole = Mesh.from_arrays(vertices, faces, covered=True)
    lid = whole.normals[:, 2] > 0.5
    mesh = Mesh(whole.vertices, whole.faces, whole.corner_normals, whole.crease, (), lid)
    corner = np.array([R, R, R / 2])
    wrench = pressing(corner, np.ones(3) / np.sqrt(3), -np.ones(3), 2e-4)
    found = Locator(mesh).run(wrench)
    assert found.status == Status.CONTACT
    assert np.linalg.norm(found.point - corner) < 1e-9


@pytest.mark.parametrize("crease", [float("nan"), -0.1, 30.0])
def test_a_crease_that_is_no_angle_is_refused(crease: float) -> None:
    with pytest.raises(InputError, match=r"crease must be between 0 and pi \[rad\].*radians"):
        Mesh.from_arrays(*box(), crease=crease)
