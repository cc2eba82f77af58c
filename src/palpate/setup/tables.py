"""The tables of a rig as plain values, as a person writes them, each of which is checked."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

import numpy as np
from jaxtyping import Float

from palpate.files.logs.orientation import SensorPose
from palpate.files.schema import INFINITE
from palpate.files.units import ACCELERATION_UNITS, SAMPLES, TIME_UNITS, known_unit
from palpate.signals.filters import Butterworth, Kalman

Three = tuple[float, float, float]
Four = tuple[float, float, float, float]
Six = tuple[str, str, str, str, str, str]
_SMALLEST = 1e-15  # N, N m: below any sensor, and its square is still a number


@dataclass(frozen=True)
class RigUnits:
    """Units of forces and torques in the log."""

    force: str = "N"
    torque: str = "N m"


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
class RigNoise(RigPair):
    """Standard deviations of one reading; below `corner` [Hz] the noise goes as 1/f; None: `corner` is the log's.

    Raises:
        ValueError: a value is not positive and finite.
    """

    corner: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "corner")


@dataclass(frozen=True)
class RigForceTorque:
    """The [force_torque] of a rig: the wrench's columns, units and meaning in the log, and the sensor's properties.

    `acts_on` is "body", or "environment" where the wrench is what the robot does to the world; `frame` and
    `torque_frame` are "sensor" or "base", and `reference` is the point of the torque: "sensor", "base" (their origins),
    or a point [m] in the sensor's frame. `torque_axes` and `torque_frame` are those of the force if they are not given.
    """

    columns: Six = ("fx", "fy", "fz", "tx", "ty", "tz")
    topic: str | None = None
    units: RigUnits = field(default_factory=RigUnits)
    axes: tuple[str, str, str] = ("x", "y", "z")
    left_handed: bool = False
    torque_axes: tuple[str, str, str] | None = None
    acts_on: str = "body"
    frame: str = "sensor"
    torque_frame: str | None = None
    reference: str | Three = "sensor"
    noise: RigNoise | None = None
    range: RigPair | None = None
    gain_error: float = 0.0
    drift: RigPair | None = None
    payload: str | None = None

    def __post_init__(self) -> None:
        for name in ("frame", "torque_frame"):
            if (frame := getattr(self, name)) not in ("sensor", "base", *((None,) if name == "torque_frame" else ())):
                raise ValueError(f"{name} must be 'sensor' or 'base', not {frame!r}")
        if self.acts_on not in ("body", "environment"):
            raise ValueError(f"acts_on must be 'body' or 'environment', not {self.acts_on!r}")
        if self.acts_on == "environment" and all(axis.startswith("-") for axis in self.axes):
            raise ValueError(
                "acts_on = 'environment' and axes that are all reversed undo each other: state one of them"
            )
        if isinstance(self.reference, str) and self.reference not in ("sensor", "base"):
            raise ValueError(
                f"reference must be 'sensor', 'base', or a point [x, y, z] in m in the sensor's frame, such as of a "
                f"flange or a TCP, not {self.reference!r}"
            )
        if not 0 <= self.gain_error < 1:
            raise ValueError(
                f"gain_error must be a share of the force, at least 0 and below 1, not {self.gain_error:g}"
            )
        require_path("payload", self.payload)


@dataclass(frozen=True)
class RigTime:
    """The [time] of a rig: the time's column and unit; `rate` [Hz] if it is a counter ("samples") or there is none.

    Without `unit` it is the one that the log states, or else the one that its first times suggest.

    Raises:
        ValueError: the rate is not positive and finite, or is missing for a counter.
    """

    column: str = "time"
    unit: str | None = None
    rate: float | None = None

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
    "none" no poses are read. `base` and `sensor` are frames of /tf, or links of a `urdf` that the joint states of the
    topic `joints` move.

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
    joints: str | None = None
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
        if self.joints is not None and self.urdf is None:
            raise ValueError("joints needs a urdf, which states what they move")

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
