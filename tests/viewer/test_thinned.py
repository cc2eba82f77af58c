"""Of a stream without end an even share is kept, the peaks of force and exact counts, in memory that does not grow."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.contact.estimate import ROW, ContactEstimate, Status
from palpate.viewer.thinned import Thinned


def _estimate(rng: np.random.Generator, count: int) -> ContactEstimate:
    rows = rng.normal(size=(count, ROW.length))
    rows[:, ROW.candidates] = rng.integers(0, 5, count)
    rows[:, ROW.status] = rng.integers(0, len(Status), count)
    rows[rng.random(count) < 0.2, :10] = np.nan
    return ContactEstimate.from_rows(rows)


def _same(one: ContactEstimate, other: ContactEstimate) -> bool:
    return all(np.array_equal(vars(one)[name], vars(other)[name], equal_nan=True) for name in vars(one))


def test_a_short_stream_is_kept_whole_and_to_the_last_bit() -> None:
    estimate = _estimate(np.random.default_rng(1), 500)
    thinned = Thinned(1000)
    thinned.add(np.arange(500.0), estimate)
    assert thinned.stride == 1
    assert thinned.even.all()
    assert np.array_equal(thinned.time, np.arange(500.0))
    assert _same(thinned.estimate, estimate)


def test_nothing_added_is_nothing_kept() -> None:
    thinned = Thinned()
    thinned.add(np.empty(0), _estimate(np.random.default_rng(0), 0))
    assert len(thinned.time) == len(thinned.estimate.status) == thinned.count == 0


@settings(max_examples=40)
@given(
    sizes=st.lists(st.integers(0, 400), min_size=1, max_size=12),
    limit=st.integers(8, 300),
    seed=st.integers(0, 2**32 - 1),
)
def test_block_sizes_do_not_matter(sizes: list[int], limit: int, seed: int) -> None:
    """Whatever the blocks: the same samples are kept, at most `limit`, evenly, and every count is exact."""
    total = sum(sizes)
    estimate, time = _estimate(np.random.default_rng(seed), total), np.arange(total) / 7
    whole, pieces = Thinned(limit), Thinned(limit)
    whole.add(time, estimate)
    start = 0
    for size in sizes:
        pieces.add(time[start : start + size], estimate[start : start + size])
        start += size
    assert len(pieces.time) <= limit
    assert pieces.count == total
    assert np.array_equal(pieces.statuses, np.bincount(estimate.status, minlength=len(Status)))
    assert np.array_equal(pieces.time[pieces.even], time[:: pieces.stride])
    if pieces.stride == whole.stride:  # the moment of doubling may fall into a block
        assert np.array_equal(pieces.time[pieces.even], whole.time[whole.even])


@pytest.mark.parametrize("at", [0, 1, 54_321, 99_999])
def test_the_peak_of_force_survives(at: int) -> None:
    """One strong sample in a hundred thousand, wherever it lies."""
    rows = np.zeros((100_000, ROW.length))
    rows[:, ROW.force] = np.random.default_rng(2).uniform(0, 1, (100_000, 3))
    rows[at, ROW.force] = 50.0
    thinned = Thinned(100)
    time, estimate = np.arange(100_000.0), ContactEstimate.from_rows(rows)
    for start in range(0, len(rows), 3_000):
        block = slice(start, start + 3_000)
        thinned.add(time[block], estimate[block])
    assert len(thinned.time) <= 100
    assert thinned.time[np.argmax(np.linalg.norm(thinned.estimate.force, axis=1))] == at


def test_memory_stays_flat() -> None:
    """What is held never exceeds twice the limit and one block, by count of rows."""
    thinned, estimate = Thinned(200), _estimate(np.random.default_rng(3), 1_000)
    for k in range(300):
        thinned.add(np.arange(1_000.0) + 1_000 * k, estimate)
        for buckets in (thinned._even, thinned._peaks):
            assert buckets._held <= 2 * buckets.limit + 1_000
    assert thinned.stride >= 300_000 / 200


def test_a_limit_below_eight_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 8"):
        Thinned(7)
