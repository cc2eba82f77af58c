"""Many links of a robot over time, from joint states, columns or /tf, against closed forms; commands and positions."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pytransform3d.urdf import UrdfTransformManager
from scipy.spatial.transform import Rotation

from claims.evidence.logs_written import header, write_mcap
from claims.evidence.robot import KINDS, TYPES, transform
from palpate.cli import main
from palpate.control.servo import Servo
from palpate.errors import InputError
from palpate.files.logs.robot_motion import JointSamples, RobotMotion
from palpate.files.models import read_model
from palpate.files.urdf import Kinematics, Urdf
from palpate.spatial.pose import rotation_from_quaternion
from palpate_lab.simulation.bags import nanoseconds, write_bag
from tests.calibration.test_servo import rows, short
from tests.support.arms import joint
from tests.support.dice import rolled

STEP = 10**7  # ns
UPPER, FORE = 0.3, 0.2  # m
PLANAR = "".join(
    (
        '<robot name="planar"><link name="base"/><link name="upper"/><link name="fore"/><link name="hand"/>',
        joint("shoulder", "revolute", "base", "upper", more='<axis xyz="0 0 1"/>'),
        joint("elbow", "revolute", "upper", "fore", more=f'<origin xyz="{UPPER} 0 0"/><axis xyz="0 0 1"/>'),
        joint("palm", "fixed", "fore", "hand", more=f'<origin xyz="{FORE} 0 0"/>', limit=""),
        "</robot>",
    )
)
SLOW = np.column_stack([np.linspace(-0.5, 0.5, 201), np.linspace(0.2, -0.3, 201)])  # rad: 0.5 rad/s at 100 Hz


def _urdf(folder: Path, text: str = PLANAR) -> Urdf:
    path = folder / "robot.urdf"
    path.write_text(text, encoding="utf-8")
    return Urdf(path)


def _states(values: np.ndarray, names: tuple[str, ...] = ("elbow", "shoulder")) -> list[tuple[int, str, Any]]:
    """Joint states in an order that is not the URDF's; `values` are of `names`."""
    kind, none = TYPES["sensor_msgs/msg/JointState"], np.zeros(0)
    return [
        (STEP * k, "/joint_states", kind(header(STEP * k, ""), list(names), np.array(row), none, none))
        for k, row in enumerate(values)
    ]


def _log(folder: Path, rows: list[tuple[int, str, Any]]) -> Path:
    write_mcap(folder / "log.mcap", rows, {name: KINDS[name] for name in dict.fromkeys(each[1] for each in rows)})
    return folder / "log.mcap"


def _motion(folder: Path, values: np.ndarray, **options: Any) -> RobotMotion:
    """The motion of the planar arm; `values` (n, 2) are shoulder and elbow."""
    log = _log(folder, _states(values[:, ::-1]))
    return RobotMotion.read(log, _urdf(folder), "base", ["hand", "upper"], joints=None, **options)


def test_two_links_are_where_trigonometry_puts_them(tmp_path: Path) -> None:
    time = STEP * np.arange(len(SLOW)) / 1e9
    motion = _motion(tmp_path, SLOW)
    (turn, place), (_, upper) = motion.at("hand", time), motion.at("upper", time)
    first, both = SLOW[:, 0], SLOW.sum(axis=1)
    expected = [UPPER * f(first) + FORE * f(both) for f in (np.cos, np.sin)]
    np.testing.assert_allclose(place, np.column_stack([*expected, 0 * both]), atol=1e-14)
    np.testing.assert_allclose(Rotation.from_quat(turn).as_rotvec()[:, 2], both, atol=1e-14)
    np.testing.assert_allclose(upper, 0, atol=1e-14)
    assert not motion.warnings()


def test_a_pose_is_known_only_near_joint_states(tmp_path: Path) -> None:
    rows = _states(SLOW[:, ::-1])
    log = _log(tmp_path, [*rows[:20], *rows[80:100]])  # 0 to 0.19 s, 0.8 to 0.99 s
    motion = RobotMotion.read(log, _urdf(tmp_path), "base", ["hand"], joints="/joint_states")
    _, place = motion.at("hand", np.array([-0.01, 0.0, 0.105, 0.5, 0.9, 1.0]))
    assert np.isfinite(place).all(axis=1).tolist() == [False, True, True, False, True, False]


