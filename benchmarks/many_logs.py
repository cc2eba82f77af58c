"""Many logs by `palpate batch`, and one long log by `palpate estimate`, on two processes against one.

Wall time means something on a machine that does nothing else; the CPU time beside it says what it could be there.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.processes import prepare
from evidence.long_logs import write_log
from evidence.row import Row
from palpate.simulation import simulate_session

__all__ = ["rows"]

COMMAND = "python -m benchmarks --only many_logs"
THEME = "many_logs"
LOGS, SAMPLES, LONG = 1_000, 20_000, 10_000_000
MOST, LEAST = 1.3, 1.7  # times the ideal time; times as quick
WARM = """\
import sys, time
from palpate.cli import main
first, logs, rig, out, some = sys.argv[1:]
main(["batch", first, "--rig", rig, "-o", out, "--workers", "1"])
wall, cpu = time.perf_counter(), time.process_time()
main(["batch", logs, "--rig", rig, "-o", some, "--workers", "1"])
print("warm", time.perf_counter() - wall, time.process_time() - cpu)
"""


@dataclass(frozen=True)
class _Time:
    """Seconds of a command: on the wall, and of all its processes together."""

    wall: float
    cpu: float


def rows(small: bool) -> Iterator[Row]:
    """A body of 20k facets, wrenches and poses at 1 kHz, MCAP; small judges nothing."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        session = simulate_session(facets=2_000 if small else 20_000)
        prepare(session, folder)
        (folder / "logs").mkdir()
        count, samples = (4, 500) if small else (LOGS, SAMPLES)
        for number in range(count):
            write_log(folder / "logs" / f"log_{number:04}.mcap", session, samples - samples // 10 + 37 * number % 2_000)
        yield _batch(folder, count, small)
        samples = 2_000 if small else LONG
        write_log(folder / "long.mcap", session, samples)
        yield _long(folder, samples, small)


def _batch(folder: Path, count: int, small: bool) -> Row:
    rig = str(folder / "rig.toml")
    words = [
        str(folder / "logs" / "log_0000.mcap"),
        str(folder / "logs"),
        rig,
        str(folder / "warm"),
        str(folder / "one"),
    ]
    printed, _ = _timed(sys.executable, "-c", WARM, *words)
    wall, cpu = map(float, printed.split()[-2:])
    command = ("batch", str(folder / "logs"), "--rig", rig, "-o", str(folder / "two"), "--workers", "2")
    _, both = _timed(sys.executable, "-m", "palpate", *command)
    same = all(
        file.read_bytes() == (folder / "two" / file.name).read_bytes() for file in (folder / "one").glob("*.parquet*")
    )
    ratio = both.wall / (wall / 2)
    got = (
        f"{ratio:.2f}x: {both.wall:.0f} s, start included, one by one in a warm process {wall:.0f} s; CPU "
        f"{both.cpu / cpu:.2f}x ({both.cpu:.0f} s, {cpu:.0f} s); {'the same' if same else 'OTHER'} bits"
    )
    target = f"<= {MOST}x the ideal, same bits"
    what = f"batch of {count:,} logs on 2 processes"
    return Row(THEME, what, target, got, None if small else same and ratio <= MOST, COMMAND)


def _long(folder: Path, samples: int, small: bool) -> Row:
    found = dict[int, list[_Time]]({1: [], 2: []})
    for workers in (1, 2, 1, 2):  # in turns
        command = ("estimate", str(folder / "long.mcap"), "--rig", str(folder / "rig.toml"))
        output = str(folder / f"long{workers}.mcap")
        _, took = _timed(sys.executable, "-m", "palpate", *command, "-o", output, "--workers", str(workers))
        found[workers].append(took)
    same = (folder / "long1.mcap").read_bytes() == (folder / "long2.mcap").read_bytes()
    one, two = (min(each.wall for each in found[workers]) for workers in (1, 2))
    cpu = min(each.cpu for each in found[2]) / min(each.cpu for each in found[1])
    got = f"{one / two:.2f}x: {one:.0f} s, {two:.0f} s; CPU {cpu:.2f}x; {'the same' if same else 'OTHER'} bits"
    target = f">= {LEAST}x on two cores, same bits"
    what = f"one log of {samples:,} samples, read, located and written by three processes"
    return Row(THEME, what, target, got, None if small else same and one / two >= LEAST, COMMAND)


def _timed(*command: str) -> tuple[str, _Time]:
    """What a command prints, and how long it took."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with {done.returncode}: {done.stderr}")
    return done.stdout, _Time(wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
