"""The bench of pokes: geometry without strain, wrenches that are integrals, errors as they are said to be."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.sensors.taxels.modules import LAYOUTS
from palpate.spatial.pose import Pose
from palpate_lab.simulation.forearm import Cone, Forearm, places_near
from palpate_lab.simulation.poke_bench import MIX, Elbow, PokeBench, PokeErrors, PokeSession, boussinesq

NONE = PokeErrors(1e-9, 1e-9, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # a covariance must not be singular


@pytest.fixture(scope="module")
def exact() -> PokeSession:
    rng = np.random.default_rng(3)
    return PokeBench.drawn(rng, errors=NONE).session(rng, 300)


def test_the_cone_unrolls_without_strain() -> None:
    """The first fundamental form is the plane's: finite differences, of second order in 1e-5 m over 32 mm."""
    cone, rng = Cone(), np.random.default_rng(1)
    s, t, step = rng.uniform(-0.04, 0.04, 50), rng.uniform(-0.05, 0.05, 50), 1e-5
    across = (cone.at(s + step, t)[0] - cone.at(s - step, t)[0]) / (2 * step)
    along = (cone.at(s, t + step)[0] - cone.at(s, t - step)[0]) / (2 * step)
    _, normals = cone.at(s, t)
    axes = np.stack([across, along, normals], axis=1)
    np.testing.assert_allclose(axes @ np.swapaxes(axes, 1, 2), np.broadcast_to(np.eye(3), (50, 3, 3)), atol=1e-6)
    np.testing.assert_allclose(np.linalg.det(axes), 1.0, atol=1e-6)
    np.testing.assert_allclose(cone.unrolled(cone.at(s, t)[0]), np.stack([s, t], axis=-1), atol=1e-15)


def test_the_mesh_of_the_cone_is_closed_and_within_its_chords() -> None:
    cone = Cone()
    vertices, faces = cone.mesh(96, 40)
    corners = vertices[faces]
    volume = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    wide, narrow = cone.radius + cone.slope * cone.length / 2, cone.radius - cone.slope * cone.length / 2
    frustum = np.pi * cone.length / 3 * (wide**2 + wide * narrow + narrow**2)
    assert volume == pytest.approx(frustum * np.sin(2 * np.pi / 96) * 96 / (2 * np.pi), rel=1e-9)
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


@pytest.mark.parametrize("layout", sorted(LAYOUTS))
def test_modules_do_not_overlap_and_neighbours_are_near(layout: str) -> None:
    arm = Forearm.of(layout=layout)
    flat = arm.flat[arm.places.there]
    away = np.linalg.norm(flat[:, None] - flat[None], axis=2)
    module = arm.places.module[arm.places.there]
    nearest = np.where(module[:, None] != module, away, np.inf).min(axis=1)
    gap = [nearest[module == each].min() for each in range(arm.modules)]
    assert min(gap) > 6e-3
    assert max(gap) < 8e-3


def test_tangents_at_a_point_are_those_of_the_sheet() -> None:
    """A poke that moves along a tangent moves its taxels back as far; the tangents turn by 1 / 0.35 m, times 6 mm."""
    arm = Forearm.of()
    points = places_near(arm, np.random.default_rng(2), 40)
    axes, _ = arm.frame(points)
    rows, taxel = np.arange(40), np.argmin(np.linalg.norm(points[:, None] - arm.places.positions, axis=2), axis=1)
    for axis in range(2):
        moved = points + 1e-6 * axes[:, axis]
        change = arm.offsets(moved, rows, taxel) - arm.offsets(points, rows, taxel)
        np.testing.assert_allclose(change, np.tile(-1e-6 * np.eye(2)[axis], (40, 1)), atol=2e-8)


def test_cad_is_off_by_what_is_said() -> None:
    """Distances within a module stay (exactly, on the sheet); 200 skins of 7: deviations within 6 %, 3 sd of them."""
    arm, rng = Forearm.of(), np.random.default_rng(4)
    slid: list[np.ndarray] = []
    turned: list[np.ndarray] = []
    for _ in range(200):
        flat = arm.cone.unrolled(arm.cad(rng, 3e-3, 0.1).positions).reshape(7, 12, 2)
        true = arm.flat.reshape(7, 12, 2)
        slid.append(flat.mean(axis=1) - true.mean(axis=1))
        here, there = flat - flat.mean(axis=1, keepdims=True), true - true.mean(axis=1, keepdims=True)
        np.testing.assert_allclose(np.linalg.norm(here, axis=2), np.linalg.norm(there, axis=2), atol=1e-12)
        cross = here[..., 1] * there[..., 0] - here[..., 0] * there[..., 1]
        turned.append(np.arctan2(cross.sum(axis=1), (here * there).sum(axis=(1, 2))))
    assert np.std(slid) == pytest.approx(3e-3, rel=0.06)
    assert np.std(turned) == pytest.approx(0.1, rel=0.06)


