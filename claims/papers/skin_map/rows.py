"""The `skin map` paper: its B-spline of the wrist, table 2, and where cells come to lie, figures 6 to 8."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from claims.evidence.skin_contacts import protocol
from claims.evidence.skin_map import HEADING, ORIGIN, SHEET, splines, wrist
from claims.page import fill, table
from claims.row import Row, skipped
from palpate.sensors.taxels.skin_map import map_skin
from palpate.sensors.taxels.skin_map.paper import paper_map

FOLDER = Path(__file__).parent
PAPER = {  # n, m: min, max, mean [mm] of the geometric distance, and time [ms], as printed in table 2
    (5, 5): (0.001, 3.820, 0.987, 344),
    (5, 10): (0.001, 3.856, 0.824, 414),
    (10, 5): (0.001, 3.820, 1.006, 598),
    (10, 10): (0.001, 3.856, 0.854, 766),
}
BENCH = (  # what, theirs, and ours of a session's comparison
    ("7: directions, sensor, x and y of unit vectors [%]", "2.9", lambda j: 100 * np.nanmean(j.paper)),
    ("directions, sensor, in space [deg]", "", lambda j: np.degrees(np.nanmean(np.concatenate(j.turned)))),
    ("8: positions, sensor, z set to zero [mm]", "4.2", lambda j: 1e3 * np.nanmean([one[0] for one in j.flat])),
    ("positions, sensor, in space [mm]", "", lambda j: 1e3 * np.nanmean(np.concatenate(j.sensor))),
    ("8: positions, wand, z set to zero [mm]", "14.0", lambda j: 1e3 * np.nanmean([one[1] for one in j.flat])),
    ("positions, wand, in space [mm]", "", lambda j: 1e3 * np.nanmean(np.concatenate(j.wand))),
)


def rows(small: bool) -> Iterator[Row]:
    link, count = wrist(), 3 if small else 50
    if link is None:
        yield from skipped("table 2 and figures 6 to 8, on the paper's own wrist", "")
        return
    first = [
        [f"the paper, n = {n}, m = {m}", f"{low:.3f}, {high:.3f}, {mean:.3f}", "", f"{took}"]
        for (n, m), (low, high, mean, took) in PAPER.items()
    ]
    for name, _, values, took, _ in splines(link, small):
        first.append([name, *(f"{low:.3f}, {high:.3f}, {mean:.3f}" for low, mean, high in values), f"{took:.1f}"])
    given = {"origin": ORIGIN, "heading": HEADING}
    ours = map_skin(link, SHEET, **given)
    theirs = {
        f"the paper's way, {how}": paper_map(link, SHEET, **given, reading=how) for how in ("literal", "greville")
    }
    facets = map_skin(link, SHEET, **given, mode="facets")
    cells = list[list[str]]()
    for name, other in (theirs | {"along facets instead of through vertices": facets}).items():
        apart = 1e3 * np.linalg.norm(ours.centres - other.centres, axis=-1)
        turned = np.degrees(np.arccos(np.clip(np.einsum("rci,rci->rc", ours.normals, other.normals), -1.0, 1.0)))
        cells.append([f"{name}: cells off by [mm]", f"{apart.mean():.2f}", f"{apart.max():.2f}"])
        cells.append([f"{name}: normals turned by [deg]", f"{turned.mean():.2f}", f"{turned.max():.2f}"])
    for name, skin in (theirs | {"ours": ours}).items():
        for axis, kind in ((1, "columns"), (0, "rows")):
            step = 1e3 * np.linalg.norm(np.diff(skin.centres, axis=axis), axis=-1)
            worst = step.flat[np.abs(step - 10).argmax()]
            what = f"{name}: between neighbouring {kind} (10 on the sheet) [mm]"
            cells.append([what, f"{step.mean():.2f}", f"{worst:.2f}"])
    touched = [protocol(count, size) for size in (0.3, 3.0)]
    bench = [[what, others, *(f"{figure(each):.2f}" for each in touched)] for what, others, figure in BENCH]
    heads = ("way", "min, max, mean to the mesh [mm]", "min, max, mean from the mesh [mm]", "time [ms]")
    if not small:
        tables = {
            "table_2": table(heads, first),
            "cells": table(("", "mean", "worst"), cells),
            "bench": table(("", "theirs", "touches of 0.3 cells", "patches of 3 cells"), bench),
        }
        (rms, worst), notes = (100 * strain for strain in ours.strain), " ".join(f"{note}." for note in ours.notes)
        overlap = np.count_nonzero(ours.overlap)
        fill(FOLDER, rms=rms, worst=worst, overlap=overlap, notes=notes, count=count, **tables)
    yield from (Row(f"table 2, {name}: {heads[1]}", "", got) for name, got, *_ in first[len(PAPER) :])
    yield from (Row(what, "", f"{mean}, {worst} at worst") for what, mean, worst in cells)
    for what, others, one, wide in bench:
        yield Row(f"{what}, touches of 0.3 cells, of 3", "", f"{one}, {wide}", None, (others,))
