"""Simulated robots: URDF and MJCF are one robot, wrenches obey Newton and Euler, true touches lie on the links."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import polars
import pytest
from scipy.spatial.transform import Rotation

from palpate.errors import InputError
from palpate_lab.simulation.robot.bodies import hand, humanoid
from palpate_lab.simulation.robot.files import START, write_robot_truth
from palpate_lab.simulation.robot.motion import QUIET, JointMotion, RobotMechanics
from palpate_lab.simulation.robot.plan import RATE, REST, plan_touches
from palpate_lab.simulation.robot.run import RobotDevices, RobotRun, RobotRunSettings, simulate_robot
from palpate_lab.simulation.robot.sensors import LabRobot, SheetPatch, WristSensor
from palpate_lab.simulation.robot.tree import GRAVITY, SolidShape, moving, urdf

pytest.importorskip("mujoco")
pytest.importorskip("rosbags")

ROBOTS = pytest.mark.parametrize("make", [hand, humanoid])
Make = Callable[[np.random.Generator], LabRobot]
SETTINGS = RobotRunSettings(seconds=9.0, touches=16, wrench_rate=200)


def _robot(make: Make) -> tuple[LabRobot, RobotMechanics]:
    robot = make(np.random.default_rng(3))
    return robot, RobotMechanics(robot.name, robot.links, robot.sites())


def _motion(robot: LabRobot) -> JointMotion:
    return JointMotion.drawn(moving(robot.links), np.random.default_rng(4), 20.0, 1.0)


def _run(robot: LabRobot, settings: RobotRunSettings = SETTINGS, seed: int = 6) -> RobotRun:
    devices = RobotDevices.drawn(robot, np.random.default_rng(5), settings.encoder)
    return simulate_robot(robot, devices, settings, np.random.default_rng(seed))


def _by_urdf(robot: LabRobot, positions: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Rotation and origin of each link at positions (k,) of the joints that move on their own, from the text alone."""
    root = ElementTree.fromstring(urdf(robot.name, robot.links))
    angles = dict(zip((link.joint for link in moving(robot.links)), positions.tolist(), strict=True))
    found = {robot.base: (np.eye(3), np.zeros(3))}
    for joint in root.iterfind("joint"):  # parents come first
        parts = {part.tag: part.attrib for part in joint}
        xyz, rpy, axis = (
            np.array([float(word) for word in parts.get(tag, {}).get(name, "0 0 0").split()])
            for tag, name in (("origin", "xyz"), ("origin", "rpy"), ("axis", "xyz"))
        )
        mimic = parts.get("mimic", {"joint": joint.get("name", ""), "multiplier": "1"})
        angle = float(mimic["multiplier"]) * angles.get(mimic["joint"], 0.0)
        turn = Rotation.from_euler("xyz", rpy) * Rotation.from_rotvec(angle * axis)
        above, at = found[parts["parent"]["link"]]
        found[parts["child"]["link"]] = above @ turn.as_matrix(), at + above @ xyz
    return found


@ROBOTS
def test_urdf_and_mjcf_are_the_same_robot(make: Make) -> None:
    robot, mechanics = _robot(make)
    positions = np.random.default_rng(0).uniform(-1.5, 1.5, (5, len(moving(robot.links))))
    turned, placed = mechanics.poses(positions)
    for k, position in enumerate(positions):
        found = _by_urdf(robot, position)
        for i, link in enumerate(robot.links):
            np.testing.assert_allclose(turned[k, i], found[link.name][0], atol=1e-9)
            np.testing.assert_allclose(placed[k, i], found[link.name][1], atol=1e-9)


def test_one_joint_of_the_hand_follows_another() -> None:
    robot, _ = _robot(hand)
    assert [link.name for link in robot.links if link.mimic is not None] == ["ring_2"]
    assert [len(moving(make(np.random.default_rng(0)).links)) for make in (hand, humanoid)] == [13, 14]


@pytest.mark.parametrize("pauses", [False, True])
@ROBOTS
def test_velocities_and_accelerations_are_derivatives_and_keep_to_their_bounds(make: Make, pauses: bool) -> None:
    robot, _ = _robot(make)
    motion, step = replace(_motion(robot), pauses=pauses), 1e-4
    time = np.random.default_rng(1).uniform(QUIET, 20.0, 200)
    before, here, after = (motion.at(time + each) for each in (-step, 0.0, step))
    for k in (0, 1):  # step^2 times a third derivative
        np.testing.assert_allclose((after[k] - before[k]) / (2 * step), here[k + 1], atol=1e-6)
    away = np.abs(here[0] - motion.middle).max(axis=0)
    assert (away <= [link.span for link in moving(robot.links)]).all()
    assert np.abs(here[1]).max() <= 1.0
    assert not motion.at(np.array([0.5 * QUIET]))[1].any()


