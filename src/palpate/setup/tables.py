"""The tables of a rig as plain values, as a person writes them, each of which is checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from palpate.files.logs.orientation import SensorPose
from palpate.files.schema import INFINITE, covariance_matrix
from palpate.files.units import ACCELERATION_UNITS, SAMPLES, TIME_UNITS, known_unit
from palpate.files.urdf import GEOMETRIES
from palpate.signals.filters import Butterworth, Kalman
from palpate.spatial.pose import Pose
from palpate.surfaces import UNITS, Cylinder, Ellipsoid, EllipticCylinder, Paraboloid, Sphere, Surface, superquadric

Three = tuple[float, float, float]
Four = tuple[float, float, float, float]
_SMALLEST = 1e-15  # N, N m: below any sensor, and its square is still a number
EQUATIONS: dict[str, tuple[Callable[..., Surface], tuple[str, ...]]] = {
    "sphere": (Sphere, ("radius",)),
    "ellipsoid": (Ellipsoid, ("axes",)),
    "cylinder": (Cylinder, ("radius", "half_length", "upper")),
    "elliptic_cylinder": (EllipticCylinder, ("a", "b", "half_length", "upper")),
    "paraboloid": (Paraboloid, ("radii", "height")),
    "superquadric": (superquadric, ("axes", "exponents")),
}
OF_ANY_MESH = ("crease", "region", "covered", "pose", "pose_covariance", "placement")  # keys that another mesh keeps
_KINDS = ("mesh", "plane", *EQUATIONS)
_LENGTHS = tuple(dict.fromkeys(name for _, names in EQUATIONS.values() for name in names))


@dataclass(frozen=True)
class RigPair:
    """A positive number for the forces [N] and one for the torques [N m], or three each.

    Raises:
        ValueError: one is not above 1e-15, or not finite.
    """

    force: float | Three
    torque: float | Three

    def __post_init__(self) -> None:
        if not np.all((self.six() > _SMALLEST) & (self.six() < inf)):  # NaN too
            raise ValueError(f"force and torque must be positive (above {_SMALLEST:g})")

    def six(self) -> Float[np.ndarray, "6"]:
        """Return one number for each axis, (6,), force first."""
        return np.concatenate([np.broadcast_to(self.force, 3), np.broadcast_to(self.torque, 3)])


@dataclass(frozen=True)
class RigPose:
    """Pose of the surface, or of a link, in the sensor's frame: position [m] and unit quaternion.

    Raises:
        ValueError: the quaternion's length is not 1 within 1 %.
    """

    xyz: Three = (0.0, 0.0, 0.0)
    quaternion_xyzw: Four = (0.0, 0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        if not abs(np.linalg.norm(self.quaternion_xyzw) - 1.0) <= 0.01:  # NaN too
            given = list(self.quaternion_xyzw)
            raise ValueError(f"quaternion_xyzw {given} must have length 1 (the order is x, y, z, w)")

    def pose(self) -> Pose:
        """Return the pose as a `Pose`."""
        return Pose.from_quaternion(self.quaternion_xyzw, self.xyz)


@dataclass(frozen=True)
class RigRegion:
    """The part of the mesh that can be touched: a box in the mesh's frame [m], or facets counted from 0."""

    box: tuple[Three, Three] | None = None
    facets: tuple[int, ...] | None = None


