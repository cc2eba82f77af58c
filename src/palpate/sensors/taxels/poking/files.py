"""Read pokes from a table that has one row for each, or wrenches and frames of taxels from a log."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.logs import Log, Stored, contents, open_log
from palpate.files.logs.layout import ORIENTATION_COLUMNS, POSITION_COLUMNS, WRENCH_COLUMNS, ArrayChannel, LogLayout
from palpate.files.logs.topics import NONE
from palpate.files.tables.stated import Stated
from palpate.files.tables.table import TextTable, read_table
from palpate.files.units import FORCE_UNITS, TORQUE_UNITS, split_unit, to_si
from palpate.files.urdf import Kinematics, Urdf
from palpate.sensors.taxels.poking.pokes import Pokes
from palpate.sensors.taxels.section import SKIN
from palpate.setup.pokes import RigPokes
from palpate.setup.setup import Setup
from palpate.setup.tables import RigAcceleration, RigOrientation
from palpate.signals.recording import ORIENTATION, POSITION, Recording
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import rotation_from_quaternion
from palpate.surfaces.mesh import UNITS

WRENCH = "force_torque"  # name of the sensor that measures the pokes
_JOINTS = "joints"
_NOISE = np.diag([1e-2, 1e-2, 1e-2, 1e-3, 1e-3, 1e-3]) ** 2  # N, N m: of a mean, where nothing says it
_TAXEL = re.compile(r"(?:t|taxel_?)(\d+)", re.IGNORECASE)


def holds_pokes(names: Sequence[str]) -> bool:
    """Return whether a table with these columns contains pokes: it numbers them, and has a wrench and answers."""
    bare = {split_unit(name)[0].strip().lower() for name in names}
    return bool(bare & {"configuration", "poke"}) and bare >= {*WRENCH_COLUMNS} and any(map(_TAXEL.fullmatch, names))


@takes_arrays
def read_pokes(path: str | Path, *, threshold: float = 0.0, noise: Float[np.ndarray, "6 6"] | None = None) -> Pokes:
    """Read `Pokes` from `configuration,fx,fy,fz,tx,ty,tz,qx,qy,qz,qw,x,y,z,t0,t1,...[,weight][,time]`.

    Wrenches [N, N m] are on the body in the sensor's frame, minus its untouched reading; poses [m] are the link's in
    that frame; answers are above the baseline. Columns may state other units, as `fx [mN]`.

    Args:
        path: of the table.
        threshold: responses up to it are no answers.
        noise: (6, 6) covariance of a wrench; None: standard deviations of 10 mN and 1 mN m.

    Raises:
        InputError: the file cannot be read, a column is missing, a unit is unknown, a cell is not a number, or a
            quaternion is not of length 1.
    """
    path = Path(path)
    table = read_table(path)
    names = {split_unit(name)[0].strip().lower(): name for name in reversed(table.names)}
    numbered = {int(match[1]): name for name in table.names if (match := _TAXEL.fullmatch(name))}
    if sorted(numbered) != list(range(len(numbered))) or not numbered:
        raise InputError("answers must be columns t0, t1, ... without a gap.", where=str(path))
    scales = _scales(table, names)
    wanted = (*WRENCH_COLUMNS, *ORIENTATION_COLUMNS, *POSITION_COLUMNS)
    for name in wanted:
        if name not in names:
            raise InputError(f"column {name!r} is missing.", where=str(path), hint=f"Give {', '.join(wanted)}.")
    values = table.numbers([names[name] for name in wanted], strict=True)[0] * scales
    unknown = ~(np.abs(values) < 1e9).all(axis=1)
    if unknown.any():
        table.refuse(int(np.argmax(unknown)), "every poke needs a wrench and a pose, in numbers below 1e9")
    long = np.abs(np.linalg.norm(values[:, 6:10], axis=1) - 1.0) > 0.01
    if long.any():
        table.refuse(int(np.argmax(long)), "qx, qy, qz, qw must have length 1")
    configuration = np.zeros(len(values), dtype=np.int64)
    if "configuration" in names:
        stated = table.numbers([names["configuration"]], strict=True)[0][:, 0]
        configuration = np.unique(stated, return_inverse=True)[1]
    responses = np.nan_to_num(table.numbers([numbered[k] for k in range(len(numbered))])[0])
    weight, time = (table.numbers([names[name]])[0][:, 0] if name in names else None for name in ("weight", "time"))
    return Pokes.from_table(
        values[:, :6],
        rotation_from_quaternion(values[:, 6:10] / np.linalg.norm(values[:, 6:10], axis=1, keepdims=True)),
        values[:, 10:],
        configuration,
        responses,
        noise=_NOISE if noise is None else noise,
        threshold=threshold,
        weight=None if weight is None else np.nan_to_num(weight),
        time=time,
    )


def _scales(table: TextTable, names: dict[str, str]) -> Float[np.ndarray, "13"]:
    """Return the factors (13,) from the units of wrench, quaternion and position to SI."""
    stated, where = Stated.of_dialect(table.dialect).units, str(table.path)

    def scale(name: str, units: dict[str, float], usual: str) -> float:
        return to_si(stated.get(names.get(name, ""), "") or usual, units, where=where)

    force = [scale(name, dict(FORCE_UNITS), "N") for name in WRENCH_COLUMNS[:3]]
    torque = [scale(name, dict(TORQUE_UNITS), "N m") for name in WRENCH_COLUMNS[3:]]
    return np.array([*force, *torque, 1, 1, 1, 1, *(scale(name, dict(UNITS), "m") for name in POSITION_COLUMNS)])


def open_pokes(path: Path, setup: Setup) -> tuple[Log, Log, Iterator[Recording | Stored]]:
    """Return a `Log` of wrenches, a `Log` of taxel frames, and an iterator over blocks of both with link poses.

    In a table, with a `urdf` in [pokes], the joints between sensor and link are columns with their names [rad].

    Raises:
        InputError: the log, urdf or a rig file cannot be read, an extra is missing (rosbags, pinocchio), the wrench is
            not in the sensor's frame, or a joint is missing; while iterating, also if joints are in degrees.
    """
    bare = replace(setup, orientation=RigOrientation(topic=NONE), acceleration=RigAcceleration())
    layout, frames = _wrench_layout(setup), open_log(path, SKIN.layout(bare))
    if layout.urdf is None or layout.frames is None or not contents(path).names:
        log = open_log(path, layout)
        return log, frames, log.merged_with(frames)
    kinematics = Kinematics(Urdf(layout.urdf), *layout.frames)
    joints = ArrayChannel(_JOINTS, (len(kinematics.joints),), kinematics.joints, table="pokes")
    log = open_log(path, replace(layout, frames=None, urdf=None, joints_topic=None, arrays=(joints,)))
    parts = (_posed(part, kinematics) if isinstance(part, Recording) else part for part in log.merged_with(frames))
    return log, frames, parts


def _wrench_layout(setup: Setup) -> LogLayout:
    """Return the layout of wrenches and of poses of the link in the sensor's frame."""
    table, there = setup.pokes or RigPokes(), setup.sensors.get(WRENCH)
    if there is not None and there.table.frame != "sensor":
        raise InputError(
            "wrenches of pokes must be in the sensor's frame, in which the link is known.",
            where="force_torque.frame",
            hint='Log the wrench as the sensor reads it, and state frame = "sensor".',
        )
    poses = RigOrientation(
        columns=table.columns,
        position=table.position,
        topic=NONE if table.pose is not None else table.topic,
        base=table.sensor,
        sensor=table.link,
        urdf=table.urdf,
        joints=table.joints,
        offset=table.offset,
        max_gap=table.max_gap,
    )
    posed = replace(setup, orientation=poses, acceleration=RigAcceleration())
    return LogLayout(**posed.common) if there is None else there.kind.layout(posed)


def _posed(block: Recording, kinematics: Kinematics) -> Recording:
    channels = dict(block.channels)
    values = channels.pop(_JOINTS)
    known = np.isfinite(values).all(axis=1)
    kinematics.require_radians(values[known], block.source)
    quaternion, position = np.full((len(block), 4), np.nan), np.full((len(block), 3), np.nan)
    if known.any():
        turned, moved = kinematics.poses(values[known])
        quaternion[known], position[known] = turned[:, 0], moved[:, 0]
    return replace(block, channels={**channels, ORIENTATION: quaternion, POSITION: position})
