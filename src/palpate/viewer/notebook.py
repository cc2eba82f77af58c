"""Show contacts in a notebook: one line and a short table of the touches, or a drawing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from html import escape

import numpy as np

from palpate.contact.contacts import Contacts
from palpate.contact.ellipse import ellipse
from palpate.contact.estimate import ContactEstimate
from palpate.contact.events import Events
from palpate.contact.touch_finder import find_touches
from palpate.surfaces.surface import SurfaceLike
from palpate.viewer.drawing import Drawing, Mark

__all__ = ["drawing_of_estimates", "drawing_of_touches", "marks_of", "table_of"]

_SHOWN = 10  # touches
_DRAWN = 200  # touches, or estimates
_RIM = 48  # points
_HEADER = ("touch", "start [s]", "end [s]", "peak [N]", "x [mm]", "y [mm]", "z [mm]", "+- [mm]")


def table_of(contacts: Contacts) -> str:
    """Return HTML as text: a line that counts the contacts, a table of ten touches (times as in the log), notes."""
    touches = find_touches(contacts)
    said = [f"<p>{escape(repr(contacts))}</p>"]
    if len(touches):
        said.append(_table(_HEADER, _rows(touches, _SHOWN)))
    if len(touches) > _SHOWN:
        said.append(f"<p>and {len(touches) - _SHOWN:,} more touches: contacts.touches() has all</p>")
    said += [f"<p>{escape(note)}</p>" for note in contacts.notes]
    return "<div>" + "".join(said) + "</div>"


def drawing_of_touches(contacts: Contacts, surface: SurfaceLike | None) -> Drawing:
    """Return a `Drawing` of each touch (at most 200) with its number, at its place, and the force at its peak.

    Raises:
        InputError: `surface` is no surface, such as the path of a mesh file, whose unit is not given.
    """
    touches = find_touches(contacts)
    marks = marks_of(touches, _DRAWN)
    rows = [_peak(contacts, touches, k) for k in range(len(marks))]
    marks = [replace(mark, force=force) for mark, force in zip(marks, contacts.force[rows], strict=True)]
    return Drawing.of(surface, marks, repr(contacts))


def drawing_of_estimates(found: ContactEstimate, surface: SurfaceLike | None) -> Drawing:
    """Return a `Drawing` of each estimate with a place, as an arrow and its 95 % ellipse; of many, an even share.

    Raises:
        InputError: `surface` is no surface, such as the path of a mesh file, whose unit is not given.
    """
    count = int(np.prod(found.batch))
    flat = found.reshaped((count,))
    known = np.flatnonzero(np.isfinite(np.hstack([flat.point, flat.normal])).all(axis=1))
    few = known[:: 1 + len(known) // _DRAWN]
    return Drawing.of(surface, [_mark(flat[int(k)]) for k in few], repr(found))


def marks_of(touches: Events, most: int, start: float = 0.0) -> list[Mark]:
    """Return a list of `Mark`, the first `most` touches, numbered from 1, with tooltips; times count from `start`."""
    marks: list[Mark] = []
    for k in range(min(len(touches), most)):
        place, deviation = ", ".join(f"{value:.2f}" for value in 1e3 * touches.point[k]), 1e3 * touches.deviation[k]
        said = (
            f"touch {k + 1}, {touches.start[k] - start:.2f} to {touches.end[k] - start:.2f} s: "
            f"peak {touches.peak_force[k]:.2f} N, ({place}) mm"
        )
        said += f", sd {deviation:.2f} mm" if np.isfinite(deviation) else ""
        marks.append(Mark(touches.point[k], touches.normal[k], said, f"{k + 1}"))
    return marks


def _peak(contacts: Contacts, touches: Events, k: int) -> int:
    """Return the row of a touch's greatest force."""
    mine = contacts.answered & (contacts.time == touches.peak_time[k]) & (contacts.identity == touches.identity[k])
    return int(np.argmax(mine))


def _mark(found: ContactEstimate) -> Mark:
    """Return the mark of a single estimate."""
    axes, frame = ellipse(found.covariance, found.normal)
    turns = 2 * np.pi * np.arange(_RIM) / _RIM
    rim = found.point + (np.column_stack([np.cos(turns), np.sin(turns)]) * axes) @ frame[:, :2].T
    place, force = ", ".join(f"{value:.2f}" for value in 1e3 * found.point), float(np.linalg.norm(found.force))
    said = f"{found.status}: {force:.2f} N at ({place}) mm"
    return Mark(found.point, found.normal, said, force=found.force, rim=rim if np.isfinite(rim).all() else None)


def _rows(touches: Events, most: int) -> Iterable[Sequence[str]]:
    deviation = touches.deviation
    for k in range(min(len(touches), most)):
        place = (f"{1e3 * value:.2f}" for value in (*touches.point[k], deviation[k]))
        times = (f"{touches.start[k]:.3f}", f"{touches.end[k]:.3f}", f"{touches.peak_force[k]:.3f}")
        yield str(k + 1), *times, *place


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    head = "".join(f"<th>{escape(name)}</th>" for name in header)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
