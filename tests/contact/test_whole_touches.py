"""Which place a touch is, decided by its samples: live by those before, on logs by all; and where a touch begins."""

import numpy as np
import pytest

from palpate.contact import WrenchEstimator
from palpate.contact.estimate import Status
from palpate.contact.locate import Locator
from palpate.sensors.force_torque.compensation import Compensation
from palpate.sensors.force_torque.model import ForceTorque
from palpate.signals import Recording
from palpate.signals.payload import Payload
from palpate.signals.recording import FORCE, TORQUE
from palpate.spatial.pose import Pose
from palpate.surfaces.mesh import Mesh, plane
from palpate_lab.simulation import BumpySphere, contact_wrenches

NOISE = np.array([0.02] * 3 + [1e-4] * 3)
UPPER, LOWER = 0.0, -0.01  # m, heights of two plates
STEADY, COUNT = 60, 200  # samples with one direction of the force, and all
RATE = 500.0
UNTOUCHED = (Status.NO_CONTACT, Status.TOO_LIGHT)
UP = np.array([0.0, 0.0, 1.0])


def plates() -> Mesh:
    """Two squares of 6 mm over each other, both pressed from above."""
    square = 3e-3 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    lower = square + np.array([0.0, 0.0, LOWER])
    return Mesh.from_arrays(np.concatenate([square, lower]), np.concatenate([faces, faces + 4]))


def tilted() -> Mesh:
    """The plates, the lower one turned so that (-0.2, 0, -1) presses it along its normal."""
    mesh = plates()
    vertices = mesh.vertices - np.where(mesh.vertices[:, 2:] < 0, 0.2, 0.0) * mesh.vertices[:, :1] * [0.0, 0.0, 1.0]
    return Mesh.from_arrays(vertices, mesh.faces)


def touch(height: float, *, turns: bool, seed: int = 0) -> np.ndarray:
    """Wrenches (COUNT, 6) of 5 N at a plate's middle: straight down, then, where it turns, by 8 degrees."""
    after = np.maximum(np.arange(COUNT) - STEADY, 0) / RATE
    lean = 0.14 * np.sin(2 * np.pi * 5.0 * after) * turns
    force = 5.0 * np.stack([np.sin(lean), 0 * lean, -np.cos(lean)], axis=1)
    at, up = np.tile([0.0, 0.0, height], (COUNT, 1)), np.tile(UP, (COUNT, 1))
    clean = contact_wrenches(at, up, force, np.zeros(COUNT))
    return clean + NOISE * np.random.default_rng(seed).standard_normal((COUNT, 6))


def recorded(wrenches: np.ndarray) -> Recording:
    return Recording(np.arange(len(wrenches)) / RATE, {FORCE: wrenches[:, :3].copy(), TORQUE: wrenches[:, 3:].copy()})


@pytest.mark.parametrize("height", [UPPER, LOWER], ids=["met first", "met last"])
def test_a_false_place_wanders_as_the_force_turns(height: float) -> None:
    """Its point moves by 1.4 mm, ten standard deviations; the plate met first is given until then."""
    found = Locator(plates(), noise=NOISE).run(touch(height, turns=True))
    assert (found.status[5:STEADY] == Status.AMBIGUOUS).mean() > 0.9
    assert np.allclose(found.point[:STEADY, 2], UPPER)
    assert (found.status[-50:] == Status.CONTACT).all()
    assert np.allclose(found.point[-50:, 2], height)


