"""Covariances of a compensated wrench: payload, tare, followed zero, mounting, noise and acceleration, all mixed.

What is true is simulated here from the payload's equations; what is read stays, and what is true about it is drawn.
"""

import numpy as np
import pytest

from palpate import Compensation, ForceTorque
from palpate.signals import Recording
from palpate.signals.recording import ACCELERATION, FORCE, ORIENTATION, TORQUE, UNSTEADY
from palpate.signals.wrench_sensor import Placement
from palpate.signals.zero_filter import ZeroState
from tests.support.dice import agree, joint, mixed, rolled
from tests.support.payloads import (
    BIAS,
    CENTER,
    EXACT,
    FELT,
    MOUNT,
    MOUNTED,
    OWN,
    READING,
    SWING,
    TURNS,
    WEIGHT,
    WITH_IMU,
    in_surface,
    known_payload,
    load,
    load_by_imu,
    payload_with_imu,
)

DRIFT = np.array([0.03, 0.05, 0.02, 2e-3, 1e-3, 3e-3])
NOISE = mixed(np.repeat([0.05, 3e-3], 3), 2)
UNSURE, RATE = 0.4, 50.0
MISFIT = np.array([0.3, 0.02])  # N, N m: the residual of the payload's fit, well above the noise


def recording(k: int, swing: np.ndarray, reading: np.ndarray, start: float, unsteady: float) -> Recording:
    """The same reading fifty times, from a time on."""
    rows = {FORCE: reading[:3], TORQUE: reading[3:], ORIENTATION: TURNS[k].as_quat(), ACCELERATION: swing}
    rows[UNSTEADY] = np.array([unsteady])
    return Recording(start + np.arange(50) / RATE, {name: np.tile(row, (50, 1)) for name, row in rows.items()})


def placed(sensor: Compensation, share: float = 1.0, swing: np.ndarray = SWING[1]) -> tuple[np.ndarray, np.ndarray]:
    """The last of fifty readings in the second pose, and the covariance that is stated of it."""
    measured = sensor.measure(recording(1, swing, READING, 7.0, UNSURE))
    wrench, covariance = sensor.place(measured, measured.wrench, np.array([share]), Placement(MOUNT, MOUNTED))
    assert covariance is not None
    return wrench[-1], covariance[-1]


@pytest.mark.parametrize("share", [1.0, 0.3])
@pytest.mark.parametrize("misfit", [False, True])
@pytest.mark.parametrize("gain", [0.0, 0.02])
def test_a_wrench_on_a_moving_sensor_is_as_sure_as_all_of_its_parts(share: float, misfit: bool, gain: float) -> None:
    """Payload, noise as filtered, acceleration, gains, drift since the log began, what the fit left, mounting."""
    sensor = ForceTorque(NOISE, gain_error=gain, drift=DRIFT, limits=np.repeat([200.0, 12.0], 3))
    wrench, covariance = placed(Compensation(sensor, known_payload(MISFIT if misfit else None, 9)), share)
    contact = READING - load(EXACT, 1)
    np.testing.assert_allclose(wrench, in_surface(contact), atol=1e-12)
    lever, age = 12.0 / 200.0, 49 / RATE
    size = np.sqrt(contact[:3] @ contact[:3] + contact[3:] @ contact[3:] / lever**2)
    left = np.repeat(MISFIT**2 - np.diag(NOISE).reshape(2, 3).mean(axis=1), 3) if misfit else np.zeros(6)
    gains = (gain * size) ** 2 * np.repeat([1.0, lever**2], 3)
    more = share * NOISE + np.diag(age * DRIFT**2 + left + gains)

    def true(off: np.ndarray) -> np.ndarray:
        felt = READING - off[15:21] - load(off[:12], 1, off[12:15])
        return in_surface(felt, off[21:])

    agree(covariance, rolled(true, joint(OWN, UNSURE**2 * np.eye(3), more, MOUNTED)))


def test_a_tare_leaves_what_differs_from_its_pose() -> None:
    """Biases cancel; of weight and centre remains what they change between the poses; the mean's noise is added."""
    sensor = Compensation(ForceTorque(NOISE, drift=DRIFT), known_payload())
    zero = load(EXACT, 0) + 0.02 * READING
    sensor.tare(recording(0, SWING[0], zero, 0.0, 0.0))
    wrench, covariance = placed(sensor)

    def true(off: np.ndarray) -> np.ndarray:
        taken = zero - off[21:27] - load(off[:12], 0)  # of a sensor that felt nothing then
        felt = READING - off[15:21] - load(off[:12], 1, off[12:15]) - taken
        return in_surface(felt, off[27:])

    np.testing.assert_allclose(wrench, true(np.zeros(33)), atol=1e-12)
    more = NOISE + 7.0 * np.diag(DRIFT**2)  # s since the tare's last reading
    agree(covariance, rolled(true, joint(OWN, UNSURE**2 * np.eye(3), more, NOISE / 50, MOUNTED)))