@pytest.mark.parametrize("rarely", [1, 4])
def test_columns_and_transforms_are_joint_states_in_another_form(tmp_path: Path, rarely: int) -> None:
    """Of two edges that move, one may be sent more rarely: both turn evenly, so that nothing is lost in between."""
    time = STEP * np.arange(len(SLOW)) / 1e9
    expected = _motion(tmp_path, SLOW).at("hand", time)
    table = tmp_path / "log.csv"
    np.savetxt(table, np.column_stack([time, SLOW]), delimiter=",", header="time,q1,q2", comments="", fmt="%.17g")
    urdf, columns = _urdf(tmp_path), {"shoulder": "q1", "elbow": "q2"}
    found = RobotMotion.read(table, urdf, "base", ["hand"], joints=columns).at("hand", time)
    np.testing.assert_allclose(found[1], expected[1], atol=1e-15)
    tree, turns = TYPES["tf2_msgs/msg/TFMessage"], Rotation.from_rotvec
    rows = list[tuple[int, str, Any]]()
    for k, (one, two) in enumerate(SLOW):
        edges = (("base", "upper", 0.0, one), ("upper", "fore", UPPER, two), ("fore", "hand", FORE, 0.0))
        sent = [edge for edge in edges if edge[1] != "fore" or k % rarely == 0]
        moved = [transform(STEP * k, a, b, [x, 0, 0], turns([0, 0, turn]).as_quat()) for a, b, x, turn in sent]
        rows.append((STEP * k, "/tf", tree(moved)))
    found = RobotMotion.read(_log(tmp_path, rows), urdf, "base", ["hand"], joints="/tf").at("hand", time)
    np.testing.assert_allclose(found[1], expected[1], atol=1e-14)
    np.testing.assert_allclose(np.abs(np.sum(found[0] * expected[0], axis=1)), 1, atol=1e-14)


def test_two_publishers_may_each_state_some_of_the_joints(tmp_path: Path) -> None:
    """The arm moves at constant speed, so that positions between states are on its line."""
    time = STEP * np.arange(len(SLOW)) / 1e9
    expected = _motion(tmp_path, SLOW).at("hand", time)[1]
    one, other = _states(SLOW[:, :1], ("shoulder",)), _states(SLOW[:, 1:], ("elbow",))
    log = _log(tmp_path, [pair[k % 2] for k, pair in enumerate(zip(one, other, strict=True))])
    motion = RobotMotion.read(log, _urdf(tmp_path), "base", ["hand"], joints=None)
    np.testing.assert_allclose(motion.at("hand", time[1:-1])[1], expected[1:-1], atol=1e-14)
    assert any("lack joints" in note for note in motion.notes())
    assert not motion.warnings()


def _random(rng: np.random.Generator) -> str:
    """A tree of 20 links: joints that turn, for ever too, slide, are fixed, or mimic the first."""
    parts = ['<robot name="random">', *(f'<link name="l{k}"/>' for k in range(20))]
    for k in range(1, 20):
        xyz, rpy, axis = (" ".join(map(repr, rng.normal(size=3).tolist())) for _ in range(3))
        kind = "revolute" if k == 1 else str(rng.choice(["revolute", "continuous", "prismatic", "fixed"]))
        more = f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
        more += '<mimic joint="j1" multiplier="-0.5" offset="0.1"/>' if kind == "revolute" and k > 8 else ""
        limit = "" if kind in ("continuous", "fixed") else 'lower="-9" upper="9" effort="1" velocity="1"'
        parts.append(joint(f"j{k}", kind, f"l{rng.integers(0, k)}", f"l{k}", more=more, limit=limit))
    return "".join([*parts, "</robot>"])


