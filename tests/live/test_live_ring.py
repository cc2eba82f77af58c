"""The ring of `palpate live`: what a reader may see, and which files are rings."""

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.live.record import only_one
from palpate.live.source import Batch
from palpate.live.stream_buffer import SlotForm, StreamBuffer
from tests.support.live_rings import answered, sphere_ring, touches


@pytest.fixture
def ring(tmp_path: Path) -> StreamBuffer:
    return sphere_ring(tmp_path / "ring")


def test_what_is_written_over_while_it_is_copied_is_not_given(
    ring: StreamBuffer, monkeypatch: pytest.MonkeyPatch
) -> None:
    answered(ring, 1000)
    reader, laps = StreamBuffer(ring.path), [len(ring.slots)]
    places = reader._parts

    def meanwhile(first: int, count: int) -> object:
        """The reader knows where to copy from; before it does, the writer goes round."""
        found = places(first, count)
        if laps:
            answered(ring, laps.pop())
        return found

    monkeypatch.setattr(reader, "_parts", meanwhile)
    slots, first = reader.read(0, 100)
    assert first > 0
    assert np.array_equal(slots["number"], first + 1 + np.arange(100))


def test_a_reader_of_all_slots_ends_though_the_writer_goes_on(
    ring: StreamBuffer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a busy machine samples come during any copy of a full ring: these are missing, and the others are right."""
    answered(ring, len(ring.slots) + 10)
    reader, tries = StreamBuffer(ring.path), list[int]()
    places = reader._parts

    def meanwhile(first: int, count: int) -> object:
        assert len(tries) < 3, "the reader does not end"
        tries.append(first)
        answered(ring, 3)
        return places(first, count)

    monkeypatch.setattr(reader, "_parts", meanwhile)
    slots, first = reader.read(0, len(ring.slots))
    assert first == ring["received"] - ring.safe
    assert np.array_equal(slots["number"], first + 1 + np.arange(ring.safe - 3))


def test_what_is_received_and_not_answered_is_for_those_who_ask_for_it(ring: StreamBuffer) -> None:
    answered(ring, 7)
    ring.take_in(Batch((6,), 5), 5, np.zeros(5))
    assert len(ring.read(0, 100)[0]) == 7
    assert len(ring.read(0, 100, "received")[0]) == 12


def test_contacts_have_the_numbers_of_their_samples_over_a_gap_and_an_unanswered_one(ring: StreamBuffer) -> None:
    answered(ring, 20)
    first, rest = ring.read(0, 5)[0], ring.read(12, 8)[0]
    rest["ready"][2] = 0
    found = ring.form.contacts(np.concatenate([first, rest]))
    assert found.sample.tolist() == [0, 1, 2, 3, 4, 12, 13, 15, 16, 17, 18, 19]
    known = touches(0, 20)
    assert np.array_equal(found.force, known.force[found.sample])
    assert ring.form.contacts(rest[3:]).sample.tolist() == [15, 16, 17, 18, 19]


def test_a_ring_of_another_version_and_one_that_is_cut_off_are_refused(ring: StreamBuffer) -> None:
    ring["version"] += 1
    with pytest.raises(InputError, match=r"another version.*Read"):
        StreamBuffer(ring.path)
    ring["version"] -= 1
    os.truncate(ring.path, ring.path.stat().st_size - 1)
    with pytest.raises(InputError, match=r"is incomplete.*Remove"):
        StreamBuffer(ring.path)


def test_tares_are_counted_and_said_by_any_thread_while_somebody_records(ring: StreamBuffer) -> None:
    """None of 40 is lost, and the recorder's lock of the file stops nobody."""
    with only_one(ring.path), ThreadPoolExecutor(8) as askers:
        list(askers.map(ring.ask_tare, [f"asker {k}" for k in range(40)], timeout=30.0))
    said, count = ring.events(0)
    assert ring["asked"] == count == 40
    assert sorted(sentence for _, sentence in said) == sorted(f"tare requested by asker {k}" for k in range(40))


def test_what_was_published_has_its_latency(ring: StreamBuffer) -> None:
    answered(ring, 30)
    assert len(ring.published()) == 0
    ring.slots["arrived"][7] -= 2_000_000_000
    ring.publish([7])
    (waited,) = ring.published()
    assert 2.0 <= waited < 60.0
    ring.publish([8] * 2000)
    assert len(ring.published()) == 512
    assert ring.published().max() < 2.0


def test_sentences_do_not_reach_the_slots(ring: StreamBuffer) -> None:
    answered(ring, 30)
    before = ring.read(0, 30)[0].tobytes()
    for k in range(300):
        ring.say(f"{k}" + "x" * 400)
    ring.publish([3] * 600)
    assert ring.read(0, 30)[0].tobytes() == before
    said, count = ring.events(0)
    assert count == 300
    assert [int(text.rstrip("x")) for _, text in said] == list(range(300 - len(said), 300))


@pytest.mark.parametrize("rows", [-1, 1 << 61])
def test_a_damaged_number_of_rows_gives_no_more_than_there_are(ring: StreamBuffer, rows: int) -> None:
    answered(ring, 10)
    ring.slots["rows"][3] = rows
    assert len(ring.form.contacts(ring.read(0, 10)[0])) in (9, 10)


def test_a_copy_without_unused_room_has_all_contacts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ring = StreamBuffer.make(tmp_path / "ring", SlotForm("taxels", (3,), False, (), 22, 4))
    counts, rows = np.arange(200) % 4, np.arange(300 * 22.0).reshape(300, 22)
    ring.take_in(Batch((3,), 200), 200, np.zeros(200))
    ring.answer(rows, counts)
    wanted = ring.read(0, 200)[0]
    monkeypatch.setattr("palpate.live.stream_buffer.SMALL", 0)
    found = ring.read(0, 200)[0]
    assert np.array_equal(found["values"], wanted["values"])
    assert np.array_equal(ring.form.contacts(found).rows(), ring.form.contacts(wanted).rows())
