"""Guess the columns, units and frame of the wrenches in a table, with remarks on what is odd."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os.path import relpath
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.logs import LogContents
from palpate.files.logs.columns import flattened
from palpate.files.logs.layout import LogLayout
from palpate.files.tables.stated import Stated
from palpate.files.units import ACCELERATION_UNITS, FORCE_UNITS, TORQUE_UNITS, known_unit, split_unit, to_si
from palpate.setup.guess import commented, orientation_table, quoted, time_unit
from palpate.setup.guess_time import TimeGuess, guess_time
from palpate.setup.makers import NamedPose, NamedWrench, named_pose, named_wrench
from palpate.setup.names import acceleration_columns, made_up, time_column, wrenches
from palpate.signals.acceleration import kind_of_acceleration
from palpate.signals.recording import ACCELERATION, Recording

_COUNTS = 50.0  # in whole numbers up to less than this, forces may have been rounded


@dataclass(frozen=True)
class WrenchColumns:
    """A guess at the columns of a wrench, before its numbers are read.

    Attributes:
        why: what in the log looks like this sensor.
        layout: how to read the log.
        fields: name -> part of a rig's text; without "torque_unit" if the log does not state it.
        remarks: what the reader should check.
        time: the guess at the time of a table.
        pose: columns of the sensor's pose, if any.
        pose_table: lines of a rig on the second table that has them; (): the log has them.
        acceleration: columns of the acceleration, if any.
    """

    why: str
    layout: LogLayout
    fields: Mapping[str, str]
    remarks: tuple[str, ...] = ()
    time: TimeGuess | None = None
    pose: NamedPose | None = None
    pose_table: tuple[str, ...] = ()
    acceleration: tuple[str, ...] = ()

    def looked_at(
        self, recording: Recording, stated: Stated, time_unit: tuple[str, str], pose: NamedPose | None
    ) -> WrenchColumns:
        """Return a `WrenchColumns` completed from the table's numbers: unit of time, kind of acceleration, counts.

        `time_unit` is the unit in which the times were read, and a remark on it; `pose` has what they show of the pose.
        """
        fields, remarks, layout = dict(self.fields), list(self.remarks), self.layout
        time = None if self.time is None else self.time.judged(recording.time, *time_unit)
        if time is not None:
            layout = replace(layout, time=time.column or "time", time_unit=time.unit, rate=time.rate)
            fields["time"] = time.text()
            remarks[:0] = time.remarks
        fields["orientation"], doubts = orientation_table(pose, *self.pose_table)
        remarks += doubts
        if whole := _counted(recording.wrenches(), fields):
            fields["unsure"] = "# "  # in counts: without it, it is taken from the log by the units that will stand here
            remarks.append(whole)
        if self.acceleration:
            unit, named = _acceleration_unit(self.acceleration, stated), f"{self.acceleration[0]!r} ... are"
            fields["acceleration"], doubt = acceleration_table("columns", self.acceleration, named, unit, recording)
            remarks.append(doubt)
        return replace(self, layout=layout, fields=fields, remarks=tuple(remarks), time=time)


def _counted(values: Float[np.ndarray, "n 6"], fields: Mapping[str, str]) -> str:
    """Return a remark if all values of a wrench in N are integers, as a sensor's counts are; else ""."""
    known = values[np.isfinite(values)]
    if fields.get("force_unit", "N") != "N" or not len(known) or np.abs(known).max() < _COUNTS or (known % 1.0).any():
        return ""
    return (
        f"all numbers of the wrench are integers, up to {np.abs(known).max():,.0f}: if they are counts, write the "
        'counts per unit in [force_torque], as units = { force = "N/1000000", torque = "N m/1000000" }'
    )


def columns_guess(log: Path, contents: LogContents) -> WrenchColumns | None:
    """Return a `WrenchColumns` guessed from the names and units in a log; None if no names look like a wrench.

    Raises:
        InputError: a unit of force, torque or time is unknown, or forces or torques have two units.
    """
    contents = replace(contents, names=dict.fromkeys(flattened(contents.names), ()))
    names = list(contents.names)
    found = wrenches(names)
    if not found:
        return None
    wrench, others = found[0], found[1:]
    time = guess_time(contents, wrench)
    force = _unit(wrench[:3], "force", FORCE_UNITS, contents)
    torque = _unit(wrench[3:], "torque", TORQUE_UNITS, contents)
    meaning = named_wrench(wrench)
    fields = {"wrench": f"columns = {quoted(wrench)}", "force_unit": force or "N"}
    fields |= {"frame": meaning.frame} | ({"torque_unit": torque} if torque else {})
    if settings := meaning.settings:
        fields["meaning"] = "".join(f"{key} = {quoted(value)}\n" for key, value in settings.items())
    if meaning.unknown or meaning.reference != "sensor":
        fields["unsure"] = "# "  # the noise of the torque is another one about another point
    pose, lines, read = columns_of_pose(contents, names)
    remarks = _said(wrench, others, meaning, pose)
    acceleration = acceleration_columns([name for name in names if name not in wrench]) or ()
    layout = LogLayout(
        time=time.column or "time",
        time_unit=time.unit or None,
        rate=time.rate,
        wrench=wrench,
        force_unit=force or "N",
        torque_unit=torque or "N m",
        frame=meaning.frame,
        acts_on=meaning.acts_on,
        acceleration=acceleration or None,
        acceleration_unit=_acceleration_unit(acceleration, contents.stated) or "m/s^2",
        **read,
    )
    why = f"columns {', '.join(wrench)} look like forces and torques"
    if not meaning.whose:
        why += ", of what acts on the body, along the sensor's axes and about its origin (acts_on, frame, reference)"
    return WrenchColumns(why, layout, fields, tuple(remarks), time, pose, lines, acceleration)


