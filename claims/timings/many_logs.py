"""Many logs by `palpate batch`, killed in the middle and resumed.

The ideal time of a batch on two processes is half of the CPU seconds that its logs take one by one in one process that
is warm. Wall time means something on a machine that does nothing else, so the load stands beside it, and the CPU
seconds of all processes say what the wall time could be there.
"""

import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

from claims.evidence.long_logs import write_log
from claims.process import python
from claims.row import Row, scratch
from claims.timings.processes import prepare
from palpate_lab.simulation import simulate_session

LOGS, SAMPLES = 1_000, 20_000
ENGINES = {"processes": "joblib", "dask": "distributed", "ray": "ray"}  # backend -> its module
TAG = "PALPATE_BENCHMARK"  # variable by which all processes of a command are known
TICK = os.sysconf("SC_CLK_TCK")
MOST = 1.3  # times the ideal time
WARM = """\
import sys, time
from palpate.cli import main
first, logs, rig, out, some = sys.argv[1:]
main(["batch", first, "--rig", rig, "-o", out, "--workers", "1"])
wall, cpu = time.perf_counter(), time.process_time()
main(["batch", logs, "--rig", rig, "-o", some, "--workers", "1"])
print("warm", time.perf_counter() - wall, time.process_time() - cpu)
"""


def rows(small: bool) -> Iterator[Row]:
    """A body of 20k facets, wrenches and poses at 1 kHz, MCAP; small judges nothing."""
    with scratch() as folder:
        session = simulate_session(facets=2_000 if small else 20_000)
        prepare(session, folder)
        (folder / "logs").mkdir()
        count, samples = (4, 500) if small else (LOGS, SAMPLES)
        for number in range(count):
            write_log(folder / "logs" / f"log_{number:04}.mcap", session, samples - samples // 10 + 37 * number % 2_000)
        yield from _batches(folder, count, small)


def _batches(folder: Path, count: int, small: bool) -> Iterator[Row]:
    rig = str(folder / "rig.toml")
    logs = (str(folder / "logs" / "log_0000.mcap"), str(folder / "logs"))
    printed = python("-c", WARM, *logs, rig, folder / "warm", folder / "one").printed
    ideal = float(printed.split()[-1]) / 2
    for backend in (name for name, module in ENGINES.items() if find_spec(module) is not None):
        out = folder / backend
        command = ("batch", logs[1], "--rig", rig, "-o", str(out), "--workers", "2", "--backend", backend)
        took = [_watched(command, out / "batch.jsonl", most) for most in (count // 2, None)]
        wall, cpu = map(sum, zip(*took, strict=True))
        one = sorted((folder / "one").glob("*.parquet"))
        same = len(one) == count and all(file.read_bytes() == (out / file.name).read_bytes() for file in one)
        ratio = wall / ideal
        got = (
            f"{ratio:.2f}x: {wall:.0f} s, two starts included, ideal {ideal:.0f} s; CPU of all processes "
            f"{cpu / ideal / 2:.2f}x; {'the same' if same else 'OTHER'} bits; load {os.getloadavg()[0]:.1f}"
        )
        what = f"batch of {count:,} logs, 2 workers of {backend}, killed in the middle and resumed"
        yield Row(what, f"<= {MOST}x the ideal, same bits", got, None if small else same and ratio <= MOST)


def _watched(command: Sequence[str], kept: Path, most: int | None) -> tuple[float, float]:
    """Seconds on the wall and of all processes of a command until it ends, or is killed when so many are kept."""
    begin, spent = time.perf_counter(), dict[str, float]()
    environment = {**os.environ, TAG: str(os.urandom(8).hex())}
    words, nowhere = [sys.executable, "-m", "palpate", *command], subprocess.DEVNULL
    process = subprocess.Popen(words, env=environment, stdout=nowhere, stderr=nowhere)
    while process.poll() is None:
        spent |= _spent(f"{TAG}={environment[TAG]}".encode())
        if most is not None and kept.exists() and kept.read_bytes().count(b"\n") > most:
            process.kill()
        time.sleep(0.2)
    if process.returncode and most is None:
        raise RuntimeError(f"{' '.join(command)} ended with {process.returncode}")
    return time.perf_counter() - begin, sum(spent.values())


def _spent(tag: bytes) -> dict[str, float]:
    """CPU seconds of each process that has a variable; what has ended meanwhile is not in it."""
    found = dict[str, float]()
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if tag in (process / "environ").read_bytes().split(b"\0"):
                ticks = (process / "stat").read_text().rpartition(")")[2].split()[11:13]
                found[process.name] = sum(map(int, ticks)) / TICK
    return found
