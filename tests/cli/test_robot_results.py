"""What is made of the contacts of a robot: its report, its picture at a sample, and its errors against the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.cli import main
from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ContactEstimate
from palpate.contact.ground_truth import TrueSamples, TrueTouches
from palpate.contact.origins import Origins
from palpate.errors import InputError
from palpate.evaluation.evaluate import evaluate, evaluate_robot
from palpate.files.ground_truth import read_ground_truth
from palpate.setup.load import load_robot
from palpate.setup.robot_pipeline import RobotPipeline
from palpate.setup.robot_view import in_pictures, robot_scene, touched_robot
from palpate.viewer.film import ScenePicture
from palpate.viewer.report import ReportTable, render
from palpate.viewer.robot_layer import RobotLayer
from palpate.viewer.robot_report import EstimatedRobot, compose_robot
from palpate.viewer.run_summary import RunSummary
from tests.support.arms import joint

TIME = np.arange(400) / 100.0
AT = np.array([0.3, 0.02, 0.05])  # in the link, on its upper side
ABOVE = np.array([0.0, 0.0, 1.0])  # from the base to the joint
TURN = 0.7  # rad, of the second touch
ROBOT = """\
[robot]
urdf = "arm.urdf"
joints = { turn = "q" }
base = "base"
gravity = "fixed"

