"""Wrenches of one topic beside the rows of another: means about each row, however rows and wrenches come."""

from itertools import pairwise

import numpy as np
import pytest

from palpate.files.logs.wrench_means import WrenchMeans

RNG = np.random.default_rng(3)
FAST = np.arange(0.0005, 1.0, 1e-3)  # s: a sensor at 1 kHz
ROWS = np.arange(0.01, 0.99, 0.01)  # s: a skin at 100 Hz
LINE = np.outer(FAST, np.arange(1.0, 7.0))


def _all(track: WrenchMeans, time: np.ndarray, wrenches: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    track.add(time, wrenches)
    track.complete()
    return track.means(rows)


def test_every_reading_is_used_once_and_the_mean_stands_at_the_row() -> None:
    made, counts = _all(WrenchMeans(), FAST, LINE, ROWS)
    assert (counts[1:] == 10).all()
    assert np.allclose(made[1:], np.outer(ROWS, np.arange(1.0, 7.0))[1:], atol=1e-12)  # of a line: its value there


def test_nothing_depends_on_how_rows_and_wrenches_are_cut() -> None:
    noisy = RNG.normal(size=LINE.shape)
    rows = np.sort(np.concatenate([ROWS, [0.5003, np.nan]]))
    expected = _all(WrenchMeans(), FAST, noisy, rows)
    track, done, parts = WrenchMeans(), 0, []
    for a, b in pairwise([0, 3, 40, 41, 500, 700, len(FAST)]):
        track.add(FAST[a:b], noisy[a:b])
        ready = done + track.answerable(rows[done:])
        parts.append(track.means(rows[done:ready]))
        track.forget(rows[ready] if ready < len(rows) else 1.0)
        done = ready
    track.complete()
    parts.append(track.means(rows[done:]))
    for k in range(2):
        assert np.array_equal(np.concatenate([part[k] for part in parts]), expected[k], equal_nan=True)


def test_a_slow_sensor_is_read_on_the_line_between_and_never_across_a_gap() -> None:
    slow = np.array([0.0, 0.1, 0.2, 0.9])
    made, counts = _all(WrenchMeans(), slow, np.repeat(slow[:, None], 6, axis=1), np.array([0.05, 0.15, 0.5, 0.97]))
    assert np.allclose(made[:2, 0], [0.05, 0.15])
    assert np.isnan(made[2:]).all()
    assert not counts[2:].any()


def test_a_mean_does_not_hide_a_saturated_reading_nor_take_one_that_is_none() -> None:
    wrenches = np.zeros_like(LINE)
    wrenches[200, 2], wrenches[404, 1] = 100.0, np.nan
    made, counts = _all(WrenchMeans(limits=np.full(6, 100.0)), FAST, wrenches, ROWS)
    hit = int(np.argmin(np.abs(ROWS - FAST[200])))
    assert made[hit, 2] == 100.0
    assert not np.delete(made, hit, axis=0).any()
    assert sorted(set(counts[1:, 0].tolist())) == [9, 10]


def test_clocks_apart_leave_rows_without_wrenches_and_say_so() -> None:
    track = WrenchMeans()
    made, _ = _all(track, FAST + 1000.0, LINE, ROWS)
    assert np.isnan(made).all()
    assert track.notes() == (f"{len(ROWS)} of {len(ROWS)} rows have no wrench within 0.25 s",)


@pytest.mark.parametrize("count", [0, 1])
def test_few_wrenches_answer_what_they_can(count: int) -> None:
    made, counts = _all(WrenchMeans(), FAST[:count], LINE[:count], FAST[:3])
    assert made.shape == (3, 6)
    assert counts.sum() <= count
