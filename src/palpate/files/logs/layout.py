"""Describe the layout of a log: columns, arrays or topics, units and axes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import prod
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.tables.stated import Stated
from palpate.files.units import ACCELERATION_UNITS, FORCE_UNITS, SAMPLES, TIME_UNITS, TORQUE_UNITS, split_unit, to_si
from palpate.signals.recording import ACCELERATION, ORIENTATION, POSITION

WRENCH_COLUMNS = ("fx", "fy", "fz", "tx", "ty", "tz")
ORIENTATION_COLUMNS = ("qx", "qy", "qz", "qw")
POSITION_COLUMNS = ("x", "y", "z")
ACCELERATION_COLUMNS = ("ax", "ay", "az")
POSE_COLUMNS = {ORIENTATION: ORIENTATION_COLUMNS, POSITION: POSITION_COLUMNS, ACCELERATION: ACCELERATION_COLUMNS}


@dataclass(frozen=True)
class ArrayChannel:
    """A channel with an array per sample: voltages of load cells, readings of taxels.

    Args:
        name: of the channel of the `Recording`.
        shape: of one sample: (12,), or (6, 22).
        columns: of a table, in the order in which they are recorded; or a field path, in which * is any text: a pattern
            of columns, the name of an array or of a column of lists, or a field of a topic's messages. None: those that
            `palpate.files.logs.numbering` finds.
        topic: of a log with topics; None: the only one that holds arrays.
        scale: SI value of one unit of the log, for all numbers or for each.
        order: "rows", or "columns" where the numbers of a sheet are recorded column by column.
        ids: of the numbers, as the names of columns state them; None: they are counted.
        unit: in which the numbers are read; None: as the log has them, whatever it states.
        axes: names of the axes of a taxel, of which each has a number: the last side of the shape; (): one number.
        table: of the rig that declares this channel, for messages.
    """

    name: str
    shape: tuple[int, ...]
    columns: tuple[str, ...] | str | None = None
    topic: str | None = None
    scale: float | tuple[float, ...] = 1.0
    table: str = ""
    order: str = "rows"
    ids: tuple[int, ...] | None = None
    unit: str | None = None
    axes: tuple[str, ...] = ()

    @property
    def taxels(self) -> tuple[int, ...]:
        """The shape without the axes of a taxel."""
        return self.shape[:-1] if self.axes else self.shape

    @property
    def size(self) -> int:
        """Number of values per sample."""
        return prod(self.shape)

    @property
    def described(self) -> str:
        """The shape as text, such as '6 x 22'."""
        return " x ".join(map(str, self.shape))

    @property
    def recorded(self) -> tuple[int, ...]:
        """The shape in which numbers are recorded: (columns, rows) if they run column by column."""
        return (*self.taxels[::-1], *self.shape[len(self.taxels) :]) if self.order == "columns" else self.shape

    @property
    def mend(self) -> str:
        """A sentence on what to correct in a rig; "" without one."""
        return f"Correct the numbers in the rig's [{self.table}], or name the columns there." if self.table else ""

    def sized(self, columns: Sequence[str], path: Path) -> Sequence[str]:
        """Return columns of the log `path`, one for each number of the channel.

        Raises:
            InputError: there are more or fewer.
        """
        if (count := len(columns)) != self.size:
            named = self.columns is not None
            has = f"names {count} columns" if named else f"has {count} columns in addition to the time"
            what = f"{has}, but {self.size} {self.name} ({self.described}) are needed."
            raise InputError(what, where=self.table if named else str(path), hint=self.mend)
        return columns

    def as_recorded(self) -> ArrayChannel:
        """Return the channel with numbers in the unit and the order in which they are recorded."""
        return replace(self, shape=self.recorded, scale=1.0, order="rows")


@dataclass(frozen=True)
class ImageChannel:
    """The images of a camera.

    Args:
        topic: of a log with topics; None: the only one that holds images.
        table: of the rig that declares this channel, for messages.
    """

    topic: str | None = None
    table: str = ""


@dataclass(frozen=True)
class LogLayout:
    """The columns or topics of a log that are read, with their units and axes.

    Args:
        time, time_unit: column of the time, and its unit; "samples" for a counter, which needs the rate. None: the unit
            that the log states, or else the one that its first times suggest (`palpate.files.tables.stated`).
        wrench: six columns, force first; None: no wrench is read.
        arrays: other channels; of a log with topics one at most. A wrench is averaged about each row of that.
        images: of a camera, which are read alone: `wrench` is None, and no `arrays`. None: no images are read.
        rate: [Hz] of a log without a time column; None: it must have one. For a video it replaces the stamps; for a
            folder of images without times None is 30 Hz.
        episode: the only rows to read of a Parquet file with a column `episode_index`; None: all.
        force_unit, torque_unit: see `palpate.files.units`.
        axes: recorded axes that are the sensor's x, y, z, of force and torque alike; "-x" flips.
        left_handed: declares that `axes` is a reflection: the driver reported a left-handed wrench, or the reaction.
        torque_axes: as `axes`, of the torque; None: those of the force. They may be a reflection.
        acts_on: "body", or "environment" where the recorded wrench is what the robot does to the world.
        frame: "sensor" or "base", of the recorded wrench.
        torque_frame: as `frame`, of the torque; None: that of the force.
        reference: point about which the torque is recorded: the origin of the "sensor" or of the "base", or a point [m]
            in the sensor's frame, such as of a flange or a TCP.
        wrench_range: [N, N m] of the sensor's axes (6,); a reading at it is saturated.
        orientation: columns of the orientation, in `orientation_form`; None: qx, qy, qz, qw, if there.
        orientation_form: see `palpate.files.logs.orientation`.
        joints: names of joints whose positions the columns `orientation` are; they move the links `frames` of `urdf`.
        inverse: whether orientation and position are those of the base in the sensor.
        sensor_rotation: quaternion x, y, z, w of the sensor in the frame whose orientation is logged.
        position: columns of the sensor's position in the base [m]; None: x, y, z, if there.
        acceleration: columns of the acceleration in the sensor's frame; None: ax, ay, az, if there.
        acceleration_unit: see `palpate.files.units`.
        wrench_topic, orientation_topic: topics; None: the only ones of their kind. "none" as the latter: no poses.
        frames: base and sensor: the pose of one in the other is read from the tree of /tf.
        urdf: description with these links: the pose is computed from joint states instead.
        joints_topic: of joint states; None: the only one.
        imu_topic: of an IMU on the link `frames[0]`, in whose world the pose is given; None: in that link.
        acceleration_topic: None: no acceleration.
        offset: [s] added to the stamps of the poses to put them on the samples' clock.
        pose_file: table of the poses, in the folder of the log; "{log}" in it is the log's name without its suffix.
            `orientation`, `position` and their forms are of that table then. None: the log has the poses.
        pose_time, pose_time_unit: column of the times in `pose_file`, and its unit; None: as `time`, and as the table
            states.
        temperature: column or topic of a temperature [K or degrees C]; None: it is not read.
        max_gap: [s] largest gap between poses, accelerations or wrenches of a topic that is interpolated.
    """

    time: str = "time"
    time_unit: str | None = None
    wrench: tuple[str, ...] | None = WRENCH_COLUMNS
    arrays: tuple[ArrayChannel, ...] = ()
    images: ImageChannel | None = None
    rate: float | None = None
    episode: int | None = None
    force_unit: str = "N"
    torque_unit: str = "N m"
    axes: tuple[str, ...] = ("x", "y", "z")
    left_handed: bool = False
    torque_axes: tuple[str, ...] | None = None
    acts_on: str = "body"
    frame: str = "sensor"
    torque_frame: str | None = None
    reference: str | tuple[float, float, float] = "sensor"
    wrench_range: tuple[float, ...] | None = None
    orientation: tuple[str, ...] | None = None
    orientation_form: str = "quaternion"
    joints: tuple[str, ...] = ()
    inverse: bool = False
    sensor_rotation: tuple[float, ...] = ()
    position: tuple[str, ...] | None = None
    acceleration: tuple[str, ...] | None = None
    acceleration_unit: str = "m/s^2"
    wrench_topic: str | None = None
    orientation_topic: str | None = None
    frames: tuple[str, str] | None = None
    urdf: Path | None = None
    joints_topic: str | None = None
    imu_topic: str | None = None
    acceleration_topic: str | None = None
    pose_file: str | None = None
    pose_time: str | None = None
    pose_time_unit: str | None = None
    temperature: str | None = None
    offset: float = 0.0
    max_gap: float = 0.25

    @property
    def moves_torque(self) -> bool:
        """True if the torque must be rotated or moved to the sensor's origin before it is used."""
        return self.torque_frame not in (None, self.frame) or self.reference != "sensor"

    def as_recorded(self) -> LogLayout:
        """Return the layout with wrenches as they are recorded: along the log's axes, about its point of reference."""
        plain = LogLayout()
        names = ("axes", "left_handed", "torque_axes", "acts_on", "torque_frame", "reference")
        return replace(self, **{name: getattr(plain, name) for name in names})

    def require_live(self) -> None:
        """Check that a live stream can be read so: its poses and torques are taken as they come.

        Raises:
            InputError: the orientation has another form, or the torque another frame or point of reference.
        """
        posed = (self.orientation_form, self.inverse, self.sensor_rotation) != ("quaternion", False, ()) or self.joints
        if posed or self.moves_torque:
            keys = (
                "[orientation] form, inverse, sensor_rotation, joints"
                if posed
                else "[force_torque] torque_frame, reference"
            )
            raise InputError(
                f"{keys} of the rig are for logs, not live streams.",
                where="[source]",
                hint="Convert the stream at its source, or record it and run `palpate estimate`.",
            )


