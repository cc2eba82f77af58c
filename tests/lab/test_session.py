"""The demonstration's session: it is what it says it is, in memory and on disk."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from palpate.signals.recording import ORIENTATION
from palpate.spatial.pose import rotation_from_quaternion
from palpate_lab.simulation.session import ASSEMBLY, NOISE, Session, simulate_session
from palpate_lab.simulation.session_files import POSE_TOPIC, WRENCH_TOPIC, write_session
from palpate_lab.simulation.session_mcap import CLOCK_OFFSET, POSITION, write_session_mcap
from tests.support.read_back import messages, rows


@pytest.fixture(scope="module")
def session() -> Session:
    return simulate_session(3)


def test_readings_in_free_motion_are_weight_and_bias_and_the_stated_noise(session: Session) -> None:
    log, load = session.free_motion, session.load
    down = np.array([0.0, 0.0, -load.mass * 9.80665])
    weight = np.stack([r.T @ down for r in rotation_from_quaternion(log.channels[ORIENTATION])])
    left = log.wrenches() - np.concatenate(
        [weight + load.force_bias, np.cross(load.center_of_mass, weight) + load.torque_bias], axis=1
    )
    assert np.allclose(left.std(axis=0), NOISE, rtol=0.06)  # 4,480 samples know their spread to 1 %
    assert np.all(np.abs(left.mean(axis=0)) < 5 * NOISE / np.sqrt(len(log)))


def test_held_touches_press_at_the_true_point_through_the_true_pose(session: Session) -> None:
    log, truth = session.touches, session.truth
    contact = log.wrenches() - session.load.wrenches(log.channels[ORIENTATION])
    for start, end, point, normal in zip(truth.start, truth.end, truth.point, truth.normal, strict=True):
        held = contact[(log.time >= start) & (log.time <= end)]
        force, torque = held.mean(axis=0)[:3], held.mean(axis=0)[3:]
        left = torque - np.cross(session.true.apply(point), force)
        assert 1.0 < np.linalg.norm(force) < 10.5
        assert force @ session.true.rotate(normal) < 0
        across = np.cross(left, session.true.rotate(normal))
        assert np.linalg.norm(across) < 6 * 2e-3 / np.sqrt(len(held))  # 1 mN m, and 0.02 N at 0.1 m, averaged


def test_between_touches_nothing_touches(session: Session) -> None:
    log, truth = session.touches, session.truth
    contact = log.wrenches() - session.load.wrenches(log.channels[ORIENTATION])
    busy = np.any((log.time[:, None] > truth.start - 0.31) & (log.time[:, None] < truth.end + 0.31), axis=1)
    assert np.abs(contact[~busy, :3]).max() < 6 * NOISE[0]
    assert (~busy).mean() > 0.2


def test_orientation_never_jumps(session: Session) -> None:
    for log in (session.free_motion, session.touches):
        q = log.channels[ORIENTATION]  # q and -q are the same orientation
        turned = 2 * np.arccos(np.minimum(1.0, np.abs(np.sum(q[1:] * q[:-1], axis=1))))
        assert turned.max() < 0.06  # rad in 5 ms: half a turn in 0.6 s, eased


def test_assembly_is_off_the_drawing_by_what_is_stated(session: Session) -> None:
    turn = session.true.rotation @ session.nominal.rotation.T
    assert np.isclose(np.arccos((np.trace(turn) - 1) / 2), ASSEMBLY[0])
    assert np.isclose(np.linalg.norm(session.true.translation - session.nominal.translation), ASSEMBLY[1])


def test_files_hold_the_session(session: Session, tmp_path: Path) -> None:
    write_session(session, tmp_path)
    table = rows(tmp_path / "touches.csv")
    assert list(table[0]) == ["time", "fx", "fy", "fz", "tx", "ty", "tz", "qx", "qy", "qz", "qw"]
    read = np.array([[float(row[name]) for name in ("fx", "fy", "fz", "tx", "ty", "tz")] for row in table])
    assert np.abs(read - session.touches.wrenches()).max() < 1e-6  # six digits are written
    mesh = trimesh.load_mesh(tmp_path / "probe.stl")
    assert mesh.is_watertight
    assert np.allclose(mesh.extents, [60, 25, 40], rtol=1e-3)  # mm
    assert mesh.volume > 0
    rig = tomllib.loads((tmp_path / "rig.toml").read_text())
    assert rig["surface"]["pose"]["xyz"] == session.nominal.translation.tolist()
    marks = {row["label"] for row in rows(tmp_path / "marks.csv")}
    truth = {row["label"] for row in rows(tmp_path / "truth.csv")}
    assert marks | truth == set(session.truth.label)
    assert not marks & truth


def test_mcap_holds_the_session_to_the_last_bit_with_a_clock_each(tmp_path: Path) -> None:
    """Read by the mcap library; stamps are those of the samples to the nanosecond, poses 30 ms less and every other."""
    session = simulate_session(5, touches=2, facets=20)
    write_session_mcap(session, tmp_path)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["free_motion.mcap", "touches.mcap"]
    for name, log in (("free_motion", session.free_motion), ("touches", session.touches)):
        read = messages(tmp_path / f"{name}.mcap")
        assert set(read) == {WRENCH_TOPIC, POSE_TOPIC}
        stamps, found = zip(*read[WRENCH_TOPIC], strict=True)
        assert np.array_equal(np.array(stamps), np.rint(log.time * 1e9).astype(np.int64))
        assert stamps == tuple(map(_stamp, found))
        assert [message.header.frame_id for message in found] == ["ft_sensor"] * len(log)
        wrenches = [_xyz(message.wrench.force) + _xyz(message.wrench.torque) for message in found]
        assert np.array_equal(np.array(wrenches), log.wrenches())
        stamps, found = zip(*read[POSE_TOPIC], strict=True)
        assert stamps == tuple(map(_stamp, found))
        expected = np.rint((log.time[::2] - CLOCK_OFFSET) * 1e9).astype(np.int64)
        there = expected >= 0  # no header says a time before 0
        assert np.array_equal(np.array(stamps), expected[there])
        turns = [(*_xyz(message.pose.orientation), message.pose.orientation.w) for message in found]
        assert np.array_equal(np.array(turns), log.channels[ORIENTATION][::2][there])
        assert {_xyz(message.pose.position) for message in found} == {POSITION}


def _stamp(message: Any) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def _xyz(vector: Any) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z