def test_a_wrench_is_the_force_at_the_contact_and_the_spin(exact: PokeSession) -> None:
    """No error but 1e-9 of noise: what the force at the centre of pressure leaves is a moment about the normal.

    Cells of a flat tip on a curved skin lie up to 0.1 mm apart in height, so friction leaves 0.02 mm of moment arm.
    """
    pokes, bench = exact.pokes, exact.bench
    pose = Pose(pokes.rotation, pokes.origin)
    contact, force = pose.apply(exact.contacts), pose.rotate(exact.directions) * exact.force[:, None]
    np.testing.assert_allclose(pokes.wrench[:, :3], force, atol=1e-7)
    left = pose.inverse().rotate(pokes.wrench[:, 3:] - np.cross(contact, force))
    axes, _ = bench.skin.frame(exact.contacts)
    spin = np.einsum("ni,ni->n", left, axes[:, 2])
    across = np.linalg.norm(left - spin[:, None] * axes[:, 2], axis=1)
    assert (across < 3e-5 * exact.force).all()
    assert np.abs(spin).max() < 0.5 * 15.0 * 2.83e-3  # all friction at the corners
    assert np.abs(spin).mean() > 2e-4  # and it is there
    pure = np.einsum("ni,ni->n", force, pokes.wrench[:, 3:] - np.cross(contact, force)) / exact.force
    np.testing.assert_allclose(np.abs(pure), np.abs(spin), atol=2e-5 * 15 + 0.05 * np.abs(spin).max())


def test_friction_and_forces_stay_in_their_bounds(exact: PokeSession) -> None:
    axes, _ = exact.bench.skin.frame(exact.contacts)
    normal = -np.einsum("ni,ni->n", exact.directions * exact.force[:, None], axes[:, 2])
    assert normal.min() > 4.0 * 0.99  # the normal at the contact is not quite that at the middle of the tip
    assert normal.max() < 15.0 * 1.01
    lean = np.degrees(np.arccos(normal / exact.force))
    assert 14.0 < lean.max() < 18.0


def test_the_tip_bears_the_force_at_the_stated_law() -> None:
    """Cells bear k max(0, d) and the sum is the force, also where a tilted tip touches with a part of it only."""
    rng = np.random.default_rng(5)
    bench = PokeBench.drawn(rng)
    for newtons in (0.02, 8.0):
        _, _, load = bench.pressed(np.full(50, newtons), np.full(50, 30.0), rng)
        np.testing.assert_allclose(load.sum(axis=1), newtons, rtol=1e-12)
        assert load.min() >= 0.0
        assert ((load == 0).any()) == (newtons < 1.0)


def test_stress_of_a_point_load_bears_it_all() -> None:
    """Equilibrium: the stress over the whole plane adds up to the load, whatever the depth."""
    edges = np.linspace(0.0, 0.5, 100_001)
    r = (edges[1:] + edges[:-1]) / 2
    total = float((2 * np.pi * r * boussinesq(r * r, 2.5e-3)).sum() * 5e-6)
    assert total == pytest.approx(1.0, rel=1e-5)


def test_responses_fall_with_distance_and_about_three_answer(exact: PokeSession) -> None:
    pokes = exact.pokes
    assert 2.5 <= np.diff(pokes.starts).mean() <= 4.0
    away = np.linalg.norm(exact.bench.skin.places.positions[pokes.taxel] - exact.contacts[pokes.poke], axis=1)
    share = pokes.response / exact.force[pokes.poke]
    means = [share[(away >= low) & (away < low + 1e-3)].mean() for low in np.arange(0.0, 7e-3, 1e-3)]
    assert (np.diff(means) < 0).all()
    assert away.max() < 9e-3
    assert pokes.response.max() <= 255
    assert (pokes.response == np.rint(pokes.response)).all()


def test_errors_are_those_that_are_said() -> None:
    """300 sessions: standard deviations within 5 %, more than 3 sd of each (42 numbers a session, 6 of common)."""
    drawn = [PokeBench.drawn(np.random.default_rng(seed)) for seed in range(300)]
    bias, frames = np.array([each.bias for each in drawn]), np.array([each.frames for each in drawn])
    assert bias[..., :3].std() == pytest.approx(MIX.bias_force, rel=0.05)
    assert bias[..., 3:].std() == pytest.approx(MIX.bias_torque, rel=0.05)
    own = frames - frames.mean(axis=1, keepdims=True)
    assert own[..., :3].std() == pytest.approx(MIX.frame * np.sqrt(6 / 7), rel=0.05)
    assert frames.mean(axis=1)[:, 3:].std() == pytest.approx(MIX.common_angle * np.sqrt(8 / 7), rel=0.1)
    talk = np.array([each.cross_talk for each in drawn])
    for rows, columns, scale in ((0, 0, 1.0), (3, 3, 1.0), (3, 0, 0.1), (0, 3, 10.0)):
        part = talk[:, rows : rows + 3, columns : columns + 3]
        assert part.std() == pytest.approx(0.02 * scale, rel=0.05)


