"""Wrenches that no sensor measured are found in noisy logs, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.files.logs.stuck import StuckWrenches


def noisy(count: int = 2000, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 6)) * ([0.05] * 3 + [0.003] * 3)


def found(wrench: np.ndarray, block: int = 700) -> tuple[np.ndarray, tuple[str, ...]]:
    finder, time = StuckWrenches(), np.arange(len(wrench)) / 100
    parts = [finder.find(time[k : k + block], wrench[k : k + block]) for k in range(0, len(wrench), block)]
    return np.concatenate(parts), finder.notes()


def test_zeros_in_the_middle_are_not_measured() -> None:
    wrench = noisy()
    wrench[600:900] = 0.0
    stuck, notes = found(wrench)
    np.testing.assert_array_equal(np.flatnonzero(stuck), np.arange(600, 900))
    assert notes == ("the wrench is exactly zero from 6.000 s to 8.990 s (300 rows): these samples are invalid",)


@pytest.mark.parametrize("block", [2000, 700, 333])
def test_a_sensor_that_hangs_measured_its_first_row_only(block: int) -> None:
    wrench = noisy()
    wrench[600:] = wrench[600]
    stuck, notes = found(wrench, block)
    missed = np.setdiff1d(np.arange(601, 2000), np.flatnonzero(stuck))
    assert not stuck[:601].any()
    assert len(missed) < 20  # of a stretch that a block begins and that is still short in it
    assert "does not change from" in notes[0]


def test_a_dead_channel_makes_every_sample_invalid() -> None:
    wrench = noisy()
    wrench[:, 2] = 0.0165
    stuck, notes = found(wrench)
    assert stuck.all()
    assert "z of the force is 0.0165 in all rows" in notes[0]


@pytest.mark.parametrize("missing", [False, True])
def test_a_channel_that_comes_alive_is_noted_for_the_samples_before(missing: bool) -> None:
    wrench = noisy()
    wrench[:1500, 2] = 0.0165
    wrench[800] = np.nan if missing else wrench[800]  # a missing row is no sign of life
    stuck, notes = found(wrench)
    np.testing.assert_array_equal(np.flatnonzero(stuck), np.arange(1400))  # by whole blocks
    assert len(notes) == 1
    assert "z of the force is 0.0165 in all rows before 14.000 s" in notes[0]


def test_good_logs_are_left_alone() -> None:
    count = 3000
    ramp = np.clip(np.sin(np.arange(count) / 300), 0.0, None)[:, None] * np.array([1, 2, 3, 0.1, 0.2, 0.3])
    for name, wrench in {
        "noise": noisy(count),
        "no noise, at rest between touches": ramp,
        "one force without noise": np.tile([1.0, 0, 0, 0, 0, 0], (count, 1)),
        "held: the log is faster than the sensor": np.repeat(noisy(count // 50), 50, axis=0),
        "quantised to its noise": np.round(noisy(count) / ([0.05] * 3 + [0.003] * 3)),
        "coarser than its noise": np.round(noisy(count) / ([0.4] * 3 + [0.02] * 3)),
        "short": noisy(50),
        "gaps": np.where((np.arange(count) % 100 == 0)[:, None], np.nan, noisy(count)),
    }.items():
        stuck, notes = found(wrench)
        assert not stuck.any(), name
        assert notes == (), name
