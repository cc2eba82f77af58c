"""The compiled loops of a stream against NumPy: each word of each slot, across the ring's end too, to the last bit."""

from pathlib import Path

import numpy as np
import pytest

from palpate.files.logs.decoding import seconds
from palpate.live import _stream
from palpate.live.source import Batch
from palpate.live.stream_buffer import LEAST, SlotForm, StreamBuffer

FORMS = {
    "wrench": SlotForm("force_torque", (6,), False, (), 22, 1, wrenches=True),
    "poses": SlotForm("force_torque", (6,), False, (), 22, 1, poses=True, wrenches=True),
    "array": SlotForm("taxels", (4, 3), False, ("sum",), 24, 5, poses=True),
    "image": SlotForm("marker_ring", (3, 5, 3), True, ("sum",), 23, 1),
}
BESIDE = ("orientation", "position", "acceleration")


def filled(form: SlotForm, count: int, rng: np.random.Generator) -> Batch:
    """A batch of anything."""
    batch = Batch(form.shape, count, np.uint8 if form.images else np.float64)
    batch.stamp[:], batch.lost[:] = rng.integers(-(2**62), 2**62, count), rng.integers(0, 9, count)
    batch.arrived = rng.integers(0, 2**62, count)
    batch.values[:] = rng.integers(0, 256, batch.values.shape) if form.images else rng.normal(size=batch.values.shape)
    for name in BESIDE:
        getattr(batch, name)[:] = rng.normal(size=getattr(batch, name).shape)
    return batch


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_slots_hold_what_numpy_writes_by_name(form: SlotForm, tmp_path: Path) -> None:
    """More samples than there are slots, in batches of many sizes, each answered by any number of rows."""
    rng = np.random.default_rng(1)
    ring = StreamBuffer.make(tmp_path / "ring", form, 1)
    expected = np.zeros(LEAST, dtype=form.slot())
    at = 0
    for count in (1, 7, LEAST - 20, 1, 64, 300):
        batch, unsteady = filled(form, count, rng), rng.random(count)
        assert ring.take_in(batch, count, unsteady) == at
        here = (at + np.arange(count)) % LEAST
        expected["number"][here], expected["ready"][here], expected["rows"][here] = at + 1 + np.arange(count), 0, 0
        for name in ("stamp", "arrived", "lost", "values", *(BESIDE if form.poses else ())):
            expected[name][here] = getattr(batch, name)
        if form.poses:
            expected["unsteady"][here] = unsteady
        assert np.array_equal(ring.slots, expected)
        counts = rng.integers(0, form.max_contacts + 1, count)
        rows = rng.normal(size=(counts.sum() + 3, form.width))
        ring.answer(rows, counts)
        done = 0
        for slot, many in zip(here, counts, strict=True):
            expected["contacts"][slot, :many] = rows[done : done + many]
            done += many
        expected["rows"][here] = counts
        known = ring.slots["ready"][here]
        assert (known > 0).all()
        assert np.ptp(known) == 0
        expected["ready"][here] = known
        assert np.array_equal(ring.slots, expected)
        at += count
    if form.max_contacts > 1:
        with pytest.raises(ValueError, match=f"there is room for {form.max_contacts}$"):
            ring.answer(rows, np.array([0, form.max_contacts + 1]))
    assert (ring["received"], ring["answered"]) == (at, at)
    ring.close()


def test_stamps_in_seconds_have_the_bits_of_a_log() -> None:
    rng = np.random.default_rng(2)
    near = (np.array([-(2**53), 0, 10**9, 2**53])[:, None] + np.arange(-9, 10)).ravel()
    stamp = np.concatenate([near, rng.integers(-(2**62), 2**62, 1000), 1_700_000_000_000_000_000 + near])
    times = np.empty(len(stamp))
    _stream.seconds(stamp, times)
    assert np.array_equal(times, seconds(stamp))


def test_datagrams_have_the_kernels_stamp_or_the_time_now() -> None:
    rng = np.random.default_rng(3)
    whole, parts = rng.integers(0, 2**33, 9), rng.integers(0, 10**9, 9)
    said = np.array([40, 0, 32, 31, 56, 33, 52, 40, 16], dtype=np.uint64)
    stamp, told = np.zeros(9, dtype=np.int64), said.copy()
    assert _stream.stamped(8, whole, parts, 32, 5, stamp, told, 56) == said[7]
    assert np.array_equal(stamp[:8], np.where(said >= 32, whole * 10**9 + parts, 5)[:8])
    assert np.array_equal(told, [56] * 8 + [16])
    assert stamp[8] == 0
    assert _stream.stamped(0, whole, parts, 32, 5, stamp, told, 56) == 0
