"""Sensors of one robot whose samples are received and recorded together, and its joint states."""

import gc
import os
import signal
import sys
import time
from dataclasses import replace
from multiprocessing import Pipe, get_context
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from palpate.contact.estimate import ROW
from palpate.errors import InputError
from palpate.files.contacts import read_contacts
from palpate.live.joints import JointSource
from palpate.live.live import Live
from palpate.live.receiver import receive_together
from palpate.live.record import Recorder, require_record, ring_of
from palpate.live.stream_buffer import SlotForm, StreamBuffer
from palpate.live.supervisor import Worker
from palpate.setup.source import RigSource
from tests.cli.test_live_robot import LONG
from tests.support.live_rings import answered, rows
from tests.support.robots import COUNT, JOINTS, OTHER, STEP, two_sensors


def test_a_receiver_of_several_sensors_that_was_killed_continues(tmp_path: Path) -> None:
    """Killed and started again, it goes on with both rings: no number is missing, and none is there twice."""
    names, rings = ["wrist", "elbow"], [tmp_path / "wrist.ring", tmp_path / "elbow.ring"]
    together, pipes = get_context("spawn").Event(), [Pipe(duplex=False) for _ in names]
    together.set()
    rig, senders = two_sensors(tmp_path, 1.0), [sender for _, sender in pipes]
    worker = Worker("receiver", receive_together, (rig, rings, names, os.getpid(), senders, True, False, together))
    opened, before = list[StreamBuffer](), [0, 0]
    for _ in range(2):
        worker.start()
        assert worker.process is not None
        end = time.monotonic() + LONG
        while not opened or any(ring["answered"] < count + 30 for ring, count in zip(opened, before, strict=True)):
            assert time.monotonic() < end
            time.sleep(0.05)
            opened = opened or [StreamBuffer(ring) for ring in rings if all(map(Path.exists, rings))]
        (_, said), *_ = opened[0].events(0)[0]
        hurried = [os.sched_getscheduler(int(task)) for task in os.listdir(f"/proc/{worker.process.pid}/task")]
        assert hurried.count(os.SCHED_FIFO) >= 2 or "no real-time priority was granted" in said  # and the log's reader
        worker.process.kill()
        worker.process.join()
        before = [ring["received"] for ring in opened]
    for ring in opened:
        slots, first = ring.read(0, ring["received"])
        assert first == 0
        np.testing.assert_array_equal(slots["number"], 1 + np.arange(len(slots)))
        assert np.count_nonzero(np.diff(slots["stamp"]) < 0) == 1  # the log begins again
        assert np.count_nonzero(slots["ready"] == 0) <= 1  # received, and killed before it was answered
        ring.close()


def test_a_sensor_with_an_error_leaves_the_others_of_its_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is reported by its name alone; the other is received to the end of the log."""
    names, rings = ["wrist", "elbow"], [tmp_path / "wrist.ring", tmp_path / "elbow.ring"]
    together, pipes = get_context("spawn").Event(), [Pipe(duplex=False) for _ in names]
    together.set()
    taken = Live.pass_on

    def pass_on(live: Live, timeout: float) -> object:
        if live.setup.layout().wrench_topic == OTHER and live.estimator._samples > 100:
            raise InputError("cannot be read on.", where="elbow")
        if live.ended:
            for ring in map(StreamBuffer, rings):
                ring["stop"] = 1
        return taken(live, timeout)

    monkeypatch.setattr(Live, "pass_on", pass_on)
    for module, name in ((signal, "signal"), (sys, "setswitchinterval"), (gc, "freeze")):  # of this process they stay
        monkeypatch.setattr(module, name, lambda *_: None)
    senders, rig = [sender for _, sender in pipes], two_sensors(tmp_path, 1.0)
    receive_together(rig, rings, names, os.getppid(), senders, False, False, together)
    assert [pipe.recv_bytes() for pipe, _ in pipes] == [b"", b""]
    assert [pipe.poll() for pipe, _ in pipes] == [False, True]
    assert b"cannot be read on" in pipes[1][0].recv_bytes()
    wrist, elbow = map(StreamBuffer, rings)
    assert wrist["answered"] == COUNT > elbow["answered"] > 100


@pytest.mark.parametrize("split", [1e9, 40_000.0])
def test_a_recorder_of_several_rings_continues_where_another_was_killed(tmp_path: Path, split: float) -> None:
    """Rings that fill at their own pace, a recorder that is dropped at times: each file is whole, nothing is twice."""
    output, rng = tmp_path / "run.mcap", np.random.default_rng(1)
    require_record(output)
    names = ("a", "b", "c")
    wrenches = SlotForm("force_torque", (6,), False, (), ROW.length, 1, wrenches=True)
    forms = [replace(wrenches, origin=(name, f"l_{name}"), place=(k, 3)) for k, name in enumerate(names)]
    made = [StreamBuffer.make(ring_of(output, name), form, 1 << 21) for name, form in zip(names, forms, strict=True)]
    recorder = Recorder(made, output, split)
    for turn in range(60):
        for ring, most in zip(made, (5, 40, 90), strict=True):
            answered(ring, int(rng.integers(1, most)))
        if turn % 7 == 0:
            recorder = Recorder(made, output, split)
        time.sleep(0.01)
        recorder.step()
    recorder.finish()
    files = [output, *sorted(tmp_path.glob("run.*.mcap"), key=lambda path: int(path.suffixes[0][1:]))]
    assert (len(files) > 1) == (split < 1e9)
    found = [read_contacts(file) for file in files]
    for k, (name, ring) in enumerate(zip(names, made, strict=True)):
        own = [each.of(name) for each in found if name in set(each.sensor)]
        sample = np.concatenate([each.sample for each in own])
        np.testing.assert_array_equal(sample, np.arange(ring["received"]))
        force = np.concatenate([each.force for each in own])
        np.testing.assert_array_equal(force, rows(0, len(sample))[:, ROW.force])
        assert set(np.concatenate([each.identity for each in own]) % 3) == {k}
        ring.close()


@pytest.mark.parametrize("speed", [0.0, 2.0])
def test_joint_states_come_as_in_the_log(speed: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At the messages' stamps, and when these have come; a joint that some message lacks keeps its last position."""
    clock = [7.0]  # as read after each sleep, none of which is short
    slow = SimpleNamespace(monotonic=lambda: clock[-1], sleep=lambda wait: clock.append(clock[-1] + wait + 1e-7))
    monkeypatch.setattr("palpate.live.joints.time", slow)
    two_sensors(tmp_path, 0.0)
    source = JointSource(RigSource("replay", "log.mcap", speed=speed), JOINTS, tmp_path)
    source.open()
    blocks = []
    while not source.ended:
        blocks.append(source.receive(2e-3))
        assert not speed or blocks[-1][0] == pytest.approx(1e9 * speed * (clock[-1] - clock[0]), abs=1e3)
    assert max(np.diff(clock)) <= 2e-3 + 1e-6
    stamps, values = (np.concatenate(part) for part in zip(*blocks, strict=True))
    np.testing.assert_array_equal(stamps, STEP * np.arange(COUNT))
    angle = np.array([0.1, -0.4, 0.2]) * np.sin(np.arange(COUNT) / 90)[:, None]
    places = [source.joints.index(f"{name}_joint") for name in ("shoulder", "elbow", "flange")]
    np.testing.assert_allclose(values[:, places], angle, atol=1e-12)
