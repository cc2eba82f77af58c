"""A table with columns of joints: the sensor's pose is that of a chain computed by itself, alone and on a robot."""

import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation

import palpate
from claims.evidence.logs_written import write_mcap
from claims.evidence.robot import FLANGE_SENSOR, KINDS, MOVING, URDF, WRENCH, Posture, joints, wrench
from palpate.signals.recording import ORIENTATION, POSITION

COUNT = 200
RIG = """
[surface]
kind = "sphere"
radius = 0.05

[force_torque]
noise = { force = 0.02, torque = 0.001 }

[orientation]
urdf = "robot.urdf"
base = "base_link"
sensor = "ft_sensor"
joints = { shoulder_joint = "q0", flange_joint = "q2", elbow_joint = "q1" }
"""
ROBOT = """
[robot]
urdf = "robot.urdf"
joints = { shoulder_joint = "q0", flange_joint = "q2", elbow_joint = "q1", finger = "q9" }
base = "base_link"
gravity = "fixed"

[sensors.wrist]
kind = "force_torque"
link = "ft_sensor"
noise = { force = 0.02, torque = 0.001 }
surface = { kind = "sphere", radius = 0.05 }
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A log of COUNT rows in which the robot moves, its URDF, and both rigs."""
    time = 0.01 * np.arange(COUNT)
    wrench = np.random.default_rng(1).normal(size=(6, COUNT)) * 0.02
    columns = dict(zip(("fx", "fy", "fz", "tx", "ty", "tz"), wrench, strict=True))
    joints = dict(zip(("q0", "q1", "q2"), _angles(time).T, strict=True))
    pl.DataFrame({"time": time, **columns, **joints}).write_csv(tmp_path / "log.csv")
    (tmp_path / "robot.urdf").write_text(URDF)
    (tmp_path / "rig.toml").write_text(RIG)
    (tmp_path / "robot.toml").write_text(ROBOT)
    return tmp_path


def _angles(time: np.ndarray) -> np.ndarray:
    return np.array([0.9, -0.4, 0.6]) * np.sin(np.outer(time, [2.0, 3.0, 1.0]) + np.array([0.1, 0.2, 0.3]))


def _expected(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Quaternion and position of the sensor, from the numbers that the URDF was written from."""
    a, b, c = (Rotation.from_euler(axis, angles[:, [k]]) for k, (_, _, axis) in enumerate(MOVING))
    return (a * b * c * FLANGE_SENSOR).as_quat(canonical=True), Posture(angles).positions()


@pytest.mark.parametrize("name", ["rig.toml", "robot.toml"])
def test_columns_of_joints_pose_the_sensor(folder: Path, name: str) -> None:
    rig = palpate.load_rig(folder / name)
    with palpate.open_log(folder / "log.csv", rig) as opened:
        blocks = list(opened)
    turn, place = _expected(_angles(np.concatenate([block.time for block in blocks])))
    found = np.concatenate([block.channels[ORIENTATION] for block in blocks])
    signs = np.sign(np.sum(found * turn, axis=1, keepdims=True))
    np.testing.assert_allclose(found * signs, turn, atol=1e-12)
    np.testing.assert_allclose(np.concatenate([block.channels[POSITION] for block in blocks]), place, atol=1e-12)
    table = pl.read_csv(folder / "log.csv")
    pl.concat([table, table]).sort("time", maintain_order=True).write_csv(folder / "log.csv")
    again = palpate.open_log(folder / "log.csv", rig).head()  # of two recorders at once
    np.testing.assert_array_equal(again.time, np.concatenate([block.time for block in blocks]))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"q1"', '"q7"', "q7"),
        (', elbow_joint = "q1"', "", "joint 'elbow_joint' moves the sensor, and no column is named for it"),
        ('urdf = "robot.urdf"', "", "need a urdf"),
        ("[orientation]", "[orientation]\ncolumns = ['a', 'b', 'c', 'd']", "exclude columns of an orientation"),
    ],
)
def test_columns_that_cannot_pose_it_are_refused(folder: Path, old: str, new: str, said: str) -> None:
    rig = folder / "rig.toml"
    rig.write_text(rig.read_text().replace(old, new))
    with pytest.raises(palpate.InputError, match=re.escape(said)):
        palpate.estimate(folder / "log.csv", rig)


def test_joints_in_degrees_are_refused_and_a_missing_position_is_no_pose(folder: Path) -> None:
    table = pl.read_csv(folder / "log.csv")
    table.with_columns(q1=57.3 * pl.col("q1") + 180.0).write_csv(folder / "log.csv")
    with pytest.raises(palpate.InputError, match="seems to be in degrees"):
        palpate.estimate(folder / "log.csv", folder / "rig.toml")
    table.with_columns(q1=pl.when(pl.col("time") == 0.5).then(None).otherwise(pl.col("q1"))).write_csv(
        folder / "log.csv"
    )
    rig = palpate.load_rig(folder / "rig.toml")
    with palpate.open_log(folder / "log.csv", rig) as opened:
        found = np.concatenate([block.channels[ORIENTATION] for block in opened])
    assert np.flatnonzero(np.isnan(found).any(axis=1)).tolist() == [50]


def test_a_log_of_topics_has_no_columns_of_joints(folder: Path) -> None:
    messages = [(k, WRENCH, wrench(k, [0.0] * 6, "ft_sensor")) for k in range(9)]
    messages += [(k, "/joint_states", joints(k, np.zeros(3))) for k in range(9)]
    write_mcap(folder / "log.mcap", sorted(messages, key=lambda each: each[0]), KINDS)
    with pytest.raises(palpate.InputError, match="has topics, but the rig names columns as joints"):
        palpate.estimate(folder / "log.mcap", folder / "rig.toml")
