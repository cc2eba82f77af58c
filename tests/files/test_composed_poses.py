"""Gravity from /tf above the robot, or from an IMU on a link: the sensor's pose is composed with the joints."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from claims.evidence.logs_written import header, vector, write_mcap
from claims.evidence.robot import FLANGE_SENSOR, KINDS, TYPES, URDF, WRENCH, Posture, joints, transform, wrench
from palpate.errors import InputError
from palpate.files.logs import LogLayout, read_recording
from palpate.signals.recording import ORIENTATION, POSITION, Recording

IMU = "/torso/imu"
ANGLES = np.random.default_rng(0).uniform(-1, 1, (9, 3))
TILTS = Rotation.from_rotvec(np.random.default_rng(1).uniform(-0.6, 0.6, (9, 3)))  # of the base in the world
PLACE = np.array([0.3, -0.2, 0.9])  # of the base in the world
STEP = 10**7  # ns


def _imu(stamp: int, frame: str, turn: Rotation, known: float = 0.0) -> Any:
    quaternion = TYPES["geometry_msgs/msg/Quaternion"](*turn.as_quat())
    covariance = np.full(9, known)
    nothing = vector(np.zeros(3))
    return TYPES["sensor_msgs/msg/Imu"](
        header(stamp, frame), quaternion, covariance, nothing, np.zeros(9), nothing, np.zeros(9)
    )


def _log(path: Path, more: list[tuple[int, str, Any]]) -> Path:
    rows = [(STEP * k, WRENCH, wrench(STEP * k, [k] * 6, "ft_sensor")) for k in range(9)]
    rows += [(STEP * k, "/joint_states", joints(STEP * k, ANGLES[k])) for k in range(9)]
    kinds = {**KINDS, IMU: "sensor_msgs/msg/Imu"}
    used = {name: kinds[name] for name in (WRENCH, "/joint_states", *dict.fromkeys(each[1] for each in more))}
    write_mcap(path, sorted([*rows, *more], key=lambda each: each[0]), used)
    (path.parent / "robot.urdf").write_text(URDF)
    return path


def _read(path: Path, base: str, **options: str) -> Recording:
    urdf = path.parent / "robot.urdf"
    return read_recording(path, LogLayout(wrench_topic=WRENCH, frames=(base, "ft_sensor"), urdf=urdf, **options))


def _in_base() -> tuple[Rotation, np.ndarray]:
    """Rotation and position of the sensor in the base, written out."""
    return Rotation.from_euler("ZYX", ANGLES) * FLANGE_SENSOR, Posture(ANGLES).positions()


def test_a_frame_of_tf_above_the_robot_is_composed_with_its_joints(tmp_path: Path) -> None:
    tree = TYPES["tf2_msgs/msg/TFMessage"]
    moved = [
        (STEP * k, "/tf", tree([transform(STEP * k, "odom", "base_link", PLACE.tolist(), TILTS[k].as_quat().tolist())]))
        for k in range(9)
    ]
    found = _read(_log(tmp_path / "log.mcap", moved), "odom")
    turn, place = _in_base()
    np.testing.assert_allclose(found.channels[POSITION], TILTS.apply(place) + PLACE, atol=1e-12)
    seen = Rotation.from_quat(found.channels[ORIENTATION])
    assert (seen * (TILTS * turn).inv()).magnitude().max() < 1e-12
    with pytest.raises(InputError, match=r"no frame 'odon' in /tf.*odom"):
        _read(tmp_path / "log.mcap", "odon")


def test_an_imu_on_a_link_says_where_gravity_is(tmp_path: Path) -> None:
    """The IMU is on the flange's first link, `shoulder`, which its frame names; messages without orientation count."""
    turn = Rotation.from_euler("Z", ANGLES[:, :1])
    rows = [(STEP * k, IMU, _imu(STEP * k, "shoulder", TILTS[k] * turn[k])) for k in range(9)]
    rows[4] = (STEP * 4, IMU, _imu(STEP * 4, "shoulder", TILTS[4], known=-1.0))
    path = _log(tmp_path / "log.mcap", rows)
    found = _read(path, "base_link", imu_topic=IMU)
    whole, kept = _in_base()[0], np.delete(np.arange(9), 4)
    seen = Rotation.from_quat(found.channels[ORIENTATION][kept])
    assert (seen * (TILTS * whole)[kept].inv()).magnitude().max() < 1e-12
    assert f"1 of 9 messages of '{IMU}' have no orientation" in found.notes
    with pytest.raises(InputError, match=r"no topic '/imu' of an IMU.*Available"):
        _read(path, "base_link", imu_topic="/imu")
