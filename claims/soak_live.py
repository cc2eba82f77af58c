"""A day at 1 kHz, as fast as it goes: `palpate live --record` on a log that is replayed again and again.

Every file that is ended is read by the `mcap` library, counted and removed; the last figure is of samples received and
never recorded. As a script: `python -m claims.soak_live [86400000]`.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import polars as pl
import trimesh
from mcap.reader import make_reader

from palpate.live.record import ring_of
from palpate.live.stream_buffer import StreamBuffer
from palpate_lab.simulation import BumpySphere, touch_wrenches

DAY, SECONDS, RATE = 86_400_000, 1000, 1000  # samples; of the log; Hz
R, FACETS, TOUCH = 0.03, 20_000, 700  # m; of the body; samples of a touch, and of a rest
SETTLED = 60.0  # s after which memory is compared with what it was then
TOPIC = "/palpate/live/wrench"
RIG = """\
[surface]
mesh = "body.stl"
unit = "m"
[force_torque]
noise = { force = 0.02, torque = 0.001 }
[source]
kind = "replay"
address = "log.parquet"
speed = 0
loop = true
"""


@dataclass
class Soak:
    """What was seen so far; memory [MiB] without pages of files, by process."""

    recorded: int = 0
    files: int = 0
    settled: dict[str, float] = field(default_factory=dict)
    grown: float = 0.0

    def count(self, folder: Path) -> None:
        """Files that are ended, and out of the way."""
        for file in folder.glob("run*.mcap"):
            with file.open("rb") as stream:
                summary = make_reader(stream).get_summary()
            assert summary is not None
            assert summary.statistics is not None
            counts = summary.statistics.channel_message_counts
            self.recorded += sum(counts.get(k, 0) for k, each in summary.channels.items() if each.topic == TOPIC)
            self.files += 1
            file.unlink()

    def weigh(self, parent: int, seconds: float) -> None:
        """Memory of the command and its processes at most, against what it was at most until they were settled."""
        for process in [Path("/proc") / str(parent), *_children(parent)]:
            try:
                words = (process / "status").read_text().split()
                held = int(words[words.index("RssAnon:") + 1]) / 1024
            except (OSError, ValueError):  # it has just ended
                continue
            if seconds < SETTLED:
                self.settled[process.name] = max(held, self.settled.get(process.name, 0.0))
            elif process.name in self.settled:
                self.grown = max(self.grown, held - self.settled[process.name])


def soak(folder: Path, wanted: int) -> str:
    """So many samples, and what became of them."""
    _write(folder)
    words = [sys.executable, "-m", "palpate", "live", "--rig", str(folder / "rig.toml"), "--split", "500"]
    words += ["--record", str(folder / "run.mcap"), "--realtime", "False"]
    seen, begin, told = Soak(), 0.0, 0.0
    with (folder / "said.txt").open("w") as said:
        running = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=said, stderr=said)
    while not ring_of(folder / "run.mcap").exists():
        assert running.poll() is None, (folder / "said.txt").read_text()
        time.sleep(0.1)
    ring = StreamBuffer(ring_of(folder / "run.mcap"))
    while (received := ring["received"]) < wanted:
        assert running.poll() is None, (folder / "said.txt").read_text()[-2000:]
        now = time.monotonic()
        begin = begin or (now if received else 0.0)
        if begin:
            seen.weigh(running.pid, now - begin)
        seen.count(folder)
        if now - told > 30.0:
            told = now
            sys.stderr.write(f"{received:,} received, {seen.recorded:,} counted, {seen.grown:.1f} MiB\n")
        time.sleep(0.5)
    took = time.monotonic() - begin
    running.send_signal(signal.SIGINT)
    running.wait()
    received = ring["received"]
    seen.count(folder)
    rate, lost = received / took, received - seen.recorded
    return (
        f"{received:,} samples in {took / 60:.1f} min, {rate:,.0f} a second: {lost:,} received and not recorded, "
        f"{seen.files} files; memory of a process at most {seen.grown:.1f} MiB above that of its first {SETTLED:g} s"
    )


def _children(parent: int) -> list[Path]:
    """Return folders in /proc of the processes that a process started."""
    tasks = Path(f"/proc/{parent}/task").glob("*/children")
    return [Path("/proc") / child for task in tasks for child in task.read_text().split()]


def _write(folder: Path) -> None:
    """Body, log and rig: touches of 4 N, seven tenths of a second each, and as long without."""
    body, rng, count = BumpySphere(R), np.random.default_rng(1), SECONDS * RATE
    trimesh.Trimesh(*body.mesh(FACETS), process=False).export(folder / "body.stl")
    points = body.sample(1 + count // (2 * TOUCH), rng)
    wrench = np.repeat(4.0 * touch_wrenches(points, body.normals(points), rng), 2 * TOUCH, axis=0)[:count]
    wrench[np.arange(count) % (2 * TOUCH) < TOUCH] = 0.0
    wrench += rng.normal(size=(count, 6)) * ([0.02] * 3 + [0.001] * 3)
    names = ("fx", "fy", "fz", "tx", "ty", "tz")
    columns = {"time": np.arange(count) / RATE, **{name: wrench[:, k] for k, name in enumerate(names)}}
    pl.DataFrame(columns).write_parquet(folder / "log.parquet")
    (folder / "rig.toml").write_text(RIG, encoding="utf-8")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        sys.stdout.write(f"{soak(Path(made), int(sys.argv[1]) if len(sys.argv) > 1 else DAY)}\n")