@dataclass(frozen=True)
class RigSurface:
    """The surface that is touched: a `mesh` with its `unit`, a `link` of a `urdf`, or another `kind` with lengths [m].

    `geometry` of a link is "visual" or "collision"; None: the first of these that it has. `packages`: name -> folder,
    for packages of the URDF that are not found otherwise. The `unit` of a DAE that states its own is not needed.

    Facets that meet at less than `crease` [degrees] are smooth across their edge. With `covered` = true, facets that
    cannot be reached from outside give contacts too.

    plane: a `point`, a `normal` and a `half_width`. sphere: `radius`. ellipsoid: `axes` (three half-lengths).
    cylinder, along y: `radius` and `half_length`. elliptic_cylinder: half-axes `a` along x and `b` along z, and
    `half_length`; `upper` = true for its half with z >= 0. paraboloid: `radii` of curvature at its apex along x and y,
    and `height`. superquadric: `axes` and `exponents`. See `palpate.surfaces`.

    `pose_covariance`: 6 x 6, of (rotation vector [rad], translation [m]). `placement` [m]: standard deviation of a
    touch's place beyond what its wrench explains.

    Raises:
        ValueError: a value is unknown or out of bounds, a key that the kind needs is missing, or one does not belong.
    """

    kind: str = "mesh"
    mesh: str | None = None
    unit: str | None = None
    urdf: str | None = None
    link: str | None = None
    geometry: str | None = None
    packages: Mapping[str, str] = field(default_factory=lambda: {}, hash=False)
    crease: float = 30.0
    region: RigRegion = field(default_factory=RigRegion)
    covered: bool = False
    point: Three = (0.0, 0.0, 0.0)
    normal: Three = (0.0, 0.0, 1.0)
    half_width: float = 1.0
    radius: float | None = None
    axes: Three | None = None
    a: float | None = None
    b: float | None = None
    half_length: float | None = None
    upper: bool = False
    radii: tuple[float, float] | None = None
    height: float | None = None
    exponents: tuple[float, float] | None = None
    pose: RigPose = field(default_factory=RigPose)
    pose_covariance: tuple[tuple[float, ...], ...] | None = None
    placement: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in _KINDS:
            raise ValueError(f"kind must be one of {', '.join(_KINDS)}, not {self.kind!r}")
        require_path("mesh", self.mesh)
        require_path("urdf", self.urdf)
        if self.urdf is not None:
            self._require_link()
        elif self.link is not None or self.geometry is not None or self.packages:
            raise ValueError("link, geometry and packages need a urdf, which is missing")
        elif self.kind == "mesh" and self.mesh is None:
            raise ValueError("mesh, the file of the surface, is missing")
        elif self.kind == "mesh" and self.unit not in UNITS and not (self.unit is None and _may_state(self.mesh)):
            raise ValueError(f"unit of the mesh must be one of {', '.join(UNITS)}, not {self.unit!r}")
        if not 0 <= self.crease <= 180:
            raise ValueError(f"crease must be between 0 and 180 degrees, not {self.crease:g}")
        require_positive(self, "half_width")
        if not 0 < np.linalg.norm(self.normal) < inf:
            raise ValueError("normal must not be zero")
        if not 0 <= self.placement <= 1:  # NaN too
            raise ValueError(f"placement must be a standard deviation [m] from 0 to 1, not {self.placement:g}")
        if self.pose_covariance is not None:
            covariance_matrix(self.pose_covariance, 6, "pose_covariance")
        self._require_lengths()

    def _require_link(self) -> None:
        if self.kind != "mesh" or self.mesh is not None or self.unit is not None:
            raise ValueError("a urdf states what is touched and its unit (m): leave mesh, unit and kind out")
        if self.link is None:
            raise ValueError("link, the link of the urdf that is touched, is missing")
        if self.geometry is not None and self.geometry not in GEOMETRIES:
            raise ValueError(f"geometry must be one of {', '.join(GEOMETRIES)}, not {self.geometry!r}")

    def _require_lengths(self) -> None:
        needed = EQUATIONS[self.kind][1] if self.kind in EQUATIONS else ()
        for name in ("mesh", "covered", *_LENGTHS) if needed else _LENGTHS:
            if name not in needed and getattr(self, name) not in (None, False):
                raise ValueError(f"{name} does not belong to kind = {self.kind!r}")
        for name in needed:
            value: Any = getattr(self, name)
            if value is None:
                raise ValueError(f"{name} is missing: a {self.kind} needs {', '.join(needed)} (in metres)")
            if not np.all((np.asarray(value) > 0) & (np.asarray(value) < inf)) and name != "upper":
                raise ValueError(f"{name} must be positive and finite, not {value}")


def _may_state(mesh: str | None) -> bool:
    """Check whether a mesh file has a format that may state its own unit."""
    return mesh is not None and Path(mesh).suffix.lower() == ".dae"


