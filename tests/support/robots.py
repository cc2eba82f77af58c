"""Logs of robots that are made in seconds: a simulated hand, an arm that turns once, two sensors of an arm."""

import fcntl
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

from claims.evidence.logs_written import write_mcap
from claims.evidence.robot import KINDS, URDF, WRENCH, joints, wrench
from claims.evidence.three_axis_skins import few_folds
from palpate.cli import main
from palpate_lab.cli import robot_models
from tests.support.arms import joint

TIME = np.arange(400) / 100.0
AT = np.array([0.3, 0.02, 0.05])  # in the link, on its upper side
ABOVE = np.array([0.0, 0.0, 1.0])  # from the base to the joint
TURN = 0.7  # rad, of the second touch
ROBOT = """\
[robot]
urdf = "arm.urdf"
joints = { turn = "q" }
base = "base"
gravity = "fixed"

[sensors.arm]
kind = "force_torque"
link = "arm"
noise = { force = 0.02, torque = 0.001 }
"""
STEP, COUNT = 5 * 10**6, 600  # ns between samples, and how many
OTHER, JOINTS = "/other", "/joint_states"
SENSOR = """
[sensors.{name}]
kind = "force_torque"
link = "{link}"
noise = {{ force = 0.02, torque = 0.001 }}
surface = {{ kind = "sphere", radius = 0.05 }}
topic = "{topic}"
estimate = {{ tare = 0.2 }}
source = {{ kind = "replay", address = "{log}", speed = {speed} }}
"""


@contextmanager
def rough_pads() -> Iterator[None]:
    """Pads of simulated robots are calibrated with few presses: in two seconds instead of five."""
    with few_folds(True), mock.patch.object(robot_models, "_PRESSES", 40):
        yield


def small_hand(made: pytest.TempPathFactory) -> Path:
    """A hand for eight seconds, with five fingertips, roughly calibrated pads and ten touches; made once a run."""
    base = made.getbasetemp()
    kept = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "small_hand"
    with rough_pads(), kept.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not kept.exists():
            options = ("--seconds", "8", "--touches", "10", "--free", "6", "--seed", "5", "-o", str(kept))
            assert main(["simulate", "hand", *options]) == 0
    return Path(shutil.copytree(kept, made.mktemp("robot") / "hand"))


def rotation(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])


def turning_arm(folder: Path) -> Path:
    """Write a log of an arm that turns once, and is touched at one place of its link before and after."""
    box = '<visual><origin xyz="0.2 0 0"/><geometry><box size="0.4 0.1 0.1"/></geometry></visual>'
    turn = joint("turn", "revolute", "base", "arm", more='<origin xyz="0 0 1"/><axis xyz="0 0 1"/>')
    (folder / "arm.urdf").write_text(f'<robot name="a"><link name="base"/><link name="arm">{box}</link>{turn}</robot>')
    (folder / "robot.toml").write_text(ROBOT)
    rng = np.random.default_rng(1)
    force = np.where(((TIME > 1) & (TIME < 1.5)), -2.0, 0.0) + np.where((TIME > 3) & (TIME < 3.5), -5.0, 0.0)
    wrenches = np.zeros((len(TIME), 6))
    wrenches[:, 2] = force
    wrenches[:, 3:] = np.cross(AT, wrenches[:, :3])
    wrenches += rng.normal(size=wrenches.shape) * [0.02, 0.02, 0.02, 0.001, 0.001, 0.001]
    rows = np.column_stack([TIME, wrenches, np.where(TIME < 2.2, 0.0, TURN)])
    np.savetxt(folder / "run.csv", rows, delimiter=",", header="time,fx,fy,fz,tx,ty,tz,q", comments="", fmt="%.9g")
    return folder


def two_sensors(folder: Path, speed: float, *more: str) -> Path:
    """A rig of two sensors, and of those in `more`, whose logs are not there; and the log, with pushes and motion."""
    (folder / "robot.urdf").write_text(URDF)
    rng = np.random.default_rng(3)
    messages = list[tuple[int, str, object]]()
    for k in range(COUNT):
        push = 4.0 * max(0.0, np.sin(k / 25)) if k > 60 else 0.0
        for topic, frame, way in ((WRENCH, "ft_sensor", 0), (OTHER, "shoulder", 2)):
            values = rng.normal(size=6) * ([0.02] * 3 + [0.001] * 3)
            values[way] -= push
            messages.append((STEP * k, topic, wrench(STEP * k, values.tolist(), frame)))
        messages.append((STEP * k, JOINTS, joints(STEP * k, np.array([0.1, -0.4, 0.2]) * np.sin(k / 90))))
    write_mcap(folder / "log.mcap", messages, {**KINDS, OTHER: KINDS[WRENCH]})
    text = '[robot]\nurdf = "robot.urdf"\njoints = "/joint_states"\nbase = "base_link"\ngravity = "fixed"\n'
    stated = [("wrist", "ft_sensor", WRENCH, "log.mcap"), ("elbow", "shoulder", OTHER, "log.mcap")]
    stated += [(name, "shoulder", f"/{name}", "nowhere.mcap") for name in more]
    for name, link, topic, log in stated:
        text += SENSOR.format(name=name, link=link, topic=topic, log=log, speed=speed)
    rig = folder / "robot.toml"
    rig.write_text(text)
    return rig
