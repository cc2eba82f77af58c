"""A log that another process reads is the same log, with its notes, accelerations and what is wrong with it."""

from multiprocessing import active_children
from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.files.logs import LogLayout, open_log
from palpate.setup.prefetch import MotionAhead, PrefetchedLog, reading_in_process, sendable, way
from palpate.signals.motion import Motion
from tests.support.logs_torn import torn_pages

NAMES = "time,fx,fy,fz,tx,ty,tz,qx,qy,qz,qw,x,y,z"


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Samples of a sensor that swings, in several blocks, of which the last row is torn."""
    time = np.arange(30_000) / 100.0
    wrenches, still = np.random.default_rng(0).normal(size=(len(time), 6)), np.zeros((len(time), 1))
    place = np.column_stack([0.1 * np.sin(3.0 * time), still, still])
    table = np.column_stack([time, wrenches, np.tile([0.0, 0.0, 0.0, 1.0], (len(time), 1)), place])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=NAMES, comments="", fmt="%.6f")
    (tmp_path / "log.csv").write_text((tmp_path / "log.csv").read_text()[:-10])
    return tmp_path / "log.csv"


@pytest.mark.parametrize("moving", [False, True])
def test_another_process_reads_the_same_blocks(log: Path, moving: bool) -> None:
    layout = LogLayout(position=("x", "y", "z"))
    motion, ahead = Motion("poses"), MotionAhead(Motion("poses")) if moving else None
    with reading_in_process(log, layout) as reader:
        ours, theirs = open_log(log, layout), PrefetchedLog(open_log(log, layout), reader, ahead)
        assert theirs.contents() == ours.contents()
        count = 0
        for one, other in zip(motion.stream(ours.blocks()) if moving else ours.blocks(), theirs.blocks(), strict=True):
            assert one.channels.keys() == other.channels.keys()
            for name, values in {"time": one.time, **one.channels}.items():
                np.testing.assert_array_equal(values, other.time if name == "time" else other.channels[name])
            count += 1
    assert count > 1
    assert (theirs.notes(), theirs.position, theirs.size) == (ours.notes(), ours.position, ours.size)
    assert theirs.torn == ours.torn != ""
    assert ahead is None or ahead.notes(1.0) == motion.notes(1.0) != ()


def test_what_goes_wrong_in_it_is_raised_here(log: Path, tmp_path: Path) -> None:
    torn, layout = torn_pages(log, tmp_path / "log.parquet"), LogLayout()
    with reading_in_process(torn, layout) as reader, pytest.raises(InputError) as theirs:
        list(PrefetchedLog(open_log(log, layout), reader).blocks())
    with pytest.raises(InputError) as ours:
        list(open_log(torn, layout).blocks())
    assert str(theirs.value) == str(ours.value)

    class _Own(Exception):  # which no other process knows
        pass

    assert [type(sendable(each)) for each in (KeyError("a"), _Own("b"))] == [KeyError, RuntimeError]
    assert str(sendable(_Own("b"))) == "_Own: b"
    sender, receiver = way()
    for k in range(8):  # slots are free again
        sender.put(np.arange(3.0) + k)
        np.testing.assert_array_equal(receiver.get(), np.arange(3.0) + k)


def test_a_reader_that_was_killed_is_named(log: Path) -> None:
    with reading_in_process(log, LogLayout()) as reader:
        blocks = reader.blocks(log, None)
        next(blocks)
        (process,) = (each for each in active_children() if each.name == "palpate reader")
        process.kill()
        with pytest.raises(InputError, match=r"log.csv: the process that reads this log ended early.*Free memory"):
            list(blocks)
