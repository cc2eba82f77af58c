"""Compensation takes off a reading what a payload puts on it; its covariance is first order in the payload's errors."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.errors import InputError
from palpate.sensors.force_torque import Compensation, ForceTorque
from palpate.sensors.force_torque._kernels import rotate
from palpate.signals import Payload, Recording
from palpate.spatial.pose import rotation_from_quaternion
from palpate.spatial.pose_track import sound_quaternions

MASS, GRAVITY = 1.3, np.array([0.0, 0.0, -9.81])
CENTER, FORCE_BIAS, TORQUE_BIAS = np.array([0.01, -0.02, 0.05]), np.array([1.0, -2.0, 3.0]), np.array([0.1, 0.2, -0.3])


def a_payload(covariance: np.ndarray | None = None) -> Payload:
    covariance = np.zeros((12, 12)) if covariance is None else covariance
    return Payload(MASS * GRAVITY, FORCE_BIAS, CENTER, TORQUE_BIAS, covariance, magnitude=9.81)


def rotations(count: int) -> np.ndarray:
    return Rotation.random(count, random_state=5).as_matrix()


def test_inertia_is_newton_for_the_payload_swung_on_a_sensor() -> None:
    """The sensor translates along a path; the payload's centre follows, differentiated numerically: m a = m g - F_s."""
    rotation, step = rotations(1)[0], 1e-4

    def center(time: float) -> np.ndarray:  # in the base; the sensor does not turn
        return np.array([0.3 * np.sin(5 * time), 0.1 * time**3, 0.2 * np.cos(3 * time)]) + rotation @ CENTER

    acceleration = (center(0.7 + step) - 2 * center(0.7) + center(0.7 - step)) / step**2
    on_sensor = MASS * GRAVITY - MASS * acceleration  # the payload presses on the sensor by what does not accelerate it
    torque = np.cross(rotation @ CENTER, on_sensor)  # its line passes through the centre, as it does not spin
    reading = np.concatenate([rotation.T @ on_sensor + FORCE_BIAS, rotation.T @ torque + TORQUE_BIAS])
    got, _ = a_payload().compensate(reading, rotation, rotation.T @ acceleration)
    np.testing.assert_allclose(got, 0.0, atol=1e-10)


def test_a_lost_orientation_loses_its_sample_only() -> None:
    turned = rotations(3)
    turned[1, 0, 2] = np.nan
    got, covariance = a_payload(np.eye(12)).compensate(np.zeros((3, 6)), turned)
    assert np.isnan(got[1]).all()
    assert np.isnan(covariance[1]).any()
    assert np.isfinite(got[[0, 2]]).all()


def test_compiled_rotations_have_the_bits_of_numpys() -> None:
    quaternions = np.random.default_rng(6).normal(size=(200, 4))
    quaternions[0], quaternions[1, 2], quaternions[2] = 0.0, np.nan, np.inf
    found = np.empty((200, 3, 3))
    rotate(quaternions, found)
    sound = sound_quaternions(quaternions)
    assert 50 < np.count_nonzero(sound) < 190
    np.testing.assert_array_equal(found[sound], rotation_from_quaternion(quaternions[sound]))
    assert np.isnan(found[~sound]).all()


def test_without_orientation_only_a_tare() -> None:
    tare = replace(a_payload(), weight=np.zeros(3))
    np.testing.assert_allclose(
        tare.compensate(np.zeros((2, 6)), None)[0], np.tile(-np.concatenate([FORCE_BIAS, TORQUE_BIAS]), (2, 1))
    )
    assert np.isnan(tare.gravity).all()
    with pytest.raises(InputError, match=r"orientation.*Record"):
        a_payload().compensate(np.zeros((2, 6)), None)


def test_mass_and_gravity_follow_from_the_weight() -> None:
    assert a_payload().mass == pytest.approx(MASS, rel=1e-14)
    np.testing.assert_allclose(a_payload().gravity, GRAVITY, rtol=1e-14)


def test_values_cannot_be_changed_or_be_nonsense() -> None:
    payload = a_payload()
    with pytest.raises(ValueError, match="read-only"):
        payload.weight[0] = 1.0
    with pytest.raises(InputError, match=r"payload: center_of_mass"):
        replace(payload, center_of_mass=np.array([0.0, np.nan, 0.0]))
    with pytest.raises(InputError, match=r"payload: magnitude"):
        replace(payload, magnitude=0.0)


def test_saturation_is_any_channel_at_its_range() -> None:
    sensor = ForceTorque(limits=np.array([200.0, 200, 200, 10, 10, np.inf]))
    wrenches = np.zeros((5, 6))
    wrenches[1, 2], wrenches[2, 3], wrenches[3, 5], wrenches[4, 0] = -200.0, 9.99, 1e6, np.nan
    np.testing.assert_array_equal(sensor.saturated(wrenches), [False, True, False, False, False])
    assert not ForceTorque().saturated(wrenches).any()


def test_a_sensor_takes_six_deviations_and_refuses_nonsense() -> None:
    deviations = np.array([0.02, 0.02, 0.02, 0.001, 0.001, 0.001])
    np.testing.assert_allclose(ForceTorque(noise=deviations).noise, np.diag(deviations**2))
    with pytest.raises(InputError, match=r"force_torque: frame"):
        ForceTorque(frame="tool")
    with pytest.raises(InputError, match=r"limit.*Use"):
        ForceTorque(limits=np.zeros(6))


def test_readings_in_the_base_frame_are_those_of_the_sensor_turned() -> None:
    """With a payload and a motion; what depends on the order of products agrees to rounding."""
    rng, count = np.random.default_rng(8), 20
    turned, reading, noise = rotations(count), rng.normal(size=(count, 6)), (0.02, 0.001)
    channels = {"orientation": Rotation.from_matrix(turned).as_quat(), "acceleration": rng.normal(size=(count, 3))}
    in_base = np.einsum("nij,nkj->nki", turned, reading.reshape(count, 2, 3)).reshape(count, 6)
    found = list[np.ndarray]()
    for frame, values in (("sensor", reading), ("base", in_base)):
        sensor = Compensation(ForceTorque(noise, frame=frame), a_payload())
        given = {"force": values[:, :3], "torque": values[:, 3:]} | channels
        found.append(sensor.measure(Recording(np.arange(count) / 100.0, given, frame=frame)).wrench)
    np.testing.assert_allclose(found[1], found[0], atol=1e-12)
    assert np.ptp(found[0]) > 1.0
