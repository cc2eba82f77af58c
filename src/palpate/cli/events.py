"""`palpate events`: when it was touched, how hard and where."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from tyro.conf import arg

from palpate.cli.options import ContactsFile, FileOption
from palpate.cli.screen import lines, note, percent, table, title
from palpate.contact.events import Events, TouchFinder
from palpate.errors import InputError
from palpate.io.atomic import keep_inputs
from palpate.io.contacts import contact_blocks
from palpate.io.contacts.events import write_events

__all__ = ["events"]

_SHOWN = 40
_HEADER = (
    "touch",
    "start [s]",
    "end [s]",
    "peak [N]",
    "x [mm]",
    "y [mm]",
    "z [mm]",
    "sd [mm]",
    "slid [mm]",
    "ambiguous",
)


def events(
    contacts: ContactsFile,
    /,
    output: Annotated[FileOption, arg(aliases=["-o"])] = None,
    gap: Annotated[float, arg(metavar="X")] = 0.05,
    shortest: Annotated[float, arg(metavar="X")] = 0.02,
) -> None:
    """Touches: start, end, peak force, place.

    Args:
        contacts: written by `palpate estimate`: CSV, Parquet or MCAP.
        output: touches.csv to write, as `palpate evaluate` reads it: start,end,px,py,pz,label and more, SI.
        gap: seconds; an interruption that is shorter does not end a touch.
        shortest: seconds that a touch lasts at least.
    """
    if not (gap >= 0 and shortest >= 0):
        raise InputError("seconds must not be negative.", where="--gap, --shortest")
    if output is not None:
        keep_inputs(output, [contacts])
    finder, seconds, rows, notes = TouchFinder(gap=gap, shortest=shortest), 0, 0, dict[str, None]()
    for block in contact_blocks(contacts):
        first = block.contact == 0
        finder.add(block.time[first], block.estimate[first])
        rows, seconds = rows + len(block), seconds + int(np.count_nonzero(~first))
        notes |= dict.fromkeys(block.notes)
    found = finder.touches()
    title(f"{contacts}: {len(found)} touches in {rows:,} rows")
    _table(found)
    if len(found) and np.isnan(found.deviation).all():
        notes["no standard deviation: no noise was known"] = None
    if seconds:
        notes[f"{seconds:,} rows are second contacts and were left out"] = None
    note(notes)
    if output is not None:
        write_events(output, found)
        lines([("written to", output)])


def _table(found: Events) -> None:
    if not len(found):
        return
    figures = np.column_stack([found.start, found.end, found.peak_force, 1e3 * found.point])
    spreads = 1e3 * np.column_stack([found.deviation, found.slid])
    table(
        _HEADER,
        (
            (
                str(k + 1),
                *(f"{value:.{digits}f}" for value, digits in zip(figures[k], (3, 3, 2, 2, 2, 2), strict=True)),
                *(f"{value:.2f}" if np.isfinite(value) else "-" for value in spreads[k]),
                percent(found.ambiguous[k]),
            )
            for k in range(min(len(found), _SHOWN))
        ),
    )
    if len(found) > _SHOWN:
        note([f"{len(found) - _SHOWN} more: --output writes them all"])
