"""A log that is replayed as fast as it goes: it waits for the recorder, and says when no more samples come."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import palpate
from palpate.live.live import Live
from palpate.live.source import BATCH
from palpate.live.stream_buffer import StreamBuffer
from tests.support.live_rings import sphere_rig

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
