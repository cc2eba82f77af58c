"""Of a stream without end an even share is kept, the peaks of force and exact counts, in memory that does not grow."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ROW, ContactEstimate, Status
from palpate.viewer.run_summary import RunSummary


def _estimate(rng: np.random.Generator, count: int) -> ContactEstimate:
    rows = rng.normal(size=(count, ROW.length))
    rows[:, ROW.candidates] = rng.integers(0, 5, count)
    rows[:, ROW.status] = rng.integers(0, len(Status), count)
    rows[rng.random(count) < 0.2, :10] = np.nan
    return ContactEstimate.from_rows(rows)


def _same(one: ContactEstimate, other: ContactEstimate) -> bool:
    return all(np.array_equal(vars(one)[name], vars(other)[name], equal_nan=True) for name in vars(one))


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
    whole, pieces = RunSummary(limit), RunSummary(limit)
    whole.add(Contacts.single(time, estimate))
    start = 0
    for size in sizes:
        pieces.add(Contacts.single(time[start : start + size], estimate[start : start + size], start))
        start += size
    assert len(pieces.contacts) <= limit
    assert pieces.samples == total
    assert np.array_equal(pieces.statuses, np.bincount(estimate.status, minlength=len(Status)))
    assert np.array_equal(pieces.contacts.time[pieces.even], time[:: pieces.stride])
    if pieces.stride == whole.stride:  # the moment of doubling may fall into a block
        assert np.array_equal(pieces.contacts.time[pieces.even], whole.contacts.time[whole.even])


@pytest.mark.parametrize("at", [0, 1, 14_321, 29_999])
def test_the_peak_of_force_survives(at: int) -> None:
    """One strong sample in thirty thousand, wherever it lies."""
    rows = np.zeros((30_000, ROW.length))
    rows[:, ROW.force] = np.random.default_rng(2).uniform(0, 1, (30_000, 3))
    rows[at, ROW.force] = 50.0
    kept = RunSummary(100)
    time, estimate = np.arange(30_000.0), ContactEstimate.from_rows(rows)
    for start in range(0, len(rows), 3_000):
        block = slice(start, start + 3_000)
        kept.add(Contacts.single(time[block], estimate[block], start))
    assert len(kept.contacts) <= 100
    assert kept.contacts.sample[np.argmax(np.linalg.norm(kept.contacts.force, axis=1))] == at


def test_memory_stays_flat() -> None:
    """What is held never exceeds twice the limit and one block, by count of rows."""
    kept, estimate = RunSummary(200), _estimate(np.random.default_rng(3), 1_000)
    for k in range(100):
        kept.add(Contacts.single(np.arange(1_000.0) + 1_000 * k, estimate, 1_000 * k))
        for buckets in (kept._even, kept._peaks):
            assert sum(map(len, buckets.parts)) <= 2 * buckets.limit + 1_000
    assert kept.stride >= 100_000 / 200


def test_a_limit_below_eight_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 8"):
        RunSummary(7)


@pytest.mark.parametrize("limit", [8, 40, 1_000])
def test_a_sample_is_kept_with_all_of_its_contacts_and_features(limit: int) -> None:
    """One to three contacts a sample, in blocks that end between samples."""
    rng = np.random.default_rng(4)
    counts = rng.integers(1, 4, 300)
    sample = np.repeat(np.arange(300), counts)
    identity = np.concatenate([np.arange(count) for count in counts])
    estimate = _estimate(rng, len(sample))
    whole = Contacts(sample, sample / 10, identity, estimate, {"area": rng.random(len(sample))})
    kept = RunSummary(limit)
    for start in range(0, 300, 70):
        kept.add(whole[(sample >= start) & (sample < start + 70)])
    found = kept.contacts
    rows = np.flatnonzero(np.isin(sample, found.sample))
    assert np.array_equal(found.sample, sample[rows])
    assert np.array_equal(found.identity, identity[rows])
    assert np.array_equal(found.features["area"], whole.features["area"][rows])
    assert _same(found.estimate, estimate[rows])
    assert len(np.unique(found.sample)) <= limit
    assert (kept.samples, kept.statuses.sum()) == (300, len(sample))
    assert kept.rate == pytest.approx(10.0)
    force = np.nan_to_num(np.linalg.norm(estimate.force, axis=1))
    assert sample[force.argmax()] in found.sample