def test_deviations_of_encoders_are_those_of_dice(tmp_path: Path) -> None:
    """Of every joint that turns between base and link, mimics and all; what slides has no encoder of angles."""
    rng, encoder = np.random.default_rng(2), np.radians(0.2)
    urdf = _urdf(tmp_path, _random(rng))
    arm = Kinematics(urdf, "l0", [f"l{k}" for k in range(1, 20)])
    sliding = {each.name for each in urdf.joints if each.kind == "prismatic"}
    turning = np.array([name not in sliding for name in arm.joints])
    positions = rng.uniform(-2.0, 2.0, (2, len(arm.joints)))
    samples = JointSamples(arm, np.array([0.0, 1.0]), positions, 2.0)
    for place in range(0, len(arm.links), 4):
        stated = samples.covariance(arm.links[place], np.array([1.1, 0.1, 0.9]), encoder)
        np.testing.assert_array_equal(stated[0], stated[2])
        for row, at in ((1, positions[0]), (0, positions[1])):

            def moved(off: np.ndarray, at: np.ndarray = at, place: int = place) -> np.ndarray:
                turns, there = (part[:, place] for part in arm.poses(np.stack([at, at + off])))
                here, turned = Rotation.from_quat(turns)
                return np.concatenate([(turned * here.inv()).as_rotvec(), there[1] - there[0]])

            found = rolled(moved, np.diag(encoder**2 * turning))
            assert np.abs(stated[row] - found).max() < 1e-4 * np.abs(found).max() + 1e-18
    assert samples.covariance("l3", np.zeros(0), encoder).shape == (0, 6, 6)
    none = JointSamples(arm, np.zeros(0), np.zeros((0, len(arm.joints))), 2.0)
    assert np.isnan(none.covariance("l3", np.zeros(2), encoder)).all()
    assert all(np.isnan(part).all() for part in none.at("l3", np.zeros(2)))


@pytest.mark.parametrize("seed", range(4))
def test_all_links_of_a_random_tree_are_where_pytransform3d_puts_them(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    urdf = _urdf(tmp_path, _random(rng))
    base, links = "l5", [name for name in urdf.links if name != "l5"]
    robot = Kinematics(urdf, base, links)
    values = rng.uniform(-2, 2, (5, len(robot.joints)))
    turn, place = robot.poses(values)
    other = UrdfTransformManager()
    other.load_urdf(urdf.path.read_text(encoding="utf-8"))
    mimics = [each.name for each in urdf.joints if each.mimics and "j1" in robot.joints]
    for k, row in enumerate(values):
        positions = dict(zip(robot.joints, row, strict=True))
        positions |= {name: -0.5 * positions["j1"] + 0.1 for name in mimics}
        for name, value in positions.items():
            other.set_joint(name, value)
        for i, link in enumerate(links):
            expected = other.get_transform(link, base)
            np.testing.assert_allclose(rotation_from_quaternion(turn[k, i]), expected[:3, :3], atol=1e-12)
            np.testing.assert_allclose(place[k, i], expected[:3, 3], atol=1e-12)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (joint("bar", "revolute", "base", "fore"), "'fore' has 2 parents, 'upper' .joint 'elbow'. and 'base' .joint"),
        ('<link name="far"/>', "2 trees, with the roots 'base', 'far'.*Join"),
        (joint("back", "revolute", "hand", "base"), "the frames form a loop.*Remove"),
    ],
)
def test_joints_that_form_no_tree_are_refused(tmp_path: Path, more: str, said: str) -> None:
    urdf = _urdf(tmp_path, PLANAR.replace("</robot>", f"{more}</robot>"))
    with pytest.raises(InputError, match=said) as refusal:
        Kinematics(urdf, "base", ["hand"])
    assert str(urdf.path) in str(refusal.value)


def test_a_robot_of_one_link_does_not_move(tmp_path: Path) -> None:
    urdf = _urdf(tmp_path, '<robot name="one"><link name="base"/></robot>')
    assert urdf.root("base") == "base"
    one = Kinematics(urdf, "base", ["base"])
    turn, place = one.poses(np.zeros((3, 0)))
    assert turn.tolist() == [[[0, 0, 0, 1]]] * 3
    assert not place.any()


def test_joint_states_that_cannot_be_used_are_refused(tmp_path: Path) -> None:
    urdf = _urdf(tmp_path)
    with pytest.raises(InputError, match=r"no position of the joint 'elbow'.*Record"):
        RobotMotion.read(_log(tmp_path, _states(SLOW[:, :1], ("shoulder",))), urdf, "base", ["hand"], joints=None)
    with pytest.raises(InputError, match=r"joint 'shoulder' reads up to .* in degrees.*Write"):
        _motion(tmp_path, np.degrees(SLOW) + 30)
    with pytest.raises(InputError, match=r"there is no topic '/joints'.*Name"):
        RobotMotion.read(tmp_path / "log.mcap", urdf, "base", ["hand"], joints="/joints")


