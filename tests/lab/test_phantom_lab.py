"""The lab: what the sensor shows at rest, in contact and under acceleration, and how the robot follows."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import lsim
from scipy.spatial.transform import Rotation

from palpate.errors import InputError
from palpate_lab.simulation.phantom.lab import LabSettings, PhantomLab, Reading
from palpate_lab.simulation.phantom.motion import motion
from palpate_lab.simulation.phantom.probes import probe

pytest.importorskip("mujoco")

QUIET = LabSettings(force_noise=0.0, torque_noise=0.0, acceleration_noise=0.0, bias=(0.0,) * 6)
MASS, CENTRE, INERTIA = probe("convex").mass, np.array(probe("convex").centre), np.array(probe("convex").inertia)


@pytest.fixture(scope="module")
def quiet() -> PhantomLab:
    return PhantomLab(QUIET)


def _steps(lab: PhantomLab, count: int) -> list[Reading]:
    return [lab.step() for _ in range(count)]


def test_at_rest_the_sensor_shows_the_weight_and_its_lever(quiet: PhantomLab) -> None:
    """1e-4 N: how still the servo holds the arm."""
    quiet.start()
    reading = _steps(quiet, 20)[-1]
    weight = quiet.truth().sensor.rotation.T @ [0.0, 0.0, -9.81 * MASS]
    np.testing.assert_allclose(reading.wrench, [*weight, *np.cross(CENTRE, weight)], atol=1e-4)
    np.testing.assert_allclose(reading.acceleration, -weight / MASS, atol=1e-3)
    assert reading.fresh
    assert reading.joints_time == reading.time == pytest.approx(0.1)
    assert quiet.singular_values()[-1] > 0.1  # far from where the arm cannot move some way


def test_free_poses_show_the_weight_in_every_direction(quiet: PhantomLab) -> None:
    wrenches, rotations = quiet.free_wrenches(8)
    weight = np.swapaxes(rotations, 1, 2) @ [0.0, 0.0, -9.81 * MASS]
    np.testing.assert_allclose(wrenches, np.concatenate([weight, np.cross(CENTRE, weight)], axis=1), atol=1e-9)
    assert np.linalg.svd(weight)[1][-1] > 1.0  # the directions span space
    noisy = PhantomLab(replace(QUIET, force_noise=0.04, torque_noise=1.5e-3, bias=(1.0, 2.0, 3.0, 0.1, 0.2, 0.3)))
    off = noisy.free_wrenches(8, samples=100)[0] - wrenches - noisy.settings.bias
    assert 0.001 < np.abs(off[:, :3]).max() < 0.02  # 0.04 N over ten, five sigma
    assert np.abs(off[:, 3:]).max() < 8e-4


@pytest.mark.parametrize("depth", [0.002, 0.005])
def test_pressing_shows_the_force_of_a_flat_punch(depth: float) -> None:
    """F = k (A d - what round edges leave out) at the depth that the arm, pushed back, really stands at; within 1 %."""
    lab = PhantomLab(replace(QUIET, probe="linear"))
    lab.start(-depth)
    wrench = _steps(lab, 100)[-1].wrench
    truth = lab.truth()
    assert 0.0 < depth - truth.depth < 0.001  # contact forces bend the servo a little
    r, length, width = 0.002, 0.040, 0.010
    left_out = (1 - np.pi / 4) * r**2 * 2 * (length + width - 4 * r) + np.pi * r**3 / 3
    expected = 2e6 * ((length * width - (4 - np.pi) * r**2) * truth.depth - left_out)
    np.testing.assert_allclose(truth.press, expected, rtol=0.01)
    np.testing.assert_allclose(wrench[2] - 9.81 * MASS, -truth.press, atol=0.01)
    np.testing.assert_allclose(truth.centre, [0.0, 0.0, 0.150], atol=1e-3)
    assert truth.angle < np.radians(0.1)


def test_free_motion_adds_the_inertia_of_the_probe(quiet: PhantomLab) -> None:
    """Newton and Euler about the sensor, accelerations by differences of the true motion; 2 % of the largest."""
    start = quiet.start(0.05)
    poses, wrenches = [], []
    for i in range(300):
        if i % 4 == 0:
            shift = 0.15 * (1 - np.cos(4 * np.pi * i * 0.005))
            quiet.command(start + shift * np.array([0.5, 0.1, 0.1, 0.6, 0.5, 1.0]))
        wrenches.append(quiet.step().wrench)
        poses.append(quiet.truth().sensor)
    turns, h = np.array([pose.rotation for pose in poses]), 0.005
    spot = np.array([pose.translation for pose in poses]) + turns @ CENTRE
    a = (spot[2:] - 2 * spot[1:-1] + spot[:-2]) / h**2
    spins = np.array([Rotation.from_matrix(b @ a.T).as_rotvec() / h for a, b in pairwise(turns)])  # base axes, halfway
    w, dw, turns = 0.5 * (spins[1:] + spins[:-1]), np.diff(spins, axis=0) / h, turns[1:-1]
    tensor = turns @ np.diag(INERTIA) @ np.swapaxes(turns, 1, 2)
    spun = np.einsum("nij,nj->ni", tensor, w)
    force = MASS * (np.array([0.0, 0.0, -9.81]) - a)
    lever = np.einsum("nij,nj->ni", turns, np.broadcast_to(CENTRE, a.shape))
    torque = np.cross(lever, force) - np.einsum("nij,nj->ni", tensor, dw) - np.cross(w, spun)
    expected = np.concatenate([np.einsum("nji,nj->ni", turns, part) for part in (force, torque)], axis=1)
    seen, rest = np.array(wrenches)[1:-1], np.broadcast_to([0.0, 0.0, -9.81 * MASS], force.shape)
    moved = np.abs(expected[:, :3] - np.einsum("nji,nj->ni", turns, rest)).max()
    assert moved > 0.5  # N: the motion is worth the test
    smooth = np.arange(298) % 4 != 2  # where the interpolated command has a corner, every 20 ms, second differences lie
    assert np.abs(seen - expected)[smooth, :3].max() < 0.02 * moved
    assert np.abs(seen - expected)[smooth, 3:].max() < 0.02 * moved * CENTRE[2]


@pytest.mark.parametrize(("cycles", "extra"), [(1, 0.0), (2, 0.010)])
def test_the_robot_follows_after_its_delay_and_through_its_filter(cycles: int, extra: float) -> None:
    """A step of 10 mrad: nothing for `cycles` of 20 ms, a ramp of 20 ms, then w^2 / (s + w)^2 with w = 2 / 30 ms.

    Speeds stay below their limit; 1 % of the step for the integrator's millisecond.
    """
    lab = PhantomLab(replace(QUIET, delay_cycles=cycles, extra_delay=extra))
    start = lab.start(0.05)
    _steps(lab, 4)  # to 0.020 s, a multiple of the robot's cycle
    lab.command(start + 0.010)
    seen = []
    for _ in range(80):
        lab.step()
        seen.append(lab.truth().joints)
    wait, time = 0.020 * cycles + extra, 0.020 * (1 + np.arange(20))
    fine = np.arange(0.0, 0.401, 1e-4)
    w = 2.0 / 0.030
    _, reached, _ = lsim(([w * w], [1.0, 2 * w, w * w]), np.clip((fine - wait) / 0.020, 0.0, 1.0), fine)
    expected = np.interp(time, fine, reached)
    joints = np.array(seen)[3::4]
    for joint in range(6):
        np.testing.assert_allclose((joints[:, joint] - start[joint]) / 0.010, expected, atol=0.012)


def test_speed_limits_hold_whatever_is_commanded(quiet: PhantomLab) -> None:
    start = quiet.start(0.05)
    quiet.command(start + np.array([1.0, 0.3, -0.2, 1.0, 0.5, -9.0]))
    paths = [quiet.truth().joints for _ in range(160) if quiet.step().fresh]
    speeds = np.abs(np.diff(paths, axis=0)) / 0.005
    assert 1.5 < speeds.max() < 1.57 * 1.001
    assert quiet.truth().depth == 0.0
    with pytest.raises(InputError, match="6 finite"):
        quiet.command(np.full(6, np.nan))


def test_a_tilting_phantom_moves_the_centre_of_pressure() -> None:
    """The probe stands still, so the truth's angle is the phantom's, and the contact goes to the raised side."""
    for name in ("in-plane", "out-of-plane"):
        lab = PhantomLab(replace(QUIET, motion=motion(name, period=2.0, begin=0.0)))
        lab.start(-0.004)
        _steps(lab, 40)  # 0.2 s: 10 deg sin(36 deg)
        truth, angle = lab.truth(), np.radians(10.0) * np.sin(np.pi * 0.2)
        tilt, place = (truth.in_plane, truth.centre[0]) if name == "in-plane" else (truth.out_of_plane, truth.centre[1])
        assert truth.angle == pytest.approx(angle, abs=np.radians(0.3))
        assert abs(tilt) == pytest.approx(angle, abs=np.radians(0.3))
        assert tilt * place < 0.0
        radius = 0.060 if name == "in-plane" else 0.018
        assert abs(place) == pytest.approx(radius * angle, rel=0.25)


def test_drift_silence_and_saturation() -> None:
    lab = PhantomLab(
        replace(QUIET, drift=(0.0, 0.0, 1.0, 0.0, 0.0, 0.0), silence=(0.1, 0.2), ranges=(9.0, 9.0, 3.9) + (5.0,) * 3)
    )
    readings = _steps(lab, 120)
    times = np.array([reading.time for reading in readings])
    forces = np.array([reading.wrench[2] for reading in readings])
    fresh = np.array([reading.fresh for reading in readings])
    np.testing.assert_array_equal(fresh, (times < 0.1 - 1e-9) | (times >= 0.3 - 1e-9))
    np.testing.assert_allclose(forces[fresh], np.minimum(9.81 * MASS + times[fresh], 3.9), atol=1e-3)
    assert np.ptp(forces[(times > 0.09) & ~fresh]) == 0.0


def test_what_no_lab_can_be_built_of_is_refused() -> None:
    for wrong in ({"sensor_rate": 300}, {"stiffness": 0.0}, {"friction": -0.1}, {"lost": 1.0}):
        with pytest.raises(InputError):
            replace(QUIET, **wrong)
    with pytest.raises(InputError, match="cannot reach"):
        PhantomLab(replace(QUIET, place=(2.0, 0.0, 0.1)))