@pytest.mark.parametrize("tared", [False, True])
def test_with_an_imu_its_turn_and_bias_count_too(tared: bool) -> None:
    """Its noise is that of the acceleration; a tare takes off what the errors change in the tare's pose."""
    sensor = Compensation(ForceTorque(NOISE), payload_with_imu(0.1))
    zero = load_by_imu(np.zeros(18), FELT[0])
    if tared:
        sensor.tare(recording(0, FELT[0], zero, 0.0, 0.0))
    wrench, covariance = placed(sensor, swing=FELT[1])
    np.testing.assert_allclose(wrench, in_surface(READING - load_by_imu(np.zeros(18), FELT[1])), atol=1e-12)

    def true(off: np.ndarray) -> np.ndarray:
        taken = zero - off[18:24] - load_by_imu(off[:18], FELT[0]) if tared else 0.0
        now = load_by_imu(off[:18] + np.r_[np.zeros(15), off[24:27]], FELT[1])
        return in_surface(READING - off[27:33] - now - taken, off[33:])

    parts = WITH_IMU, NOISE / 50, 0.01 * np.eye(3), NOISE, MOUNTED
    agree(covariance, rolled(true, joint(*parts)))


@pytest.mark.parametrize("tared", [False, True])
def test_a_followed_zero_and_payload_are_as_sure_as_their_state(tared: bool) -> None:
    """Of the payload's own errors only the weight's direction remains: size and first moment are followed."""
    sensor = Compensation(ForceTorque(NOISE, drift=DRIFT), known_payload())
    if tared:
        sensor.tare(recording(0, SWING[0], load(EXACT, 0), 0.0, 0.0))
    state = mixed(np.array([0.02] * 3 + [1e-3] * 3 + [0.2] + [0.01] * 3), 5)
    sensor.follow(ZeroState(np.array(BIAS), np.zeros(4), state))
    _, covariance = placed(sensor)
    down, newtons = WEIGHT / np.linalg.norm(WEIGHT), float(np.linalg.norm(WEIGHT))
    across = np.eye(3) - np.outer(down, down)

    def hung(off: np.ndarray, k: int, swing: np.ndarray | float = 0.0) -> np.ndarray:
        """The payload with its weight turned by (3,), larger by a number, and a first moment (3,) more."""
        heavier = newtons + off[3]
        turned = np.concatenate([across @ off[:3] + off[3] * down, np.zeros(9)])
        turned[6:9] = (newtons * CENTER + off[3] * CENTER + off[4:]) / heavier - CENTER
        return load(turned, k, swing) - BIAS

    def true(off: np.ndarray) -> np.ndarray:
        followed, own, free = off[6:10], off[10:13], np.zeros(7)
        free[3:] = followed
        felt = READING - off[16:22] - (BIAS + off[:6]) - hung(np.r_[own, followed], 1, off[13:16])
        if tared:  # the zero was found with the direction that was stated
            felt += hung(np.r_[own, followed], 0) - hung(free, 0)
        return in_surface(felt, off[22:])

    parts = state, OWN[:3, :3], UNSURE**2 * np.eye(3), NOISE, MOUNTED
    agree(covariance, rolled(true, joint(*parts)), 1e-4)


def test_a_window_s_mean_has_noise_of_its_own_and_errors_that_stay() -> None:
    sensor = Compensation(ForceTorque(NOISE), known_payload())
    sensor.tare(recording(0, SWING[0], load(EXACT, 0), 0.0, 0.0))
    kept = sensor.kept(recording(1, SWING[1], READING, 7.0, UNSURE))
    usable = np.arange(50) % 2 == 0
    noise, stays = sensor.window_noise(kept, usable)
    agree(noise, NOISE / 25)
    down = WEIGHT / np.linalg.norm(WEIGHT)

    def true(off: np.ndarray) -> np.ndarray:
        turned = np.concatenate([off[:3] - down * (down @ off[:3]), np.zeros(9)])
        both = zip((1, 0), (off[3:], np.zeros(3)), (1, -1), strict=True)
        return np.sum([sign * load(turned, k, more) for k, more, sign in both], axis=0)

    agree(stays, rolled(true, joint(OWN[:3, :3], UNSURE**2 * np.eye(3))))


def test_a_wrench_of_changes_adds_the_gains_of_the_last() -> None:
    sensor = Compensation(ForceTorque(NOISE, gain_error=0.02, limits=np.repeat([200.0, 12.0], 3)), known_payload())
    change, covariance = sensor.as_wrench(np.stack([-READING, READING]), NOISE)
    np.testing.assert_array_equal(change[1], READING)
    arm = 12.0 / 200.0
    square = READING[:3] @ READING[:3] + READING[3:] @ READING[3:] / arm**2
    agree(covariance, NOISE + 0.02**2 * square * np.diag(np.repeat([1.0, arm**2], 3)))
    np.testing.assert_array_equal(sensor.as_wrench(np.zeros((0, 6)), NOISE)[1], NOISE)
    agree(sensor.start()[1].covariance, OWN[np.ix_(np.r_[3:6, 9:12], np.r_[3:6, 9:12])])