[sensors.arm]
kind = "force_torque"
link = "arm"
noise = { force = 0.02, torque = 0.001 }
"""


def _rotation(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """Write a log of an arm that turns once, and is touched at one place of its link before and after."""
    box = '<visual><origin xyz="0.2 0 0"/><geometry><box size="0.4 0.1 0.1"/></geometry></visual>'
    turn = joint("turn", "revolute", "base", "arm", more='<origin xyz="0 0 1"/><axis xyz="0 0 1"/>')
    (tmp_path / "arm.urdf").write_text(
        f'<robot name="a"><link name="base"/><link name="arm">{box}</link>{turn}</robot>'
    )
    (tmp_path / "robot.toml").write_text(ROBOT)
    rng = np.random.default_rng(1)
    force = np.where(((TIME > 1) & (TIME < 1.5)), -2.0, 0.0) + np.where((TIME > 3) & (TIME < 3.5), -5.0, 0.0)
    wrench = np.zeros((len(TIME), 6))
    wrench[:, 2] = force
    wrench[:, 3:] = np.cross(AT, wrench[:, :3])
    wrench += rng.normal(size=wrench.shape) * [0.02, 0.02, 0.02, 0.001, 0.001, 0.001]
    rows = np.column_stack([TIME, wrench, np.where(TIME < 2.2, 0.0, TURN)])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="time,fx,fy,fz,tx,ty,tz,q", comments="", fmt="%.9g")
    return tmp_path


def _contacts(point: np.ndarray, sensors: tuple[str, ...]) -> Contacts:
    count = len(point)
    made = ContactEstimate(
        point=point,
        normal=np.tile([0.0, 0.0, 1.0], (count, 1)),
        force=np.tile([0.0, 0.0, -1.0], (count, 1)),
        torque=np.zeros(count),
        covariance=np.tile(np.diag([1e-6, 1e-6, 0.0]), (count, 1, 1)),
        residual=np.zeros(count),
        candidates=np.ones(count, dtype=np.int64),
        status=np.zeros(count, dtype=np.int8),
    )
    origins = Origins.of_names(sensors, sensors)
    return replace(Contacts.single(np.arange(count) // 2 / 100.0, made), origins=origins)


def test_each_sensor_is_compared_with_its_own_truth() -> None:
    """Two sensors at the same times; a contact of one at the other's true place is an error of that one."""
    names = ("a", "b") * 50
    rng = np.random.default_rng(2)
    point = np.where(np.array(names)[:, None] == "a", [0.1, 0.0, 0.0], [0.0, 0.2, 0.0]) + 1e-3 * rng.normal(
        size=(100, 3)
    )
    truth = TrueSamples(np.arange(100) // 2 / 100.0, np.tile([[0.1, 0.0, 0.0], [0.0, 0.2, 0.0]], (50, 1)), sensor=names)
    found = _contacts(point, names)
    every, each = evaluate_robot(found, truth)
    for k, name in enumerate("ab"):
        alone = evaluate(replace(found[k::2], origins=None), TrueSamples(truth.time[k::2], truth.point[k::2]))
        assert each[name].location == alone.location
    assert (every.matched, every.missed, every.unmatched) == (100, 0, 0)
    assert every.location.worst == pytest.approx(np.linalg.norm(point - truth.point, axis=1).max())
    swapped, _ = evaluate_robot(found, replace(truth, point=truth.point[::-1].copy()))
    assert swapped.location.median > 0.2
    touches = TrueTouches(np.zeros(2), np.ones(2), np.array([[0.1, 0, 0], [0, 0.2, 0]]), ("1", "2"), ("a", "b"))
    every, each = evaluate_robot(found, touches)
    assert [touch.samples for touch in every.touches] == [50, 50]
    assert max(touch.error for touch in every.touches) < 1e-3
    with pytest.raises(InputError, match="must both name the sensor"):
        evaluate_robot(replace(found, origins=None), truth)


@pytest.mark.parametrize("lost", ["", ",0.7\n"])
def test_inspect_has_the_figures_of_each_sensor(robot: Path, lost: str, capsys: pytest.CaptureFixture[str]) -> None:
    """It names one whose columns are not there, and ends with 3 where the log is torn."""
    log, rig = robot / "run.csv", robot / "robot.toml"
    rig.write_text(f'{ROBOT}[sensors.hand]\nkind = "force_torque"\nlink = "arm"\ncolumns = {[*"abcdef"]}\n')
    log.write_text(log.read_text().removesuffix(lost))
    assert (main(["inspect", str(log), "--rig", str(rig)]) or 0) == (3 if lost else 0)
    said = capsys.readouterr().out
    assert f"sensor           arm\n  rows             {len(TIME)}\n" in said
    assert "warning: hand: " in said
    assert ("its last line ends within a row" in said) == bool(lost)


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


def test_a_robot_is_drawn_where_its_links_are() -> None:
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    half = np.sqrt(0.5)
    quaternions = np.array([[[0.0, 0, 0, 1], [0, 0, half, half]]])
    layer = RobotLayer(
        {"a": (corners, faces), "b": (corners, faces)}, quaternions, np.array([[[0.0, 0, 0], [5, 0, 0]]]), {}, {}
    )
    body = layer.body_at(0)
    wanted = {tuple(p) for p in np.concatenate([corners, corners @ _rotation(np.pi / 2).T + [5, 0, 0]]).round(9) + 0.0}
    assert {tuple(p) for p in body.vertices.round(9) + 0.0} == wanted
    assert len(body.faces) == 8
    facets = body.vertices[body.faces]
    across = np.cross(facets[:, 1] - facets[:, 0], facets[:, 2] - facets[:, 0])
    assert (np.einsum("fi,fki->fk", across, body.normals[body.faces]) > 0).all()


def test_touches_are_drawn_where_they_were_on_their_link(robot: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The same place of the link, touched in two poses of the arm, is one place of the picture."""
    pytest.importorskip("pinocchio")
    pytest.importorskip("jinja2")
    out, page = robot / "contacts.csv", robot / "report.html"
    words = [str(robot / "run.csv"), "--rig", str(robot / "robot.toml"), "-o", str(out), "--report", str(page)]
    assert main(["estimate", *words, "--frame", "base"]) in (None, 0)
    touches = Contacts.load(out).touches()
    assert len(touches) == 2
    np.testing.assert_allclose(touches.point[0], AT + ABOVE, atol=2e-3)
    np.testing.assert_allclose(touches.point[1], _rotation(TURN) @ AT + ABOVE, atol=2e-3)
    layer, marks = touched_robot(load_robot(robot / "robot.toml"), robot / "run.csv", touches)
    wanted = _rotation(TURN) @ AT + ABOVE  # the second is stronger
    for mark in marks:
        np.testing.assert_allclose(mark.point, wanted, atol=2e-3)
        np.testing.assert_allclose(mark.normal, [0, 0, 1], atol=1e-9)
    assert len(layer.body_at(0).faces) == 12
    text = page.read_text(encoding="utf-8")
    for said in ("Contacts of a robot in run.csv", "arm.urdf", "as it stood at the strongest touch", "palpate-drawing"):
        assert said in text
    capsys.readouterr()
    assert main(["estimate", *words, "--frame", "surface"]) in (None, 0)
    assert "estimate with --frame base" in page.read_text(encoding="utf-8")
    for said, call in (
        ("without the joint states", ["view", str(out), *words[1:3], "--film", str(robot / "f.mp4")]),
        ("a report needs contacts", ["estimate", words[0], "--rig", words[2], "--report", str(page)]),
    ):
        assert main(call) == 1
        assert said in capsys.readouterr().err


def test_a_film_shows_the_robot_where_it_is(robot: Path) -> None:
    """Its grey pixels are as many before and after the turn, and elsewhere; compared contacts are drawn in green."""
    pytest.importorskip("pinocchio")
    pytest.importorskip("cv2")
    rig, log = load_robot(robot / "robot.toml"), robot / "run.csv"
    scene, _ = robot_scene(rig, log)
    pictures = ScenePicture(scene)

    def grey(seconds: float) -> np.ndarray:
        top = pictures.draw(seconds)[80:540].astype(int)
        return (np.ptp(top, axis=2) < 25) & (top.max(axis=2) < 230)

    before, after, later = grey(0.5), grey(2.5), grey(2.8)
    assert before.sum() > 3_000  # the box is 4,062 pixels as the upright camera sees it
    assert np.count_nonzero(before & ~after) > 0.2 * before.sum()
    assert np.count_nonzero(after != later) < 0.05 * before.sum()  # nothing moves then
    found = Contacts.joined(list(RobotPipeline(rig, log, "base").stream()))
    both = ScenePicture(scene.compared(in_pictures(found), "other"))
    blue, green, red = np.moveaxis(both.draw(3.3)[80:540].astype(int), 2, 0)
    assert np.count_nonzero((green - red > 60) & (green >= blue)) > 100


def test_a_report_of_sensors_without_touches_says_so() -> None:
    pytest.importorskip("jinja2")
    found = _contacts(np.full((4, 3), np.nan), ("a",) * 4)
    quiet = found.with_estimate(replace(found.estimate, status=np.full(4, 2, dtype=np.int8)))
    summary = RunSummary()
    summary.add(quiet)
    table = ReportTable(("sensor",), (("a",),))
    run = EstimatedRobot(
        "l", "o", "base", (), table, {"a": summary}, summary.finder.touches(), undrawn="No touch was found."
    )
    assert "No touch was found." in render(compose_robot(run))
