"""Kill -9, again and again, of `palpate live` at 7 kHz: its receiver, its recorder, its supervisor, or all at once.

Each sample of a Net F/T's stand-in holds its own number in millionths of a newton. What was received is read off the
ring, from outside, before each kill; the files are read by the `mcap` library.
As a script: `python -m tests.support.kill_live 30`.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np

from palpate.live.netft_device import NetFtDevice
from palpate.live.record import ring_of
from palpate.live.recover import recover
from palpate.live.stream_buffer import StreamBuffer
from tests.support.kill_recorder import LIST, messages

__all__ = ["children", "kill_again_and_again"]

RATE, BLOCK = 7000, 256  # Hz, samples sent at once at most
PATIENCE = 60.0  # s
RECEIVER, RECORDER, SUPERVISOR = "receiver", "recorder", "supervisor"
WHO = ((RECEIVER,), (RECORDER,), (RECEIVER, RECORDER), (SUPERVISOR,), (RECEIVER, RECORDER, SUPERVISOR))
_RIG = """\
[surface]
kind = "sphere"
radius = 0.05

[force_torque]
noise = {{ force = 0.02, torque = 0.001 }}

[estimate]
tare = 0.2

{source}"""


class _Device:
    """Samples for ever; a press of 3 N along z in every other second."""

    def __init__(self) -> None:
        self._device, self._ending, self.sent = NetFtDevice(), threading.Event(), 0
        self.rig = _RIG.format(source=self._device.open())
        self._thread = threading.Thread(target=self._send, daemon=True)
        self._thread.start()

    def _send(self) -> None:
        begin = time.monotonic()
        while not self._ending.is_set():
            count = min(BLOCK, int((time.monotonic() - begin) * RATE) - self.sent)
            if count > 0:
                number, values = self.sent + np.arange(count), np.zeros((count, 6))
                values[:, 0], values[:, 1] = number % 1000 / 1e6, number // 1000 / 1e6
                values[:, 2] = np.where(number // RATE % 2, -3.0, 0.0)
                self._device.send(number, values)
                self.sent += count
            time.sleep(0.002)

    def close(self) -> None:
        """End."""
        self._ending.set()
        self._thread.join()
        self._device.close()


def _number(values: np.ndarray) -> int:
    low, high = np.rint(1e6 * values[:2]).astype(int).tolist()
    return 1000 * high + low


class _Run:
    """One `palpate live --record`, until all of it is dead."""

    def __init__(self, folder: Path, rig: str) -> None:
        folder.mkdir()
        (folder / "rig.toml").write_text(rig)
        self.output, self.ring = folder / "run.mcap", ring_of(folder / "run.mcap")
        words = [sys.executable, "-m", "palpate", "live", "--rig", str(folder / "rig.toml")]
        with (folder / "said.txt").open("w") as said:
            words += ["--record", str(self.output), "--split", "20"]
            self._main = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=said, stderr=said)
        self._until(self.ring.exists, "there is no ring")
        self._opened = StreamBuffer(self.ring)
        self.seen = list[tuple[int, int]]()  # samples received until then, and the number that the last one holds

    def running(self) -> dict[str, int]:
        """Process ids; the recorder, who locks it, holds the ring's file open beside the map."""
        found = {SUPERVISOR: self._main.pid}
        for child in children(self._main.pid):
            try:
                if self.ring.name not in (child / "maps").read_text():
                    continue
                links = [os.readlink(link) for link in (child / "fd").iterdir()]
            except OSError:  # it has just ended
                continue
            held = sum(link.endswith(self.ring.name) for link in links)
            found[RECORDER if held > 1 else RECEIVER] = int(child.name)
        return found

    def kill(self, who: tuple[str, ...]) -> None:
        """Once all run and samples come."""
        begin = self._opened["received"]
        self._until(lambda: len(self.running()) == 3 and self._opened["received"] > begin, "not all of them run")
        time.sleep(np.random.default_rng(len(self.seen)).uniform(0.05, 1.0))
        running = self.running()
        slots, first = self._opened.read(self._opened["received"] - 1, 1, "received")
        self.seen.append((first + 1, _number(slots["values"][0])))
        for name in who:
            os.kill(running[name], signal.SIGKILL)
        wait = running if SUPERVISOR in who else {name: running[name] for name in who}
        self._until(lambda: not any(map(_runs, wait.values())), "they do not end")

    def end(self) -> None:
        """Leave nobody behind."""
        for process in self.running().values():
            os.kill(process, signal.SIGKILL)
        self._main.wait()

    def lost(self) -> tuple[int, int, int]:
        """Put together and read: samples received, those of them that are not in the files, gaps in their numbers."""
        received = self._opened["received"]
        time.sleep(2.0)  # within which it counts as being written
        recover(self.output)
        files = sorted(self.output.parent.glob("*.mcap"), key=lambda file: file.stat().st_mtime_ns)
        found = [number for file in files for number in _numbers(file)]
        assert all(one < other for one, other in pairwise(found)), "out of order, or twice"
        wrong = sum(found[until - 1 : until] != [number] for until, number in self.seen)
        gaps = int(np.count_nonzero(np.diff(found) > 1))
        return received, max(wrong, received - len(found)), gaps

    def _until(self, true: Callable[[], bool], what: str) -> None:
        end = time.monotonic() + PATIENCE
        while not true():
            assert time.monotonic() < end, what
            time.sleep(0.02)

    @property
    def ended(self) -> bool:
        """Whether nobody is left to start the others again."""
        return self._main.poll() is not None


def children(parent: int) -> list[Path]:
    """Folders in /proc of the processes that a process started."""
    found = list[Path]()
    for task in Path(f"/proc/{parent}/task").glob("*/children"):
        found += [Path("/proc") / child for child in task.read_text().split()]
    return found


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2][0] != "Z"
    except OSError:
        return False


def _numbers(file: Path) -> list[int]:
    wrenches = (message for _, channel, message in messages(file) if channel.topic == "/palpate/live/wrench")
    return [_number(np.array(LIST.unpack(message.data[-48:]))) for message in wrenches]


def kill_again_and_again(folder: Path, count: int) -> str:
    """So many kills, and what became of the samples."""
    device, run = _Device(), None
    received = lost = gaps = records = 0
    try:
        for k in range(count):
            if run is None:
                run, records = _Run(folder / str(records), device.rig), records + 1
            run.kill(WHO[-1] if k == count - 1 else WHO[k % len(WHO)])
            if run.ended:
                found = run.lost()
                received, lost, gaps = received + found[0], lost + found[1], gaps + found[2]
                run = None
    finally:
        if run is not None:
            run.end()
        device.close()
    told = f"{records} records of {received:,} samples that were received: {lost} of them lost"
    return f"{count} kills, {told}; {gaps} gaps while no receiver ran"


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        sys.stdout.write(f"{kill_again_and_again(Path(made), int(sys.argv[1]))}\n")
