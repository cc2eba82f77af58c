"""The chain: what a sensor reads of a touch, with weight, zero and mounting, back to the place, in any frame."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.contact import ContactEstimate, Contacts, Locator, Status, WrenchEstimator
from palpate.contact.frames import placed
from palpate.errors import InputError
from palpate.sensors.force_torque import ForceTorque
from palpate.sensors.force_torque.compensation import Compensation
from palpate.signals import Payload, Recording
from palpate.signals.recording import AVERAGED, FORCE, ORIENTATION, POSITION, TORQUE
from palpate.spatial.pose import Pose, rotation_from_quaternion
from palpate.surfaces import Sphere
from palpate_lab.simulation.contacts import touch_wrenches
from tests.support import payloads as known
from tests.support.bodies import BODIES, R, on_mesh
from tests.support.dice import agree, joint, rolled

NOISE = np.array([0.02] * 3 + [5e-4] * 3)
MESH = BODIES["ellipsoid"].mesh
MOUNT = Pose.from_rotation_vector((0.3, -0.5, 1.1), (0.01, 0.02, 0.08))  # of the surface in the sensor
PAYLOAD = Payload(
    weight=np.array([0.3, -0.4, -12.0]),
    force_bias=np.array([-3.0, 4.0, -16.0]),
    center_of_mass=np.array([-0.001, 0.002, 0.045]),
    torque_bias=np.array([0.1, -0.2, 0.05]),
)


@dataclass(frozen=True)
class Session:
    """Where was touched in the surface's frame, what the sensor read, and how it stood."""

    points: np.ndarray
    contact: np.ndarray
    readings: np.ndarray
    quaternions: np.ndarray

    def recording(self, base: bool = False, orientation: bool = True) -> Recording:
        """As a log has it, its wrenches in the sensor's frame or in the base's."""
        readings = self.readings
        if base:
            turn = rotation_from_quaternion(self.quaternions)
            readings = np.einsum("nij,nkj->nki", turn, readings.reshape(-1, 2, 3)).reshape(-1, 6)
        channels = {FORCE: readings[:, :3].copy(), TORQUE: readings[:, 3:].copy()}
        if orientation:
            channels[ORIENTATION] = self.quaternions
        return Recording(np.arange(len(readings)) / 100.0, channels, frame="base" if base else "sensor", source="a.csv")


