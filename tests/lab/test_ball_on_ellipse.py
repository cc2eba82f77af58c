"""A ball on an ellipse, rigid or soft, against closed forms."""

import numpy as np
import pytest

from palpate_lab.simulation.ball_on_ellipse import Ellipse, pressed_wrench

TIP, BALL, LAYER = Ellipse(), 2e-3, 3e8
ALONG = np.array([[0.0, 1.0, 0.0]])


def _line_on(wrench: np.ndarray, point: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Where lines of action pass the tangent planes."""
    force, torque = wrench[:, :3], wrench[:, 3:]
    start = np.cross(force, torque) / np.sum(force**2, axis=1)[:, None]
    way = np.sum((point - start) * normal, axis=1) / np.sum(force * normal, axis=1)
    return start + way[:, None] * force


def test_the_foot_is_on_the_ellipse_and_the_normal_across_it() -> None:
    x = np.linspace(-12e-3, 12e-3, 1001)
    point, normal = TIP.foot(x, np.full_like(x, 3e-3))
    np.testing.assert_allclose((point[:, 0] / TIP.a) ** 2 + (point[:, 2] / TIP.b) ** 2, 1.0, atol=1e-14)
    tangent = np.gradient(point, x, axis=0)[1:-1]
    assert np.abs(np.sum(tangent * normal[1:-1], axis=1)).max() < 2e-5  # central differences over 48 um


@pytest.mark.parametrize("depth", [-1e-3, 0.0, 0.5e-3, 1.4e-3])
def test_depth_is_the_distance_along_the_normal(depth: float) -> None:
    point, normal = TIP.foot(np.linspace(-11e-3, 11e-3, 45), np.zeros(45))
    inside = point - depth * normal
    np.testing.assert_allclose(TIP.depth(inside[:, 0], inside[:, 2]), depth, atol=1e-8)


def test_a_flat_layer_carries_the_volume_of_the_cap() -> None:
    """K pi d^2 (r - d/3): the ball's volume below the plane, times the stiffness."""
    flat, depth = Ellipse(1e3, 1e3), np.array([0.2e-3, 0.7e-3, 1.3e-3])
    wrench = pressed_wrench(flat, BALL, LAYER, np.zeros(3), depth, np.zeros(3), np.repeat(ALONG, 3, axis=0))
    closed = LAYER * np.pi * depth**2 * (BALL - depth / 3)
    np.testing.assert_allclose(-wrench[:, 2], closed, rtol=2e-3)  # of the midpoint rule on 16 rings
    assert np.abs(wrench[:, :2]).max() < 1e-12


def test_without_friction_the_push_passes_through_the_centre_of_the_ball() -> None:
    x, depth = np.linspace(-10e-3, 10e-3, 11), np.full(11, 0.8e-3)
    wrench = pressed_wrench(TIP, BALL, LAYER, x, depth, np.zeros(11), np.repeat(ALONG, 11, axis=0))
    point, normal = TIP.foot(x, np.zeros(11))
    centre = point + (BALL - depth)[:, None] * normal
    left = wrench[:, 3:] - np.cross(centre, wrench[:, :3])
    assert np.abs(left).max() < 1e-16  # N m: roundings of 1 N x 10 mm


def test_left_and_right_mirror_each_other() -> None:
    x, depth, mu = np.array([6e-3, -6e-3]), np.full(2, 0.8e-3), np.full(2, 0.4)
    way = np.array([[1.0, 0.5, 0.0], [-1.0, 0.5, 0.0]])
    right, left = pressed_wrench(TIP, BALL, LAYER, x, depth, mu, way)
    np.testing.assert_allclose(left, right * [-1, 1, 1, 1, -1, -1], atol=1e-12)  # torques are axial


def test_a_stiffer_layer_comes_nearer_to_a_rigid_touch() -> None:
    """At one load the depth falls as K^-1/2, and with it how far the line of action passes beside the point."""
    x, mu = np.array([7e-3]), np.array([0.5])
    point, normal = TIP.foot(x, np.zeros(1))
    aside = []
    for stiffness in (1e9, 1e11, 1e13):
        depth = np.sqrt(1.0 / (np.pi * stiffness * BALL)) * np.ones(1)
        wrench = pressed_wrench(TIP, BALL, stiffness, x, depth, mu, ALONG)
        aside.append(float(np.linalg.norm(_line_on(wrench, point, normal) - point)))
        slope = np.sum(wrench[0, :3] * ALONG[0]) / -np.sum(wrench[0, :3] * normal[0])
    assert aside[0] > 5 * aside[1] > 25 * aside[2]
    assert aside[2] < 4e-6
    assert slope == pytest.approx(0.5, rel=1e-3)


def test_friction_acts_below_the_surface_and_moves_the_line_of_action_against_it() -> None:
    """About as deep as the ball, so that the line passes the undeformed surface mu times that beside the foot."""
    x, depth, mu = np.zeros(1), np.full(1, 0.8e-3), np.array([0.5])
    point, normal = TIP.foot(x, x)
    aside = _line_on(pressed_wrench(TIP, BALL, LAYER, x, depth, mu, ALONG), point, normal) - point
    assert -aside[0, 1] == pytest.approx(0.5 * 0.8e-3, rel=0.1)
    assert abs(aside[0, 0]) < 1e-9
