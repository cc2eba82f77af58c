"""What is made of the contacts of a robot: its report, its picture at a sample, and its errors against the truth."""

import re
from pathlib import Path

import numpy as np
import pytest

from palpate.cli import main
from palpate.contact.contacts import Contacts
from palpate.contact.ground_truth import TrueSamples
from palpate.files.ground_truth import read_ground_truth
from palpate.setup.load import load_robot
from palpate.setup.robot_view import touched_robot
from tests.support.robots import ABOVE, AT, ROBOT, TIME, TURN, rotation, turning_arm


@pytest.mark.parametrize("lost", ["", ",0.7\n"])
def test_inspect_has_the_figures_of_each_sensor(tmp_path: Path, lost: str, capsys: pytest.CaptureFixture[str]) -> None:
    """It names one whose columns are not there, and ends with 3 where the log is torn."""
    robot = turning_arm(tmp_path)
    log, rig = robot / "run.csv", robot / "robot.toml"
    rig.write_text(f'{ROBOT}[sensors.hand]\nkind = "force_torque"\nlink = "arm"\ncolumns = {[*"abcdef"]}\n')
    log.write_text(log.read_text().removesuffix(lost))
    assert (main(["inspect", str(log), "--rig", str(rig)]) or 0) == (3 if lost else 0)
    said = capsys.readouterr().out
    assert f"sensor           arm\n  rows             {len(TIME)}\n" in said
    assert "warning: hand: " in said
    assert ("its last line ends within a row" in said) == bool(lost)
    rig.write_text(
        ROBOT.replace('link = "arm"', 'link = "arm"\ntopic = "/ft"\nsource = { kind = "ros2" }\npayload = "gone.toml"')
    )
    assert main(["inspect", str(rig)]) == 0
    shown = capsys.readouterr().out
    assert re.search(r"urdf +arm\.urdf\n", shown)
    assert re.search(r"arm +force_torque +arm +6 +gone\.toml +/ft, ros2\n", shown)
    assert re.search(r"warning: arm: .*gone\.toml does not exist yet", shown)


def test_truth_is_read_in_the_frame_of_the_contacts(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text("time,sensor,px,py,pz,fx,fy,fz,base_px,base_py,base_pz\n0.5,tip,1,2,3,0,0,1,4,5,6\n")
    base, own = (read_ground_truth(path, frame) for frame in ("base", "surface"))
    assert isinstance(base, TrueSamples)
    assert isinstance(own, TrueSamples)
    assert (base.point.tolist(), own.point.tolist()) == ([[4, 5, 6]], [[1, 2, 3]])
    assert base.force is None  # that of the link is not taken for that of the base
    assert own.force is not None
    assert base.sensor == ("tip",)


def test_touches_are_drawn_where_they_were_on_their_link(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The same place of the link, touched in two poses of the arm, is one place of the picture."""
    robot = turning_arm(tmp_path)
    pytest.importorskip("pinocchio")
    pytest.importorskip("jinja2")
    out, page = robot / "contacts.csv", robot / "report.html"
    words = [str(robot / "run.csv"), "--rig", str(robot / "robot.toml"), "-o", str(out), "--report", str(page)]
    assert main(["estimate", *words, "--frame", "base"]) in (None, 0)
    touches = Contacts.load(out).touches()
    assert len(touches) == 2
    np.testing.assert_allclose(touches.point[0], AT + ABOVE, atol=2e-3)
    np.testing.assert_allclose(touches.point[1], rotation(TURN) @ AT + ABOVE, atol=2e-3)
    layer, marks = touched_robot(load_robot(robot / "robot.toml"), robot / "run.csv", touches)
    wanted = rotation(TURN) @ AT + ABOVE  # the second is stronger
    for mark in marks:
        np.testing.assert_allclose(mark.point, wanted, atol=2e-3)
        np.testing.assert_allclose(mark.normal, [0, 0, 1], atol=1e-9)
    assert len(layer.body_at(0).faces) == 12
    text = page.read_text(encoding="utf-8")
    for said in ("Contacts of a robot in run.csv", "arm.urdf", "as it stood at the strongest touch", "palpate-drawing"):
        assert said in text
    assert re.search(r"touch .*peak", capsys.readouterr().out)
    assert main(["estimate", *words, "--frame", "surface"]) in (None, 0)
    assert "estimate with --frame base" in page.read_text(encoding="utf-8")
    for said, call in (
        ("without the joint states", ["view", str(out), *words[1:3], "--film", str(robot / "f.mp4")]),
        ("a report needs contacts", ["estimate", words[0], "--rig", words[2], "--report", str(page)]),
    ):
        assert main(call) == 1
        assert said in capsys.readouterr().err
