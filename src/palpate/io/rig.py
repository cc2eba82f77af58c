"""The rig: one TOML that a person writes, and what it builds."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from palpate.contact.estimator import Estimator
from palpate.contact.locate import Locator
from palpate.errors import InputError
from palpate.io.csv import Layout, axis_matrix
from palpate.io.models import load_toml, read_payload
from palpate.io.strict import parse
from palpate.io.units import FORCE_UNITS, TIME_UNITS, TORQUE_UNITS, to_si
from palpate.sensors.force_torque import ForceTorque, Payload
from palpate.spatial.pose import Pose
from palpate.surfaces.mesh import UNITS, Mesh
from palpate.surfaces.plane import plane

__all__ = ["Rig", "RigEstimate", "RigForceTorque", "RigSurface", "build", "load_rig"]

Three = tuple[float, float, float]
Four = tuple[float, float, float, float]
Six = tuple[str, str, str, str, str, str]


@dataclass(frozen=True)
class RigPose:
    """Of the surface in the sensor's frame [m]."""

    xyz: Three = (0.0, 0.0, 0.0)
    quaternion_xyzw: Four = (0.0, 0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        if abs(np.linalg.norm(self.quaternion_xyzw) - 1.0) > 0.01:
            raise ValueError(
                f"quaternion_xyzw {list(self.quaternion_xyzw)} is not of length 1 (the order is x, y, z, w)"
            )

    def pose(self) -> Pose:
        """As a value."""
        return Pose.from_quaternion(self.quaternion_xyzw, self.xyz)


@dataclass(frozen=True)
class RigRegion:
    """The part of the mesh that can be touched: a box in the mesh's frame [m], or facets counted from 0."""

    box: tuple[Three, Three] | None = None
    facets: tuple[int, ...] | None = None


@dataclass(frozen=True)
class RigSurface:
    """What is touched: `mesh` with its `unit`, or kind = "plane" with a `point` [m], a `normal` and a `half_width`."""

    kind: str = "mesh"
    mesh: str | None = None
    unit: str | None = None
    crease: float = 30.0
    region: RigRegion = field(default_factory=RigRegion)
    point: Three = (0.0, 0.0, 0.0)
    normal: Three = (0.0, 0.0, 1.0)
    half_width: float = 1.0
    pose: RigPose = field(default_factory=RigPose)
    pose_covariance: tuple[tuple[float, ...], ...] | None = None

    def __post_init__(self) -> None:
        if self.kind not in ("mesh", "plane"):
            raise ValueError(f"kind must be 'mesh' or 'plane', not {self.kind!r}")
        if self.kind == "mesh" and self.mesh is None:
            raise ValueError("mesh is missing: the file of the surface")
        if self.kind == "mesh" and self.unit not in UNITS:
            raise ValueError(f"unit of the mesh must be one of {', '.join(UNITS)}, not {self.unit!r}")
        if self.pose_covariance is not None and np.shape(self.pose_covariance) != (6, 6):
            raise ValueError("pose_covariance must be 6 x 6, of rotation [rad] and translation [m]")

    def load(self, folder: Path) -> Mesh:
        """The surface, in metres; a relative path starts at `folder`."""
        if self.kind == "plane":
            return plane(self.point, self.normal, self.half_width)
        region = self.region.box if self.region.box is not None else self.region.facets
        return Mesh.load(folder / str(self.mesh), unit=str(self.unit), crease=radians(self.crease), region=region)


@dataclass(frozen=True)
class RigUnits:
    """Units of the log."""

    force: str = "N"
    torque: str = "N m"


@dataclass(frozen=True)
class RigPair:
    """One figure for the three forces [N] and one for the three torques [N m], or three each."""

    force: float | Three
    torque: float | Three

    def __post_init__(self) -> None:
        if np.min(self.force) <= 0 or np.min(self.torque) <= 0:
            raise ValueError("force and torque must be positive")

    def six(self) -> Float[np.ndarray, "6"]:
        """Force first."""
        return np.concatenate([np.broadcast_to(self.force, 3), np.broadcast_to(self.torque, 3)])


@dataclass(frozen=True)
class RigForceTorque:
    """How the wrench stands in the log, and what the sensor is."""

    columns: Six = ("fx", "fy", "fz", "tx", "ty", "tz")
    topic: str | None = None
    units: RigUnits = field(default_factory=RigUnits)
    axes: tuple[str, str, str] = ("x", "y", "z")
    left_handed: bool = False
    frame: str = "sensor"
    noise: RigPair | None = None
    range: RigPair | None = None
    payload: str | None = None

    def __post_init__(self) -> None:
        if self.topic is not None:
            raise ValueError("topic: logs with topics are not read yet; name the columns of a CSV file")
        if self.frame not in ("sensor", "base"):
            raise ValueError(f"frame must be 'sensor' or 'base', not {self.frame!r}")


@dataclass(frozen=True)
class RigTime:
    """The column of the time and its unit."""

    column: str = "time"
    unit: str = "s"


@dataclass(frozen=True)
class RigOrientation:
    """Columns of the sensor in the base: quaternion x, y, z, w, and (for answers in the base frame) position [m]."""

    columns: tuple[str, str, str, str] | None = None
    position: tuple[str, str, str] | None = None


@dataclass(frozen=True)
class RigAcceleration:
    """Columns of the sensor's acceleration in its own frame [m/s^2]."""

    columns: tuple[str, str, str] | None = None


@dataclass(frozen=True)
class RigThresholds:
    """Force [N] at which a contact begins, and below which it ends."""

    on: float
    off: float

    def __post_init__(self) -> None:
        if not 0 <= self.off <= self.on:
            raise ValueError(f"off ({self.off:g}) must lie between 0 and on ({self.on:g})")


@dataclass(frozen=True)
class RigEstimate:
    """How contacts are located: see `palpate.Locator`."""

    method: str = "soft_finger"
    friction: float = 1.0
    torsion: float = 5e-3
    contact: RigThresholds | None = None

    def __post_init__(self) -> None:
        if not (self.friction > 0 and self.torsion >= 0):
            raise ValueError("friction must be positive, and torsion not negative")


@dataclass(frozen=True)
class Rig:
    """The whole file; `folder` is where relative paths start."""

    surface: RigSurface
    force_torque: RigForceTorque = field(default_factory=RigForceTorque)
    time: RigTime = field(default_factory=RigTime)
    orientation: RigOrientation = field(default_factory=RigOrientation)
    acceleration: RigAcceleration = field(default_factory=RigAcceleration)
    estimate: RigEstimate = field(default_factory=RigEstimate)
    folder: Path = field(default_factory=Path)

    def layout(self) -> Layout:
        """How to read a log of this rig."""
        wrench = self.force_torque
        return Layout(
            time=self.time.column,
            time_unit=self.time.unit,
            wrench=wrench.columns,
            force_unit=wrench.units.force,
            torque_unit=wrench.units.torque,
            axes=wrench.axes,
            left_handed=wrench.left_handed,
            frame=wrench.frame,
            orientation=self.orientation.columns,
            position=self.orientation.position,
            acceleration=self.acceleration.columns,
        )

    def payload_path(self) -> Path | None:
        """Of the payload model, if one is named."""
        return None if self.force_torque.payload is None else self.folder / self.force_torque.payload

    def mesh_path(self) -> Path | None:
        """Of the mesh, if there is one."""
        return None if self.surface.kind == "plane" else self.folder / str(self.surface.mesh)

    def payload(self) -> Payload | None:
        """Read from its file, if one is named."""
        path = self.payload_path()
        return None if path is None else read_payload(path)

    def sensor(self, noise: Float[np.ndarray, "6"] | None = None) -> ForceTorque:
        """The sensor; `noise` is used where the rig states none."""
        wrench = self.force_torque
        stated = noise if wrench.noise is None else wrench.noise.six()
        return ForceTorque(stated, None if wrench.range is None else wrench.range.six(), wrench.frame)


def load_rig(path: Path) -> Rig:
    """Read a rig; what does not fit is named with the place and the nearest fit.

    Raises:
        InputError: not there, not TOML, a key misspelt or missing, a value of another kind or out of bounds.
    """
    table: dict[str, Any] = load_toml(path)
    if "folder" in table:
        raise InputError("unknown key 'folder'.", where=str(path))
    if "surface" not in table:
        raise InputError(
            "a rig needs a [surface].", where=str(path), mend="`palpate rig new` writes one to start from."
        )
    rig = replace(parse(table, Rig, file=str(path)), folder=path.parent)
    wrench = rig.force_torque
    axis_matrix(wrench.axes, left_handed=wrench.left_handed, where=f"{path}: force_torque.axes")
    to_si(wrench.units.force, FORCE_UNITS, where=f"{path}: force_torque.units.force")
    to_si(wrench.units.torque, TORQUE_UNITS, where=f"{path}: force_torque.units.torque")
    to_si(rig.time.unit, TIME_UNITS, where=f"{path}: time.unit")
    return rig


def build(rig: Rig, *, surface: Mesh | None = None, noise: Float[np.ndarray, "6"] | None = None) -> Estimator:
    """The estimator of a rig.

    Args:
        rig: what the user wrote.
        surface: where it was loaded before.
        noise: (6,) standard deviations [N, N m], used where the rig states none.
    """
    settings, sensor = rig.estimate, rig.sensor(noise)
    locator = Locator(
        rig.surface.load(rig.folder) if surface is None else surface,
        method=settings.method,
        friction=settings.friction,
        torsion=settings.torsion,
        noise=sensor.noise,
        on=None if settings.contact is None else settings.contact.on,
        off=None if settings.contact is None else settings.contact.off,
    )
    uncertain = rig.surface.pose_covariance
    return Estimator(
        locator,
        sensor,
        rig.payload(),
        rig.surface.pose.pose(),
        None if uncertain is None else np.asarray(uncertain),
    )
