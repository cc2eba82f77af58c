"""Several sensors of one robot, live: one record that reads as any log, names on what is published, one that fails."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import palpate
from claims.evidence.robot import FLANGE_SENSOR, MOVING, SHIFTS, URDF
from palpate.cli import main
from palpate.cli.estimate_robot import LEFT_OUT
from palpate.cli.live_page_robot import RobotStream
from palpate.contact.estimate import ROW
from palpate.files.contacts import read_contacts
from palpate.live.record import rings_of
from palpate.live.recover import cut_short
from palpate.live.source import Batch
from palpate.live.stream_buffer import SlotForm, StreamBuffer
from palpate.setup.load import load_robot
from palpate.viewer.live import LivePage
from tests.support.live_rings import answered, rows
from tests.support.robots import COUNT, two_sensors

LONG = 240.0  # s: what takes longer hangs


@pytest.mark.parametrize("speed", [0.0, 1.0])  # a process for each sensor, and one for all
def test_the_record_of_a_robot_reads_as_the_log(
    speed: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Readings and joint states of all sensors: in the base, too, the record gives what the log gives."""
    rig, record = two_sensors(tmp_path, speed, "lost"), tmp_path / "run.mcap"
    assert main(["live", "--rig", str(rig), "--record", str(record), "--realtime", "False"]) == LEFT_OUT
    heard = capsys.readouterr()
    assert "lost is left out" in heard.err + heard.out
    assert "nowhere.mcap" in heard.err + heard.out
    assert not rings_of(record)
    for frame in ("surface",) if speed else ("base", "surface"):  # the last joint states may come too late for the base
        found = palpate.estimate(record, two_sensors(tmp_path, 0.0), frame=frame)
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
    rig, record = two_sensors(tmp_path, 0.1), tmp_path / "run.mcap"
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


def _grew(record: Path) -> bool:
    part = record.with_name(f"{record.name}.part")
    return part.exists() and part.stat().st_size > 30_000


def _children(pid: int) -> list[int]:
    return [int(each) for each in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2] / "src"), "OPENBLAS_NUM_THREADS": "1"}


def _link(angles: np.ndarray, link: str) -> tuple[Rotation, np.ndarray]:
    """Rotation and place of a link in the base, from the numbers that the URDF was written from."""
    turn, place = Rotation.identity(), np.zeros(3)
    for (_, child, axis), angle in zip(MOVING, angles, strict=True):
        place, turn = place + turn.apply(SHIFTS[child]), turn * Rotation.from_euler(axis, angle)
        if child == link:
            return turn, place
    return turn * FLANGE_SENSOR, place + turn.apply(SHIFTS["ft_sensor"])


def test_the_page_shows_contacts_where_the_joints_have_moved_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without joint states at 0 and listed; then by the newest; a sensor that is silent is listed, not drawn."""
    pytest.importorskip("viser")
    monkeypatch.setattr("palpate.cli.live_page_robot.SILENT", 60.0)  # the page may take seconds on a busy machine
    rig = two_sensors(tmp_path, 0.0)
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
                stream._streams["elbow"]._at -= 100.0
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
