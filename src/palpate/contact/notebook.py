"""Contacts as a notebook shows them: one line, and a short table of the touches."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from palpate.contact.contacts import Contacts
from palpate.contact.events import Events, find_touches

__all__ = ["table_of"]

_SHOWN = 10  # touches
_HEADER = ("touch", "start [s]", "end [s]", "peak [N]", "x [mm]", "y [mm]", "z [mm]", "+- [mm]")


def table_of(contacts: Contacts) -> str:
    """HTML of a line that counts and of the first touches; times as in the log."""
    touches = find_touches(contacts)
    said = [f"<p>{escape(repr(contacts))}</p>"]
    if len(touches):
        said.append(_table(_HEADER, _rows(touches, _SHOWN)))
    if len(touches) > _SHOWN:
        said.append(f"<p>and {len(touches) - _SHOWN:,} touches more: palpate.contact.events.find_touches</p>")
    said += [f"<p>{escape(note)}</p>" for note in contacts.notes]
    return "<div>" + "".join(said) + "</div>"


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
