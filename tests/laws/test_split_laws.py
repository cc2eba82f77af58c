"""Law 5: how a stream is split into blocks changes no bit of its answers, and a clock that goes back begins anew."""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.contact.contacts import Contacts
from palpate.contact.touch_finder import TouchFinder
from palpate.files.contacts.writing import open_contacts, read_contacts
from palpate.files.logs.wrench_means import WrenchMeans
from palpate.live.losses import LossCount
from palpate.live.netft import NetFt
from palpate.live.sequence import SequenceCounters
from palpate.live.stuck_watch import StuckWatch
from palpate.signals.filters import Butterworth, Filter, Kalman
from palpate.signals.motion import Motion
from palpate.signals.recent_motion import RecentMotion
from palpate.signals.recording import ACCELERATION, FORCE, ORIENTATION, POSITION, Recording
from palpate.signals.smoothing import BothWays, Forward
from palpate.signals.vibration import Vibration
from palpate.spatial.live_track import LiveTrack
from palpate.spatial.pose_track import PoseTrack
from palpate.viewer.live import recent
from tests.conformance.live import BESIDE, each_reading, readings_of
from tests.support.felt import felt
from tests.support.live_rings import sphere_ring
from tests.support.state import IN_BLOCKS, differences, remembered
from tests.support.streams import STREAMS, Stream, pieces, shaken

TWICE = (Butterworth(8.0), Butterworth(8.0, zero_phase=True))
SIZES = ((1, 0), (2, 7, 0, 50))
STREAM = pytest.mark.parametrize("stream", STREAMS, ids=lambda stream: stream.name)
LIVE = pytest.mark.parametrize("stream", [each for each in STREAMS if each.live], ids=lambda stream: stream.name)


def _said(made: Any) -> Any:
    history = made.zero_history() if hasattr(made, "zero_history") else None
    return made.notes(), made.warnings(), made.unbelievable, history


def _same(found: Any, known: Any) -> None:
    assert not list(differences(found, known))


@STREAM
def test_a_log_has_the_same_bits_however_it_is_cut(stream: Stream) -> None:
    """With empty blocks between, and each block with its own rows."""
    made = stream.make()
    known = Contacts.joined(list(made.stream([stream.log]))), _said(made)
    for sizes in SIZES:
        blocks, made = list(pieces(stream.log, *sizes)), stream.make()
        pairs = list(made.pairs(iter(blocks)))
        if not stream.name.startswith("load cells"):  # they cut blocks where a log begins anew
            assert [len(block) for block, _ in pairs] == [len(block) for block in blocks]
        np.testing.assert_array_equal(np.concatenate([block.time for block, _ in pairs]), stream.log.time)
        _same((Contacts.joined([found for _, found in pairs]), _said(made)), known)


def _fed(stream: Stream, ways: Iterator[str]) -> tuple[np.ndarray, list[int], Any, Any]:
    """Rows and their number of each sample, by these ways to give samples, over and over; and what answered them."""
    made, log, done = stream.make(), stream.log, 0
    readings, single = readings_of(made, log), list(each_reading(made, log))
    rows, counts = list[np.ndarray](), list[int]()
    for way in ways:
        if done == len(log):
            break
        if way == "update":
            found = made.update(*single[done])
            assert (found.sample == done).all()
            rows.append(found.rows()[:, : made.empty(1).shape[1]])
            counts.append(len(rows[-1]))
        elif way == "into":
            time, reading, *beside = single[done]
            out = made.empty(made.most)
            counts.append(made.update_into(time, reading, out, *beside))
            rows.append(out[: counts[-1]])
        else:
            part = slice(done, done + int(way))
            out, many = made.empty(made.most * int(way)), np.zeros(len(log.time[part]), np.int64)
            beside = {name: values[part] for name, values in log.channels.items() if name in BESIDE}
            assert made.run_into(log.time[part], readings[part], out, many, beside) == len(many)
            rows.append(out[: many.sum()])
            counts += many.tolist()
        done = len(counts)
    return np.concatenate(rows), counts, _said(made), made


@LIVE
def test_live_samples_have_the_same_bits_one_by_one_in_blocks_and_mixed(stream: Stream) -> None:
    made, log = stream.make(), stream.log
    whole = _fed(stream, iter([str(len(log))]))
    for ways in (("update", "into"), ("7", "update", "0", "into", "40")):
        found = _fed(stream, itertools.cycle(ways))
        np.testing.assert_array_equal(found[0], whole[0])
        assert found[1] == whole[1]
        assert not remembered(found[3], whole[3], *IN_BLOCKS)
    run = made.run(log)
    np.testing.assert_array_equal(np.bincount(run.sample), whole[1])
    assert run.rows().shape[0] == len(whole[0])


