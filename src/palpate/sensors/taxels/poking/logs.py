"""Read a log of pokes: wrenches with the pose of the link in the sensor's frame, and frames of taxels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.errors import InputError
from palpate.files.logs import Log, Stored, contents, open_log
from palpate.files.logs.layout import ArrayChannel, LogLayout
from palpate.files.logs.topics import NONE
from palpate.files.urdf import Kinematics, Urdf
from palpate.sensors.taxels.section import SKIN
from palpate.setup.pokes import RigPokes
from palpate.setup.setup import Setup
from palpate.signals.recording import ORIENTATION, POSITION, Recording

__all__ = ["WRENCH", "open_pokes"]

WRENCH = "force_torque"  # name of the sensor that measures the pokes
_JOINTS = "joints"


def _wrench_layout(setup: Setup) -> LogLayout:
    """Return the layout of wrenches, with poses of the link in the sensor's frame."""
    table, there = setup.pokes or RigPokes(), setup.sensors.get(WRENCH)
    if there is not None and there.table.frame != "sensor":
        raise InputError(
            "wrenches of pokes must be in the sensor's frame, in which the link is known.",
            where="force_torque.frame",
            hint='Log the wrench as the sensor reads it, and state frame = "sensor".',
        )
    return replace(
        LogLayout(**setup.common) if there is None else there.kind.layout(setup),
        orientation=table.columns,
        position=table.position,
        orientation_topic=NONE if table.pose is not None else table.topic,
        frames=None if table.sensor is None or table.link is None else (table.sensor, table.link),
        urdf=None if table.urdf is None else setup.link.folder / table.urdf,
        joints_topic=table.joints,
        acceleration=None,
        acceleration_topic=None,
        offset=table.offset,
        max_gap=table.max_gap,
    )


def open_pokes(path: Path, setup: Setup) -> tuple[Log, Log, Iterator[Recording | Stored]]:
    """Return a `Log` of wrenches, a `Log` of taxel frames, and an iterator over blocks of both with link poses.

    In a table, with a `urdf` in [pokes], the joints between sensor and link are columns with their names [rad].

    Raises:
        InputError: the log, urdf or a rig file cannot be read, an extra is missing (rosbags, pinocchio), the wrench is
            not in the sensor's frame, or a joint is missing; while iterating, also if joints are in degrees.
    """
    layout, frames = _wrench_layout(setup), open_log(path, _cells_layout(setup))
    if layout.urdf is None or layout.frames is None or not contents(path).names:
        log = open_log(path, layout)
        return log, frames, log.merged_with(frames)
    kinematics = Kinematics(Urdf(layout.urdf), *layout.frames)
    joints = ArrayChannel(_JOINTS, (len(kinematics.joints),), kinematics.joints, table="pokes")
    log = open_log(path, replace(layout, frames=None, urdf=None, joints_topic=None, arrays=(joints,)))
    parts = (_posed(part, kinematics) if isinstance(part, Recording) else part for part in log.merged_with(frames))
    return log, frames, parts


def _posed(block: Recording, kinematics: Kinematics) -> Recording:
    """Return the block with poses in place of joints."""
    channels = dict(block.channels)
    values = channels.pop(_JOINTS)
    known = np.isfinite(values).all(axis=1)
    kinematics.require_radians(values[known], block.source)
    quaternion, position = np.full((len(block), 4), np.nan), np.full((len(block), 3), np.nan)
    if known.any():
        quaternion[known], position[known] = kinematics.poses(values[known])
    return replace(block, channels={**channels, ORIENTATION: quaternion, POSITION: position})


def _cells_layout(setup: Setup) -> LogLayout:
    """Return the layout of frames of taxels, without poses."""
    return replace(
        SKIN.layout(setup),
        orientation=None,
        position=None,
        orientation_topic=NONE,
        frames=None,
        urdf=None,
        joints_topic=None,
        acceleration=None,
        acceleration_topic=None,
    )
