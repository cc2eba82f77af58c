"""`palpate live` from end to end: what is killed is started again and nothing is lost; bad calls get a sentence."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator
from pathlib import Path

import numpy as np
import pytest

from palpate.cli import main
from palpate.files.contacts import read_contacts
from palpate.live.netft_device import NetFtDevice
from palpate.live.recover import cut_short

LONG = 240.0  # s: what takes longer hangs; kernels may be compiled meanwhile, on a busy machine
RIG = """\
[surface]
kind = "sphere"
radius = 0.05

[force_torque]
noise = {{ force = 0.02, torque = 0.001 }}

[estimate]
contact = {{ on = 0.5, off = 0.3 }}
tare = 0.2
{more}
[source]
kind = "netft"
address = "127.0.0.1"
port = {port}
web = {web}
"""


class Running:
    """A `palpate live` of its own, and a device that streams at rest for as long as it is asked for anything."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.folder, self.record = folder, folder / "run.mcap"
        self._device, self._rng, self.sent = NetFtDevice(), np.random.default_rng(0), 0  # since somebody listens
        self._device.open()
        self.rig = folder / "rig.toml"
        self.rig.write_text(RIG.format(port=self._device.port, web=self._device.web, more=""))
        self._said = folder / "said.txt"
        call = [sys.executable, "-m", "palpate", "live", "--rig", str(self.rig), "--record", str(self.record), *options]
        with self._said.open("wb") as said:
            self.process = subprocess.Popen(
                call, stdout=said, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, env=_environment()
            )

    @property
    def said(self) -> str:
        """All of its output so far."""
        return self._said.read_text(errors="replace")

    def until(self, holds: Callable[[], object]) -> None:
        """Streams until it holds."""
        end = time.monotonic() + LONG
        while not holds():
            assert time.monotonic() < end, self.said
            wrenches = self._rng.normal(size=(20, 6)) * ([0.02] * 3 + [0.001] * 3)
            heard = self._device.send(np.zeros(20, dtype=np.int64), wrenches)
            self.sent += 20 if heard or self.sent else 0
            time.sleep(0.02)

    def children(self) -> dict[str, int]:
        """Workers by the order in which they were started: ids of processes."""
        pid = self.process.pid
        try:
            ids = [int(each) for each in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
            spawned = [each for each in ids if b"spawn_main" in Path(f"/proc/{each}/cmdline").read_bytes()]
        except OSError:  # one of them has just gone
            return {}
        return dict(zip(("receiver", "recorder", "publisher"), sorted(spawned), strict=False))

    def close(self) -> None:
        """Nothing is left behind."""
        for pid in [*self.children().values(), *([self.process.pid] if self.process.poll() is None else [])]:
            os.kill(pid, signal.SIGKILL)
        self.process.wait(LONG)
        self._device.close()


def _environment() -> dict[str, str]:
    here = Path(__file__).parents[2] / "src"
    return {**os.environ, "PYTHONPATH": str(here), "PYTHONUNBUFFERED": "1", "OPENBLAS_NUM_THREADS": "1"}


def _gone(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


@pytest.fixture
def running(tmp_path: Path) -> Generator[Running]:
    made = Running(tmp_path, "--publish", f"unix:{tmp_path / 'contacts'}")
    yield made
    made.close()


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="asks Linux which processes there are")
def test_what_is_killed_is_started_again_and_nothing_is_lost(
    running: Running, capsys: pytest.CaptureFixture[str]
) -> None:
    """A tare by SIGUSR1, the recorder killed, then everything: what was received is in the recovered record."""
    running.until(lambda: "tare over" in running.said)
    os.kill(running.process.pid, signal.SIGUSR1)
    running.until(lambda: running.said.count("tare over") == 2)
    assert "tare requested by a signal (SIGUSR1)" in running.said
    first = running.children()
    assert len(first) == 3
    os.kill(first["recorder"], signal.SIGKILL)
    running.until(lambda: "the recorder was killed by signal 9, and was started again" in running.said)
    part = running.record.with_name("run.mcap.part")
    running.until(lambda: part.exists() and first["recorder"] not in running.children().values())
    for pid in (running.process.pid, *running.children().values()):
        os.kill(pid, signal.SIGKILL)
    running.process.wait(LONG)
    running.until(lambda: "to join them" in cut_short(running.record))  # two seconds after the last sign of life
    assert main(["live", "--rig", str(running.rig), "--record", str(running.record)]) == 1
    assert "palpate recover" in capsys.readouterr().err
    assert main(["recover", str(running.record)]) == 0
    assert "none is missing" in capsys.readouterr().out
    found = read_contacts(running.record)
    assert len(found) > 100
    assert np.array_equal(found.sample, np.arange(len(found)))
    assert main(["inspect", str(running.record)]) == 0
    assert "/palpate/live/wrench" in capsys.readouterr().out


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="asks Linux which processes there are")
def test_it_ends_whole_and_leaves_nothing_running(running: Running) -> None:
    running.until(lambda: running.record.with_name("run.mcap.part").exists() and len(running.children()) == 3)
    running.until(lambda: "tare over" in running.said)
    children = running.children().values()
    os.kill(running.process.pid, signal.SIGINT)
    os.kill(running.process.pid, signal.SIGTERM)
    running.until(lambda: running.process.poll() is not None)
    assert running.process.returncode == 0, running.said
    running.until(lambda: all(map(_gone, children)))
    assert cut_short(running.record) == ""
    assert not list(running.folder.glob("run.mcap.*"))
    found = read_contacts(running.record)
    assert f"{len(found):,} received, {len(found):,} answered" in running.said
    assert f"{len(found):,} samples" in running.said


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="asks Linux which processes there are")
def test_every_sample_is_counted_over_a_killed_receiver(running: Running) -> None:
    """By the device's own count: those sent from the first received one on are received or lost, to the last."""
    running.until(lambda: "tare over" in running.said and len(running.children()) == 3)
    before = running.sent
    os.kill(running.children()["receiver"], signal.SIGKILL)
    running.until(lambda: "samples were sent while the receiver did not run" in running.said)
    time.sleep(0.3)  # until what was sent is answered
    os.kill(running.process.pid, signal.SIGINT)
    running.process.wait(LONG)
    received, lost, away = (
        int(found[1].replace(",", "")) if (found := re.search(rf"([\d,]+) {what}", running.said)) else -1
        for what in ("received", "samples, ", "of them while")
    )
    assert received + lost == running.sent
    assert 0 < away <= min(lost, running.sent - before)


