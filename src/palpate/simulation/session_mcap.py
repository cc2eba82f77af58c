"""A simulated session as a robot would record it: wrenches and poses on topics of an MCAP file, with a clock each."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from palpate.sensors.recording import ORIENTATION, Recording
from palpate.simulation.bags import Stamped, header, nanoseconds, wrenches, write_bag
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
    def made(types: Any) -> Iterable[Iterable[Stamped]]:
        return wrenches(types, WRENCH_TOPIC, recording.time, recording.wrenches()), _poses(recording, types)

    write_bag(
        path,
        {WRENCH_TOPIC: "geometry_msgs/msg/WrenchStamped", POSE_TOPIC: "geometry_msgs/msg/PoseStamped"},
        made,
    )


def _poses(recording: Recording, types: Any) -> Iterator[Stamped]:
    point, turn, pose, stamped = (
        types[f"geometry_msgs/msg/{name}"] for name in ("Point", "Quaternion", "Pose", "PoseStamped")
    )
    stamps = nanoseconds(recording.time[::POSE_EVERY] - CLOCK_OFFSET)
    for stamp, row in zip(stamps, recording.channels[ORIENTATION][::POSE_EVERY].tolist(), strict=True):
        if stamp >= 0:
            yield stamp, POSE_TOPIC, stamped(header(types, stamp, "base"), pose(point(*POSITION), turn(*row)))