def pose_path(file: str | None, log: Path) -> Path | None:
    """Return the path of a log's `pose_file`; None for none."""
    return None if file is None else log.parent / file.replace("{log}", log.stem)


def axis_matrix(axes: tuple[str, ...], *, left_handed: bool | None, where: str) -> Float[np.ndarray, "3 3"]:
    """Return the signed permutation (3, 3) that takes recorded components to the sensor's x, y, z.

    Raises:
        InputError: the axes are not three different ones, or `left_handed`, if it is not None, contradicts them.
    """
    matrix = np.zeros((len(axes), 3))
    for row, axis in enumerate(axes):
        if not re.fullmatch(r"[-+]?[xyz]", axis):
            hint = "Write x, y or z, or -x, -y or -z for the opposite direction."
            raise InputError(f"{axis!r} is not an axis.", where=where, hint=hint)
        matrix[row, "xyz".index(axis[-1])] = -1.0 if axis[0] == "-" else 1.0
    if len(axes) != 3 or np.linalg.matrix_rank(matrix) != 3:
        raise InputError(f"{list(axes)} does not name three different axes.", where=where)
    reflected = np.linalg.det(matrix) < 0
    if reflected and left_handed is False:
        what = f"{list(axes)} turns a right-handed frame into a left-handed one."
        hint = "If the driver really mirrors the wrench (or reports the reaction), declare left_handed = true."
        raise InputError(what, where=where, hint=hint)
    if left_handed and not reflected:
        what = f"{list(axes)} is right-handed, but left_handed = true."
        raise InputError(what, where=where, hint="Remove left_handed.")
    return matrix


