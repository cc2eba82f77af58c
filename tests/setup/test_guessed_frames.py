"""Frames and topics of a robot's log are guessed for a rig, and what is doubtful of them is said."""

import json
from pathlib import Path

import numpy as np
import pytest

from claims.evidence import robot as bag
from claims.evidence.logs_written import write_mcap
from claims.evidence.robot import KINDS, OTHER, WRENCH, Posture, transform, wrench
from palpate.cli import main
from palpate.errors import InputError
from palpate.files.contacts import read_contacts
from palpate.files.logs import contents, open_log
from palpate.setup import load_rig
from palpate.setup.new import propose_rig
from palpate.signals.recording import ORIENTATION
from palpate.spatial.pose import rotation_from_quaternion
from palpate_lab.simulation.session import Session
from tests.files import test_tf
from tests.files.test_tf import TREE, _log

robot, session = test_tf.robot, test_tf.session  # fixtures


def test_guessed_frames_are_those_of_the_wrench_and_of_the_root(robot: Path, tmp_path: Path) -> None:
    made = propose_rig(robot / "touches", None, tmp_path)
    assert 'base = "world"\nsensor = "ft_sensor"' in made.text
    said = " ".join(made.remarks)
    assert "2 topics hold wrenches: /ft_sensor/wrench, /gripper_ft/wrench; the first is taken, and --topic" in said
    assert "another base can be flange, elbow, shoulder, base_link" in said
    assert "topics of poses are not used: /camera/object_pose, /vision/marker" in said


def test_another_topic_may_be_named(robot: Path, tmp_path: Path) -> None:
    made = propose_rig(robot / "touches", None, tmp_path, topic=OTHER)
    assert f'topic = "{OTHER}"' in made.text
    said = " ".join(made.remarks)
    assert "'gripper_ft' is not in it" in said
    assert 'topic = "none"' in made.text
    assert "'/camera/object_pose' (its name contains 'camera'), '/vision/marker' (its name contains 'marker')" in said
    with pytest.raises(InputError, match=r"no topic '/ft_sensor/wrnch'.*Did you mean '/ft_sensor/wrench'"):
        propose_rig(robot / "touches", None, tmp_path, topic="/ft_sensor/wrnch")


@pytest.mark.parametrize(
    ("frame", "edges", "word"),
    [
        ("base", [("base", "arm"), ("arm", "tool")], "'base' is the root of its tree. If the wrench is written in"),
        ("", [("base", "tool")], "the wrench's header names no frame"),
        ("tool", [("a", "tool"), ("b", "tool")], "/tf is not used: frame 'tool' has 2 parents"),
        ("tool", [("base", "tool")], "nothing between 'base' and 'tool' moves in /tf"),
    ],
)
def test_what_is_doubtful_of_frames_is_said(
    tmp_path: Path, frame: str, edges: list[tuple[str, str]], word: str
) -> None:
    steps = [(k, [transform(k, parent, child, (1, 0, 0)) for parent, child in edges]) for k in (1, 2)]
    log = _log(tmp_path / "log.mcap", steps, frame=frame, count=30)
    assert word in " ".join(propose_rig(log, None, tmp_path).remarks)


@pytest.mark.parametrize(
    ("frame", "child", "moves", "topic", "word"),
    [
        ("base", "tool", True, "/p", None),
        ("base", "cup", True, "none", "it is of 'cup', but the wrench is of 'tool'"),
        ("tool", "", True, "none", "written in the sensor's own frame"),
        ("camera_link", "tool", True, "none", "its frame contains 'camera'"),
        ("base", "tool", False, "/p", "the pose on '/p' never changes"),
    ],
)
def test_a_pose_of_something_else_is_doubted(
    tmp_path: Path, frame: str, child: str, moves: bool, topic: str, word: str | None
) -> None:
    poses = [transform(10**8 * k, frame, child, (k * moves, 0, 0)) for k in range(30)]
    messages = [(10**8 * k, "/p", poses[k]) for k in range(30)]
    pushes = [[k] * 3 + [1e-3 * k] * 3 for k in range(30)]  # 1 mm from the sensor: no doubt of units
    messages += [(10**8 * k, WRENCH, wrench(10**8 * k, pushes[k], "tool")) for k in range(30)]
    kinds = {WRENCH: KINDS[WRENCH], "/p": "geometry_msgs/msg/TransformStamped"}
    write_mcap(tmp_path / "log.mcap", sorted(messages, key=lambda each: each[0]), kinds)
    made = propose_rig(tmp_path / "log.mcap", None, tmp_path)
    assert f'topic = "{topic}"' in made.text
    assert (word or "") in " ".join(made.remarks)
    assert bool(made.remarks) == (word is not None)


def test_contacts_in_the_base_are_where_the_tree_puts_them(robot: Path, session: Session) -> None:
    rig = str(robot / "my_rig.toml")
    base = ["--frame", "base", "-o", str(robot / "base.csv")]
    assert main(["estimate", str(robot / "touches"), "--rig", rig, *base]) == 0
    contacts, based = read_contacts(robot / "contacts.csv"), read_contacts(robot / "base.csv")
    mount = load_rig(robot / "my_rig.toml").mount()
    at = np.flatnonzero(contacts.answered & (contacts.sample % bag.EVERY == 0))
    log = session.touches
    sensor = mount.apply(contacts.point[at])
    turned = np.einsum("nij,nj->ni", rotation_from_quaternion(log.channels[ORIENTATION][contacts.sample[at]]), sensor)
    wanted = turned + Posture.of(log.channels[ORIENTATION]).positions()[contacts.sample[at]] + [1, 2, 0]
    assert np.abs(based.point[at] - wanted).max() < 1e-8  # the file has nine digits


def test_estimate_takes_the_topic_that_is_named(robot: Path, session: Session, tmp_path: Path) -> None:
    log, options = tmp_path / "log.mcap", ["--rig", str(robot / "my_rig.toml"), "-o", str(tmp_path / "c.csv")]
    write_mcap(log, sorted(bag.messages(session.touches.picked(slice(400))), key=lambda each: each[0]), KINDS)
    assert main(["estimate", str(log), *options]) == 0
    assert main(["estimate", str(log), *options, "--topic", OTHER]) not in (0, 1)
    assert main(["estimate", str(log), *options, "--topic", "/none"]) == 1
    assert len(contents(robot / "touches").topics) == len(KINDS)
    assert open_log(robot / "touches", TREE).contents().names == {}


def test_inspect_says_what_both_wrenches_are(robot: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(robot / "touches")]) == 0
    said = capsys.readouterr().out
    assert said.count("taken for") == said.count("fx [N]") == 2
    assert main(["inspect", str(robot / "touches"), "--json"]) == 0
    parts = json.loads(capsys.readouterr().out)["parts"]
    assert [part["title"] for part in parts] == ["/ft_sensor/wrench", OTHER]
    assert [part["facts"]["frame"] for part in parts] == ["ft_sensor", "gripper_ft"]
    assert main(["inspect", str(robot / "touches"), "--topic", OTHER]) == 0
    assert "frame            gripper_ft" in capsys.readouterr().out
    assert main(["inspect", str(robot / "touches"), "--rig", str(robot / "my_rig.toml")]) == 0
