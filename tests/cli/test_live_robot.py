"""Several sensors of one robot, live: one record that reads as any log, names on what is published, one that fails."""

from __future__ import annotations

import gc
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace
from multiprocessing import Pipe, get_context
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import palpate
from claims.evidence.logs_written import write_mcap
from claims.evidence.robot import FLANGE_SENSOR, KINDS, MOVING, SHIFTS, URDF, WRENCH, joints, wrench
from palpate.cli import main
from palpate.cli.estimate_robot import LEFT_OUT
from palpate.cli.live_page_robot import RobotStream
from palpate.contact.estimate import ROW
from palpate.errors import InputError
from palpate.files.contacts import read_contacts
from palpate.live.joints import JointSource
from palpate.live.live import Live
from palpate.live.receiver import receive_together
from palpate.live.record import Recorder, require_record, ring_of, rings_of
from palpate.live.recover import cut_short
from palpate.live.source import Batch
from palpate.live.stream_buffer import SlotForm, StreamBuffer
from palpate.live.supervisor import Worker
from palpate.setup.load import load_robot
from palpate.setup.source import RigSource
from palpate.viewer.live import LivePage
from tests.support.live_rings import answered, rows

LONG = 240.0  # s: what takes longer hangs
STEP, COUNT = 5 * 10**6, 600  # ns between samples, and how many
OTHER, JOINTS = "/other", "/joint_states"
SENSOR = """
[sensors.{name}]
kind = "force_torque"
link = "{link}"
noise = {{ force = 0.02, torque = 0.001 }}
surface = {{ kind = "sphere", radius = 0.05 }}
topic = "{topic}"
estimate = {{ tare = 0.2 }}
source = {{ kind = "replay", address = "{log}", speed = {speed} }}
"""


def _robot(folder: Path, speed: float, *more: str) -> Path:
    """A rig of two sensors, and of those in `more`, whose logs are not there; and the log, with pushes and motion."""
    (folder / "robot.urdf").write_text(URDF)
    rng = np.random.default_rng(3)
    messages = list[tuple[int, str, object]]()
    for k in range(COUNT):
        push = 4.0 * max(0.0, np.sin(k / 25)) if k > 60 else 0.0
        for topic, frame, way in ((WRENCH, "ft_sensor", 0), (OTHER, "shoulder", 2)):
            values = rng.normal(size=6) * ([0.02] * 3 + [0.001] * 3)
            values[way] -= push
            messages.append((STEP * k, topic, wrench(STEP * k, values.tolist(), frame)))
        messages.append((STEP * k, JOINTS, joints(STEP * k, np.array([0.1, -0.4, 0.2]) * np.sin(k / 90))))
    write_mcap(folder / "log.mcap", messages, {**KINDS, OTHER: KINDS[WRENCH]})
    text = '[robot]\nurdf = "robot.urdf"\njoints = "/joint_states"\nbase = "base_link"\ngravity = "fixed"\n'
    stated = [("wrist", "ft_sensor", WRENCH, "log.mcap"), ("elbow", "shoulder", OTHER, "log.mcap")]
    stated += [(name, "shoulder", f"/{name}", "nowhere.mcap") for name in more]
    for name, link, topic, log in stated:
        text += SENSOR.format(name=name, link=link, topic=topic, log=log, speed=speed)
    rig = folder / "robot.toml"
    rig.write_text(text)
    return rig