def _filtered(made: Filter, blocks: list[Recording]) -> list[np.ndarray]:
    """Wrenches that a filter leaves, and the share of their noise; some samples are none."""
    recursion, parts = made.recursion(25.0), list[tuple[Any, ...]]()
    for block in blocks:
        values = block.wrenches().copy()
        parts.append((None, block.time, np.where(np.isfinite(values).all(axis=1), -1, 7).astype(np.int8), values))
    if made.zero_phase:
        done = [each[1:] for each in BothWays(recursion, 25.0).through(parts)]
    else:
        forward = Forward(recursion, 25.0)
        done = [(values, forward(time, status, values)) for _, time, status, values in parts]
    return [np.concatenate(each) for each in zip(*done, strict=True)]


def _channels(blocks: Iterator[Recording]) -> dict[str, np.ndarray]:
    found = list(blocks)
    return {name: np.concatenate([block.channels[name] for block in found]) for name in found[0].channels}


def _vibrating(blocks: list[Recording]) -> Any:
    made = Vibration(np.eye(6) * 1e-4)
    return _channels(made.stream(iter(blocks), Recording.wrenches)), made.covariances, made.notes()


def _moving(source: str, blocks: list[Recording]) -> Any:
    made = Motion(source, gravity=np.array([0.0, 0.0, -9.8]), lever=np.array([0.1, 0.0, 0.2]))
    felt = (replace(block, channels={**block.channels, ACCELERATION: block.channels[FORCE]}) for block in blocks)
    return _channels(made.stream(felt)), made.notes()


def _posed(made: PoseTrack, blocks: list[Recording]) -> Any:
    for block in blocks:
        made.add(block.time, block.channels[ORIENTATION], block.channels[POSITION])
    asked = np.linspace(-0.5, 12.0, 400)
    lag = made.lag(asked) if isinstance(made, LiveTrack) else None
    return made.at(asked), lag, made.notes(), made.stamps


def _followed(blocks: list[Recording]) -> Any:
    made = RecentMotion(np.array([0.1, 0.0, 0.2]))
    given = ((each.time, each.channels[ORIENTATION], each.channels[POSITION]) for each in blocks)
    return np.concatenate([np.hstack(made.at(*each, np.zeros((len(each[0]), 1)))) for each in given])


def _meant(blocks: list[Recording]) -> Any:
    made = WrenchMeans()
    for block in blocks:
        made.add(block.time, block.wrenches())
    made.complete()
    return made.means(np.arange(0.0, 9.0, 0.13)), made.notes()


SPLIT: dict[str, Callable[[list[Recording]], Any]] = {
    **{f"{each!r}": partial(_filtered, each) for each in (Kalman(1e-3, 2e-3), *TWICE)},
    "vibration": _vibrating,
    **{f"motion, {source}": partial(_moving, source) for source in ("none", "poses", "imu")},
    "poses": lambda blocks: _posed(PoseTrack(), blocks),
    "live poses": lambda blocks: _posed(LiveTrack(), blocks),
    "held poses": lambda blocks: _posed(LiveTrack(hold=True), blocks),
    "recent motion": _followed,
    "means": _meant,
}


@pytest.mark.parametrize("name", SPLIT)
@pytest.mark.parametrize("log", [STREAMS[0].log, shaken()], ids=["touches", "shaken"])
def test_how_samples_come_in_changes_nothing(monkeypatch: pytest.MonkeyPatch, name: str, log: Recording) -> None:
    """Of filters, and of all that adds to a log; a log that is worked on in pieces has many."""
    monkeypatch.setattr("palpate.signals.motion.CHUNK", 64)
    monkeypatch.setattr("palpate.signals.smoothing.SEGMENT", 64)
    monkeypatch.setattr("palpate.signals.vibration.ENOUGH", 128)
    known = SPLIT[name]([log])
    for sizes in SIZES:
        _same(SPLIT[name](list(pieces(log, *sizes))), known)


