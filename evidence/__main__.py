"""`python -m evidence [--small] [--only NAME]`: measure every claim and write docs/evidence.md.

With --small the tables are printed and the page is left as it is; --only NAME renews that theme's part of the page.
"""

from __future__ import annotations

import argparse
import sys

from evidence import (
    answered,
    bad_input,
    calls,
    clock,
    conformance,
    covariance,
    covered,
    edges,
    engine,
    entries,
    equations,
    files,
    filters,
    front_door,
    guarded,
    laws,
    load_cells,
    marker_images,
    meanings,
    native,
    noise,
    pad,
    page,
    payload,
    probes,
    processes,
    same,
    skin_contacts,
    skin_map,
    spoiled,
    taxel_layout,
    taxel_limit,
    taxel_work,
    torn,
    touches,
)
from evidence.report import Theme, measure
from evidence.row import ROOT

__all__ = ["THEMES", "main"]

THEMES: dict[str, Theme] = {
    "conformance": conformance.rows,
    "answered": answered.rows,
    "laws": laws.rows,
    "equations": equations.rows,
    "covariance": covariance.rows,
    "edges": edges.rows,
    "engine": engine.rows,
    "payload": payload.rows,
    "spoiled": spoiled.rows,
    "pad": pad.rows,
    "probes": probes.rows,
    "covered": covered.rows,
    "touches": touches.rows,
    "filters": filters.rows,
    "noise": noise.rows,
    "clock": clock.rows,
    "same": same.rows,
    "torn": torn.rows,
    "page": page.rows,
    "guarded": guarded.rows,
    "skin_contacts": skin_contacts.rows,
    "skin_map": skin_map.rows,
    "load_cells": load_cells.rows,
    "marker_images": marker_images.rows,
    "taxel_limit": taxel_limit.rows,
    "taxel_work": taxel_work.rows,
    "taxel_layout": taxel_layout.rows,
    "bad_input": bad_input.rows,
    "calls": calls.rows,
    "front_door": front_door.rows,
    "entries": entries.rows,
    "native": native.rows,
    "files": files.rows,
    "meanings": meanings.rows,
    "processes": processes.rows,
}


def main() -> int:
    """0 when every row that has a target meets it."""
    parser = argparse.ArgumentParser(prog="python -m evidence", description=__doc__)
    parser.add_argument("--small", action="store_true", help="the same functions on few samples, in seconds")
    parser.add_argument("--only", choices=THEMES, help="one theme")
    options = parser.parse_args()
    themes = {options.only: THEMES[options.only]} if options.only else THEMES
    page = None if options.small else ROOT / "docs" / "evidence.md"
    return int(not measure(themes, page, whole=not options.only))


if __name__ == "__main__":
    sys.exit(main())