@pytest.mark.parametrize("speed", [0.0, 1.0])  # a process for each sensor, and one for all
def test_the_record_of_a_robot_reads_as_the_log(
    speed: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Readings and joint states of all sensors: in the base, too, the record gives what the log gives."""
    rig, record = _robot(tmp_path, speed, "lost"), tmp_path / "run.mcap"
    assert main(["live", "--rig", str(rig), "--record", str(record), "--realtime", "False"]) == LEFT_OUT
    heard = capsys.readouterr()
    assert "lost is left out" in heard.err + heard.out
    assert "nowhere.mcap" in heard.err + heard.out
    assert not rings_of(record)
    for frame in ("surface",) if speed else ("base", "surface"):  # the last joint states may come too late for the base
        found = palpate.estimate(record, _robot(tmp_path, 0.0), frame=frame)
        known = palpate.estimate(tmp_path / "log.mcap", rig, frame=frame)
        for name in ("wrist", "elbow"):
            np.testing.assert_array_equal(found.of(name).time, known.of(name).time)
            np.testing.assert_array_equal(found.of(name).point, known.of(name).point)
            np.testing.assert_array_equal(found.of(name).force, known.of(name).force)
    live = read_contacts(record)
    assert set(live.sensor) == {"wrist", "elbow"}
    assert len(live) == 2 * COUNT
    assert not set(live.of("wrist").identity) & set(live.of("elbow").identity)
    np.testing.assert_array_equal(live.of("elbow").force, known.of("elbow").force)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="asks Linux which processes there are")
def test_what_was_received_outlives_a_kill_of_all_processes(udp: socket.socket, tmp_path: Path) -> None:
    """Killed while it streams, and recovered: each sensor's samples from the first on, and none twice."""
    rig, record = _robot(tmp_path, 0.1), tmp_path / "run.mcap"
    udp.settimeout(LONG)
    call = [sys.executable, "-m", "palpate", "live", "--rig", str(rig), "--record", str(record)]
    call += ["--publish", f"udp:127.0.0.1:{udp.getsockname()[1]}", "--realtime", "False"]
    said = tmp_path / "said.txt"
    with said.open("wb") as output:
        running = subprocess.Popen(call, stdout=output, stderr=subprocess.STDOUT, env=_environment())
    try:
        lines = list[dict[str, object]]()
        while {"wrist", "elbow"} - {line["sensor"] for line in lines} or not _grew(record):
            lines.append(json.loads(udp.recv(1 << 16)))
    finally:
        for pid in [running.pid, *_children(running.pid)]:
            os.kill(pid, signal.SIGKILL)
        running.wait(LONG)
    links = {(line["sensor"], line["link"]) for line in lines}
    assert links == {("wrist", "ft_sensor"), ("elbow", "shoulder")}
    end = time.monotonic() + LONG
    while "to join them" not in cut_short(record):  # two seconds after the last sign of life
        assert time.monotonic() < end, said.read_text()
        time.sleep(0.1)
    assert len(rings_of(record)) == 3
    assert main(["recover", str(record)]) == 0
    assert not rings_of(record)
    found = read_contacts(record)
    for name in ("wrist", "elbow"):
        own = found.of(name)
        assert len(own) > 20
        np.testing.assert_array_equal(own.sample, np.arange(len(own)))


def test_a_receiver_of_several_sensors_that_was_killed_continues(tmp_path: Path) -> None:
    """Killed and started again, it goes on with both rings: no number is missing, and none is there twice."""
    names, rings = ["wrist", "elbow"], [tmp_path / "wrist.ring", tmp_path / "elbow.ring"]
    together, pipes = get_context("spawn").Event(), [Pipe(duplex=False) for _ in names]
    together.set()
    rig, senders = _robot(tmp_path, 1.0), [sender for _, sender in pipes]
    worker = Worker("receiver", receive_together, (rig, rings, names, os.getpid(), senders, False, together))
    opened, before = list[StreamBuffer](), [0, 0]
    for _ in range(2):
        worker.start()
        assert worker.process is not None
        end = time.monotonic() + LONG
        while not opened or any(ring["answered"] < count + 30 for ring, count in zip(opened, before, strict=True)):
            assert time.monotonic() < end
            time.sleep(0.05)
            opened = opened or [StreamBuffer(ring) for ring in rings if all(map(Path.exists, rings))]
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
    senders, rig = [sender for _, sender in pipes], _robot(tmp_path, 1.0)
    receive_together(rig, rings, names, os.getppid(), senders, False, together)
    assert [pipe.recv_bytes() for pipe, _ in pipes] == [b"", b""]
    assert [pipe.poll() for pipe, _ in pipes] == [False, True]
    assert b"cannot be read on" in pipes[1][0].recv_bytes()
    wrist, elbow = map(StreamBuffer, rings)
    assert wrist["answered"] == COUNT > elbow["answered"] > 100


def _grew(record: Path) -> bool:
    part = record.with_name(f"{record.name}.part")
    return part.exists() and part.stat().st_size > 30_000


def _children(pid: int) -> list[int]:
    return [int(each) for each in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2] / "src"), "OPENBLAS_NUM_THREADS": "1"}


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
    _robot(tmp_path, 0.0)
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