def stated_layout(layout: LogLayout, names: Iterable[str], stated: Stated) -> LogLayout:
    """Return the layout with columns such as `Fx [N]`, `Time [ms]` in place of missing `fx`, `time`, and their units.

    It is unchanged if it names other columns, or if not each missing one of the wrench has exactly one match with a
    unit.
    """
    if layout.wrench != WRENCH_COLUMNS or layout.time != "time":
        return layout
    known = set(names)
    wanted = [name for name in (layout.time, *WRENCH_COLUMNS) if name not in known]
    if not wanted:
        return layout
    found: dict[str, list[str]] = {name: [] for name in wanted}
    for name in known:
        bare = split_unit(name)[0].lower()
        if name in stated.units and bare in found:
            found[bare].append(name)
    if not all(len(found[name]) == 1 for name in wanted if name in WRENCH_COLUMNS):
        return layout
    columns = tuple(found[name][0] if name in found else name for name in WRENCH_COLUMNS)
    changes: dict[str, object] = {"wrench": columns}
    for key, part in (("force_unit", columns[:3]), ("torque_unit", columns[3:])):
        units = {stated.units[name] for name in part if name in stated.units}
        if len(units) == 1:
            changes[key] = units.pop()
    if len(time := found.get("time", [])) == 1:
        changes |= {"time": time[0], "time_unit": stated.units[time[0]]}
    return replace(layout, **changes)


def require_stated(layout: LogLayout, stated: Stated, path: Path) -> None:
    """Check that the log `path` states no unit that differs from the one in the layout.

    Raises:
        InputError: it does.
    """
    wrench = layout.wrench or ()
    for kind, columns, unit, table, key in (
        ("force", wrench[:3], layout.force_unit, FORCE_UNITS, "[force_torque]"),
        ("torque", wrench[3:], layout.torque_unit, TORQUE_UNITS, "[force_torque]"),
        ("time", (layout.time,), layout.time_unit, TIME_UNITS, "[time] unit"),
        ("acceleration", layout.acceleration or (), layout.acceleration_unit, ACCELERATION_UNITS, "[acceleration]"),
    ):
        for name in columns if unit != SAMPLES else ():
            said = stated.unit(name, kind)
            if said and unit and not _same(said, unit, table):
                what = f"the log states that {name!r} is in {said!r}, but it is read in {unit!r}."
                hint = f"Correct the unit in the rig's {key}, or let `palpate rig new` write it."
                raise InputError(what, where=str(path), hint=hint)


def _same(unit: str, other: str, table: Mapping[str, float]) -> bool:
    """Check whether two units are equal, or one is unknown: a rig may know better."""
    try:
        return abs(to_si(unit, table, where="") / to_si(other, table, where="") - 1.0) < 1e-9
    except InputError:
        return True
