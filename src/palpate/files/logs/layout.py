"""Describe the layout of a log: columns, arrays or topics, their units and axes, and the frame of the wrench."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from math import prod
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError

__all__ = [
    "ACCELERATION_COLUMNS",
    "ORIENTATION_COLUMNS",
    "POSITION_COLUMNS",
    "WRENCH_COLUMNS",
    "ArrayChannel",
    "ImageChannel",
    "LogLayout",
    "axis_matrix",
]

WRENCH_COLUMNS = ("fx", "fy", "fz", "tx", "ty", "tz")
ORIENTATION_COLUMNS = ("qx", "qy", "qz", "qw")
POSITION_COLUMNS = ("x", "y", "z")
ACCELERATION_COLUMNS = ("ax", "ay", "az")


@dataclass(frozen=True)
class ArrayChannel:
    """A channel with an array per sample: voltages of load cells, readings of taxels, the reference of a test bench.

    Args:
        name: of the channel of the `Recording`.
        shape: of one sample: (12,), or (6, 22).
        columns: of a table, the last axis running fastest; None: all that are not named otherwise, in their order. In
            an .npz an array called `name` is used instead, if it exists.
        topic: of a log with topics. None: the only one that holds arrays.
        scale: SI value of one unit of the log, for all numbers or for each.
        table: of the rig that declares this channel, for messages.
    """

    name: str
    shape: tuple[int, ...]
    columns: tuple[str, ...] | None = None
    topic: str | None = None
    scale: float | tuple[float, ...] = 1.0
    table: str = ""

    @property
    def size(self) -> int:
        """Number of values per sample."""
        return prod(self.shape)

    @property
    def described(self) -> str:
        """The shape as text, such as '6 x 22'."""
        return " x ".join(map(str, self.shape))


@dataclass(frozen=True)
class ImageChannel:
    """The channel `IMAGE`, images of a camera.

    Args:
        topic: of a log with topics. None: the only one that holds images.
        table: of the rig that declares this channel, for messages.
    """

    topic: str | None = None
    table: str = ""


@dataclass(frozen=True)
class LogLayout:
    """The columns or topics of a log that are read, with their units and axes. The defaults need no mapping.

    Args:
        time, time_unit: the column of the time, and its unit; "samples" for a counter, which needs the rate.
        wrench: the six columns, force first; None: no wrench is read.
        arrays: other channels that are read. In a log of topics one at most; if a wrench is read too, it is averaged
            about each row of the array.
        images: images of a camera. None: no images are read. They are read alone: `wrench` is None, and no `arrays`.
        rate: [Hz] of a log without a time column. None: it must have one. For a video it replaces the stamps (of one
            that plays slower than it was recorded); for a folder of images without times None is 30 Hz.
        force_unit, torque_unit: see `palpate.files.units`.
        axes: recorded axes that are the sensor's x, y, z; "-x" flips. Applied to force and to torque alike.
        left_handed: declares that `axes` is a reflection: the driver reported a left-handed wrench, or the reaction.
        torque_axes: as `axes`, of the torque; None: those of the force. They may be a reflection.
        acts_on: "body", or "environment" where the recorded wrench is what the robot does to the world.
        frame: "sensor" or "base", of the recorded wrench.
        torque_frame: as `frame`, of the torque; None: that of the force.
        reference: point about which the torque is recorded: "sensor" (its origin), "base" (its origin), or a point
            [m] in the sensor's frame, such as of a flange or a TCP.
        wrench_range: of each channel as recorded, in SI; a reading at it is saturated, which an average must not hide.
        orientation: columns of the orientation, in `orientation_form`. None: qx, qy, qz, qw where the log has them.
        orientation_form: see `palpate.files.logs.orientation`.
        inverse: whether the orientation, and the position, are those of the base in the sensor.
        sensor_rotation: quaternion x, y, z, w of the sensor in the frame whose orientation is logged.
        position: of the sensor in the base [m]. None: x, y, z where the log has them.
        acceleration: of the sensor in its own frame. None: ax, ay, az where the log has them.
        acceleration_unit: see `palpate.files.units`.
        wrench_topic, orientation_topic: of a log with topics. None: the only one of its kind; an orientation_topic of
            "none" reads no poses.
        frames: base and sensor, of a log with topics: the pose of one in the other is read from the tree of /tf.
        urdf: description with these links: the pose is computed from joint states instead.
        joints_topic: of joint states. None: the only one.
        acceleration_topic: of a log with topics. None: no acceleration, as an accelerometer may be mounted anywhere.
        offset: [s] added to the stamps of the poses of a topic to put them on the samples' clock.
        temperature: column, or topic of a log with topics: [K or degrees C]. None: it is not read.
        max_gap: [s] largest gap between poses or accelerations of a topic that is interpolated.
    """

    time: str = "time"
    time_unit: str = "s"
    wrench: tuple[str, ...] | None = WRENCH_COLUMNS
    arrays: tuple[ArrayChannel, ...] = ()
    images: ImageChannel | None = None
    rate: float | None = None
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
    acceleration_topic: str | None = None
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
        posed = (self.orientation_form, self.inverse, self.sensor_rotation) != ("quaternion", False, ())
        if posed or self.moves_torque:
            keys = "form, inverse or sensor_rotation" if posed else "torque_frame or reference"
            raise InputError(
                f"{keys} in the rig's [{'orientation' if posed else 'force_torque'}] are for logs, not live streams.",
                where="[source]",
                hint="Convert the stream at its source, or record it and run `palpate estimate`.",
            )


def axis_matrix(axes: tuple[str, ...], *, left_handed: bool | None, where: str) -> Float[np.ndarray, "3 3"]:
    """Return the signed permutation (3, 3) that takes recorded components to the sensor's x, y, z.

    Raises:
        InputError: the axes are not three different ones, or `left_handed` does not match their handedness; None is
            either.
    """
    matrix = np.zeros((3, 3))
    for row, axis in enumerate(axes):
        if not re.fullmatch(r"[-+]?[xyz]", axis):
            raise InputError(
                f"{axis!r} is not an axis.",
                where=where,
                hint="Write x, y or z, or -x, -y or -z for the opposite direction.",
            )
        matrix[row, "xyz".index(axis[-1])] = -1.0 if axis[0] == "-" else 1.0
    if len(axes) != 3 or np.linalg.matrix_rank(matrix) != 3:
        raise InputError(f"{list(axes)} does not name three different axes.", where=where)
    reflected = np.linalg.det(matrix) < 0
    if reflected and left_handed is False:
        raise InputError(
            f"{list(axes)} turns a right-handed frame into a left-handed one.",
            where=where,
            hint="If the driver really mirrors the wrench (or reports the reaction), declare left_handed = true.",
        )
    if left_handed and not reflected:
        raise InputError(
            f"{list(axes)} is right-handed, but left_handed = true.", where=where, hint="Remove left_handed."
        )
    return matrix