def columns_of_pose(
    contents: LogContents, names: Sequence[str] = ()
) -> tuple[NamedPose | None, tuple[str, ...], dict[str, Any]]:
    """Return the columns of the pose among `names`; of a second table, also its lines of a rig, settings of the layout.

    Raises:
        InputError: the second table has no columns that look like poses or times.
    """
    if (table := contents.poses) is None:
        return named_pose(names), (), {}
    names = list(flattened(table.names))
    pose, time = named_pose(names), time_column(names)
    if pose is None or time is None:
        lacking = "orientation (qx, qy, qz, qw)" if pose is None else "time"
        what = f"has no columns that look like the {lacking}: {', '.join(names[:12])}."
        raise InputError(what, where=str(table.path), hint="Name them in the rig's [orientation].")
    unit, _ = time_unit(table.path, time)  # a doubt is a note on the log
    read = {"file": relpath(table.path, contents.path.parent), "time": time, "time_unit": unit}
    lines = tuple(f"{key} = {quoted(value)}" for key, value in read.items())
    return pose, lines, {f"pose_{key}": value for key, value in read.items()}


def _acceleration_unit(columns: Sequence[str], stated: Stated) -> str | None:
    """Return the known unit of acceleration that the log states for the columns, or None."""
    return known_unit(stated.unit(columns[0]), ACCELERATION_UNITS) if columns else None


def _unit(columns: Sequence[str], kind: str, table: Mapping[str, float], contents: LogContents) -> str:
    """Return the unit that the log states for three columns, or "" if it states none; raise InputError for several."""
    units = {stated: name for name in columns if (stated := contents.stated.unit(name, kind))}
    if len({_scale(unit, table, name, contents) for unit, name in units.items()}) > 1:
        both = ", ".join(f"{name!r} in {unit!r}" for unit, name in units.items())
        raise InputError(
            f"columns of one {kind} have different units: {both}.", where=str(contents.path), hint="Correct the header."
        )
    unit = next(iter(units), "")
    bare, slash, count = unit.partition("/")
    return f"{known_unit(bare, table) or bare}{slash}{count}"


def _scale(unit: str, table: Mapping[str, float], name: str, contents: LogContents) -> float:
    try:
        return to_si(unit, table, where=f"{contents.path}, column {name!r}")
    except InputError as problem:
        hint = f"{problem.hint} For counts, write the counts per unit, as `N/1000`, in the header or in a rig."
        raise InputError(problem.what, where=f"{contents.path}, column {name!r}", hint=hint) from None


def _said(
    wrench: Sequence[str], others: Sequence[Sequence[str]], meaning: NamedWrench, pose: NamedPose | None
) -> list[str]:
    said: list[str] = []
    if made_up(wrench):
        said.append("the columns have no names, so force and torque are assumed in the order x, y, z, x, y, z")
    for name in wrench:
        unknown = re.findall(r"\(([^()]*[^()\W\d_xyz][^()]*)\)", split_unit(name)[0])
        if unknown:
            said.append(f"{unknown[-1]!r} in {name!r} is not known as a unit: check units in [force_torque]")
            break
    if meaning.whose:
        settings = {"frame": meaning.frame, "acts_on": meaning.acts_on, **meaning.settings}
        stated = ", ".join(f"{key} = {value!r}" for key, value in settings.items())
        said.append(f"{wrench[0]!r} ... is the wrench {meaning.whose}: {stated}")
    if meaning.unknown:
        said.append(meaning.unknown)
    if meaning.frame == "base" and pose is None:
        needs = "a wrench in the base frame needs the sensor's orientation (columns qx, qy, qz, qw)"
        said.append(f'{needs}; frame = "sensor" is right only while the sensor keeps the axes of the base')
    if others:
        more = "; ".join(f"{columns[0]} ... {columns[-1]}" for columns in others)
        taken = f"{wrench[0]} ... {wrench[-1]} is used, not {more}"
        said.append(
            f"the log has {len(others) + 1} wrenches: {taken}; to use another one, change columns in [force_torque]"
        )
    return said


def acceleration_table(
    key: str, value: str | Sequence[str], named: str, unit: str | None, recording: Recording
) -> tuple[str, str]:
    """Return the [acceleration] of a rig as TOML, its kind judged by the numbers, and a remark on it.

    Args:
        key: "columns" or "topic".
        value: the names of the columns, or that of the topic.
        named: subject and verb of the remark.
        unit: in which the log states them; None: it does not.
        recording: with `ACCELERATION`, in m/s^2 if the unit is known, else as recorded.
    """
    kind, unit, length = kind_of_acceleration(recording.channels[ACCELERATION], unit)
    means = {
        "imu": f"gravity is in it: {length:.3g} {unit} at the median",
        "motion": f"no gravity is in it: {length:.3g} {unit} at the median",
        "none": f"{length:.3g} at the median is neither gravity nor motion, so it is not used",
    }
    lines = [
        "[acceleration]",
        commented(f"{key} = {quoted(value)}", "of the sensor, along its axes"),
        commented(f'kind = "{kind}"', f'{means[kind]}; or "imu" (with gravity), "motion" (without), "none"'),
        commented(f'unit = "{unit}"', "m/s^2, g, mg"),
    ]
    named = f"{named} taken for " if kind != "none" else f"{named} not used: "
    what = {"imu": "the acceleration of an IMU", "motion": "the acceleration of the motion"}.get(kind, "")
    return "\n".join(["", *lines, ""]), f"{named}{what}{', ' if what else ''}{means[kind]}: check [acceleration] kind"