@pytest.fixture
def rig(tmp_path: Path) -> Callable[..., str]:
    """The file of a rig of a device that is not there."""

    def write(more: str = "", text: str = RIG) -> str:
        path = tmp_path / "rig.toml"
        path.write_text(text.format(port=9, web=9, more=more))
        return str(path)

    return write


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--seconds", "-1"), "--seconds: must be positive"),
        (("--port", "99999", "--view"), "--port: must be a port from"),
        (("--record", "run.csv"), "Use .mcap"),
        (("--record", "nowhere/run.mcap"), "there is no folder"),
        (("--record", "run.mcap", "--split", "0"), "--split: must be positive"),
        (("--publish", "smoke"), "not a destination to which contacts can be published. Write"),
        (("--sensor", "skin"), "the rig has no [skin]. Available"),
    ],
)
def test_a_bad_call_is_refused_before_anything_starts(
    rig: Callable[..., str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: tuple[str, ...],
    sentence: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    call = ["live", "--rig", rig(), *options]
    assert main(call) == 1
    heard = capsys.readouterr()
    assert sentence in heard.err
    assert not heard.out
    assert [each.name for each in tmp_path.iterdir()] == ["rig.toml"]


def test_nothing_is_left_of_a_run_without_its_device(
    rig: Callable[..., str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["live", "--rig", rig(), "--record", str(tmp_path / "run.mcap")]) == 1
    assert "port 9" in capsys.readouterr().err
    assert [each.name for each in tmp_path.iterdir()] == ["rig.toml"]


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (("--seconds", "-1"), "--seconds: must be positive"),
        (("--speed", "0"), "--speed: must be positive"),
        (("--port", "99999"), "--port: must be a port from"),
        (("--web", "-1"), "--web: must be a port from"),
        (("--domain", "999"), "--domain: must be from"),
    ],
)
def test_a_bad_replay_is_refused(call: tuple[str, str], sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", "log.csv", "--as", "netft", *call]) == 1
    assert sentence in capsys.readouterr().err


def test_recover_wants_a_record(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, sentence in (("run.csv", "Name its .mcap"), ("run.mcap", "nothing to recover")):
        assert main(["recover", str(tmp_path / name)]) == 1
        assert sentence in capsys.readouterr().err
