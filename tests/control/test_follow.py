"""The law that follows, by geometry: what a posed probe reads of a plane, and the step that meets one."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from palpate.control import _align
from palpate.control.control_law import Sensed
from palpate.control.probe_face import ProbeFace
from palpate.control.tracking_law import Follow
from palpate.errors import InputError
from palpate.spatial.pose import Pose
from palpate.surfaces.mesh import Mesh

RADIUS, FORCE, STIFFNESS = 0.03, 7.0, 2000.0
lean = st.floats(-0.3, 0.3)


def turned(*vector: float) -> np.ndarray:
    return np.ascontiguousarray(Pose.from_rotation_vector(np.array(vector), np.zeros(3)).rotation)


def outward(a: float, b: float) -> np.ndarray:
    """The normal whose angles are atan2(nx, nz) and atan2(ny, nz)."""
    n = np.array([np.tan(a), np.tan(b), 1.0])
    return n / np.linalg.norm(n)


@given(lean, lean, lean, lean, st.floats(-0.01, 0.01))
def test_a_ball_on_a_plane_reads_the_planes_angles_and_height(
    a: float, b: float, roll: float, pitch: float, height: float
) -> None:
    """However the probe is turned: a ball of R whose foremost point is 7 N deep in a plane, in closed form.

    The contact is at R n from the ball's middle, n the plane's inward normal; rounding of a dozen products.
    """
    axes = turned(0.2, -0.1, 0.4)
    n = axes @ outward(a, b)
    rotation = axes @ turned(roll, pitch, 0.0)
    origin = np.array([0.4, -0.1, 0.2])
    point = origin + height * axes[:, 2]  # of the plane, where the first axis meets it
    middle = point + np.array([0.003, -0.002, 0.0]) @ np.eye(3)
    middle = middle - ((middle - point) @ n) * n - RADIUS * n  # its lowest point lies in the plane
    tip = middle + RADIUS * rotation[:, 2]
    place = rotation.T @ (middle + RADIUS * n - tip)
    force = rotation.T @ (-FORCE * n)
    readings, worth, floor = np.zeros(3), np.zeros(3), np.array([1e-6, 4e-6, 9e-6])
    frame = (np.array([RADIUS, RADIUS]), axes, origin, np.array([a, b, height]))
    contact = (place, np.full(2, 2e-6 * RADIUS**2), force, rotation, tip)
    pressing = _align.observed(*contact, *frame, FORCE, STIFFNESS, floor, readings, worth)
    assert worth == pytest.approx([2e-6, 4e-6, 9e-6])
    assert pressing == pytest.approx(FORCE, rel=1e-12)
    assert readings[:2] == pytest.approx([a, b], abs=1e-9)
    # R (n, -n^2/2) is the ball to second order: R n^4/8 at the largest lean of both, 0.6 rad
    assert readings[2] == pytest.approx(height, abs=RADIUS * 0.6**4 / 8 / np.cos(0.6))


def test_a_newton_too_much_is_a_surface_that_is_nearer_by_the_stiffness() -> None:
    readings, far = np.zeros(3), np.zeros(3)
    frame = (np.array([RADIUS, RADIUS]), np.eye(3), np.zeros(3), np.zeros(3))
    for force, out in ((FORCE, readings), (FORCE + 1.0, far)):
        contact = (np.zeros(3), np.zeros(2), np.array([0, 0, -force]), np.eye(3), np.zeros(3))
        _align.observed(*contact, *frame, FORCE, STIFFNESS, np.ones(3), out, np.zeros(3))
    assert far[2] - readings[2] == pytest.approx(-1.0 / STIFFNESS)


@given(lean, lean, lean, lean, st.floats(-0.02, 0.02))
def test_the_step_leads_onto_the_surface(a: float, b: float, roll: float, pitch: float, height: float) -> None:
    """After it the probe's axis is the normal, its tip `depth` below where the surface meets the first axis."""
    axes, origin, depth = turned(0.2, -0.1, 0.4), np.array([0.4, -0.1, 0.2]), 0.006
    rotation, tip, out = axes @ turned(roll, pitch, 0.1), origin + 0.01, np.zeros(6)
    _align.target(np.array([a, b, height]), axes, origin, depth, rotation, tip, out)
    n = axes @ outward(a, b)
    after = turned(*out[3:]) @ rotation
    assert after[:, 2] == pytest.approx(n, abs=1e-9)
    surface = origin + (height - depth / (n @ axes[:, 2])) * axes[:, 2]
    assert tip + out[:3] == pytest.approx(surface + depth * n, abs=1e-12)
    across = np.cross(axes[:, 2], n)  # the least rotation: what it turns about stays where it is
    assert after.T @ across == pytest.approx(axes.T @ across, abs=1e-9)


def test_the_payloads_turning_is_eulers() -> None:
    """M + I al + w x I w, and the moment of all of its motion about the tip, by NumPy."""
    rng = np.random.default_rng(4)
    motion, wrench, load = rng.standard_normal(12), rng.standard_normal(6), rng.standard_normal(3)
    inertia, sensor = np.diag([1.0, 2.0, 3.0]) + 0.1, turned(0.4, 0.1, -0.8)
    out, pull, moved = np.zeros(6), np.zeros(3), np.zeros(3)
    _align.felt(motion, sensor, inertia, load, wrench, out, pull, moved)
    w, a, al = (sensor.T @ motion[k : k + 3] for k in (3, 6, 9))
    turning = inertia @ al + np.cross(w, inertia @ w)
    assert pull == pytest.approx(a)
    assert out == pytest.approx(wrench + np.concatenate([np.zeros(3), turning]))
    assert moved == pytest.approx(np.cross(load, a) + turning)


@pytest.fixture(scope="module")
def face() -> ProbeFace:
    ball = trimesh.creation.icosphere(4, RADIUS)
    return ProbeFace.of(Mesh.from_arrays(np.asarray(ball.vertices), np.asarray(ball.faces)))


def test_the_stiffness_is_learned_while_it_presses(face: ProbeFace) -> None:
    """Force as the depth squared, as of a ball in a foundation: K = 2 F/depth at 7 N; 30 mN of noise: 5 %."""
    law, seen, rng, depth = Follow(face, FORCE), Sensed(), np.random.default_rng(5), 0.006
    for k in range(4000):
        seen.time, deep = 0.005 * k, depth * (1.0 - 0.73 * np.exp(-k / 200.0))
        seen.tip[2] = deep
        seen.force[2] = -FORCE * (deep / depth) ** 2 + 0.03 * rng.standard_normal()
        if k == 0:
            law.start(seen)
        law.observe(seen)
        if law.ready:
            break
    assert law.ready
    assert law.stiffness == pytest.approx(2.0 * FORCE / depth, rel=0.05)


def test_gains_that_are_none_are_refused(face: ProbeFace) -> None:
    with pytest.raises(InputError, match="stiffness"):
        Follow(face, FORCE, stiffness=2e4, stiffest=1e4)
