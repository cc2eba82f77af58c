"""Pokes of a skin in a rig: where the link is in the sensor's frame, and what is known of the taxels before."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.errors import InputError
from palpate.io.logs import Log, Stored, contents, open_log
from palpate.io.logs.layout import ArrayChannel, Layout
from palpate.io.logs.topics import NONE
from palpate.io.rig.surface import RigPose
from palpate.io.rig.tables import require_path, require_positive
from palpate.io.schema import INFINITE
from palpate.io.urdf import Kinematics, Urdf
from palpate.sensors.recording import ORIENTATION, POSITION, Recording

if TYPE_CHECKING:
    from palpate.io.rig.rig import Rig

__all__ = ["RigPokes", "RigPriors", "cells_layout", "open_pokes", "wrench_layout"]

_JOINTS = "joints"


@dataclass(frozen=True)
class RigPriors:
    """Standard deviations of errors of sensor and robot: see `palpate.calibration.taxels.Priors`; angles in degrees.

    What is left out has its default there.
    """

    bias_force: float | None = None
    bias_torque: float | None = None
    frame: float | None = None
    frame_angle: float | None = None
    common: float | None = None
    common_angle: float | None = None
    cross_talk: float | None = None
    lever: float | None = None
    start: float | None = field(default=None, metadata=INFINITE)
    start_angle: float | None = field(default=None, metadata=INFINITE)
    smooth: float | None = field(default=None, metadata=INFINITE)
    neighbours: float | None = None
    spacing: float | None = field(default=None, metadata=INFINITE)

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value is not None and not value >= 0:
                raise ValueError(f"{name} must not be negative")
        require_positive(self, "lever")

    def stated(self) -> dict[str, float]:
        """Those that are, with angles in radians."""
        known = {name: value for name, value in vars(self).items() if value is not None}
        return {name: radians(value) if name.endswith("angle") else value for name, value in known.items()}


@dataclass(frozen=True)
class RigPokes:
    """The link in the sensor's frame, and what pokes start from.

    `sensor` and `link` are frames of /tf, or links of a `urdf` that is moved by the `joints` of a topic of joint
    states, or by columns of their names in a table. Else `columns` (quaternion x, y, z, w) and `position` of a table, a
    `topic` of poses, or a `pose` that stays say where the link is in the sensor's frame. `offset` and `max_gap` [s] are
    as in [orientation].

    `threshold`: a taxel answers where it stands so far above its rest; found where it is left out. `layout` of the
    modules: a name such as "ring12", or a file of taxels; `start`: a file of where taxels are thought to be (CAD).
    """

    sensor: str | None = None
    link: str | None = None
    urdf: str | None = None
    joints: str | None = None
    columns: tuple[str, str, str, str] | None = None
    position: tuple[str, str, str] | None = None
    topic: str | None = None
    pose: RigPose | None = None
    offset: float = 0.0
    max_gap: float = 0.25
    threshold: float | None = None
    layout: str | None = None
    start: str | None = None
    priors: RigPriors = field(default_factory=RigPriors)

    def __post_init__(self) -> None:
        require_positive(self, "max_gap", "threshold")
        for name in ("urdf", "start", "layout"):
            require_path(name, getattr(self, name))
        if (self.sensor is None) != (self.link is None):
            raise ValueError("sensor and link belong together: two frames, one of them in the other")
        if self.urdf is not None and self.link is None:
            raise ValueError("urdf needs sensor and link: two of its links")
        if self.joints is not None and self.urdf is None:
            raise ValueError("joints needs a urdf, which says what they move")
        ways = {"sensor and link": self.link, "columns": self.columns, "topic": self.topic, "pose": self.pose}
        given = [name for name, value in ways.items() if value is not None]
        if len(given) > 1:
            raise ValueError(f"{' and '.join(given)} exclude each other: the link has one pose in the sensor's frame")
        if (self.columns is None) != (self.position is None):
            raise ValueError("columns and position belong together: the link's orientation and its place")

    def files(self, folder: Path) -> Mapping[str, Path]:
        """What it names: what each is -> where."""
        named = {"kinematics": self.urdf, "start": self.start}
        if self.layout is not None and Path(self.layout).suffix:
            named["layout"] = self.layout
        return {name: folder / path for name, path in named.items() if path is not None}


def wrench_layout(rig: Rig) -> Layout:
    """How wrenches are read, each with the pose of the link in the sensor's frame where a Layout has the sensor's.

    Raises:
        InputError: the wrench is not in the sensor's frame.
    """
    table = rig.pokes or RigPokes()
    if rig.force_torque.frame != "sensor":
        raise InputError(
            "wrenches of pokes must be in the sensor's frame, which the link is known in.",
            where="force_torque.frame",
            hint='Log the wrench as the sensor reads it, and state frame = "sensor".',
        )
    return replace(
        rig.layout("force_torque") if "force_torque" in rig.sensors else Layout(**rig.common()),
        orientation=table.columns,
        position=table.position,
        orientation_topic=NONE if table.pose is not None else table.topic,
        frames=None if table.sensor is None or table.link is None else (table.sensor, table.link),
        urdf=None if table.urdf is None else rig.folder / table.urdf,
        joints_topic=table.joints,
        acceleration=None,
        acceleration_topic=None,
        offset=table.offset,
        max_gap=table.max_gap,
    )


def open_pokes(path: Path, rig: Rig) -> tuple[Log, Log, Iterator[Recording | Stored]]:
    """A log for its wrenches and for its frames of taxels, and both: wrenches with the link where the log says it.

    Of a table with a `urdf`, the joints between sensor and link are columns of their names [rad].

    Raises:
        InputError: the log cannot be read, or a joint is missing or in degrees.
    """
    layout, frames = wrench_layout(rig), open_log(path, cells_layout(rig))
    if layout.urdf is None or layout.frames is None or not contents(path).names:
        log = open_log(path, layout)
        return log, frames, log.beside(frames)
    kinematics = Kinematics(Urdf(layout.urdf), *layout.frames)
    joints = ArrayChannel(_JOINTS, (len(kinematics.joints),), kinematics.joints, table="pokes")
    log = open_log(path, replace(layout, frames=None, urdf=None, joints_topic=None, arrays=(joints,)))
    parts = (_posed(part, kinematics) if isinstance(part, Recording) else part for part in log.beside(frames))
    return log, frames, parts


def _posed(block: Recording, kinematics: Kinematics) -> Recording:
    """With poses in place of joints."""
    values = block.channels[_JOINTS]
    known = np.isfinite(values).all(axis=1)
    kinematics.require_radians(values[known], block.source)
    quaternion, position = np.full((len(block), 4), np.nan), np.full((len(block), 3), np.nan)
    if known.any():
        quaternion[known], position[known] = kinematics.poses(values[known])
    kept = {name: each for name, each in block.channels.items() if name != _JOINTS}
    return replace(block, channels={**kept, ORIENTATION: quaternion, POSITION: position})


def cells_layout(rig: Rig) -> Layout:
    """How frames of taxels are read, without poses."""
    layout = rig.layout("skin")
    return replace(
        layout,
        orientation=None,
        position=None,
        orientation_topic=NONE,
        frames=None,
        urdf=None,
        joints_topic=None,
        acceleration=None,
        acceleration_topic=None,
    )