@dataclass(frozen=True)
class RigTime:
    """The [time] of a rig: the time's column and unit; `rate` [Hz] if it is a counter ("samples") or there is none.

    Without `unit` it is the one that the log states, or else the one that its first times suggest. `episode` is the one
    to read of a Parquet file with several (`episode_index`), whose times each begin again.

    Raises:
        ValueError: the rate is not positive and finite, or is missing for a counter.
    """

    column: str = "time"
    unit: str | None = None
    rate: float | None = None
    episode: int | None = None

    def __post_init__(self) -> None:
        require_positive(self, "rate")
        if self.unit == SAMPLES and self.rate is None:
            raise ValueError('unit = "samples" needs rate [Hz]')


@dataclass(frozen=True)
class RigOrientation:
    """The [orientation] of a rig: the sensor's pose in the base.

    It comes from columns (orientation in the given `form`, position [m]), a topic of poses, or two frames. The `form`
    is "quaternion" (x, y, z, w), "quaternion_wxyz", "matrix_rows" or "matrix_columns" (9 or 16 numbers, row by row or
    column by column), "rotation_vector", or Euler angles, such as "euler_xyz" (about fixed axes) or "euler_ZYX_deg"
    (moving axes, in degrees). `inverse` says that poses are those of the base in the sensor, and `sensor_rotation` is
    the quaternion x, y, z, w of the sensor in the frame that is logged, such as of a flange. A `file` is a second table
    in the folder of the log, with these columns, and with times in the column `time`, in `time_unit`; "{log}" in its
    name is the log's name without its suffix. With the `topic`
    "none" no poses are read. `base` and `sensor` are frames of /tf, or links of a `urdf` that `joints` move: a topic of
    joint states, or joint -> column [rad, m] of a table. `base` may be a frame of /tf above the links, too. With the
    topic of an IMU on the link `base` as `imu`, the pose is that in the world of the IMU's orientation.

    `offset` [s] is added to the stamps of the poses to put them on the wrenches' clock. No orientation is interpolated
    between poses more than `max_gap` [s] apart.
    """

    columns: tuple[str, ...] | None = None
    form: str = "quaternion"
    inverse: bool = False
    sensor_rotation: Four | None = None
    position: tuple[str, str, str] | None = None
    file: str | None = None
    time: str | None = None
    time_unit: str | None = None
    topic: str | None = None
    base: str | None = None
    sensor: str | None = None
    urdf: str | None = None
    joints: str | Mapping[str, str] | None = field(default=None, hash=False)
    imu: str | None = None
    offset: float = 0.0
    max_gap: float = 0.25

    def __post_init__(self) -> None:
        require_positive(self, "max_gap")
        require_path("urdf", self.urdf)
        require_path("file", self.file)
        if self.file is None and (self.time, self.time_unit) != (None, None):
            raise ValueError("time and time_unit are of a second table, and need its file")
        if self.time_unit is not None and self.time_unit not in TIME_UNITS:
            raise ValueError(f"time_unit must be one of {', '.join(TIME_UNITS)}, not {self.time_unit!r}")
        if self.file is not None and (self.topic is not None or self.base is not None):
            raise ValueError("file excludes topic and frames (base, sensor): the sensor has one pose")
        numbers = SensorPose(self.form).numbers
        if self.columns is not None and len(self.columns) not in numbers:
            raise ValueError(f"columns of form {self.form!r} must be {' or '.join(map(str, numbers))} names")
        if self.sensor_rotation is not None and not abs(np.linalg.norm(self.sensor_rotation) - 1.0) <= 0.01:
            raise ValueError("sensor_rotation must be a quaternion x, y, z, w of length 1")
        if (self.base is None) != (self.sensor is None):
            raise ValueError(
                "base and sensor must be given together: the pose is that of the frame sensor in the frame base"
            )
        if self.base is not None and self.topic is not None:
            raise ValueError("topic and frames (base, sensor) exclude each other: the sensor has one pose")
        if self.urdf is not None and self.base is None:
            raise ValueError("urdf needs base and sensor, the names of two of its links")
        if (self.joints is not None or self.imu is not None) and self.urdf is None:
            raise ValueError("joints and imu need a urdf, which states what the joints move")
        if isinstance(self.joints, Mapping) and (self.columns, self.imu) != (None, None):
            raise ValueError("columns of joints exclude columns of an orientation, and an imu")

    def frames(self) -> tuple[str, str] | None:
        """Return the names of the frames (base, sensor), or None if they are not named."""
        return None if self.base is None or self.sensor is None else (self.base, self.sensor)


