"""One long log by `palpate estimate`, in one process and with others that read and write and threads that locate.

Wall time means something on a machine that does nothing else, so the load stands beside it.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.many_logs import Time, timed
from benchmarks.processes import prepare
from evidence.long_logs import write_log
from evidence.row import Row
from palpate.simulation import simulate_session

__all__ = ["rows"]

COMMAND = "python -m benchmarks --only long_log"
SAMPLES, LEAST = 10_000_000, 1.7  # times as quick


def rows(small: bool) -> Iterator[Row]:
    """A body of 20k facets, wrenches and poses at 1 kHz, MCAP; small judges nothing."""
    samples = 2_000 if small else SAMPLES
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        session = simulate_session(facets=2_000 if small else 20_000)
        prepare(session, folder)
        write_log(folder / "long.mcap", session, samples)
        found = dict[int, list[Time]]({1: [], 2: []})
        for workers in (1, 2, 1, 2):  # in turns
            command = ("estimate", str(folder / "long.mcap"), "--rig", str(folder / "rig.toml"))
            output = str(folder / f"long{workers}.mcap")
            _, took = timed(sys.executable, "-m", "palpate", *command, "-o", output, "--workers", str(workers))
            found[workers].append(took)
        same = (folder / "long1.mcap").read_bytes() == (folder / "long2.mcap").read_bytes()
    one, two = (min(each.wall for each in found[workers]) for workers in (1, 2))
    cpu = min(each.cpu for each in found[2]) / min(each.cpu for each in found[1])
    got = (
        f"{one / two:.2f}x: {one:.0f} s, {two:.0f} s; CPU {cpu:.2f}x; {'the same' if same else 'OTHER'} bits; "
        f"load {os.getloadavg()[0]:.1f}"
    )
    what = f"one log of {samples:,} samples, read and written by processes of their own, located in two threads"
    met = None if small else same and one / two >= LEAST
    yield Row("long_log", what, f">= {LEAST}x on two cores, same bits", got, met, COMMAND)
