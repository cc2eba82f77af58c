"""Every variant on every mesh, logs and loops, and other estimators: the tables of RESULTS.md."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from claims.page import fill, table
from claims.row import Row
from claims.timings import peers, streams
from claims.timings.measure import FLAT, Meshes, batches, short, singles

SIZES = (200, 2_000, 20_000, 200_000, 1_000_000)


def rows(small: bool) -> Iterator[Row]:
    """Yield how many times slower others are than the flat kernel; small: meshes up to 20k facets, few queries."""
    begin, sizes = time.perf_counter(), SIZES[:3] if small else SIZES
    one, many = dict[int, dict[str, list[float]]](), dict[int, dict[str, float]]()
    for size in sizes:
        meshes = Meshes(size)
        times = singles(meshes, *((100, 0.1) if small else (1_000, 0.5)))
        one[size] = {name: np.percentile(each, [50, 99]).tolist() for name, each in times.items()}
        many[size] = batches(meshes, 2_000 if small else 100_000)
        for name, (middle, _) in one[size].items():
            got = f"{short(middle)} us, {short(middle / one[size][FLAT][0])} times the flat kernel"
            yield Row(f"one query, {name}, {size:,} facets", "", got)
        del meshes
    for each in many.values():
        for name in ("flat, h = 0", "flat, facets only, h = 0"):
            if "embreex, h = 0" in each:
                each[f"{name}, over embreex"] = 1e6 * each[name] / each["embreex, h = 0"]
    samples = 2_000 if small else 100_000
    others = peers.parts(100 if small else 1_000)
    parts = {
        "one": _table(one, lambda each, _: f"{short(each[0])} ({short(each[1])})"),
        "slower": _table(one, lambda each, size: short(each[0] / one[size][FLAT][0])),
        "batches": _table(many, lambda rate, _: f"{1e-6 * rate:.2f}"),
        "samples": samples,
        "rounds": streams.ROUNDS,
        "streams": streams.report(samples),
        **others,
    }
    if not small:
        fill(Path(__file__).parent, page="RESULTS.md", took=time.perf_counter() - begin, **parts)


def _table(found: dict[int, dict[str, Any]], said: Callable[[Any, int], str]) -> str:
    names = dict.fromkeys(name for each in found.values() for name in each)
    cells = [
        [name, *(said(each[name], size) if name in each else "" for size, each in found.items())] for name in names
    ]
    return table(("", *(f"{size:,}" for size in found)), cells, "---:")
