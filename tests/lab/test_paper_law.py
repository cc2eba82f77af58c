"""The law of `probe`: signs that geometry decides, and gains that are refused."""

import numpy as np
import pytest

from palpate.control.probe_face import ProbeFace
from palpate.control.stability import Admittance
from palpate.errors import InputError
from palpate.spatial.pose import Pose
from palpate.surfaces import Sphere
from palpate_lab.papers.probe_law import Plain, force_error, selected_step, turning_error

RADIUS = 0.06


def test_a_light_touch_goes_deeper() -> None:
    """-5 N where 7 N are wanted pushes along z, into the tissue; -9 N away from it."""
    assert force_error(-5.0, 7.0) == 2.0
    assert force_error(-9.0, 7.0) == -2.0


def touched(rotation: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Where a ball on the sensor's z meets a plane, from its centre, in the sensor's axes."""
    return rotation.T @ (-RADIUS * normal)


@pytest.mark.parametrize("lean", [(0.1, 0.0), (-0.1, 0.0), (0.0, 0.1), (0.0, -0.1), (0.08, -0.05)])
@pytest.mark.parametrize("spin", [0.0, 2.0])
def test_turning_brings_the_contact_back_to_the_middle(lean: tuple[float, float], spin: float) -> None:
    """A ball on a plane that leans: turned again and again, its z ends along the plane's inward normal.

    Turning a ball about its centre leaves it on the plane, so geometry alone says where it touches. Each turn takes
    0.3 of the angle: 0.7^60 = 5e-10 of 0.1 rad are left.
    """
    normal = np.array([*lean, 1.0]) / np.linalg.norm([*lean, 1.0])
    down = np.diag([1.0, -1.0, -1.0])  # z of the sensor points down
    rotation = down @ Pose.from_rotation_vector([0.0, 0.0, spin], np.zeros(3)).rotation
    start, e = touched(rotation, normal)[:2], np.empty(6)
    for _ in range(60):
        x, y = touched(rotation, normal)[:2]
        about_x, about_y = turning_error(x, y)
        selected_step(rotation, 0.0, (0.3 * about_x / RADIUS, 0.3 * about_y / RADIUS), 1.0, e)
        assert not e[:3].any()
        rotation = Pose.from_rotation_vector(e[3:], np.zeros(3)).rotation @ rotation
    assert np.abs(start).max() > 2e-3
    assert np.abs(touched(rotation, normal)[:2]).max() < 1e-8 * RADIUS
    assert rotation[:, 2] == pytest.approx(-normal, abs=1e-8)


def test_a_step_is_along_z_and_about_x_and_y() -> None:
    rotation = Pose.from_rotation_vector([0.3, -1.0, 2.0], np.zeros(3)).rotation
    e = np.empty(6)
    selected_step(rotation, 0.5, (0.2, -0.4), 0.02, e)
    assert rotation.T @ e[:3] == pytest.approx([0.0, 0.0, 0.01], abs=1e-15)
    assert rotation.T @ e[3:] == pytest.approx([0.004, -0.008, 0.0], abs=1e-15)
    with pytest.raises(InputError, match="out must be a writable"):
        selected_step(rotation, 0.5, (0.2, -0.4), 0.02, np.empty(12)[::2])


def test_gains_that_are_none_are_refused() -> None:
    face = ProbeFace.of(Sphere(0.03).mesh(2000))
    with pytest.raises(InputError, match="damping of at least"):
        Plain(face, 7.0, Admittance(10.0, 60.0), 2.6, stiffest=2500.0)
    with pytest.raises(InputError, match="bandwidth"):
        Plain(face, 7.0, Admittance(10.0, 290.0), 0.0, stiffest=2500.0)
