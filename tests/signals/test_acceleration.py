"""Accelerations are told by their length: an IMU's is that of gravity at rest, a motion's is small."""

import numpy as np
import pytest

from palpate.signals.acceleration import kind_of_acceleration, turned_from_gravity, wrong_acceleration

G = 9.80665


def _turning(length: float, noise: float = 0.0) -> np.ndarray:
    """Gravity in a sensor that turns about its y, read with noise."""
    angles = np.linspace(0.0, 2.0, 200)
    still = length * np.column_stack([np.sin(angles), 0 * angles, np.cos(angles)])
    return still + np.random.default_rng(3).normal(0.0, noise, still.shape)


@pytest.mark.parametrize(
    ("values", "unit", "kind", "found"),
    [
        (_turning(G, 0.3), None, "imu", "m/s^2"),
        (_turning(G, 0.3), "m/s^2", "imu", "m/s^2"),
        (_turning(1.0, 0.02), None, "imu", "g"),
        (_turning(1000.0, 20.0), None, "imu", "mg"),
        (_turning(G, 0.3), "g", "imu", "g"),  # in m/s^2 once read
        (_turning(0.0, 0.1), None, "motion", "m/s^2"),
        (_turning(0.0, 0.6), None, "motion", "m/s^2"),  # about 1 at the median, and never the same
        (_turning(16384.0), None, "none", "m/s^2"),
        (_turning(20.0), None, "none", "m/s^2"),
    ],
)
def test_gravity_is_told_from_motion_by_its_length(values: np.ndarray, unit: str | None, kind: str, found: str) -> None:
    assert kind_of_acceleration(values, unit)[:2] == (kind, found)


@pytest.mark.parametrize(
    ("values", "kind", "word"),
    [
        (_turning(G, 0.3), "motion", 'write kind = "imu"'),
        (_turning(1.0, 0.02), "motion", 'unit = "g"'),
        (_turning(20.0), "motion", 'kind = "none"'),
        (_turning(1.0, 0.02), "imu", 'unit = "g"'),
        (_turning(0.0, 0.1), "imu", 'kind = "motion"'),
        (_turning(G, 0.3), "imu", ""),
        (_turning(0.0, 0.5), "motion", ""),
    ],
)
def test_what_a_rig_says_wrong_is_named_with_what_mends_it(values: np.ndarray, kind: str, word: str) -> None:
    said = wrong_acceleration(values, kind)
    assert word in said
    assert bool(said) == bool(word)


@pytest.mark.parametrize("degrees", [0.0, 30.0, 90.0, 180.0])
def test_other_axes_show_in_where_gravity_is(degrees: float) -> None:
    """At rest an accelerometer reads -R^T g; one that is turned about x reads it turned."""
    still = np.tile([0.0, 0.0, 0.0, 1.0], (50, 1))
    angle = np.radians(degrees)
    felt = np.tile(G * np.array([0.0, np.sin(angle), np.cos(angle)]), (50, 1))
    assert turned_from_gravity(felt, still, np.array([0.0, 0.0, -G])) == pytest.approx(degrees, abs=1e-5)
    assert turned_from_gravity(felt, 0 * still, np.array([0.0, 0.0, -G])) == 0.0
