"""Accelerations from the latest poses: closed forms, a NumPy twin, and deviations by Monte Carlo."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.signals.motion import UNKNOWN
from palpate.signals.recent_motion import RecentMotion
from palpate.spatial.pose import rotation_from_quaternion

LEVER = np.array([0.02, -0.01, 0.1])


def moving(time: np.ndarray, swing: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return quaternions, positions and the lever's true accelerations in the sensor's frame, of a joint's swing."""
    axis, arm, rate = np.array([0.6, 0.0, 0.8]), np.array([0.3, 0.1, 0.2]), 2.0 * np.pi * swing
    angle, speed, bend = np.sin(rate * time), rate * np.cos(rate * time), -(rate**2) * np.sin(rate * time)
    turns = Rotation.from_rotvec(angle[:, None] * axis)
    reach = arm + LEVER
    felt = np.cross(axis, np.cross(axis, reach)) * speed[:, None] ** 2 + np.cross(axis, reach) * bend[:, None]
    return turns.as_quat(), turns.apply(arm), felt


def answers(time: np.ndarray, quaternion: np.ndarray, position: np.ndarray, **options: bool) -> np.ndarray:
    found = RecentMotion(LEVER, **options).at(time, quaternion, position, np.zeros((len(time), 1)))
    return np.column_stack(found)


def test_a_swing_is_followed_as_a_cubic_through_nine_means_does() -> None:
    time = 100.0 + np.arange(2000) / 1000
    quaternion, position, felt = moving(time, 0.5)
    found = answers(time, quaternion, position)
    path = position + rotation_from_quaternion(quaternion) @ LEVER
    for row in (900, 1537):
        whole = row // 23 * 23  # rows of complete parts: 23 are the first to span a ninth of 0.2 s
        parts = np.array([rows.mean(axis=0) for rows in np.split(path[whole - 207 : whole], 9)])
        times = np.array([rows.mean() for rows in np.split(time[whole - 207 : whole], 9)]) - time[row]
        twin = 2.0 * np.polynomial.polynomial.polyfit(times, parts, 3)[2]
        turned = rotation_from_quaternion(quaternion[row : row + 1])[0].T @ twin
        np.testing.assert_allclose(found[row, :3], turned, atol=1e-6)
    assert np.all(found[:207, 3] == UNKNOWN)
    assert np.abs(found[300:, :3] - felt[300:]).max() < 0.4 * np.abs(felt).max()


@pytest.mark.parametrize(("swing", "noise"), [(0.5, 0.0), (1.0, 2e-5), (1.5, 2e-5), (0.5, 3e-4), (0.0, 1e-4)])
def test_deviations_hold(swing: float, noise: float) -> None:
    rng = np.random.default_rng(3)
    time = np.arange(8000) / 1000
    quaternion, position, felt = moving(time, swing)
    slow = np.repeat(np.arange(0, len(time), 10), 10)  # noise of poses at 100 Hz
    found = answers(time, quaternion, position + noise * rng.normal(size=(len(time), 3))[slow])[400:]
    off, stated = ((found[:, :3] - felt[400:]) ** 2).sum(axis=1), 3.0 * found[:, 3] ** 2
    assert 0.05 < off.sum() / stated.sum() < 1.3
    assert np.mean(off > 9.0 * stated + 1e-3) < 0.01


def test_gaps_begin_anew() -> None:
    time = np.arange(1500) / 1000
    quaternion, position, _ = moving(time, 0.5)
    time[800:] += 1.0
    quaternion[1200] = np.nan
    deviation = answers(time, quaternion, position)[:, 3]
    np.testing.assert_array_equal(deviation[[800, 1000, 1201, 1400]], UNKNOWN)
    assert deviation[[790, 1100, 1499]].max() < 1.0


def test_without_accelerations_the_motion_is_the_deviation() -> None:
    time = np.arange(1500) / 1000
    quaternion, position, felt = moving(time, 0.5)
    still = np.zeros_like(time)
    for given in (position, np.full_like(position, np.nan)):
        size = answers(time, quaternion, given, answers=False)
        assert not size[:, :3].any()
        assert not size[:200, 3].any()
        assert 0.3 < np.sqrt(3.0 * np.mean(size[400:, 3] ** 2) / np.mean((felt[400:] ** 2).sum(axis=1))) < 5.0
    rest = answers(time, *moving(still)[:2], answers=False)
    assert not rest.any()