def session(count: int = 80) -> Session:
    """Forwards by hand: F_s = R F + R_s^T w + f0 and M_s = t x (R F) + R M + c x (R_s^T w) + m0."""
    rng = np.random.default_rng(0)
    points, normals, _ = on_mesh(MESH, count, rng)
    contact = touch_wrenches(points, normals, rng, force=(2.0, 10.0), tan_theta=0.5, pitch=0.2 * R)
    quaternions = rng.normal(size=(count, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    force = contact[:, :3] @ MOUNT.rotation.T
    torque = contact[:, 3:] @ MOUNT.rotation.T + np.cross(MOUNT.translation, force)
    weight = np.einsum("nji,j->ni", rotation_from_quaternion(quaternions), PAYLOAD.weight)
    force = force + weight + PAYLOAD.force_bias
    torque = torque + np.cross(PAYLOAD.center_of_mass, weight) + PAYLOAD.torque_bias
    return Session(points, contact, np.concatenate([force, torque], axis=1), quaternions)


def estimator(sensor: ForceTorque, payload: Payload | None = PAYLOAD, **options: object) -> WrenchEstimator:
    locator = Locator(MESH, noise=NOISE, friction=2.0, torsion=0.05, on=0.1)  # the payload's error is more
    return WrenchEstimator(locator, Compensation(sensor, payload), **({"mount": MOUNT} | options))


def assert_found(answer: Contacts, made: Session, which: np.ndarray | None = None) -> None:
    """To 1e-9 m: 20 N of payload rounded off 2 N of contact on an arm of 0.1 m is 1e-16 m."""
    which = np.ones(len(made.points), dtype=bool) if which is None else which
    assert answer.answered[which].all()
    assert np.abs(answer.point - made.points)[which].max() < 1e-9
    assert np.abs(answer.force - made.contact[:, :3])[which].max() < 1e-12 * 100


def test_what_was_touched_is_found_through_weight_bias_and_mounting() -> None:
    made = session()
    assert_found(estimator(ForceTorque(NOISE)).run(made.recording()), made)


def test_without_payload_and_mounting_the_reading_is_the_wrench() -> None:
    made = session()
    plain = Recording(np.arange(80.0), {FORCE: made.contact[:, :3], TORQUE: made.contact[:, 3:]})
    answer = estimator(ForceTorque(NOISE), payload=None, mount=None).run(plain)
    assert_found(answer, made)


def test_a_tare_without_weight_needs_no_orientation() -> None:
    made = session()
    tare = Payload(np.zeros(3), PAYLOAD.force_bias, PAYLOAD.center_of_mass, PAYLOAD.torque_bias)
    readings = MOUNT.wrench_matrix() @ made.contact[..., None]
    readings = readings[..., 0] + np.concatenate([tare.force_bias, tare.torque_bias])
    answer = estimator(ForceTorque(NOISE), payload=tare).run(
        Recording(np.arange(80.0), {FORCE: readings[:, :3], TORQUE: readings[:, 3:]})
    )
    assert_found(answer, made)


def test_samples_without_an_orientation_have_no_pose_and_hurt_no_other() -> None:
    made = session()
    quaternions = made.quaternions.copy()
    lost = np.zeros(80, dtype=bool)
    lost[[3, 40, 41]] = True
    quaternions[3], quaternions[40, 2], quaternions[41] = np.nan, np.nan, 0.0
    for base in (False, True):
        recording = made.recording(base)
        channels = {**recording.channels, ORIENTATION: quaternions}
        sensor = ForceTorque(NOISE, frame="base" if base else "sensor")
        answer = estimator(sensor).run(Recording(recording.time, channels))
        assert (answer.status[lost] == Status.NO_POSE).all()
        assert np.isnan(answer.point[lost]).all()
        assert_found(answer, made, ~lost)


def test_saturated_and_invalid_samples_are_named_and_hurt_no_other() -> None:
    made = session()
    readings = made.readings.copy()
    readings[5, 4], readings[9, 0], readings[10, 2], readings[11, 5] = 10.0, -200.0, np.nan, np.inf
    odd = np.isin(np.arange(80), [5, 9, 10, 11])
    sensor = ForceTorque(NOISE, limits=[200.0] * 3 + [10.0] * 3)
    answer = estimator(sensor).run(Session(made.points, made.contact, readings, made.quaternions).recording())
    assert answer.status[[5, 9]].tolist() == [Status.SATURATED] * 2
    assert answer.status[[10, 11]].tolist() == [Status.INVALID] * 2
    assert np.isnan(answer.point[odd]).all()
    assert_found(answer, made, ~odd)


@pytest.mark.parametrize("base", [False, True])
def test_a_missing_orientation_is_said_with_the_file_and_the_columns(base: bool) -> None:
    sensor = ForceTorque(NOISE, frame="base" if base else "sensor")
    chain = estimator(sensor, payload=None) if base else estimator(sensor)
    with pytest.raises(InputError, match=r"a.csv: the log has no orientation.*qx, qy, qz, qw"):
        chain.run(session().recording(orientation=False))


def test_payload_and_mounting_add_to_the_covariance_what_dice_say() -> None:
    read = _parts(known.READING[None]) | {ORIENTATION: known.TURNS[1].as_quat()[None]}
    sensor = Compensation(ForceTorque(NOISE), known.known_payload())
    made = WrenchEstimator(Locator(MESH), sensor, mount=known.MOUNT, mount_covariance=known.MOUNTED)
    _, stated, _ = made.contact_wrenches(Recording(np.zeros(1), read))

    def true(off: np.ndarray) -> np.ndarray:
        return known.in_surface(known.READING - off[12:18] - known.load(off[:12], 1, -known.SWING[1]), off[18:])

    assert stated is not None
    agree(stated[0], rolled(true, joint(known.OWN, np.diag(NOISE**2), known.MOUNTED)))


def test_what_a_tare_is_unsure_of_is_in_every_covariance() -> None:
    rng = np.random.default_rng(2)
    window = Recording(np.arange(40) / 100.0, _parts(rng.normal(size=(40, 6)) * NOISE))
    estimator = WrenchEstimator(Locator(MESH), ForceTorque(NOISE), live=False)
    _, before, _ = estimator.contact_wrenches(window)
    estimator.tare(window)
    _, after, _ = estimator.contact_wrenches(window)
    assert before is not None
    assert after is not None
    np.testing.assert_allclose(before[0], np.diag(NOISE**2), atol=1e-15)
    np.testing.assert_allclose(after[0], (1 + 1 / 40) * np.diag(NOISE**2), atol=1e-15)


def _parts(wrenches: np.ndarray) -> dict[str, np.ndarray]:
    return {FORCE: wrenches[:, :3].copy(), TORQUE: wrenches[:, 3:].copy()}


def test_a_channel_that_is_not_the_sensors_changes_nothing() -> None:
    """Of how many readings a wrench is the mean is for a skin's frames; rows to write into hold no contact."""
    rng = np.random.default_rng(3)
    channels = {"force": rng.normal(0, 1, (50, 3)), "torque": rng.normal(0, 0.01, (50, 3))}
    estimator = WrenchEstimator(Locator(Sphere(0.01)), ForceTorque([0.02] * 3 + [1e-3] * 3))
    plain = estimator.run(Recording(np.arange(50.0), channels))
    estimator.reset()
    more = estimator.run(Recording(np.arange(50.0), {**channels, AVERAGED: np.full((50, 1), 9.0)}))
    assert np.array_equal(plain.rows(), more.rows(), equal_nan=True)
    assert np.isnan(estimator.empty(2)).all()


def test_moving_the_answer_is_moving_the_question() -> None:
    mesh, rng = BODIES["ellipsoid"].mesh, np.random.default_rng(0)
    points, normals, _ = on_mesh(mesh, 50, rng)
    wrenches = touch_wrenches(points, normals, rng, pitch=0.2 * R)
    wrenches[7] = np.nan
    noise = np.diag(np.array([0.02] * 3 + [5e-4] * 3) ** 2)
    move = Pose.from_rotation_vector((0.4, -1.1, 2.0), (0.05, -0.02, 0.11))
    matrix = move.wrench_matrix()
    one = Locator(mesh, noise=noise).run(wrenches, sequential=False).in_frame(move)
    two = Locator(mesh.transformed(move)).run(wrenches @ matrix.T, matrix @ noise @ matrix.T, sequential=False)
    assert one.status[7] == two.status[7]
    for name in ("point", "normal", "force", "torque", "residual", "candidates"):
        # 1e-9 of lengths of centimetres, unit normals turn 50 times faster, forces of 10 N
        assert np.allclose(getattr(one, name), getattr(two, name), rtol=1e-8, atol=1e-10, equal_nan=True), name
    assert np.nanmax(np.abs(one.covariance - two.covariance)) < 1e-6 * np.nanmax(two.covariance)


@pytest.mark.parametrize("samples", [[], [5], [5, 5, 5], [5, 6, 6, 8, 8, 8]])
def test_contacts_of_one_sample_are_all_in_its_own_pose(samples: list[int]) -> None:
    """On a base that moves, in a block that begins at sample 5; a sample between them has none, and one no pose."""
    rng, count = np.random.default_rng(2), len(samples)
    mesh, mount = BODIES["ellipsoid"].mesh, Pose.from_rotation_vector((0.3, 0.2, -0.4), (0.01, 0.02, 0.03))
    points, normals, _ = on_mesh(mesh, max(count, 1), rng)
    estimate = Locator(mesh).run(touch_wrenches(points, normals, rng)[:count], sequential=False)
    turns, places = Rotation.random(4, random_state=3), rng.normal(size=(4, 3))
    quaternions = turns.as_quat()
    quaternions[1] = np.nan
    block = Recording(np.arange(4.0), {ORIENTATION: quaternions, POSITION: places})
    contacts = Contacts(np.array(samples, dtype=np.int64), np.array(samples, float), np.zeros(count, int), estimate)
    found = placed(contacts, block, "base", mount)
    assert found.sample.tolist() == samples
    assert found.point.shape == (count, 3)
    for k, sample in enumerate(samples):
        if sample == 6:
            assert found.status[k] == Status.NO_POSE
            assert np.isnan(found.point[k]).all()
        else:
            there = turns[sample - 5].apply(mount.apply(estimate.point[k])) + places[sample - 5]
            np.testing.assert_allclose(found.point[k], there, atol=1e-12)
            np.testing.assert_allclose(found.force[k], turns[sample - 5].apply(mount.rotate(estimate.force[k])))


def test_a_frame_that_is_none_is_refused_and_nothing_cannot_be_joined() -> None:
    estimate = Locator(BODIES["ellipsoid"].mesh).run(np.zeros((1, 6)))
    contacts, block = Contacts.single(np.zeros(1), estimate), Recording(np.zeros(1), {})
    with pytest.raises(InputError, match="the frame 'world' is unknown"):
        placed(contacts, block, "world", Pose.identity())
    for joined in (Contacts.joined, ContactEstimate.joined):
        with pytest.raises(InputError, match="at least one"):
            joined([])
