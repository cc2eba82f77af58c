"""The tables of a rig, each as a person writes it: plain values, checked one by one."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, radians
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.io.strict import INFINITE, covariance_matrix
from palpate.sensors.filters import Butterworth, Kalman
from palpate.spatial.pose import Pose
from palpate.surfaces.mesh import UNITS, Mesh
from palpate.surfaces.plane import plane

__all__ = [
    "RigAcceleration",
    "RigEstimate",
    "RigFilter",
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
    """The sensor in the base, as columns (quaternion x, y, z, w; position [m]) or as a topic of poses.

    `offset` [s] is added to the stamps of the poses to put them on the wrenches' clock; between poses further apart
    than `max_gap` [s] there is no orientation.
    """

    columns: tuple[str, str, str, str] | None = None
    position: tuple[str, str, str] | None = None
    topic: str | None = None
    offset: float = 0.0
    max_gap: float = 0.25

    def __post_init__(self) -> None:
        if not self.max_gap > 0:
            raise ValueError("max_gap must be positive")


@dataclass(frozen=True)
class RigAcceleration:
    """The sensor's acceleration in its own frame [m/s^2], as columns or a topic, or from the poses.

    `kind` says what is recorded: "motion" (zero at rest) or "imu" (what an accelerometer reads: 1 g upward at rest).
    `from_poses` differentiates positions and orientations over `window` [s].
    """

    columns: tuple[str, str, str] | None = None
    topic: str | None = None
    kind: str = "motion"
    from_poses: bool = False
    window: float = 0.2

    def __post_init__(self) -> None:
        if self.kind not in ("motion", "imu"):
            raise ValueError(f"kind must be 'motion' or 'imu', not {self.kind!r}")
        if not self.window > 0:
            raise ValueError("window must be positive")
        if self.from_poses and (self.columns or self.topic):
            raise ValueError("from_poses and recorded acceleration exclude each other")


@dataclass(frozen=True)
class RigFilter:
    """What smooths the compensated wrench before it is located: see `palpate.sensors.filters`.

    kind: "none"; "kalman" with `q` and `r` (variances [N^2] of one step of the contact and of one reading);
    "butterworth" with `cutoff` [Hz] and `order`; "zero_phase", the same forward and backward, for logs only.
    `rate` [Hz] of the log; measured where it is not given.
    """

    kind: str = "none"
    q: float = 1e-6
    r: float = 2e-4
    cutoff: float = 10.0
    order: int = 2
    rate: float | None = None

    def __post_init__(self) -> None:
        if self.kind not in ("none", "kalman", "butterworth", "zero_phase"):
            raise ValueError(f"kind must be 'none', 'kalman', 'butterworth' or 'zero_phase', not {self.kind!r}")
        if not (self.q > 0 and self.r > 0):
            raise ValueError("q and r must be positive")
        if not self.cutoff > 0:
            raise ValueError("cutoff must be positive")
        if not 1 <= self.order <= 8:
            raise ValueError("order must lie between 1 and 8")
        if self.rate is not None and not self.rate > 0:
            raise ValueError("rate must be positive")

    def filter(self) -> Kalman | Butterworth | None:
        """As a value."""
        if self.kind == "none":
            return None
        if self.kind == "kalman":
            return Kalman(self.q, self.r)
        return Butterworth(self.cutoff, self.order, zero_phase=self.kind == "zero_phase")


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
    """How contacts are located: see `palpate.Locator`. `tare` [s]: the log starts unloaded for so long."""

    method: str = "soft_finger"
    friction: float = 1.0
    torsion: float = field(default=5e-3, metadata=INFINITE)
    contact: RigThresholds | None = None
    tare: float | None = None

    def __post_init__(self) -> None:
        if self.tare is not None and not self.tare > 0:
            raise ValueError("tare must be a positive time [s]")
        if not (0 < self.friction < inf and self.torsion >= 0):
            raise ValueError("friction must be positive and finite, and torsion not negative")


def _require_path(key: str, path: str | None) -> None:
    if path is not None and (not path.strip() or "\0" in path):
        raise ValueError(f"{key} must name a file, not {path!r}")