def test_poses_between_rare_joint_states_are_as_far_off_as_stated(tmp_path: Path) -> None:
    fine = np.column_stack([np.sin(0.04 * np.arange(201.0)), np.cos(0.03 * np.arange(201.0))])
    (tmp_path / "rare").mkdir()
    log = _log(tmp_path / "rare", _states(fine[:, ::-1])[::10])
    rare = RobotMotion.read(log, _urdf(tmp_path), "base", ["hand", "upper"], joints=None)
    between = np.linspace(0.01, 1.99, 100)
    (turn, place), (true_turn, true_place) = rare.at("hand", between), _motion(tmp_path, fine).at("hand", between)
    turned = (Rotation.from_quat(turn) * Rotation.from_quat(true_turn).inv()).as_rotvec()
    error, stated = np.column_stack([turned, place - true_place]), rare.covariance("hand", between)
    for which in ([2], [3], [4]):
        assert np.mean(error[:, which] ** 2) == pytest.approx(np.mean(stated[:, which, which]), rel=0.3)
    assert np.sqrt(np.mean(stated[:, 2, 2])) > 3e-3


def test_what_may_be_wrong_is_a_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    jumping = SLOW.copy()
    jumping[100:, 1] += 0.3
    (said,) = _motion(tmp_path, jumping).warnings()
    assert said.startswith("joint 'elbow' jumps by 0.29")
    assert "at 1.000 s" in said
    (said,) = _motion(tmp_path, SLOW + np.array([0.0, 3.0])).warnings()
    assert said.startswith("joint 'elbow' reads 3.2, beyond its limits -2.5 to 2.6")
    hung = np.where((np.arange(201) > 90)[:, None] & [False, True], SLOW[90], SLOW)
    (said,) = _motion(tmp_path, hung).warnings()
    assert said.startswith("joint 'elbow' stands still from 0.910 s to 2.000 s, while most others move")
    locked = _motion(tmp_path, SLOW * [1.0, 0.0])
    assert (locked.warnings(), locked.notes()) == (
        (),
        ("the position of 'elbow' never changes, and those of most joints do",),
    )
    rows = _states(SLOW[:, ::-1])
    still = (STEP * 500, "/tf", TYPES["tf2_msgs/msg/TFMessage"]([]))
    log = _log(tmp_path, [*rows, still])
    (said,) = RobotMotion.read(log, _urdf(tmp_path), "base", ["hand"], joints=None).warnings()
    assert said.startswith(
        "3.0 s of the 5.0 s of the log have no states of all joints within 0.25 s on '/joint_states'"
    )
    assert "the last is at 2.000 s" in said
    log = _log(tmp_path, [*rows, (18 * 10**17, *still[1:])])  # events of a live record have the computer's clock
    assert not RobotMotion.read(log, _urdf(tmp_path), "base", ["hand"], joints=None).warnings()
    main(["inspect", str(log)])
    assert re.search(r"/joint_states .* 201 +100\n", capsys.readouterr().out)


def test_topics_are_joined_by_the_joints_names(tmp_path: Path) -> None:
    """Commands and positions with their own stamps, and joints in another order."""
    time, commands, positions, _ = rows(short(rate=200.0))
    kind, none, names = "sensor_msgs/msg/JointState", np.zeros(0), np.array(["a", "b", "c"])

    def states(topic: str, each: slice, order: list[int], values: np.ndarray) -> list[tuple[int, str, Any]]:
        return [
            (stamp, topic, TYPES[kind](header(stamp, ""), names[order].tolist(), row[order], none, none))
            for stamp, row in zip(nanoseconds(time[each]), values[each], strict=True)
        ]

    sent, reached = states("/command", slice(0, None, 4), [0, 1, 2], commands), slice(1, None, 2)
    made = sent, states("/joints", reached, [2, 0, 1], positions)
    write_bag(tmp_path / "log.mcap", dict.fromkeys(("/command", "/joints"), kind), lambda _: made)
    words = ["calibrate", "servo", str(tmp_path / "log.mcap"), "--commands", "/command", "--positions", "/joints"]
    assert main([*words, "-o", str(tmp_path / "servo.toml")]) == 0
    servo = read_model(tmp_path / "servo.toml", Servo)
    assert (servo.delay, servo.lag) == pytest.approx((0.021, 0.033), abs=1e-3)
