"""Run `palpate events`: list when, how hard and where it was touched."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from tyro.conf import arg

from palpate.console.console import Quantity, in_full, lines, note, table, title
from palpate.console.options import ContactsFile, FileOption
from palpate.contact.events import Events
from palpate.contact.touch_finder import GAP, SHORTEST, SPEED, TouchFinder
from palpate.errors import InputError
from palpate.files.atomic import keep_inputs
from palpate.files.contacts import contact_blocks
from palpate.files.contacts.writing import write_events
from palpate.viewer.run_report import touch_table
from palpate.viewer.timeline import since

_SHOWN = 40


def events(
    contacts: ContactsFile,
    /,
    output: Annotated[FileOption, arg(aliases=["-o"])] = None,
    gap: Annotated[float, arg(metavar="X")] = GAP,
    shortest: Annotated[float, arg(metavar="X")] = SHORTEST,
    speed: Annotated[float, arg(metavar="X")] = SPEED,
) -> None:
    """List touches: start, end, peak force, contact point.

    Args:
        contacts: written by `palpate estimate`: CSV, Parquet or MCAP.
        output: touches.csv to write, as `palpate evaluate` reads it: start,end,px,py,pz,label and more, SI.
        gap: seconds from one sample in contact to the next; if they are further apart, the touch has ended.
        shortest: seconds that a touch lasts at least.
        speed: metres per second; a point that moves faster, and by more than its noise, is of another touch.

    Raises:
        InputError: an option is negative, a file cannot be read or written, or the output is the input.
    """
    if not (gap >= 0 and shortest >= 0 and speed >= 0):
        raise InputError("seconds and speed must not be negative.", where="--gap, --shortest, --speed")
    if output is not None:
        keep_inputs(output, [contacts])
    finder, rows, touched = TouchFinder(gap=gap, shortest=shortest, speed=speed), 0, 0
    notes = dict[str, None]()
    for block in contact_blocks(contacts):
        finder.add(block)
        rows, touched = rows + len(block), touched + int(np.count_nonzero(block.answered))
        notes |= dict.fromkeys(block.notes)
    found = finder.touches()
    if touched and not len(found):
        what = f"no contact lasts {shortest:g} s (in {touched:,} rows): check the times of the log"
        notes[f"{what}, or find touches of one row with --shortest 0"] = None
    title(f"{contacts}: {len(found)} touches in {rows:,} rows")
    say_touches(found, "--output writes them all")
    if len(found) and np.isnan(found.deviation).all():
        notes["there are no standard deviations, because the noise is not known"] = None
    note(notes)
    if output is not None:
        write_events(output, found)
        lines([("written to", output)])


def say_touches(found: Events, otherwise: str) -> None:
    """Print a table of touches, in text of the first 40, and then `otherwise`: how to get them all."""
    start, after = since(found.start)
    lines([("time [s]", Quantity(after, start))] if after else [])
    shown = len(found) if in_full() else _SHOWN
    if len(found):
        made = touch_table(found, shown)
        table(made.header, made.rows)
    if len(found) > shown:
        note([f"{len(found) - shown} more: {otherwise}"])