@pytest.mark.parametrize("live", [True, False], ids=["live", "log"])
def test_what_begins_within_a_touch_has_as_many_places_as_what_begins_after_one(live: bool) -> None:
    """From the middle to 2.5 mm beside it without letting go: either plate may be touched there, at once."""
    wrenches = touch(UPPER, turns=False)
    wrenches[COUNT // 2 :, 4] += 5.0 * 2.5e-3  # moment of a force that stands at x = 2.5 mm
    found = WrenchEstimator(Locator(plates(), noise=NOISE), ForceTorque(NOISE), live=live).run(recorded(wrenches))
    assert np.allclose(found.point[COUNT // 2 :, 0], 2.5e-3, atol=2e-4)
    assert (found.status[COUNT // 2 :] == Status.AMBIGUOUS).mean() > 0.98
    assert found.status[COUNT // 2] == Status.AMBIGUOUS


def test_what_cannot_be_told_apart_stays_ambiguous() -> None:
    found = Locator(plates(), noise=NOISE).run(touch(UPPER, turns=False))
    assert (found.status == Status.AMBIGUOUS).mean() > 0.9


@pytest.mark.parametrize(("beyond", "status"), [(0.01, Status.AMBIGUOUS), (0.4, Status.CONTACT)])
def test_a_place_that_noise_may_have_put_beyond_the_bound_is_a_rival(beyond: float, status: Status) -> None:
    """So many newtons, of 0.02 N of noise, over the friction of the upper plate; the lower is tilted towards it."""
    locator = Locator(tilted(), noise=NOISE, friction=0.2)
    force = np.array([[-5.0 * 0.2 - beyond, 0.0, -5.0]])
    wrench = contact_wrenches(np.zeros((1, 3)), UP[None], force, np.zeros(1))
    found = locator.run(wrench)
    assert found.status[0] == status
    assert found.point[0, 2] < -5e-3


@pytest.mark.parametrize("height", [UPPER, LOWER], ids=["met first", "met last"])
def test_on_a_log_the_end_of_a_touch_decides_its_beginning(height: float) -> None:
    silence = NOISE * np.random.default_rng(1).standard_normal((20, 6))
    log = recorded(np.concatenate([touch(height, turns=True), silence, touch(LOWER, turns=True, seed=2), silence]))
    estimator = WrenchEstimator(Locator(plates(), noise=NOISE), ForceTorque(NOISE), live=False)
    for size in (1000, 64):
        estimator.reset()
        blocks = [log.picked(slice(start, start + size)) for start in range(0, len(log), size)]
        status, point = (
            np.concatenate([getattr(part.estimate, name) for part in estimator.stream(blocks)])
            for name in ("status", "point")
        )
        assert len(status) == len(log)
        for begin, truth in ((0, height), (COUNT + 20, LOWER)):
            assert (status[begin : begin + COUNT] == Status.CONTACT).all()
            assert np.allclose(point[begin : begin + COUNT, 2], truth)
            assert np.isin(status[begin + COUNT : begin + COUNT + 20], UNTOUCHED).all()


def test_on_a_log_an_undecided_touch_is_where_its_force_meets_the_surface_first() -> None:
    """Weak first and last samples act 3.5 mm beside the touch, where there is the lower plate alone."""
    mesh = plates()
    wide = Mesh.from_arrays(mesh.vertices * np.where(mesh.vertices[:, 2:] < 0.0, [2.0, 2.0, 1.0], 1.0), mesh.faces)
    wrenches = touch(UPPER, turns=False)
    for weak in (slice(0, 3), slice(-3, None)):
        wrenches[weak] = [0.0, 0.0, -0.3, 0.0, 0.3 * 3.5e-3, 0.0]
    parts = WrenchEstimator(Locator(wide, noise=NOISE), ForceTorque(NOISE), live=False).stream([recorded(wrenches)])
    found = next(iter(parts)).estimate
    assert np.allclose(found.point[3:-3, 2], UPPER, atol=1e-9)
    assert (found.status[3:-3] == Status.AMBIGUOUS).mean() > 0.9


def test_a_touch_is_followed_back_from_where_it_was_believed() -> None:
    """The upper plate, for long at its friction's bound; noise puts the hardest late sample beyond."""
    lean = np.full(2 * COUNT, 0.248)
    lean[20:38], lean[-5] = 0.1, 0.252  # what tells the plates apart, and what is beyond
    force = 5.0 * np.stack([-lean, 0 * lean, -np.ones(len(lean))], axis=1)
    force[-5] *= 1.1
    clean = contact_wrenches(np.zeros((len(lean), 3)), np.tile(UP, (len(lean), 1)), force, 0 * lean)
    noise = NOISE * np.random.default_rng(0).standard_normal(clean.shape)
    noise[-5] = 0.0
    locator = Locator(tilted(), noise=NOISE, friction=0.25)
    log = recorded(np.concatenate([clean + noise, np.zeros((5, 6))]))
    parts = WrenchEstimator(locator, ForceTorque(NOISE), live=False).stream([log])
    assert np.allclose(np.concatenate([part.estimate.point for part in parts])[: len(lean), 2], UPPER)


def test_a_touch_begins_where_its_own_covariance_does_not_explain_the_force() -> None:
    """5.5 standard deviations along the force, and it ends below 3; here the noise is ten times larger along x."""
    noise = np.diag([0.2, 0.02, 0.02, 1e-4, 1e-4, 1e-4]) ** 2
    locator = Locator(plane([0, 0, 0], [-1, -1, -1], 1.0), noise=noise)

    def status(x: float, y: float) -> int:
        return int(locator.run(np.array([[x, y, 0.0, 0.0, 0.0, 0.0]])).status[0])

    for axis, deviation in ((0, 0.2), (1, 0.02)):
        for ratio, touched in ((5.4, False), (5.6, True), (3.1, True), (2.9, False), (5.4, False)):
            force = [0.0, 0.0]
            force[axis] = ratio * deviation
            assert (status(*force) not in UNTOUCHED) == touched, (axis, ratio)


def test_drift_since_the_tare_and_a_misfit_of_the_payload_raise_the_threshold() -> None:
    """0.3 N: a contact at once, with 0.02 N of noise; none after 100 s of 0.02 N/sqrt(s), nor with 0.1 N of misfit."""
    wrench = np.array([0.0, 0.0, -0.3, 0.0, 0.0, 0.0])
    locator = Locator(plane([0, 0, 0], [0, 0, 1], 1.0), noise=NOISE)
    late = Recording(np.array([0.0, 100.0]), {FORCE: np.tile(wrench[:3], (2, 1)), TORQUE: np.zeros((2, 3))})
    drift = np.array([0.02] * 3 + [1e-4] * 3)
    steady, drifting = (
        WrenchEstimator(locator, ForceTorque(NOISE, drift=known)).run(late).status for known in (None, drift)
    )
    assert not np.isin(steady, UNTOUCHED).any()
    assert np.isin(drifting, UNTOUCHED).tolist() == [False, True]
    weightless = Payload(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), residual=np.array([0.1, 1e-3]))
    still = Recording(late.time, late.channels | {"orientation": np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))})
    found = WrenchEstimator(locator, Compensation(ForceTorque(NOISE), weightless), Pose.identity()).run(still)
    assert np.isin(found.status, UNTOUCHED).all()


def test_on_a_flat_surface_noise_makes_no_doubt_where_a_contact_slides() -> None:
    """There a place is excluded by the wrench exactly as by the ellipse, so no mean place contradicts an answer."""
    at = np.stack([np.linspace(-0.02, 0.02, 3000), np.zeros(3000), np.zeros(3000)], axis=1)
    wrenches = contact_wrenches(at, np.tile(UP, (3000, 1)), np.tile([0.3, 0.0, -3.0], (3000, 1)), np.zeros(3000))
    wrenches += 5 * NOISE * np.random.default_rng(3).standard_normal((3000, 6))
    found = Locator(plane(np.zeros(3), UP, 0.1), noise=5 * NOISE).run(wrenches)
    assert (found.status == Status.CONTACT).all()


def test_no_error_beyond_the_ellipse_is_sure_where_the_surface_bends_within_it() -> None:
    """A body of bumps with a torsion as large as itself: wrenches fold, and single samples land 4 mm away."""
    body = BumpySphere(0.01, amplitude=0.4)
    noise, rng = np.array([0.05] * 3 + [3e-3] * 3), np.random.default_rng(11)
    points = body.sample(12, rng)
    normals = body.normals(points)
    locator, wrong, sure = Locator(Mesh.from_arrays(*body.mesh(2_000)), noise=noise, torsion=0.01), 0, 0
    for point, normal in zip(points, normals, strict=True):
        push = 3.0 * (1 - np.exp(-np.arange(COUNT) / 20)) + 0.5
        force, twist = -push[:, None] * normal, 0.008 * push * np.sin(np.arange(COUNT) / 15)
        clean = contact_wrenches(np.tile(point, (COUNT, 1)), np.tile(normal, (COUNT, 1)), force, twist)
        found = locator.run(clean + noise * rng.standard_normal((COUNT, 6)))
        locator.reset()
        error, far = np.linalg.norm(found.point - point, axis=1), np.sqrt(np.trace(found.covariance, axis1=1, axis2=2))
        off = error > np.maximum(5 * far, 2e-3)
        wrong += int(off.sum())
        sure += int((off & (found.status == Status.CONTACT)).sum())
    assert wrong >= 10
    assert sure == 0
