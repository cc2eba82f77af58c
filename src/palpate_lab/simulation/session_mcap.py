"""Write a simulated session as a robot would record it: wrenches and poses on topics of an MCAP file, on two clocks."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from palpate.signals.recording import ORIENTATION, Recording
from palpate_lab.simulation.bags import Stamped, poses, wrenches, write_bag
from palpate_lab.simulation.session import Session
from palpate_lab.simulation.session_files import POSE_TOPIC, WRENCH_TOPIC

CLOCK_OFFSET = 0.030  # s by which the arm's clock is behind the sensor's
POSE_EVERY = 2  # samples: poses come at half the rate
POSITION = (0.4, 0.0, 0.6)  # m: the arm turns the sensor about its origin


def write_session_mcap(session: Session, folder: Path) -> None:
    """Write free_motion.mcap and touches.mcap: WrenchStamped at 200 Hz, PoseStamped at 100 Hz, its stamps 30 ms late.

    Raises:
        InputError: rosbags is not installed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name, recording in (("free_motion", session.free_motion), ("touches", session.touches)):
        _write(recording, folder / f"{name}.mcap")


def _write(recording: Recording, path: Path) -> None:
    def made(types: Any) -> Iterable[Iterable[Stamped]]:
        time, quaternions = recording.time[::POSE_EVERY] - CLOCK_OFFSET, recording.channels[ORIENTATION][::POSE_EVERY]
        return (
            wrenches(types, WRENCH_TOPIC, recording.time, recording.wrenches()),
            poses(types, POSE_TOPIC, time, quaternions, POSITION),
        )

    write_bag(
        path,
        {WRENCH_TOPIC: "geometry_msgs/msg/WrenchStamped", POSE_TOPIC: "geometry_msgs/msg/PoseStamped"},
        made,
    )
