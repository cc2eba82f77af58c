"""`palpate simulate hand` and `palpate simulate humanoid`: record a moving robot with many sensors, and its touches."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from tyro.conf import arg

from palpate.console.console import counting, lines, note, progress, title, wait
from palpate.errors import InputError
from palpate_lab.cli.simulate import complete_session, require_new, require_within

if TYPE_CHECKING:
    from palpate_lab.simulation.robot.run import RobotRun, RobotRunSettings
    from palpate_lab.simulation.robot.sensors import LabRobot

Folder = Annotated[Path, arg(aliases=["-o"], metavar="FOLDER")]
Count = Annotated[int, arg(metavar="N")]
Number = Annotated[float, arg(metavar="X")]
_RATES = (100, 200, 250, 500, 1000)  # Hz
_NOTE = (
    "truth.csv has every contact by the mechanics that made the readings, in its link and in the base, which estimates "
    "never see. Pads have a calibrated response; other models are true but for the errors that they state. Next:"
)


def simulate_hand(
    *,
    output: Folder,
    seed: Count = 0,
    seconds: Number = 50.0,
    touches: Count = 100,
    speed: Number = 1.0,
    encoder: Number = 0.0,
    free: Number = 30.0,
) -> None:
    """Simulate a hand with five fingertips, which grasps and is pushed.

    Record a hand of 14 joints, one of which follows another, while it moves and is touched. Thumb, index and middle
    finger end in tips on load cells, ring and little finger in pads of three-axis taxels.

    Args:
        output: folder to make: run.mcap, free.mcap, robot.urdf with meshes, robot.xml, robot.toml, models, truth.csv.
        seed: seed of everything random.
        seconds: duration [s]; the first 3 s are untouched and at rest.
        touches: number of touches.
        speed: speed of the fastest joint [rad/s].
        encoder: standard deviation of each joint's error [degrees].
        free: duration of free.mcap [s], in which the robot moves and pauses, untouched; 0: none.
    """
    _simulate("hand", output, seed, (seconds, touches, speed, 1000), encoder, free)


def simulate_humanoid(
    *,
    output: Folder,
    seed: Count = 0,
    seconds: Number = 50.0,
    touches: Count = 100,
    speed: Number = 1.0,
    encoder: Number = 0.0,
    free: Number = 30.0,
    wrench_rate: Count = 1000,
) -> None:
    """Simulate a torso with two arms, twelve patches of skin and two force/torque sensors.

    Record a torso with two arms of seven joints while it moves and is touched, at several places at once.
    Six sheets of one-axis taxels and six pads of three-axis ones cover torso, arms and hands.

    Args:
        output: folder to make: run.mcap, free.mcap, robot.urdf, robot.xml, robot.toml, models, truth.csv.
        seed: seed of everything random.
        seconds: duration [s]; the first 3 s are untouched and at rest.
        touches: number of touches.
        speed: speed of the fastest joint [rad/s].
        encoder: standard deviation of each joint's error [degrees].
        free: duration of free.mcap [s], in which the robot moves and pauses, untouched; 0: none.
        wrench_rate: rate of the force/torque sensors [Hz].
    """
    _simulate("humanoid", output, seed, (seconds, touches, speed, wrench_rate), encoder, free)


def _simulate(
    name: str, output: Path, seed: int, settings: tuple[float, int, float, int], encoder: float, free: float
) -> None:
    """Check the options, of which settings are seconds, touches, speed and rate of wrenches; write the session."""
    seconds, touches, speed, wrench_rate = settings
    require_new(output)
    require_within(seed=(0, seed, 1 << 62), seconds=(6.0, seconds, 3600.0), touches=(0, touches, 100_000))
    require_within(speed=(0.01, speed, 2.0), encoder=(0.0, encoder, 5.0))
    if free:
        require_within(free=(6.0, free, 3600.0))
    if wrench_rate not in _RATES:
        raise InputError(f"must be one of {', '.join(map(str, _RATES))} Hz, not {wrench_rate}.", where="--wrench-rate")
    from palpate_lab.simulation.robot import bodies  # here: with them comes scipy
    from palpate_lab.simulation.robot.run import RobotRunSettings

    make = bodies.hand if name == "hand" else bodies.humanoid
    wait("starting the physics engine")
    with complete_session(output) as part, counting():
        robot = make(np.random.default_rng([seed, 0]))
        stated = RobotRunSettings(seconds, touches, speed, wrench_rate, float(np.radians(encoder)))
        run = _record(robot, stated, part, seed, free)
    title(f"{name}, seed {seed} -> {output}")
    lines(_figures(robot, run))
    note([_NOTE, f"palpate estimate {output / 'run.mcap'} --rig {output / 'robot.toml'} -o contacts.csv"])


def _record(robot: LabRobot, settings: RobotRunSettings, folder: Path, seed: int, free: float) -> RobotRun:
    """Simulate the runs, and write all files."""
    from palpate_lab.cli.robot_models import write_robot_models, write_robot_rig
    from palpate_lab.simulation.robot.files import write_robot, write_robot_log, write_robot_truth
    from palpate_lab.simulation.robot.run import RobotDevices, simulate_robot

    devices = RobotDevices.drawn(robot, np.random.default_rng([seed, 1]), settings.encoder)
    run = simulate_robot(robot, devices, settings, np.random.default_rng([seed, 2]), progress)
    write_robot(robot, folder)
    write_robot_log(robot, run, folder / "run.mcap")
    write_robot_truth(robot, run, folder / "truth.csv")
    if free:
        untouched = replace(settings, seconds=free, touches=0, pauses=True)
        log = simulate_robot(robot, devices, untouched, np.random.default_rng([seed, 3]), progress)
        write_robot_log(robot, log, folder / "free.mcap")
    write_robot_models(robot, np.random.default_rng([seed, 4]), folder)
    write_robot_rig(robot, folder, float(np.degrees(settings.encoder)))
    return run


def _figures(robot: LabRobot, run: RobotRun) -> list[tuple[str, object]]:
    at_once = np.bincount(run.contacts.frame, minlength=len(run.poses[0]))
    push = np.linalg.norm(run.contacts.force, axis=1).max(initial=0.0)
    joints = run.joints[:, 1]
    return [
        ("robot", f"{len(robot.links)} links, {joints.shape[1]} joints, up to {np.abs(joints).max():.2f} rad/s"),
        ("sensors", ", ".join(each.name for each in robot.sensors)),
        ("touches", f"{len(run.touches)}, up to {push:.1f} N"),
        ("touched", f"{(at_once > 0).mean():.0%} of the time, by {at_once.max()} at once at most"),
    ]
