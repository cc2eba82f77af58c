"""Law 5: how a stream is split into blocks changes no bit of what is answered, and a clock that goes back begins anew."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import fields
from functools import cache
from typing import Any

import numpy as np
import pytest

from palpate.contact.contacts import Contacts
from palpate.contact.touch_finder import TouchFinder
from palpate.files.logs.stuck import StuckWrenches
from palpate.files.logs.wrench_means import WrenchMeans
from palpate.live.stuck_watch import StuckWatch
from palpate.signals.filters import Butterworth, Filter, Kalman
from palpate.signals.motion import Motion
from palpate.signals.recording import FORCE, ORIENTATION, POSITION, TORQUE, Recording
from palpate.signals.smoothing import BothWays, Forward
from palpate.signals.vibration import Vibration
from palpate.spatial.live_track import LiveTrack
from palpate.spatial.pose_track import PoseTrack
from palpate.viewer.live import recent
from tests.conformance.live import BESIDE, each_reading, readings_of
from tests.support.state import differences
from tests.support.streams import STREAMS, Stream, pieces, shaken

SIZES = ((1,), (2, 0), (7, 1, 0, 90), (0, 33))
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


def _fed(stream: Stream, ways: Iterator[str]) -> tuple[np.ndarray, list[int], Any]:
    """Rows and their number of each sample, by these ways to give samples, over and over."""
    made, log, done = stream.make(), stream.log, 0
    readings, single = readings_of(made, log), list(each_reading(made, log))
    rows, counts = list[np.ndarray](), list[int]()
    for way in ways:
        if done == len(log):
            break
        if way == "update":
            rows.append(made.update(*single[done]).rows()[:, : made.empty(1).shape[1]])
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
    return np.concatenate(rows), counts, _said(made)


@LIVE
def test_live_samples_have_the_same_bits_one_by_one_in_blocks_and_mixed(stream: Stream) -> None:
    made = stream.make()
    made.kelvin = np.nan
    log = stream.log
    whole = _fed(stream, iter([str(len(log))]))
    for ways in (("update", "into"), ("7", "update", "0", "into", "2"), ("1", "40", "into", "into")):
        found = _fed(stream, itertools.cycle(ways))
        np.testing.assert_array_equal(found[0], whole[0])
        assert found[1] == whole[1]
    run = made.run(log)
    np.testing.assert_array_equal(np.bincount(run.sample), whole[1])
    assert run.rows().shape[0] == len(whole[0])
