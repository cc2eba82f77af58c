"""One long log by `palpate estimate`, in one process and with others that read and write and threads that locate.

Wall time means something on a machine that does nothing else, so the load stands beside it.
"""

import os
from collections.abc import Iterator
from pathlib import Path

from claims.evidence.long_logs import write_log
from claims.process import Took, palpate
from claims.row import Row, scratch
from claims.timings.processes import prepare
from palpate_lab.simulation import simulate_session

SAMPLES, LEAST = 10_000_000, 1.7  # times as quick
SHORTER = (60_000, 120_000, 240_000, 480_000)


def rows(small: bool) -> Iterator[Row]:
    """A body of 20k facets, wrenches and poses at 1 kHz, MCAP; small judges nothing."""
    with scratch() as folder:
        session = simulate_session(facets=2_000 if small else 20_000)
        prepare(session, folder)
        for samples in (2_000,) if small else SHORTER:
            write_log(folder / "long.mcap", session, samples)
            got = _compared(folder)[2] + f"; {(folder / 'long.mcap').stat().st_size / 1e6:.0f} MB"
            yield Row(f"one log of {samples:,} samples: from what size on do other processes pay?", "", got)
        samples = 2_000 if small else SAMPLES
        write_log(folder / "long.mcap", session, samples)
        ratio, same, got = _compared(folder)
    what = f"one log of {samples:,} samples, read and written by processes of their own, located in two threads"
    met = None if small else same and ratio >= LEAST
    yield Row(what, f">= {LEAST}x on two cores, same bits", got, met)


def _compared(folder: Path) -> tuple[float, bool, str]:
    """The log of a folder with two workers: how many times as quick, whether with the same bits, and all in words."""
    found = dict[int, list[Took]]({1: [], 2: []})
    for workers in (1, 2, 1, 2):  # in turns
        words = f"estimate long.mcap --rig rig.toml -o long{workers}.mcap --workers {workers}"
        found[workers].append(palpate(*words.split(), cwd=folder))
    same = (folder / "long1.mcap").read_bytes() == (folder / "long2.mcap").read_bytes()
    one, two = (min(each.wall for each in found[workers]) for workers in (1, 2))
    cpu = min(each.cpu for each in found[2]) / min(each.cpu for each in found[1])
    figure = f"{one / two:.2f}x: {one:.1f} s, {two:.1f} s; CPU {cpu:.2f}x; {'the same' if same else 'OTHER'} bits"
    return one / two, same, f"{figure}; load {os.getloadavg()[0]:.1f}"
