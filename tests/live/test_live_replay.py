"""A log that is replayed as fast as it goes: it waits for the recorder, and says when no more samples come."""

from pathlib import Path

import numpy as np
import pytest

import palpate
from palpate.errors import InputError
from palpate.files.logs import read_recording
from palpate.live.capture import listen, stated_source
from palpate.live.live import Live
from palpate.live.losses import LossCount
from palpate.live.source import BATCH
from palpate.live.stream_buffer import StreamBuffer
from tests.support.given_source import Given
from tests.support.live_rings import answered, sphere_rig, sphere_ring

COUNT = 20_000  # samples: several times the ring


@pytest.fixture
def live(tmp_path: Path) -> Live:
    """Of a log of that many."""
    rig = sphere_rig(tmp_path)
    rig.write_text(rig.read_text().replace("[source]", "[source]\nspeed = 0"))
    rows = np.column_stack([np.arange(COUNT) / 1000.0, np.random.default_rng(1).normal(0.0, 0.01, (COUNT, 6))])
    head = "time,fx,fy,fz,tx,ty,tz"
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=head, comments="", fmt="%.6f")
    return Live(palpate.load_rig(str(rig)))


@pytest.mark.parametrize("slots", [1800, 3000])
def test_samples_that_can_wait_are_not_lost_to_a_slow_recorder(live: Live, tmp_path: Path, slots: int) -> None:
    """Never so far ahead of it that it cannot be sure of its samples; nobody is waited for otherwise."""
    assert live.patient
    form = live.form()
    ring = StreamBuffer.make(tmp_path / "ring", form, slots * form.slot().itemsize)
    assert 4 * slots < COUNT
    ring["recording"] = 1
    live.into(ring)
    with live:
        while not live.ended:
            before = ring["received"]
            for _ in range(slots // BATCH + 4):
                live.step(0.0)
                assert ring["received"] - ring["recorded"] <= ring.safe
            if ring["received"] == before:
                assert live.ended or before - ring["recorded"] + BATCH > ring.safe
            ring["recorded"] = ring["received"] - slots // 8
        assert not live.step(0.0).stamp.size
    assert ring["received"] == ring["answered"] == COUNT
    ring.close()


def test_without_a_recorder_nothing_waits(live: Live, tmp_path: Path) -> None:
    """All of the log passes, though nobody says that it was recorded."""
    ring = StreamBuffer.make(tmp_path / "ring", live.form(), 1 << 20)
    live.into(ring)
    with live:
        for _ in range(COUNT // BATCH + 8):
            live.step(0.0)
    assert live.ended
    assert ring["received"] == COUNT
    ring.close()


def test_a_device_is_listened_to_for_a_rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What it sends is a log of the wrenches from 0 s on, or a sentence with what to do."""
    monkeypatch.setattr("palpate.live.capture.SECONDS", 0.3)
    rows = np.column_stack([7.0 + np.arange(1000) / 100.0, np.random.default_rng(1).normal(size=(1000, 6))])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="time,fx,fy,fz,tx,ty,tz", comments="", fmt="%.6f")
    found = read_recording(listen(stated_source(f"replay:{tmp_path / 'log.csv'}"), tmp_path))
    assert 2 <= len(found) < 100
    np.testing.assert_allclose(found.time, rows[: len(found), 0] - 7.0, atol=1e-9)
    np.testing.assert_allclose(found.wrenches(), rows[: len(found), 1:], atol=1e-6)
    assert stated_source("ros2").kind == "ros2"
    with pytest.raises(InputError, match=r"--source: .*kind must be one of"):
        stated_source("netf:10.0.0.1")
    for shape, said in (((12,), "does not send wrenches.*Record a log"), ((6,), "two samples within 0.3 s.*is on")):
        monkeypatch.setattr("palpate.live.capture.source_of", lambda *_, shape=shape: Given(shape))
        with pytest.raises(InputError, match=f"--source: .*{said}"):
            listen(stated_source("ros2"), tmp_path)


class _Counting(Given):
    """A device that counts its samples, and is at some number."""

    late = unknown = 0
    at: tuple[int, ...] = ()

    def position(self) -> tuple[int, ...]:
        return self.at

    def resume(self, position: tuple[int, ...]) -> None:
        self.at = position


@pytest.mark.parametrize(("noted", "unknown"), [((41,), 0), ((41,), 1), ((), 0)])
def test_losses_are_counted_over_a_restart(tmp_path: Path, noted: tuple[int, ...], unknown: int) -> None:
    """30 samples, then 4 of which the position was not noted; 11 are missing by the counter, which are these and 7."""
    ring, device = sphere_ring(tmp_path / "ring"), _Counting((6,))
    count = LossCount(ring, device)
    device.at, device.late = noted, 2
    answered(ring, 30, lost=5)
    assert count.add(30, 5) == ""
    assert (ring["lost"], ring.position) == (3, (30, *noted))
    answered(ring, 4)
    again = _Counting((6,))
    count, again.unknown = LossCount(ring, again), unknown
    assert again.at == noted
    answered(ring, 10, lost=11)
    said = count.add(10, 11)
    known = bool(noted) and not unknown
    assert said.startswith("7 samples were sent while" if known else "an unknown number of samples was sent")
    assert (ring["lost"], ring["away"], ring["unknown"]) == ((10, 7, 0) if known else (14, 0, 1))
    assert count.add(10, 0) == ""