@ROBOTS
def test_wrenches_obey_newton_and_euler(make: Make) -> None:
    """Weight less the change of momentum of the link beyond each site, by central differences of its poses."""
    robot, mechanics = _robot(make)
    motion, step = _motion(robot), 1e-3
    time = np.array([1.0, 5.0, 7.7, 11.3])
    found = mechanics.wrenches(motion.at(time))
    around = [mechanics.poses(motion.at(time + each)[0]) for each in (-2 * step, -step, 0.0, step, 2 * step)]
    names = [link.name for link in robot.links]
    for s, site in enumerate(mechanics.sites):
        body = next(link for link in robot.links if link.mass and site in (link.name, link.parent))
        k, here = names.index(body.name), names.index(site)
        centres = [placed[:, k] + turned[:, k] @ np.array(body.centre) for turned, placed in around]
        pulled = (centres[4] - 2 * centres[2] + centres[0]) / (4 * step**2)
        force = body.mass * (np.array([0.0, 0.0, -GRAVITY]) - pulled)
        spins = [
            turned[:, k]
            @ np.diag(body.inertia())
            @ turned[:, k].transpose(0, 2, 1)
            @ Rotation.from_matrix(later[0][:, k] @ earlier[0][:, k].transpose(0, 2, 1)).as_rotvec()[..., None]
            / (2 * step)
            for earlier, (turned, _), later in zip(around, around[1:], around[2:], strict=False)
        ]
        change = (spins[2] - spins[0])[..., 0] / (2 * step)
        turn, origin = around[2][0][:, here], around[2][1][:, here]
        torque = np.cross(centres[2] - origin, force) - change
        wrench = np.concatenate([force, torque], axis=1).reshape(-1, 2, 3) @ turn
        np.testing.assert_allclose(found[:, s], wrench.reshape(-1, 6), atol=2e-5)  # step^2 times a fourth derivative


def _off(shape: SolidShape, points: np.ndarray) -> np.ndarray:
    """How far from 0 the equation of a shape is at points, in lengths for a box and a cylinder."""
    away = points - shape.at
    if shape.kind == "box":
        return np.abs(np.max(np.abs(away) - shape.size, axis=1))
    if shape.kind == "cylinder":
        beyond = np.maximum(np.abs(away[:, 2]) - shape.size[1], 0)
        return np.abs(np.hypot(away[:, 0], away[:, 1]) - shape.size[0]) + beyond
    return np.abs(np.sum((away / shape.size) ** 2, axis=1) - 1.0)


@ROBOTS
def test_true_contacts_press_the_surfaces_of_links_and_move_with_them(make: Make, tmp_path: Path) -> None:
    robot, _ = _robot(make)
    run = _run(robot)
    write_robot_truth(robot, run, tmp_path / "truth.csv")
    truth = polars.read_csv(tmp_path / "truth.csv")
    assert truth["touch"].n_unique() == SETTINGS.touches
    point, normal, force = (truth.select(f"{each}{axis}" for axis in "xyz").to_numpy() for each in "pnf")
    assert (np.einsum("ni,ni->n", normal, force) <= 0).all()
    for link in robot.links:
        rows = truth["link"].to_numpy() == link.name
        if rows.any():
            off = np.min([_off(shape, point[rows]) for shape in link.shapes], axis=0)
            assert off.max() < 1e-4  # of an ellipsoid: 0.1 um over 9 mm
    rng = np.random.default_rng(6)
    plan_touches(robot, rng, SETTINGS.touches, SETTINGS.seconds)  # before the motion, as in the run
    true = JointMotion.drawn(moving(robot.links), rng, SETTINGS.seconds, SETTINGS.speed)
    base, pushed = (truth.select(f"base_{each}{axis}" for axis in "xyz").to_numpy() for each in "pf")
    for row in range(0, len(truth), 97):
        found = _by_urdf(robot, true.at(truth["time"].to_numpy()[row : row + 1] - START)[0][0])
        turn, origin = found[truth["link"][row]]
        np.testing.assert_allclose(base[row], origin + turn @ point[row], atol=1e-6)
        np.testing.assert_allclose(pushed[row], turn @ force[row], atol=1e-6)


@ROBOTS
def test_each_region_rests_between_touches(make: Make) -> None:
    robot, _ = _robot(make)
    touches = plan_touches(robot, np.random.default_rng(2), 60, 40.0)
    assert [each.number for each in touches] == list(range(60))
    assert {"push", "grasp"} <= {each.kind for each in touches}
    for region in range(len(robot.regions)):
        own = [each for each in touches if each.region == region]
        for one, other in pairwise(own):
            pair = one.kind == other.kind == "grasp" and one.start == other.start
            assert pair or other.start - one.frames[-1] >= REST * RATE
    with pytest.raises(InputError, match="999 touches need"):
        plan_touches(robot, np.random.default_rng(2), 999, 40.0)


def test_what_presses_a_sensor_is_in_its_readings() -> None:
    """Wrists and sheets: readings with touches less those without are the touches' own, but for noise."""
    robot, _ = _robot(humanoid)
    run = _run(robot)
    for sensor in robot.sensors:
        time, values = run.readings[sensor.name]
        number = {k for k, each in enumerate(run.touches) if sensor in robot.regions[each.region].parts}
        if isinstance(sensor, SheetPatch):
            pressed = np.isin(np.arange(len(time)), run.contacts.frame[np.isin(run.contacts.touch, list(number))])
            assert values[~pressed].max(initial=0.0) < 15.0  # rest up to 8 counts, and noise of 1
            assert not number or values[pressed].max() > 20.0
        elif isinstance(sensor, WristSensor):
            still = time < QUIET
            np.testing.assert_allclose(values[still].std(axis=0), np.repeat(sensor.noise, 3), rtol=0.15)


def test_encoders_err_as_stated() -> None:
    """A constant of each joint, and a tenth of that as noise."""
    robot, _ = _robot(humanoid)
    size = float(np.radians(0.2))
    settings = replace(SETTINGS, seconds=6.0, touches=0, wrench_rate=100)
    exact, off = (_run(robot, replace(settings, encoder=each)).joints[:, 0] for each in (0.0, size))
    error = off - exact
    np.testing.assert_allclose(error.std(axis=0), 0.1 * size, rtol=0.1)
    assert 0.5 * size < np.linalg.norm(error.mean(axis=0)) / 14**0.5 < 1.6 * size  # of 14 joints
