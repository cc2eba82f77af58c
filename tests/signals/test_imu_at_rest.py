"""An accelerometer's bias and rotation from rests; truth is drawn, and gravity turned by SciPy."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.signals.imu import Imu
from palpate.signals.imu_at_rest import imu_at_rest
from palpate.signals.motion import Motion
from palpate.signals.recording import ACCELERATION, FORCE, ORIENTATION, POSITION, TORQUE, UNSTEADY, Recording

GRAVITY = np.array([0.0, 0.0, -9.80665])
RATE, RESTS, LASTING = 100, 100, 60  # Hz, samples of a rest and of a turn
TURN, BIAS = np.radians(1.0), 0.2  # rad, m/s^2: standard deviations of the truth along each axis


def a_log(
    rests: int, rng: np.random.Generator, noise: float = 0.05, scale: float = 0.0
) -> tuple[Recording, np.ndarray]:
    """Rests of random orientation with turns between, and the true specific force (n, 3)."""
    turns = Rotation.random(rests, random_state=int(rng.integers(2**31)))
    parts = [np.tile(turns[0].as_quat(), (RESTS, 1))]
    for one, other in pairwise(turns):
        s = np.linspace(0.0, 1.0, LASTING)[:, None]
        way = (one.inv() * other).as_rotvec() * s**2 * (3 - 2 * s)
        parts += [(one * Rotation.from_rotvec(way)).as_quat(), np.tile(other.as_quat(), (RESTS, 1))]
    orientation = np.concatenate(parts)
    force = Rotation.from_quat(orientation).inv().apply(-GRAVITY)
    tilt = Rotation.from_rotvec(rng.normal(0.0, TURN, 3))
    felt = tilt.apply(force) * (1.0 + rng.normal(0.0, scale, 3)) + rng.normal(0.0, BIAS, 3)
    nothing = np.zeros((len(force), 3))
    channels = {FORCE: nothing, TORQUE: nothing, POSITION: nothing, ORIENTATION: orientation}
    channels[ACCELERATION] = felt + rng.normal(0.0, 0.05, felt.shape)
    return Recording(np.arange(len(force)) / RATE, channels), force


def imu(**options: object) -> Motion:
    return Motion("imu", gravity=GRAVITY, **options)


@pytest.mark.parametrize("scale", [0.0, 0.003])
@pytest.mark.parametrize(("rests", "most"), [(1, 0.3), (3, 0.15), (20, 0.07)])
def test_what_remains_is_as_large_as_stated(rests: int, most: float, scale: float) -> None:
    """Of 20 accelerometers, in orientations of later rests: errors over UNSTEADY; the median narrows to the noise."""
    rng, ratios, sizes = np.random.default_rng(7), list[float](), list[float]()
    for _ in range(20):
        log, _ = a_log(rests + 4, rng, scale=scale)
        known = log.picked(slice(rests * (RESTS + LASTING) - LASTING))
        (answer,) = imu(accelerometer=imu_at_rest(known, imu())).stream(iter([log]))
        later = slice(len(known) + LASTING, None)
        off = answer.channels[ACCELERATION][later]
        ratios.append(float(np.mean((off / answer.channels[UNSTEADY][later]) ** 2)))
        sizes.append(float(np.median(answer.channels[UNSTEADY][later])))
    assert 0.5 < np.mean(ratios) < 1.3
    assert np.median(sizes) < most


def test_many_rests_give_bias_and_rotation() -> None:
    """To 3 deviations of a mean of 32 readings, one a second: 0.05 m/s^2 over the root of 32, 9 mm/s^2."""
    rng = np.random.default_rng(8)
    log, force = a_log(20, rng)
    found = imu_at_rest(log, imu())
    assert found is not None
    assert found.noise == pytest.approx(0.05, rel=0.1)
    np.testing.assert_allclose(found.forces(log.channels[ACCELERATION]).mean(axis=0), force.mean(axis=0), atol=0.03)


def test_the_deviation_is_that_of_drawn_errors() -> None:
    """Errors drawn from the covariance, put through the equation: 20,000 draws give a variance to 3 %."""
    rng = np.random.default_rng(9)
    root = rng.normal(size=(6, 6)) * np.repeat([0.02, 0.2], 3)[:, None]
    log, force = a_log(3, rng)
    found = imu_at_rest(log, imu())
    assert found is not None
    wide = Imu(found.quaternion, found.bias, found.noise, np.concatenate([np.zeros((6, 12)), root @ root.T], axis=1))
    drawn = rng.normal(size=(20_000, 6)) @ root.T
    for given in force[::400]:
        off = np.cross(given, drawn[:, :3]) - drawn[:, 3:] @ found.rotation
        expected = found.noise**2 + np.mean(off**2)
        assert wide.deviations(given[None])[0, 0] ** 2 == pytest.approx(expected, rel=0.05)


def test_readings_without_gravity_have_a_bias_only() -> None:
    log, force = a_log(4, np.random.default_rng(10))
    plain = replace(log, channels={**log.channels, ACCELERATION: log.channels[ACCELERATION] - force})
    found = imu_at_rest(plain, Motion("motion"))
    assert found is not None
    assert found.quaternion[:3] == pytest.approx(0.0, abs=1e-12)


def test_without_rests_or_orientations_nothing_is_known() -> None:
    log, force = a_log(2, np.random.default_rng(11))
    rest = {name: values for name, values in log.channels.items() if name != ORIENTATION}
    assert imu_at_rest(replace(log, channels=rest), Motion("motion")) is None
    assert imu_at_rest(log.picked(slice(49)), imu()) is None
    exact = imu_at_rest(replace(log, channels={**log.channels, ACCELERATION: force}), imu())
    assert exact is not None
    assert exact.noise < 1e-5
    assert np.abs(exact.bias).max() < 1e-5