def _link(angles: np.ndarray, link: str) -> tuple[Rotation, np.ndarray]:
    """Rotation and place of a link in the base, from the numbers that the URDF was written from."""
    turn, place = Rotation.identity(), np.zeros(3)
    for (_, child, axis), angle in zip(MOVING, angles, strict=True):
        place, turn = place + turn.apply(SHIFTS[child]), turn * Rotation.from_euler(axis, angle)
        if child == link:
            return turn, place
    return turn * FLANGE_SENSOR, place + turn.apply(SHIFTS["ft_sensor"])


def test_the_page_shows_contacts_where_the_joints_have_moved_them(tmp_path: Path) -> None:
    """Without joint states at 0 and listed; then by the newest; a sensor that is silent is listed, not drawn."""
    pytest.importorskip("viser")
    rig = _robot(tmp_path, 0.0)
    (tmp_path / "robot.urdf").write_text(re.sub(r"<mesh [^>]*>", '<sphere radius="0.02"/>', URDF))
    robot = load_robot(rig)
    links = {"wrist": "ft_sensor", "elbow": "shoulder"}
    wrenches = SlotForm("force_torque", (6,), False, (), ROW.length, 1, wrenches=True)
    forms = [replace(wrenches, origin=(name, links[name]), place=(k, 2)) for k, name in enumerate(links)]
    names = tuple(f"{child}_joint" for _, child, _ in MOVING)
    forms.append(SlotForm("joints", (3,), False, (), 1, 1, joints=names))
    made = [StreamBuffer.make(tmp_path / f"{k}.ring", form, 1 << 20) for k, form in enumerate(forms)]
    stream, none = RobotStream(made, robot), np.zeros((0, 1))
    answered(made[0], 7)
    stream.look(watched=False)
    assert stream.newest is None
    assert stream.figures().skipped == 0
    with LivePage(None, (stream.layer,), "robot", stream.tare, port=0) as page:
        for k, angles in enumerate([None, np.array([0.3, -0.4, 0.5]), np.array([-1.0, 0.2, 0.9])]):
            for ring in made[bool(k == 0) : 1 if k == 2 else 2]:  # the first has samples that came unwatched
                answered(ring, 7)
            if angles is not None:
                batch = Batch((3,))
                batch.values[0] = angles
                batch.arrive(1, time.time_ns())
                made[2].take_in(batch, 1, batch.turned)
                made[2].answer(none, np.zeros(1, dtype=np.int64))
            if k == 2:  # the elbow's last sample is old now
                stream._streams["elbow"]._at -= 10.0
            stream.look(watched=True)
            stream.gather()
            page.show(stream.newest)
            page.tell(stream.window, stream.figures())
            seen = ["wrist"] if k == 2 else ["wrist", "elbow"]
            assert list(stream.newest.sensor) == seen
            for name, point, force in zip(seen, stream.newest.point, stream.newest.force, strict=True):
                turn, place = _link(np.zeros(3) if angles is None else angles, links[name])
                [row] = rows(7 * k + 6, 1)
                np.testing.assert_allclose(point, turn.apply(row[ROW.point]) + place, atol=1e-9)
                np.testing.assert_allclose(force, turn.apply(row[ROW.force]), atol=1e-9)
            listed = dict(stream.layer.rows(page.scene, 0))
            assert ("no readings" in listed["elbow"]) == (k == 2)
            assert ("drawn at 0" in listed.get("joint states", "")) == (k == 0)
        stream.tare("somebody")
        assert all(ring["asked"] == 1 for ring in made[:2])
        assert stream.figures().taring
    assert len(stream.window) == 5
    for ring in made:
        ring.close()