def test_a_measured_wrench_undone_is_the_true_one() -> None:
    """Conventions: c_sensor = R (Exp(phi) c + rho) + o, and (1 + C) w + b; left is the spin, at most 25 N mm."""
    rng = np.random.default_rng(6)
    errors = replace(MIX, noise_force=1e-9, noise_torque=1e-9)
    bench = PokeBench.drawn(rng, errors=errors)
    session = bench.session(rng, 200)
    pokes, row = session.pokes, session.pokes.configuration
    wrench = np.linalg.solve(np.eye(6) + bench.cross_talk, (pokes.wrench - bench.bias[row]).T).T
    turn = Pose.from_rotation_vector(bench.frames[row, 3:], np.zeros((200, 3))).rotation
    inner = np.einsum("nij,nj->ni", turn, session.contacts) + bench.frames[row, :3]
    contact = np.einsum("nij,nj->ni", pokes.rotation, inner) + pokes.origin
    direction = np.einsum("nij,nj->ni", pokes.rotation @ turn, session.directions)
    np.testing.assert_allclose(wrench[:, :3], direction * session.force[:, None], atol=1e-7)
    left = wrench[:, 3:] - np.cross(contact, wrench[:, :3])
    assert np.linalg.norm(left, axis=1).max() < 25e-3
    wrong = np.einsum("nij,nj->ni", pokes.rotation, session.contacts) + pokes.origin
    assert np.linalg.norm(np.cross(wrong - contact, wrench[:, :3]), axis=1).mean() > 10e-3


def test_the_arm_has_the_papers_poses() -> None:
    arm = Elbow()
    poses = arm.pose(*arm.joints.T)
    middle = poses.apply(Forearm.of().places.positions.mean(axis=0))
    assert (np.abs(np.linalg.norm(middle, axis=1) - 0.15) < 0.04).all()
    assert len(np.unique(arm.joints, axis=0)) == 5
    straight = arm.pose(np.zeros(()), np.zeros(()))
    np.testing.assert_array_equal(straight.rotation, np.eye(3))
    assert np.bincount(arm.shared(1000)).tolist() == [260, 100, 80, 140, 140, 140, 140]


def test_pokes_among_some_taxels_touch_no_others() -> None:
    rng = np.random.default_rng(9)
    bench = PokeBench.drawn(rng)
    among = np.flatnonzero(bench.skin.places.module < 3)
    touched = np.unique(bench.session(rng, 400, among=among).pokes.taxel)
    assert set(touched) <= set(among.tolist())
    assert len(touched) > 24
    with pytest.raises(InputError, match="no place"):
        places_near(bench.skin, rng, 5, among=np.array([30]), clear=0.1)


def test_pokes_at_given_places_are_there() -> None:
    """The centre of pressure is within a tenth of the tip of its middle; the force is along what is asked for."""
    rng = np.random.default_rng(10)
    bench = PokeBench.drawn(rng)
    points, configuration = bench.skin.places.positions[:9], np.arange(9) % 7
    directions = bench.directions(points, rng)
    session = bench.poke_at(points, directions, configuration, rng)
    np.testing.assert_allclose(session.directions, directions, atol=1e-12)  # spin adds no force
    assert np.linalg.norm(session.contacts - points, axis=1).max() < 0.4e-3
    np.testing.assert_array_equal(session.pokes.configuration, configuration)
    strongest = [session.pokes.taxel[a + np.argmax(session.pokes.response[a:b])] for a, b in
                 zip(session.pokes.starts[:-1], session.pokes.starts[1:], strict=True)]  # fmt: skip
    assert strongest == list(range(9))
    with pytest.raises(ValueError, match="within friction"):
        bench.poke_at(points, -bench.directions(points, rng), 0, rng)


def test_a_big_skin_fits_its_link_or_says_so() -> None:
    assert Forearm.of(334, rows=20).places.there.sum() >= 4000
    with pytest.raises(InputError, match="along the link"):
        Forearm.of(334, rows=20, cone=Cone())
    with pytest.raises(InputError, match="the layout"):
        Forearm.of(layout="square")
