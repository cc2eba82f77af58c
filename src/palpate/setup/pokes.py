"""The [pokes] of a rig: the link's pose in the sensor's frame during pokes of a skin, and priors of its taxels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import radians
from pathlib import Path

from palpate.files.schema import INFINITE
from palpate.setup.tables import RigPose, require_path, require_positive


@dataclass(frozen=True)
class RigPriors:
    """Standard deviations of the errors of sensor, robot and skin while taxels are located; angles in degrees.

    `palpate.sensors.taxels.poking.Priors` explains each and has the default that None stands for.

    Raises:
        ValueError: one is negative, or `lever` is not positive.
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
        """Return the standard deviations that are not None as a dict, name -> value, with angles in radians."""
        known = {name: value for name, value in vars(self).items() if value is not None}
        return {name: radians(value) if name.endswith("angle") else value for name, value in known.items()}


@dataclass(frozen=True)
class RigPokes:
    """The [pokes] of a rig: the link's pose in the sensor's frame, and the settings by which taxels are located.

    `sensor` and `link` are frames of /tf, or links of a `urdf` that is moved by the joint states of the topic `joints`
    or by a table's columns with the joints' names. Otherwise the pose comes from `columns` (quaternion x, y, z, w) and
    `position` [m] of a table, a `topic` of poses, or a constant `pose`. `offset` and `max_gap` [s] are as in
    [orientation].

    A taxel responds if its reading exceeds its baseline by the `threshold`; None: it is determined from the log.
    `layout` of the modules is a name such as "ring12" or a file of taxels; `start` is a file of expected taxels (CAD).

    Raises:
        ValueError: a value is out of bounds, keys that belong together are incomplete, or several state the pose.
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
            pose = "the pose is that of the frame link in the frame sensor"
            raise ValueError(f"sensor and link must be given together: {pose}")
        if self.urdf is not None and self.link is None:
            raise ValueError("urdf needs sensor and link, the names of two of its links")
        if self.joints is not None and self.urdf is None:
            raise ValueError("joints needs a urdf, which states what they move")
        ways = {"sensor and link": self.link, "columns": self.columns, "topic": self.topic, "pose": self.pose}
        given = [name for name, value in ways.items() if value is not None]
        if len(given) > 1:
            raise ValueError(f"{' and '.join(given)} exclude each other: the link has one pose in the sensor's frame")
        if (self.columns is None) != (self.position is None):
            raise ValueError("columns and position must be given together: the link's orientation and its position")

    def files(self, folder: Path) -> Mapping[str, Path]:
        """Return a dict, key -> path, of the files that the table names: "kinematics" (URDF), "start", "layout"."""
        named = {"kinematics": self.urdf, "start": self.start}
        if self.layout is not None and Path(self.layout).suffix:
            named["layout"] = self.layout
        return {name: folder / path for name, path in named.items() if path is not None}