@dataclass(frozen=True)
class RigAcceleration:
    """The [acceleration] of a rig: the sensor's acceleration in its own frame, from columns, a topic or the poses.

    `kind` is "motion" (zero at rest), "imu" (an accelerometer's reading: 1 g upward at rest) or "none" (not used).
    `unit` is "m/s^2", "g" or "mg". `from_poses` differentiates positions and orientations over `window` [s].

    Raises:
        ValueError: a value is unknown or out of bounds, or `from_poses` has columns or a topic too.
    """

    columns: tuple[str, str, str] | None = None
    topic: str | None = None
    kind: str = "motion"
    unit: str = "m/s^2"
    from_poses: bool = False
    window: float = 0.2

    def __post_init__(self) -> None:
        if self.kind not in ("motion", "imu", "none"):
            raise ValueError(f"kind must be 'motion', 'imu' or 'none', not {self.kind!r}")
        if known_unit(self.unit, ACCELERATION_UNITS) is None:
            raise ValueError(f"unit must be one of {', '.join(ACCELERATION_UNITS)}, not {self.unit!r}")
        require_positive(self, "window")
        if self.from_poses and (self.columns or self.topic):
            raise ValueError("from_poses and recorded acceleration exclude each other")

    @property
    def recorded(self) -> bool:
        """True if recorded accelerations are used."""
        return self.kind != "none" and not self.from_poses


@dataclass(frozen=True)
class RigFilter:
    """The [filter] of a rig, which smooths the compensated wrench before contacts are located.

    `kind` is "none"; "kalman" with `q` and `r` (variances [N^2] of one step of the contact and of one reading);
    "butterworth" with `cutoff` [Hz] and `order`; or "zero_phase", the same forward and backward, for logs only.
    The `rate` [Hz] is measured if it is None.

    Raises:
        ValueError: a value is unknown or out of bounds.
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
        require_positive(self, "q", "r", "cutoff", "rate")
        if not 1 <= self.order <= 8:
            raise ValueError(f"order must be between 1 and 8, not {self.order}")

    def filter(self) -> Kalman | Butterworth | None:
        """Return the filter to run; None if `kind` is "none".

        Raises:
            InputError: `q` is too small a fraction of `r`.
        """
        if self.kind == "none":
            return None
        if self.kind == "kalman":
            return Kalman(self.q, self.r)
        return Butterworth(self.cutoff, self.order, zero_phase=self.kind == "zero_phase")


@dataclass(frozen=True)
class RigThresholds:
    """Thresholds of the force [N]: a contact begins at `on` and ends below `off`.

    Raises:
        ValueError: unless 0 <= off <= on < inf.
    """

    on: float
    off: float

    def __post_init__(self) -> None:
        if not 0 <= self.off <= self.on < inf:
            raise ValueError(f"off ({self.off:g}) must be between 0 and on ({self.on:g}), and on must be finite")


@dataclass(frozen=True)
class RigEstimate:
    """The [estimate] of a rig: how contacts are located, see `palpate.Locator`; the first `tare` [s] are unloaded.

    Raises:
        ValueError: the tare or the friction is not positive, or the torsion negative.
    """

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


def require_positive(table: object, *names: str) -> None:
    """Check named fields of a table.

    Raises:
        ValueError: a field is neither None nor positive and finite, or such numbers.
    """
    for name in names:
        value: float | tuple[float, ...] | None = getattr(table, name)
        for number in value if isinstance(value, tuple) else () if value is None else (value,):
            if not 0 < number < inf:
                raise ValueError(f"{name} must be positive and finite, not {number:g}")


def require_path(key: str, path: str | None) -> None:
    """Check the path that a table has under a key.

    Raises:
        ValueError: the path is blank or has a null character.
    """
    if path is not None and (not path.strip() or "\0" in path):
        raise ValueError(f"{key} must name a file, not {path!r}")
