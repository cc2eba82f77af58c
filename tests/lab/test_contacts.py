"""Wrenches that are made: within their stated bounds, and at the place they say."""

import numpy as np

from palpate_lab.simulation.contacts import touch_wrenches
from palpate_lab.simulation.shapes import EllipsoidBody

BODY = EllipsoidBody((0.01, 0.007, 0.005))


def test_forces_press_within_the_cone_and_sizes_and_pitch_within_bounds() -> None:
    rng = np.random.default_rng(0)
    points = BODY.sample(5000, rng)
    normals = BODY.normals(points)
    wrenches = touch_wrenches(points, normals, rng, force=(2.0, 9.0), tan_theta=0.5, pitch=3e-3)
    force, torque = wrenches[:, :3], wrenches[:, 3:]
    size = np.linalg.norm(force, axis=1)
    pressing = -np.sum(force * normals, axis=1)
    slope = np.sqrt(size**2 - pressing**2) / pressing
    pitch = np.sum(force * torque, axis=1) / size**2
    assert np.all(pressing > 0)
    for values, low, high in ((size, 2.0, 9.0), (slope, 0.0, 0.5), (pitch, -3e-3, 3e-3)):
        reach = 0.01 * (high - low)  # 5000 uniform draws come this near to both ends (e^-50 against it)
        assert low - 1e-9 <= values.min() < low + reach
        assert high - reach < values.max() <= high + 1e-9


def test_what_is_left_at_the_point_is_a_torque_about_the_normal() -> None:
    rng = np.random.default_rng(1)
    points = BODY.sample(500, rng)
    normals = BODY.normals(points)
    wrenches = touch_wrenches(points, normals, rng, pitch=2e-3)
    left = wrenches[:, 3:] - np.cross(points, wrenches[:, :3])
    assert np.abs(np.cross(left, normals)).max() < 1e-15  # N m: roundings of 10 N x 10 mm
