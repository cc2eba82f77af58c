"""Wrenches that no sensor measured are found in noisy logs, and nowhere else."""

from collections.abc import Sequence

import numpy as np
import pytest

from palpate.files.logs.stuck import StuckWrenches


def noisy(count: int = 2000, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 6)) * ([0.05] * 3 + [0.003] * 3)


def found(
    wrench: np.ndarray, cuts: Sequence[int] = (700, 1400), limits: np.ndarray | None = None
) -> tuple[np.ndarray, tuple[str, ...]]:
    finder, time = StuckWrenches(limits), np.arange(len(wrench)) / 100
    pieces = np.split(np.arange(len(wrench)), sorted(cuts))
    parts = [finder.find(time[rows], wrench[rows]) for rows in pieces]
    return np.concatenate([*parts, finder.find(time[:0], wrench[:0], complete=True)]), finder.notes()


def test_zeros_and_a_sensor_that_hangs_are_not_measured_but_for_the_first_row() -> None:
    for end, first, said in (
        (900, 600, "is exactly zero from 6.000 s to 8.990 s (300 rows)"),
        (2000, 601, "does not change from 6.010 s to 19.990 s (1,399 rows)"),
    ):
        wrench = noisy()
        wrench[600:end] = 0.0 if end == 900 else wrench[600]
        stuck, notes = found(wrench)
        np.testing.assert_array_equal(np.flatnonzero(stuck), np.arange(first, end))
        assert notes == (f"the wrench {said}: these samples are invalid",)


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
    np.testing.assert_array_equal(np.flatnonzero(stuck), np.arange(1500))
    assert len(notes) == 1
    assert "z of the force is 0.0165 from 0.000 s to 14.990 s (1,500 rows) while others change" in notes[0]


@pytest.mark.parametrize("died", [300, 1200, 1850])
def test_a_channel_that_dies_is_found_wherever_it_dies(died: int) -> None:
    wrench = noisy()
    wrench[died:, 4] = wrench[died, 4]
    stuck, notes = found(wrench)
    np.testing.assert_array_equal(np.flatnonzero(stuck), np.arange(died + 1, 2000))  # its first row was measured
    assert len(notes) == 1
    assert f"y of the torque is {wrench[died, 4]:g} from" in notes[0]
    assert not found(wrench[: died + 99])[0].any()  # too short to be told from chance


def test_a_channel_at_its_limit_is_saturated_not_dead() -> None:
    wrench = noisy()
    wrench[1200:, 2] = 5.0
    assert found(wrench)[0].sum() == 799
    assert not found(wrench, limits=np.full(6, 5.0))[0].any()


@pytest.mark.parametrize("seed", range(8))
def test_blocks_of_any_size_give_the_same_answers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    wrench = np.repeat(noisy(2500, seed), seed % 3 + 1, axis=0)
    for _ in range(8):
        start, length = rng.integers(len(wrench)), rng.choice([15, 60, 150, 1000])
        channels = slice(None) if rng.random() < 0.5 else rng.integers(6)
        frozen = wrench[start, channels] * (rng.random() < 0.6)
        wrench[start : start + length, channels] = np.nan if rng.random() < 0.2 else frozen
    stuck, notes = found(wrench, ())
    assert 0 < np.count_nonzero(stuck) < len(wrench)
    for count in (1, 5, 60):
        cut, said = found(wrench, rng.integers(0, len(wrench), count).tolist())
        np.testing.assert_array_equal(cut, stuck)
        assert said == notes


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
