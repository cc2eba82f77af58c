"""Describe the layout of a log: columns, arrays or topics, their units and axes."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import prod
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.signals.recording import ACCELERATION, ORIENTATION, POSITION

__all__ = [
    "ACCELERATION_COLUMNS",
    "ORIENTATION_COLUMNS",
    "POSE_COLUMNS",
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
POSE_COLUMNS = {ORIENTATION: ORIENTATION_COLUMNS, POSITION: POSITION_COLUMNS, ACCELERATION: ACCELERATION_COLUMNS}


@dataclass(frozen=True)
class ArrayChannel:
    """A channel with an array per sample: voltages of load cells, readings of taxels, the reference of a test bench.

    Args:
        name: of the channel of the `Recording`.
        shape: of one sample: (12,), or (6, 22).
        columns: of a table, the last axis running fastest; None: all that are not named otherwise, in their order. In
            an .npz an array called `name` is used instead, if it exists.
        topic: of a log with topics; None: the only one that holds arrays.
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
        time, time_unit: column of the time, and its unit; "samples" for a counter, which needs the rate.
        wrench: six columns, force first; None: no wrench is read.
        arrays: other channels; of a log with topics one at most. A wrench is averaged about each row of that.
        images: of a camera, which are read alone: `wrench` is None, and no `arrays`. None: no images are read.
        rate: [Hz] of a log without a time column; None: it must have one. For a video it replaces the stamps; for a
            folder of images without times None is 30 Hz.
        force_unit, torque_unit: see `palpate.files.units`.
        axes: recorded axes that are the sensor's x, y, z, of force and torque alike; "-x" flips.
        left_handed: declares that `axes` is a reflection: the driver reported a left-handed wrench, or the reaction.
        frame: "sensor" or "base", of the recorded wrench.
        wrench_range: [N, N m] of the sensor's axes (6,); a reading at it is saturated, which an average must not hide.
        orientation: columns of the quaternion x, y, z, w, sensor in base; None: qx, qy, qz, qw where the log has them.
        position: columns of the sensor's position in the base [m]; None: x, y, z where the log has them.
        acceleration: columns of the acceleration in the sensor's frame; None: ax, ay, az where the log has them.
        acceleration_unit: see `palpate.files.units`.
        wrench_topic, orientation_topic: of a log with topics; None: the only one of its kind. An orientation_topic
            "none" reads no poses.
        frames: base and sensor, of a log with topics: the pose of one in the other is read from the tree of /tf.
        urdf: description with these links: the pose is computed from joint states instead.
        joints_topic: of joint states; None: the only one.
        acceleration_topic: of a log with topics; None: no acceleration.
        offset: [s] added to the stamps of the poses of a topic to put them on the samples' clock.
        temperature: column or topic of a temperature [K or degrees C]; None: it is not read.
        max_gap: [s] largest gap between poses, accelerations or wrenches of a topic that is interpolated.
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
    frame: str = "sensor"
    wrench_range: tuple[float, ...] | None = None
    orientation: tuple[str, ...] | None = None
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


def axis_matrix(axes: tuple[str, ...], *, left_handed: bool, where: str) -> Float[np.ndarray, "3 3"]:
    """Return the signed permutation (3, 3) that takes recorded components to the sensor's x, y, z.

    Raises:
        InputError: the axes are not three different ones, or `left_handed` contradicts their handedness.
    """
    matrix = np.zeros((3, 3))
    for row, axis in enumerate(axes):
        if not re.fullmatch(r"[-+]?[xyz]", axis):
            hint = "Write x, y or z, or -x, -y or -z for the opposite direction."
            raise InputError(f"{axis!r} is not an axis.", where=where, hint=hint)
        matrix[row, "xyz".index(axis[-1])] = -1.0 if axis[0] == "-" else 1.0
    if len(axes) != 3 or np.linalg.matrix_rank(matrix) != 3:
        raise InputError(f"{list(axes)} does not name three different axes.", where=where)
    reflected = np.linalg.det(matrix) < 0
    if reflected and not left_handed:
        what = f"{list(axes)} turns a right-handed frame into a left-handed one."
        hint = "If the driver really mirrors the wrench (or reports the reaction), declare left_handed = true."
        raise InputError(what, where=where, hint=hint)
    if left_handed and not reflected:
        what = f"{list(axes)} is right-handed, but left_handed = true."
        raise InputError(what, where=where, hint="Remove left_handed.")
    return matrix
