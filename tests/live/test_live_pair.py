"""Two devices as one source: frames wait for the wrenches about them, and go without where none come."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

from palpate.files.logs.wrench_means import WrenchMeans
from palpate.live.paired_source import PairedSource
from palpate.live.source import Batch, Source
from tests.support.given_source import Given

MS = 10**6


@pytest.fixture
def devices() -> tuple[Given, Given, PairedSource]:
    frames, wrenches = Given((2, 3)), Given((6,))
    pair = PairedSource(frames, wrenches, WrenchMeans())
    assert isinstance(pair, Source)
    pair.open()
    return frames, wrenches, pair


def test_frames_have_the_mean_of_the_wrenches_about_them(devices: tuple[Given, Given, PairedSource]) -> None:
    frames, wrenches, pair = devices
    batch, rng = Batch(pair.shape), np.random.default_rng(1)
    stamps, cells = 10 * MS * np.arange(1, 6), rng.normal(size=(5, 2, 3))
    fast = MS * np.arange(0, 60) + MS // 2
    pushed = np.outer(fast / 1e9, np.ones(6))
    frames.give(stamps[:3], cells[:3])
    wrenches.give(fast[:30], pushed[:30])
    assert pair.receive(batch, 0.0) == 2  # the third waits for what comes after it
    assert np.array_equal(batch.stamp[:2], stamps[:2])
    assert np.array_equal(batch.values[:2, :6], cells[:2].reshape(2, 6))
    assert np.allclose(batch.values[1, 6:12], 0.020)
    assert batch.values[1, 12] == 10
    frames.give(stamps[3:], cells[3:])
    wrenches.give(fast[30:], pushed[30:])
    assert pair.receive(batch, 0.0) == 3
    assert np.allclose(batch.values[:3, 6], [0.03, 0.04, 0.05])
    pair.close()


def test_a_frame_does_not_wait_for_ever(devices: tuple[Given, Given, PairedSource]) -> None:
    frames, _, pair = devices
    batch = Batch(pair.shape)
    frames.give(np.array([10 * MS]), np.ones((1, 2, 3)))
    found = sum(pair.receive(batch, 0.2) for _ in range(3))
    assert found == 1
    assert np.isnan(batch.values[0, 6:12]).all()
    assert batch.values[0, 12] == 0


def test_a_frame_waits_for_wrenches(
    devices: tuple[Given, Given, PairedSource], monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a clock that stands still, so that a busy machine does not make it late."""
    frames, _, pair = devices
    clock = SimpleNamespace(monotonic=lambda: 1e9, sleep=time.sleep, time_ns=time.time_ns)
    monkeypatch.setattr("palpate.live.waiting_source.time", clock)
    frames.give(np.array([10 * MS]), np.ones((1, 2, 3)))
    assert pair.receive(Batch(pair.shape), 0.0) == 0


def test_what_is_missing_is_said_of_the_frame_before_which_it_is(devices: tuple[Given, Given, PairedSource]) -> None:
    frames, wrenches, pair = devices
    batch = Batch(pair.shape)
    frames.missing = {30 * MS: 3, 50 * MS: 1}
    frames.give(10 * MS * np.arange(1, 6), np.ones((5, 2, 3)))
    wrenches.give(MS * np.arange(30) + MS // 2, np.ones((30, 6)))
    assert pair.receive(batch, 0.0) == 2
    assert batch.lost[:2].tolist() == [0, 0]
    wrenches.give(MS * np.arange(30, 60) + MS // 2, np.ones((30, 6)))
    assert pair.receive(batch, 0.0) == 3
    assert batch.lost[:3].tolist() == [3, 0, 1]


def test_wrenches_of_another_clock_are_said(devices: tuple[Given, Given, PairedSource]) -> None:
    frames, wrenches, pair = devices
    batch = Batch(pair.shape)
    pair._heard -= 10.0  # as if that long had passed
    wrenches.give(MS * np.arange(100) + 10**18, np.ones((100, 6)))
    frames.give(10 * MS * np.arange(1, 6), np.ones((5, 2, 3)))
    assert sum(pair.receive(batch, 0.2) for _ in range(3)) == 5
    assert "stamped by one clock" in " ".join(pair.events())
