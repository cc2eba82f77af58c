"""Simulate a robot that moves while it is touched: readings of all its sensors and joints, and the true contacts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from palpate_lab.simulation.robot.contacts import RobotContacts, pad_readings, planned_contacts, sheet_readings
from palpate_lab.simulation.robot.motion import JointMotion, RobotMechanics
from palpate_lab.simulation.robot.plan import RATE, RobotTouch, plan_touches
from palpate_lab.simulation.robot.sensors import CellTip, LabRobot, PadPatch, SheetPatch, WristSensor
from palpate_lab.simulation.robot.tree import moving
from palpate_lab.simulation.skin_bench import PaperSheet, paper_sheet

JOINT_RATE, TIP_RATE = 200, 500  # Hz
_JOINTS_LATE = 0.0013  # s: joints are not measured at the times of the sensors
_STEADY = 0.1  # of an encoder's error: noise; the rest is constant
TIP_NOISE, _TIP_BIAS = 2e-3, 0.02  # N of a cell; V


@dataclass(frozen=True)
class RobotRunSettings:
    """The settings of a run.

    Attributes:
        seconds: duration [s].
        touches: number of touches.
        speed: largest speed of a joint [rad/s].
        wrench_rate: of force/torque sensors [Hz].
        encoder: standard deviation [rad] of each joint's error.
        pauses: True: the robot stops for a second every two seconds.
    """

    seconds: float = 60.0
    touches: int = 100
    speed: float = 1.0
    wrench_rate: int = 1000
    encoder: float = 0.0
    pauses: bool = False


@dataclass(frozen=True)
class RobotDevices:
    """The true properties of a robot's sensors, the same in all its runs.

    Attributes:
        sheets: cells of each sheet, by its name.
        encoder: (k,) constant errors [rad] of the joints.
        sway: standard deviation [rad] of their noise.
    """

    sheets: dict[str, PaperSheet]
    encoder: Float[np.ndarray, " k"]
    sway: float

    @classmethod
    def drawn(cls, robot: LabRobot, rng: np.random.Generator, encoder: float) -> RobotDevices:
        """Draw the devices, with encoders whose errors have a standard deviation [rad]."""
        sheets = {each.name: paper_sheet(each.sheet, rng) for each in robot.sensors if isinstance(each, SheetPatch)}
        constant = encoder * (1.0 - _STEADY**2) ** 0.5 * rng.standard_normal(len(moving(robot.links)))
        return cls(sheets, constant, _STEADY * encoder)


@dataclass(frozen=True)
class RobotRun:
    """The logs of a run, and its truth.

    Attributes:
        joint_time, joints: (n,) [s], and positions and velocities of the joints (n, 2, k) as logged.
        readings: times [s] and readings of each sensor, by its name.
        touches: planned touches.
        contacts: true contacts of all of them.
        poses: rotations (n, l, 3, 3) and origins (n, l, 3) [m] of all links in each frame.
    """

    joint_time: Float[np.ndarray, " n"]
    joints: Float[np.ndarray, "n 2 k"]
    readings: dict[str, tuple[np.ndarray, np.ndarray]]
    touches: Sequence[RobotTouch]
    contacts: RobotContacts
    poses: tuple[np.ndarray, np.ndarray]


def simulate_robot(
    robot: LabRobot,
    devices: RobotDevices,
    settings: RobotRunSettings,
    rng: np.random.Generator,
    watch: Callable[[int, float], None] | None = None,
) -> RobotRun:
    """Simulate a run, and return the `RobotRun`.

    Args:
        robot: the robot.
        devices: the true properties of its sensors.
        settings: the settings.
        rng: random numbers of motion, touches and noise.
        watch: function called with the number of samples done, and the share that is done.

    Raises:
        InputError: MuJoCo is not installed, or the touches do not fit into the time.
    """
    touches = plan_touches(robot, rng, settings.touches, settings.seconds)
    drawn = JointMotion.drawn(moving(robot.links), rng, settings.seconds, settings.speed)
    motion = replace(drawn, pauses=settings.pauses)
    mechanics = RobotMechanics(robot.name, robot.links, robot.sites())
    frames = np.arange(round(settings.seconds * RATE)) / RATE
    readings, contacts = _skins(robot, devices, touches, frames, rng)
    sensors = [each for each in robot.sensors if isinstance(each, CellTip | WristSensor)]
    rate = TIP_RATE if isinstance(sensors[0], CellTip) else settings.wrench_rate
    time = np.arange(round(settings.seconds * rate)) / rate
    weights = mechanics.wrenches(motion.at(time), watch)
    for k, sensor in enumerate(sensors):
        acting = _acting(robot, sensor, touches, contacts, frames, time)
        readings[sensor.name] = time, _read(sensor, weights[:, k] + acting, rng)
    joint_time = np.arange(round(settings.seconds * JOINT_RATE)) / JOINT_RATE + _JOINTS_LATE
    position, velocity, _ = motion.at(joint_time)
    position = position + devices.encoder + devices.sway * rng.standard_normal(position.shape)
    joints = np.stack([position, velocity], axis=1)
    return RobotRun(joint_time, joints, readings, touches, contacts, mechanics.poses(motion.at(frames)[0]))


def _skins(
    robot: LabRobot, devices: RobotDevices, touches: Sequence[RobotTouch], time: np.ndarray, rng: np.random.Generator
) -> tuple[dict[str, tuple[np.ndarray, np.ndarray]], RobotContacts]:
    """Return the readings of sheets and pads, and the contacts, those of pads as they act in truth."""
    frames, found = len(time), dict[str, tuple[np.ndarray, np.ndarray]]()
    contacts = planned_contacts(robot, touches)
    radii = np.array([each.radius for each in touches] or [0.0])[contacts.touch]
    parts = [robot.regions[each.region].parts[each.part] for each in touches]
    for sensor in robot.sensors:
        own = np.isin(contacts.touch, [k for k, part in enumerate(parts) if part is sensor])
        if isinstance(sensor, SheetPatch):
            model = devices.sheets[sensor.name]
            found[sensor.name] = time, sheet_readings(sensor, model, contacts.of(own), radii[own], frames, rng)
        elif isinstance(sensor, PadPatch):
            counts, acting = pad_readings(sensor, contacts.of(own), radii[own], frames, int(rng.integers(1 << 30)))
            found[sensor.name], contacts = (time, counts), contacts.put(own, acting)
    return found, contacts


def _read(sensor: CellTip | WristSensor, wrench: Float[np.ndarray, "n 6"], rng: np.random.Generator) -> np.ndarray:
    """Return the voltages of a fingertip, or the wrenches of a wrist, by what acts on it."""
    if isinstance(sensor, WristSensor):
        return wrench + sensor.bias + np.repeat(sensor.noise, 3) * rng.standard_normal(wrench.shape)
    volts = sensor.cells.voltages(wrench)
    noise = sensor.cells.voltage_noise(TIP_NOISE, array=False) * rng.standard_normal(volts.shape)
    return volts + noise + _TIP_BIAS * rng.standard_normal(3 * sensor.cells.count)


def _acting(
    robot: LabRobot,
    sensor: CellTip | WristSensor,
    touches: Sequence[RobotTouch],
    contacts: RobotContacts,
    frames: Float[np.ndarray, " f"],
    time: Float[np.ndarray, " n"],
) -> Float[np.ndarray, "n 6"]:
    """Return the wrench of the touches of the link that a sensor carries, which changes linearly between frames."""
    link = sensor.surface if isinstance(sensor, WristSensor) else sensor.link
    parts = [robot.regions[each.region].parts[each.part] for each in touches]
    own = np.isin(contacts.touch, [k for k, part in enumerate(parts) if part.link == link])
    wrench = contacts.of(own).wrenches(len(frames))
    if link != sensor.link:
        wrench = wrench @ next(each for each in robot.links if each.name == link).origin().wrench_matrix().T
    return np.stack([np.interp(time, frames, wrench[:, k]) for k in range(6)], axis=1)
