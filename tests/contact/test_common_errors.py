"""Errors that are the same in every sample of a touch: gains, what a touch errs by beside its wrench, slow noise."""

from typing import Any

import numpy as np
import pytest

from palpate.contact import WrenchEstimator
from palpate.contact.locate import Locator
from palpate.errors import InputError
from palpate.sensors.force_torque.model import ForceTorque
from palpate.signals import Butterworth
from palpate.signals.noise import NoiseSpectrum
from palpate.signals.recording import FORCE, TORQUE, Recording
from palpate.spatial.pose import Pose
from palpate.surfaces import Sphere

NOISE = np.array([0.02] * 3 + [0.001] * 3)
MOUNT = Pose(np.eye(3), [0.0, 0.0, 0.05])
PRESS = np.array([1.0, 0.5, -8.0, -0.05, 0.1, 0.01])
RATE = 500.0


def estimator(sensor: ForceTorque, **options: Any) -> WrenchEstimator:
    return WrenchEstimator(Locator(Sphere(0.02)), sensor, mount=MOUNT, **options)


def pressed(count: int) -> Recording:
    wrench = np.repeat(PRESS[None], count, axis=0)
    return Recording(np.arange(count) / RATE, {FORCE: wrench[:, :3], TORQUE: wrench[:, 3:]})


def test_gains_add_their_share_of_the_wrench() -> None:
    plain, off = (
        estimator(ForceTorque(NOISE, gain_error=share)).contact_wrenches(pressed(3))[1] for share in (0.0, 0.01)
    )
    assert plain is not None
    assert off is not None
    lever = 0.05
    square = 1e-4 * (np.sum(PRESS[:3] ** 2) + np.sum(PRESS[3:] ** 2) / lever**2)
    back = MOUNT.inverse().wrench_matrix()
    expected = square * (back * np.repeat([1.0, lever**2], 3)) @ back.T
    np.testing.assert_allclose((off - plain)[1], expected, rtol=0, atol=1e-12 * expected.max())


def test_placement_widens_the_point_across_its_normal_live_and_in_blocks() -> None:
    plain, wide = (estimator(ForceTorque(NOISE), placement=size) for size in (0.0, 2e-3))
    before, after = plain.run(pressed(1)).estimate, wide.run(pressed(1)).estimate
    normal = after.normal[0]
    expected = 4e-6 * (np.eye(3) - np.outer(normal, normal))
    np.testing.assert_allclose(after.covariance[0] - before.covariance[0], expected, rtol=0, atol=1e-18)
    single = wide.update(0.0, PRESS).estimate
    np.testing.assert_array_equal(single.covariance, after.covariance)
    assert single.status[0] == before.status[0]
    with pytest.raises(InputError, match=r"placement.*Write"):
        estimator(ForceTorque(NOISE), placement=-1.0)


@pytest.mark.parametrize("zero_phase", [False, True])
def test_a_filter_leaves_of_each_channel_what_its_spectrum_says(zero_phase: bool) -> None:
    made = Butterworth(10.0, 2, zero_phase=zero_phase)
    power = np.zeros((2, 6))
    power[0, :3], power[1, 3:] = 1.0, 1.0  # forces wander, torques hum
    spectrum = NoiseSpectrum(np.array([0.0, 0.4]), power)
    chain = estimator(ForceTorque(NOISE, spectrum=spectrum), filter=made, rate=RATE)
    shares = np.concatenate([np.ones(3), np.full(3, float(made.gain(0.4 * RATE, RATE)) ** 2)])
    # settled, nothing is left of a hum, and all of what wanders
    back = MOUNT.inverse().wrench_matrix()
    expected = (back * (shares * NOISE**2)) @ back.T
    alone = Locator(Sphere(0.02), noise=expected).run(back @ PRESS).covariance
    found = next(contacts.estimate for contacts in chain.stream([pressed(1000)]))
    # of a hum the least share of white noise is looked for, which a transient of 4 % passes below
    np.testing.assert_allclose(found.covariance[500], alone, rtol=0, atol=0.02 * float(np.abs(alone).max()))
