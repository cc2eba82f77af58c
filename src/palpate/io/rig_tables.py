"""The tables of a rig, each as a person writes it: plain values, checked one by one."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, radians
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.io.strict import INFINITE, covariance_matrix
from palpate.spatial.pose import Pose
from palpate.surfaces.mesh import UNITS, Mesh
from palpate.surfaces.plane import plane

__all__ = [
    "RigAcceleration",
    "RigEstimate",
    "RigForceTorque",
    "RigOrientation",
    "RigPair",
    "RigPose",
    "RigRegion",
    "RigSurface",
    "RigThresholds",
    "RigTime",
    "RigUnits",
]

Three = tuple[float, float, float]
Four = tuple[float, float, float, float]
Six = tuple[str, str, str, str, str, str]
_SMALLEST = 1e-15  # N, N m: below any sensor, and its square is still a number


@dataclass(frozen=True)
class RigPose:
    """Of the surface in the sensor's frame [m]."""

    xyz: Three = (0.0, 0.0, 0.0)
    quaternion_xyzw: Four = (0.0, 0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        if not abs(np.linalg.norm(self.quaternion_xyzw) - 1.0) <= 0.01:  # NaN too
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
        _require_path("mesh", self.mesh)
        if not 0 <= self.crease <= 180:
            raise ValueError(f"crease must lie between 0 and 180 degrees, not {self.crease:g}")
        if not 0 < self.half_width < inf:
            raise ValueError("half_width must be positive")
        if not 0 < np.linalg.norm(self.normal) < inf:
            raise ValueError("normal must not be zero")
        if self.pose_covariance is not None:
            covariance_matrix(self.pose_covariance, 6, "pose_covariance")

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
        if not np.all((self.six() > _SMALLEST) & (self.six() < inf)):  # NaN too
            raise ValueError(f"force and torque must be positive (above {_SMALLEST:g})")

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
        _require_path("payload", self.payload)


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
        if not 0 <= self.off <= self.on < inf:
            raise ValueError(f"off ({self.off:g}) must lie between 0 and on ({self.on:g}), and on must be finite")


@dataclass(frozen=True)
class RigEstimate:
    """How contacts are located: see `palpate.Locator`."""

    method: str = "soft_finger"
    friction: float = 1.0
    torsion: float = field(default=5e-3, metadata=INFINITE)
    contact: RigThresholds | None = None

    def __post_init__(self) -> None:
        if not (0 < self.friction < inf and self.torsion >= 0):
            raise ValueError("friction must be positive and finite, and torsion not negative")


def _require_path(key: str, path: str | None) -> None:
    if path is not None and (not path.strip() or "\0" in path):
        raise ValueError(f"{key} must name a file, not {path!r}")
