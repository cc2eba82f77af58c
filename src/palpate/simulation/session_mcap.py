"""A simulated session as a robot would record it: wrenches and poses on topics of an MCAP file, with a clock each.

Written by rosbags, message by message, so that what is read later was not written by the code that reads it.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from palpate.errors import InputError
from palpate.sensors.recording import ORIENTATION, Recording
from palpate.simulation.session import Session
from palpate.simulation.session_files import POSE_TOPIC, WRENCH_TOPIC

__all__ = ["CLOCK_OFFSET", "write_session_mcap"]

CLOCK_OFFSET = 0.030  # s: the arm's clock is so much behind the sensor's
POSE_EVERY = 2  # samples: poses come at half the rate
POSITION = (0.4, 0.0, 0.6)  # m: the arm turns the sensor about its origin


def write_session_mcap(session: Session, folder: Path) -> None:
    """Write free_motion.mcap and touches.mcap: WrenchStamped at 200 Hz, PoseStamped at 100 Hz, 30 ms behind.

    Raises:
        InputError: rosbags is not installed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name, recording in (("free_motion", session.free_motion), ("touches", session.touches)):
        _write(recording, folder / f"{name}.mcap")


def _write(recording: Recording, path: Path) -> None:
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as problem:
        raise InputError("writing MCAP needs rosbags.", hint="pip install 'palpate[ros]'") from problem
    store = get_typestore(Stores.ROS2_HUMBLE)
    messages = sorted([*_wrenches(recording, store.types), *_poses(recording, store.types)], key=lambda each: each[0])
    with tempfile.TemporaryDirectory(dir=path.parent) as scratch:  # rosbags writes a folder with one MCAP in it
        bag = Path(scratch) / "bag"
        with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            topics = {
                topic: writer.add_connection(topic, kind, typestore=store)
                for topic, kind in (
                    (WRENCH_TOPIC, "geometry_msgs/msg/WrenchStamped"),
                    (POSE_TOPIC, "geometry_msgs/msg/PoseStamped"),
                )
            }
            for stamp, topic, message in messages:
                writer.write(topics[topic], stamp, store.serialize_cdr(message, topics[topic].msgtype))
        shutil.move(bag / "bag.mcap", path)


def _wrenches(recording: Recording, types: Any) -> list[tuple[int, str, Any]]:
    vector, wrench, stamped = (types[f"geometry_msgs/msg/{name}"] for name in ("Vector3", "Wrench", "WrenchStamped"))
    stamps = _nanoseconds(recording.time)
    return [
        (stamp, WRENCH_TOPIC, stamped(_header(types, stamp, "ft_sensor"), wrench(vector(*row[:3]), vector(*row[3:]))))
        for stamp, row in zip(stamps, recording.wrenches().tolist(), strict=True)
    ]


def _poses(recording: Recording, types: Any) -> list[tuple[int, str, Any]]:
    point, turn, pose, stamped = (
        types[f"geometry_msgs/msg/{name}"] for name in ("Point", "Quaternion", "Pose", "PoseStamped")
    )
    stamps = _nanoseconds(recording.time[::POSE_EVERY] - CLOCK_OFFSET)
    return [
        (stamp, POSE_TOPIC, stamped(_header(types, stamp, "base"), pose(point(*POSITION), turn(*row))))
        for stamp, row in zip(stamps, recording.channels[ORIENTATION][::POSE_EVERY].tolist(), strict=True)
        if stamp >= 0
    ]


def _header(types: Any, stamp: int, frame: str) -> Any:
    seconds, nanoseconds = divmod(stamp, 10**9)
    return types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](seconds, nanoseconds), frame)


def _nanoseconds(time: np.ndarray) -> list[int]:
    return np.rint(time * 1e9).astype(np.int64).tolist()
