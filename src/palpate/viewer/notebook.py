"""Show contacts in a notebook: one line and a short table of the touches, or a drawing."""

from __future__ import annotations

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
from palpate.viewer.scene import disc

_SHOWN = 10  # touches
_DRAWN = 200  # touches, or estimates
_RIM = 48  # points
_HEADER = ("touch", "start [s]", "end [s]", "peak [N]", "x [mm]", "y [mm]", "z [mm]", "+- [mm]")


def table_of(contacts: Contacts) -> str:
    """Return HTML: a line that counts the contacts, a table of ten touches (times as in the log), notes."""
    touches = find_touches(contacts)
    said = [f"<p>{escape(repr(contacts))}</p>"]
    if len(touches):
        head = "".join(f"<th>{escape(name)}</th>" for name in _HEADER)
        rows = (_row(touches, k) for k in range(min(len(touches), _SHOWN)))
        body = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows)
        said.append(f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>")
    if len(touches) > _SHOWN:
        said.append(f"<p>and {len(touches) - _SHOWN:,} more touches: contacts.touches() has all</p>")
    said += [f"<p>{escape(note)}</p>" for note in contacts.notes]
    return "<div>" + "".join(said) + "</div>"


def drawing_of_touches(contacts: Contacts, surface: SurfaceLike | None) -> Drawing:
    """Return one `Drawing` of all touches (at most 200), each with its number, place, and force at its peak.

    Raises:
        InputError: `surface` is no surface, such as the path of a mesh file, whose unit is not given.
        GeometryError: an implicit surface cannot be drawn.
    """
    touches = find_touches(contacts)
    marks = marks_of(touches, _DRAWN)
    rows = [_peak(contacts, touches, k) for k in range(len(marks))]
    marks = [replace(mark, force=force) for mark, force in zip(marks, contacts.force[rows], strict=True)]
    return Drawing.of(surface, marks, repr(contacts))


def drawing_of_estimates(found: ContactEstimate, surface: SurfaceLike | None) -> Drawing:
    """Return one `Drawing` of the estimates with a place, as arrows and 95 % ellipses; of many, an even share.

    Raises:
        InputError: `surface` is no surface, such as the path of a mesh file, whose unit is not given.
        GeometryError: an implicit surface cannot be drawn.
    """
    count = int(np.prod(found.batch))
    flat = found.reshaped((count,))
    known = np.flatnonzero(np.isfinite(np.hstack([flat.point, flat.normal])).all(axis=1))
    few = known[:: 1 + len(known) // _DRAWN]
    return Drawing.of(surface, [_mark(flat[int(k)]) for k in few], repr(found))


def marks_of(touches: Events, most: int, start: float = 0.0) -> list[Mark]:
    """Return the marks of the first `most` touches, numbered from 1, with tooltips; times count from `start` [s]."""
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
    rim = found.point + (disc(1, _RIM)[1:] * axes) @ frame[:, :2].T
    place, force = ", ".join(f"{value:.2f}" for value in 1e3 * found.point), float(np.linalg.norm(found.force))
    said = f"{found.status}: {force:.2f} N at ({place}) mm"
    return Mark(found.point, found.normal, said, force=found.force, rim=rim if np.isfinite(rim).all() else None)


def _row(touches: Events, k: int) -> tuple[str, ...]:
    """Return the cells of a touch's row."""
    times = (f"{value[k]:.3f}" for value in (touches.start, touches.end, touches.peak_force))
    return f"{k + 1}", *times, *(f"{1e3 * value:.2f}" for value in (*touches.point[k], touches.deviation[k]))
