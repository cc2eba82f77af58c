"""`palpate live` of a robot of 24 sensors: its share of a core, from sample to contact, and its memory.

The robot is that of the log in `evidence.robots`: 20 sheets and patches of taxels at 100 Hz, four force/torque sensors
at 1 kHz with payload and filter. Its log is replayed at its own speed in a loop, recorded, and shown by a page that
nobody looks at. All processes count: the receiver of all sensors, that of the joint states, recorder and page.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from claims.evidence.robots import MINUTE, SHORT, doubled, simulated
from claims.row import Row
from palpate.live.record import rings_of
from palpate.live.stream_buffer import StreamBuffer

SHARE, LATE, GROWN = 35.0, 1.0, 1.02  # % of a core; ms; times the memory after the first minute
SETTLE, SECONDS, RUNS = 8.0, 20.0, 5  # s; s of a run
LONG = 600.0  # s over which memory is watched
SOURCE = '[source]\nkind = "replay"\naddress = "twice.mcap"\nspeed = 1.0\nloop = true\n'
PAGE = os.sysconf("SC_PAGE_SIZE")


def rows(small: bool) -> Iterator[Row]:
    """Processor time and latency, the median of five runs, and memory; small runs once and judges nothing."""
    with TemporaryDirectory() as scratch:
        rig = doubled(simulated(Path(scratch), "humanoid", 60, *(SHORT if small else MINUTE)))
        head, mark, rest = rig.read_text(encoding="utf-8").partition("\n[sensors.")
        rig.write_text(f"{head}\n{SOURCE}{mark}{rest}", encoding="utf-8")
        runs = [_run(rig, 3.0 if small else SECONDS) for _ in range(1 if small else RUNS)]
        share, late, due, each = map(np.array, zip(*runs, strict=True))
        load = f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors"
        kinds = ", ".join(f"{what} {many:.0f} %" for what, many in zip(_KINDS, np.median(each, axis=0), strict=True))
        middle, (half, last), waits = np.median(share), np.median(late, axis=0), np.median(due, axis=0)
        turns = "p50 {:.2f}, p99 {:.2f} ms".format(*waits)
        for what, bound, got, met in (
            ("recorder and page: processor", f"<= {SHARE:g} %", f"{middle:.0f} % of a core ({kinds})", middle <= SHARE),
            ("from sample to contact", f"p99 <= {LATE:g} ms", f"p50 {half:.2f}, p99 {last:.2f} ms", last <= LATE),
            ("from when a sample is due to its contact; up to 24 are due at once", "", turns, None),
        ):
            yield Row(
                f"24 sensors of a replayed log, {what}",
                "" if small else bound,
                f"{got}; {load}",
                None if small else met,
            )
        if not small:
            yield _memory(rig)


_KINDS = "receiver of sensors", "others"
SENSORS = 24


def _run(rig: Path, seconds: float) -> tuple[float, np.ndarray, np.ndarray, list[float]]:
    """Return % of a core, p50 and p99 [ms] from sample and from its time to contact, and % of a core of `_KINDS`."""
    with TemporaryDirectory() as scratch, _Live(rig, Path(scratch)) as live:
        time.sleep(SETTLE)
        before, begin, counts = live.spent(), time.monotonic(), [ring["answered"] for ring in live.rings]
        time.sleep(seconds)
        after, took = live.spent(), time.monotonic() - begin
        times = np.concatenate([_times(ring, count) for ring, count in zip(live.rings, counts, strict=True)])
    each = [100.0 * (after[kind] - before[kind]) / took for kind in _KINDS]
    stamp, arrived, ready = times.T
    begun = (arrived - stamp).min()  # ns, of the log: by the sample that came with the least delay
    waits = ready - arrived, ready - stamp - begun
    return sum(each), *(1e-6 * np.percentile(wait, [50, 99]) for wait in waits), each


def _times(ring: StreamBuffer, first: int) -> np.ndarray:
    """Return (n, 3) [ns] stamp, arrival and answer of the samples from `first` on that are still in the ring."""
    if ring.form.joints:
        return np.zeros((0, 3), dtype=np.int64)
    last = ring["answered"]
    slots, _ = ring.read(max(first, last - ring.safe), last)
    return np.column_stack([slots[name] for name in ("stamp", "arrived", "ready")])


def _memory(rig: Path) -> Row:
    with TemporaryDirectory() as scratch, _Live(rig, Path(scratch)) as live:
        time.sleep(60.0)
        before = live.memory()
        time.sleep(LONG - 60.0)
        after = live.memory()
    got = f"{before / 2**20:.0f} MiB after a minute, {after / 2**20:.0f} after ten"
    return Row(
        "24 sensors of a replayed log: memory of all processes",
        f"<= {GROWN:g} x that of a minute",
        got,
        after <= GROWN * before,
    )


class _Live:
    """`palpate live` of a rig with a record and a page, and its rings, once all are there and the page can be seen."""

    def __init__(self, rig: Path, folder: Path) -> None:
        self._record = folder / "record.mcap"
        words = ["live", "--rig", rig, "--record", self._record, "--view", "--port", "0"]
        command = [sys.executable, "-m", "palpate", *map(str, words)]
        nothing = subprocess.DEVNULL
        self._running = subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=nothing, start_new_session=True)
        self.rings = list[StreamBuffer]()

    def __enter__(self) -> "_Live":
        end = time.monotonic() + 180.0
        while time.monotonic() < end and self._running.poll() is None:
            paths = rings_of(self._record)
            if len(paths) > SENSORS and not self.rings:  # and the joint states
                self.rings = [StreamBuffer(path) for path in paths]
            if any(text.startswith("the page is at") for ring in self.rings for _, text in ring.events(0)[0]):
                return self
            time.sleep(0.5)
        self.__exit__()
        raise TimeoutError("palpate live of 24 sensors does not begin")

    def __exit__(self, *_: object) -> None:
        for ring in self.rings:
            ring.close()
        self._running.send_signal(signal.SIGTERM)
        self._running.wait()

    def spent(self) -> dict[str, float]:
        """Return the seconds of processor so far by `_KINDS`: the receiver maps the rings of the sensors alone."""
        spent: dict[str, float] = dict.fromkeys(_KINDS, 0.0)
        for process in self._processes():
            mapped = {line.split()[-1] for line in (process / "maps").read_text().splitlines() if ".ring" in line}
            kind = 0 if len(mapped) == SENSORS else 1
            words = (process / "stat").read_text(encoding="ascii").rpartition(")")[2].split()
            spent[_KINDS[kind]] += (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")
        return spent

    def memory(self) -> int:
        """Return the bytes of memory of all processes, without what they share."""
        own = 0
        for process in self._processes():
            _, resident, shared, *_ = map(int, (process / "statm").read_text(encoding="ascii").split())
            own += (resident - shared) * PAGE
        return own

    def _processes(self) -> list[Path]:
        """Return the folders in /proc of the processes of this session."""
        found = list[Path]()
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                words = stat.read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
            except OSError:  # it has ended
                continue
            if int(words[3]) == self._running.pid:
                found.append(stat.parent)
        return found
