"""A run's files say what they were given: topics a robot, states at changes, blocks when they move, tables beside."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate_lab.simulation.arena.layout import ArenaLayout, Block
from palpate_lab.simulation.arena.moment import ArenaMoment
from palpate_lab.simulation.arena.run_files import RunRecorder, files_of, write_arena, write_rig
from tests.support.read_back import messages, rows

pytest.importorskip("rosbags")

NONE = np.zeros((0, 5))


def _moment(time: float, frames: list[np.ndarray] | None) -> ArenaMoment:
    """Two robots: the first is pressed from its left by a corner."""
    poses, tracked = np.array([[1.0, 2.0, np.pi / 2], [0.5, 0.5, 0.0]]), [[1.001, 2.0, np.pi / 2], [0.5, 0.5, 0.0]]
    touches, truth = [np.array([[np.pi / 2, 2.0]]), np.zeros((0, 2))], np.array([[np.pi / 2, 2.1, 0.5, 0.004, 1.0]])
    wheels, states, whys = np.array([[0.05, 0.04], [0.0, 0.0]]), ("push", "arrived"), ("it moves", "at its goal")
    blocks, arrived = np.array([[1.0, 1.0, 0.0]]), np.array([False, True])
    return ArenaMoment(
        time, poses, np.array(tracked), blocks, touches, [truth, NONE], wheels, states, whys, frames, arrived
    )


def _run(images: bool) -> list[ArenaMoment]:
    """The second robot is blind from half a second on, and a block moves."""
    frames = [np.full((48, 64, 3), 90, np.uint8)] * 2 if images else None
    moments = [_moment(k / 30.0, frames) for k in range(30)]
    for k in range(15, 30):
        felt = [*moments[k].touches[:1], None]
        moved = np.add(moments[k].blocks, [0.001 * (k - 14), 0.0, 0.0])
        moments[k] = replace(moments[k], touches=felt, blocks=moved, states=("back off", "stopped"))
    return moments


def _recorded(folder: Path, images: bool) -> Path:
    recording = folder / "run.mcap"
    with RunRecorder(recording, 2, images=images) as recorder:
        for moment in _run(images):
            recorder.add(moment)
    return recording


def test_what_robots_record(tmp_path: Path) -> None:
    found = messages(_recorded(tmp_path, images=False))
    assert set(found) == {"/truth/blocks"} | {
        f"/robot_{k}/{name}" for k in (1, 2) for name in ("pose", "truth/pose", "wheels", "contacts", "state")
    }
    stamp, pose = found["/robot_1/pose"][3]
    assert stamp == 100_000_000
    assert pose.pose.position.x == 1.001
    assert found["/robot_1/truth/pose"][3][1].pose.position.x == 1.0
    assert pose.pose.orientation.z == pytest.approx(np.sqrt(0.5))
    np.testing.assert_array_equal(found["/robot_1/wheels"][0][1].velocity, [0.05, 0.04])
    force = found["/robot_1/contacts"][0][1].wrench.force  # pressed at its left: pushed to its right
    np.testing.assert_allclose([force.x, force.y], [0.0, -2.0], atol=1e-12)
    blind = [np.isnan(message.wrench.force.x) for _, message in found["/robot_2/contacts"]]
    assert blind == [False] * 15 + [True] * 15
    assert [message.data for _, message in found["/robot_2/state"]] == ["arrived: at its goal", "stopped: at its goal"]
    assert len(found["/truth/blocks"]) == 16  # once, and whenever it moved
    assert found["/truth/blocks"][-1][1].poses[0].position.x == pytest.approx(1.015)


def test_the_truth_beside_it(tmp_path: Path) -> None:
    recording = _recorded(tmp_path, images=False)
    files = files_of(recording, 2, False)
    assert set(tmp_path.iterdir()) == {recording, files["truth"], files["felt"]}
    truth, felt = rows(files["truth"]), rows(files["felt"])
    assert len(truth) == 30
    assert {row["kind"] for row in truth} == {"edge"}
    numbers = [float(truth[0][name]) for name in ("angle_deg", "depth_mm", "force_n", "shear_n")]
    np.testing.assert_allclose(numbers, [90.0, 4.0, 2.1, 0.5])
    assert {row["robot"] for row in truth} == {"1"}
    assert [float(row["force_n"]) for row in felt] == [2.0] * 30


def test_cameras_and_what_an_estimate_of_them_is_judged_by(tmp_path: Path) -> None:
    """The force on the skin: inwards at its left, and its shear along rising angles, which is backwards there."""
    pytest.importorskip("cv2")
    recording = _recorded(tmp_path, images=True)
    write_rig(recording)
    images = messages(recording)["/robot_2/camera/compressed"]
    assert len(images) == 30
    assert bytes(images[0][1].data[:2]) == b"\xff\xd8"
    found = rows(tmp_path / "run_robot_1_truth.csv")
    numbers = [float(found[0][name]) for name in ("px", "py", "nx", "ny", "fx", "fy")]
    np.testing.assert_allclose(numbers, [0.0, 0.055, 0.0, 1.0, -0.5, -2.1], atol=1e-6)
    assert not rows(tmp_path / "run_robot_2_truth.csv")
    rig = tomllib.loads((tmp_path / "run_rig.toml").read_text())
    assert rig["marker_ring"] == {"model": "run_ring.toml", "topic": "/robot_1/camera/compressed"}


def test_nothing_is_left_of_a_run_that_breaks_off(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="stop"), RunRecorder(tmp_path / "run.mcap", 1):
        raise RuntimeError("stop")
    assert not (tmp_path / "run.mcap").exists()


def test_the_arena_as_a_table(tmp_path: Path) -> None:
    blocks = (Block(1.0, 1.0, 0.1, (0.1, 0.2)), Block(2.0, 1.0, 0.0, (0.1, 0.1), mass=0.5))
    layout = ArenaLayout((3.0, 2.0), blocks, np.array([[0.2, 1.0, 0.0]]), np.array([[2.8, 1.0]]), 'a "name"')
    write_arena(tmp_path / "arena.toml", layout, {"seed": 3, "method": "ours", "images": True})
    said = tomllib.loads((tmp_path / "arena.toml").read_text())
    assert said["seed"] == 3
    assert said["images"] is True
    assert said["size"] == [3.0, 2.0]
    assert said["starts"] == [[0.2, 1.0, 0.0]]
    assert "mass" not in said["block"][0]
    assert said["block"][1]["mass"] == 0.5
