"""Logs of robots that are made in seconds: a simulated hand, and an arm that turns once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.cli import main
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


def small_hand(folder: Path) -> Path:
    """A hand for eight seconds, with five fingertips, roughly calibrated pads and ten touches."""
    options = ("--seconds", "8", "--touches", "10", "--free", "6", "--seed", "5", "-o", str(folder))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("palpate_lab.cli.robot_models._PRESSES", 40)
        assert main(["simulate", "hand", *options]) == 0
    return folder


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
    wrench = np.zeros((len(TIME), 6))
    wrench[:, 2] = force
    wrench[:, 3:] = np.cross(AT, wrench[:, :3])
    wrench += rng.normal(size=wrench.shape) * [0.02, 0.02, 0.02, 0.001, 0.001, 0.001]
    rows = np.column_stack([TIME, wrench, np.where(TIME < 2.2, 0.0, TURN)])
    np.savetxt(folder / "run.csv", rows, delimiter=",", header="time,fx,fy,fz,tx,ty,tz,q", comments="", fmt="%.9g")
    return folder