def test_touches_do_not_depend_on_the_blocks_of_contacts() -> None:
    """Sums in another order differ by rounding."""
    stream = next(each for each in STREAMS if each.name == "sheet")
    contacts = stream.make().run(stream.log)
    found = list[Any]()
    for size in (len(contacts), 1, 7, 40):
        finder = TouchFinder()
        for start in range(0, len(contacts), size):
            finder.add(contacts[start : start + size])
            finder.add(contacts[:0])
        found.append(finder.touches())
    assert len(found[0]) >= 3
    for other in found[1:]:
        for field in ("start", "end", "point", "covariance", "mean_force", "samples", "slid", "identity"):
            np.testing.assert_allclose(getattr(other, field), getattr(found[0], field), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mcap"])
def test_a_file_of_contacts_has_their_rows_however_they_come(
    suffix: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("palpate.files.contacts.writing._SMALL", 16)
    monkeypatch.setattr("palpate.files.contacts.writing._CHUNK", 16)
    contacts, path = felt(), tmp_path / f"contacts{suffix}"
    contacts.save(path)
    known = read_contacts(path)
    for size in (1, 50):
        with open_contacts(path, features=tuple(contacts.features)) as writer:
            for start in range(0, len(contacts), size):
                writer.write(contacts[:0])
                writer.write(contacts[start : start + size])
            assert writer.rows == len(contacts)
        _same(read_contacts(path), known)


class _Sender(NetFt):
    """Samples by their numbers, without a device."""

    def __init__(self) -> None:
        self._sequence = SequenceCounters()

    def missing(self, numbers: np.ndarray) -> np.ndarray:
        """Return the number of samples missing before each that is kept."""
        lost = np.zeros(len(numbers), dtype=np.int64)
        kept = self._sequence.follow(numbers.tolist(), numbers.tolist(), (numbers * 1_000_000).tolist(), lost)
        return lost[: len(numbers) if kept is None else len(kept)]


def test_samples_are_counted_alike_however_they_come(tmp_path: Path) -> None:
    """With some lost, late and twice, by two receivers, the first of which is killed."""
    first = np.delete(np.arange(1, 200), [20, 21, 22, 90, 150])
    first[[30, 31]], first[100] = first[[31, 30]], first[99]  # late by one; 101 comes not at all, the one before twice
    second = np.delete(np.arange(230, 300), [7, 8])
    known = {"received": 193 + 68, "lost": 5 + 1 + 2 + 30, "away": 30, "unknown": 0}
    for size in (1, 7, 500):
        ring = sphere_ring(tmp_path / f"ring{size}")
        for numbers in (first, second):
            source = _Sender()
            losses = LossCount(ring, source)
            for start in range(0, len(numbers), size):
                lost = source.missing(numbers[start : start + size])
                ring["received"] += len(lost)
                ring["lost"] += int(lost.sum())
                losses.add(len(lost), int(lost[0]) if len(lost) else 0)
        assert {word: ring[word] for word in known} == known, size


# --- a clock that goes back


def _back(log: Recording, by: float) -> Recording:
    """The same samples, so long before."""
    return Recording(log.time - by, log.channels)


@pytest.mark.parametrize("size", [1, 7, 1000])
@pytest.mark.parametrize("hold", [False, True])
def test_poses_of_a_clock_that_goes_back_are_those_of_a_new_track(size: int, hold: bool) -> None:
    """Also what is known of the motion, by which answers beyond the newest pose are unsure."""
    first, second = shaken().picked(slice(0, 600, 5)), _back(shaken().picked(slice(600, 1150, 5)), 50.0)
    used, fresh = LiveTrack(hold=hold), LiveTrack(hold=hold)
    used.add(first.time, first.channels[ORIENTATION], first.channels[POSITION])
    used.lag(first.time[-1:] + 0.1)
    for part in pieces(second, size):
        for made in (used, fresh):
            made.add(part.time, part.channels[ORIENTATION], part.channels[POSITION])
        if len(fresh.stamps) > 2:
            asked = part.time[-1] + np.array([-0.03, 0.0, 0.02, 0.2])
            _same((used.at(asked), used.lag(asked), used.stamps), (fresh.at(asked), fresh.lag(asked), fresh.stamps))
    assert (used.restarts, fresh.restarts) == (1, 0)


def test_a_page_shows_a_clock_that_went_back_as_a_new_stream() -> None:
    stream = next(each for each in STREAMS if each.name == "sheet")
    contacts = stream.make().run(stream.log.picked(slice(120)))
    later = recent(None, replace(contacts, time=contacts.time + 100.0))
    assert np.nanmax(recent(later, contacts).time) <= np.nanmax(contacts.time)
    _same(recent(later, contacts), recent(None, contacts))


def test_a_stuck_watch_says_of_a_second_hang_what_a_new_one_says() -> None:
    moves, hangs = np.random.default_rng(3).normal(size=(2000, 6)), np.ones((1000, 6))
    wrenches = np.concatenate([moves, hangs, moves])

    def said(watch: StuckWatch, begins: float) -> list[str]:
        blocks = (slice(k, k + 4) for k in range(0, len(wrenches), 4))
        return [watch.add(begins + np.arange(4) / 1000.0 + block.start / 1000.0, wrenches[block]) for block in blocks]

    used, known = StuckWatch(), [each for each in said(StuckWatch(), 0.0) if each]
    assert len(known) == 2
    for begins in (0.0, 5.0, -9.0):
        assert [each for each in said(used, begins) if each] == known
