"""A CSV log becomes a `Recording`: columns found, units turned into SI, axes put right, oddities said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.io.layout import ACCELERATION_COLUMNS, ORIENTATION_COLUMNS, POSITION_COLUMNS, Layout, axis_matrix
from palpate.io.table import Table, read_table
from palpate.io.units import FORCE_UNITS, TIME_UNITS, TORQUE_UNITS, near, to_si
from palpate.sensors.recording import ACCELERATION, FORCE, LARGEST, ORIENTATION, POSITION, TORQUE, Recording

__all__ = ["read_recording"]

GAP = 5.0  # steps of the median length that make a gap


def read_recording(path: Path, layout: Layout | None = None) -> Recording:
    """Read a log: as many samples as the file has rows, in their order; what cannot be read is NaN and noted.

    Raises:
        InputError: the file is no table, or a column is missing.
    """
    layout = layout or Layout()
    axes = axis_matrix(layout.axes, left_handed=layout.left_handed, where="axes")
    force = to_si(layout.force_unit, FORCE_UNITS, where="units.force")
    torque = to_si(layout.torque_unit, TORQUE_UNITS, where="units.torque")
    table = read_table(path)
    _require_known(table, [layout.time, *layout.wrench])
    time, time_notes = table.numbers([layout.time])
    seconds = time[:, 0] * to_si(layout.time_unit, TIME_UNITS, where="time_unit")
    wrench, wrench_notes = table.numbers(layout.wrench)
    channels = {FORCE: force * _turned(wrench[:, :3], axes), TORQUE: torque * _turned(wrench[:, 3:], axes)}
    notes = [
        *table.notes,
        *time_notes,
        *wrench_notes,
        *_infinite_notes(channels[FORCE], channels[TORQUE]),
        *_time_notes(seconds),
    ]
    optional = (
        (ORIENTATION, layout.orientation, ORIENTATION_COLUMNS),
        (POSITION, layout.position, POSITION_COLUMNS),
        (ACCELERATION, layout.acceleration, ACCELERATION_COLUMNS),
    )
    for name, declared, usual in optional:
        columns = declared or (usual if set(usual) <= set(table.names) else ())
        if columns:
            channels[name], column_notes = table.numbers(columns)
            notes += column_notes
    if ORIENTATION in channels:
        channels[ORIENTATION], quaternion_notes = _sound_quaternions(channels[ORIENTATION])
        notes += quaternion_notes
    unique = tuple(dict.fromkeys(notes))
    return Recording(seconds, channels, frame=layout.frame, source=path.name, notes=unique)


def _turned(values: Float[np.ndarray, "n 3"], axes: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "n 3"]:
    """Picked and flipped, not multiplied out: an infinite component must not spoil the others."""
    picked = np.argmax(np.abs(axes), axis=1)
    return values[:, picked] * axes[np.arange(3), picked]


def _require_known(table: Table, names: list[str]) -> None:
    """One sentence for all missing columns, not one error after the other."""
    missing = [name for name in names if name not in table.names]
    if missing:
        raise InputError(
            f"there is no column {', '.join(map(repr, missing))}.",
            where=str(table.path),
            mend=f"{near(missing[0], table.names)} Columns are named in a rig; `palpate rig new` guesses them.".strip(),
        )


def _infinite_notes(force: Float[np.ndarray, "n 3"], torque: Float[np.ndarray, "n 3"]) -> list[str]:
    count = int(np.count_nonzero((np.abs(np.hstack([force, torque])) > LARGEST).any(axis=1)))
    return [f"{count} of {len(force)} rows have a force or torque that is infinite or beyond 1e9"] if count else []


def _time_notes(time: Float[np.ndarray, " n"]) -> list[str]:
    """Sentences on times that are missing, repeat, run backwards or leave a gap."""
    notes: list[str] = []
    known = time[np.isfinite(time)]
    steps = np.diff(known)
    if len(known) < len(time):
        notes.append(f"{len(time) - len(known)} of {len(time)} times are missing")
    if np.any(steps < 0):
        notes.append(f"times run backwards {np.count_nonzero(steps < 0)} times (kept in the order of the file)")
    if np.any(steps == 0):
        notes.append(f"{np.count_nonzero(steps == 0)} times repeat the one before")
    forward = steps[steps > 0]
    usual = float(np.median(forward)) if len(forward) else np.inf
    gaps = np.flatnonzero(steps > GAP * usual)
    if len(gaps):
        longest = gaps[np.argmax(steps[gaps])]
        notes.append(
            f"{len(gaps)} gaps longer than {GAP:g} steps of {usual:.4g} s "
            f"(the longest {steps[longest]:.4g} s, at time {known[longest]:.6f})"
        )
    return notes


def _sound_quaternions(quaternion: Float[np.ndarray, "n 4"]) -> tuple[Float[np.ndarray, "n 4"], list[str]]:
    """Quaternions with NaN where the length says that they are none, and what was found."""
    length = np.linalg.norm(quaternion, axis=1)
    none = (length < 0.5) | (length > 2.0)
    far = ~none & (np.abs(length - 1.0) > 0.01)
    notes: list[str] = []
    if none.any():
        notes.append(f"{np.count_nonzero(none)} quaternions have a length far from 1 and were set aside")
    if far.any():
        notes.append(f"{np.count_nonzero(far)} quaternions are not unit (by more than 1 %) and were normalised")
    return np.where(none[:, None], np.nan, quaternion), notes
