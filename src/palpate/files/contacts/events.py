"""Write touches.csv, the touches that were found, in the form of known touches."""

from __future__ import annotations

from pathlib import Path

import polars as pl

from palpate.contact.events import Events
from palpate.files.atomic import replacing
from palpate.forks import require_polars_threads


def write_events(path: Path, events: Events) -> None:
    """Write touches as CSV, in SI: start,end,px,py,pz,label, then other columns; labels count from 1.

    Raises:
        InputError: the file cannot be written.
    """
    require_polars_threads()
    columns = {
        "start": events.start,
        "end": events.end,
        **dict(zip(("px", "py", "pz"), events.point.T, strict=True)),
        "label": [str(k + 1) for k in range(len(events))],
        **dict(zip(("nx", "ny", "nz"), events.normal.T, strict=True)),
        **{name: getattr(events, name) for name in ("peak_force", "peak_time", "mean_force", "deviation", "slid")},
        "samples": events.samples,
        "ambiguous": events.ambiguous,
        "contact": events.identity,
        **events.features,
    }
    with replacing(path) as temporary:
        pl.DataFrame(columns).with_columns(pl.col(pl.Float64).fill_nan(None)).write_csv(temporary)
