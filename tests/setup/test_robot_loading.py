"""Each way in which the rig of a robot can be wrong is a sentence that names the place; what it says otherwise."""

from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.files.urdf import Urdf
from palpate.setup.load import load_rig, load_robot, robot_of
from tests.support.arms import SIX, write_arm

BOX = '<link name="link6"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>'
ROBOT = """\
[robot]
urdf = "arm.urdf"
joints = "/joint_states"
gravity = "fixed"
encoder = 0.2

[sensors.wrist]
kind = "force_torque"
link = "ft"
surface = { link = "link6" }
topic = "/wrist"
"""
ALONE = '[force_torque]\ntopic = "/wrist"\n[surface]\nkind = "sphere"\nradius = 0.1\n'


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    write_arm(tmp_path, SIX.replace('<link name="link6"/>', BOX))
    return tmp_path / "robot.toml"


def _written(rig: Path, old: str = "", new: str = "") -> Path:
    assert old in ROBOT
    rig.write_text(ROBOT.replace(old, new, 1))
    return rig


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (ROBOT[ROBOT.index("[sensors") :], "[sensors]", r"the robot has no sensors.*Add \[sensors"),
        ("[robot]", "[robt]\n[robot]", r"unknown key 'robt'.*robot"),
        ("encoder = 0.2", "encoder = -1", r"robot: encoder must be .* from 0 to 45 degrees, not -1"),
        ("encoder = 0.2", "max_gap = 0", r"robot: max_gap"),
        ("encoder = 0.2", 'expected = ["foot"]', r"no link 'foot'.*Did"),
        ("encoder = 0.2", "encodr = 0.2", r"unknown key 'encodr'.*encoder"),
        ('gravity = "fixed"', "", r"robot: gravity is missing: write gravity"),
        ('urdf = "arm.urdf"', "", r"robot: joints and base need the robot's urdf"),
        ('"arm.urdf"', '"leg.urdf"', r"leg\.urdf.*Did"),
    ],
)
def test_mistakes_of_the_robot_are_refused(rig: Path, old: str, new: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        load_robot(_written(rig, old, new))
    assert str(rig.parent) in str(caught.value)


@pytest.mark.parametrize(("old", "new"), [("[sensors.wrist]", "[sensors]"), ("sensors.wrist", "sensors.9wrist")])
def test_what_is_no_name_or_no_table_is_no_sensor(rig: Path, old: str, new: str) -> None:
    robot = load_robot(_written(rig, old, new))
    assert not robot.sensors
    assert any("must be a name of letters" in str(each) for each in robot.faulty.values())


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('kind = "force_torque"', "", r"kind, of the sensor, is missing.*force_torque"),
        ('kind = "force_torque"', "kind = 3", r": kind must be text in quotes, not 3"),
        ('kind = "force_torque"', 'kind = "force_torqe"', r"no kind 'force_torqe'.*force_torque"),
        ('link = "ft"', "link = true", r": link must be text in quotes"),
        ('link = "ft"', 'link = "ft"\nexpected = "yes"', r": expected must be true or false, not 'yes'"),
        ('link = "ft"', 'link = "tf"', r"no link 'tf'.*ft"),
        ('link = "ft"', 'link = "link4"', r"'joint\d' moves the touched link 'link6' against .* 'link4'.*Write"),
        ('"link6"', '"link7"', r"no link 'link7'.*link6"),
        ('topic = "/wrist"', 'topik = "/wrist"', r"'topik'.*topic"),
        ('topic = "/wrist"', 'topic = "/wrist"\nnoise = { force = -1.0, torque = 1.0 }', r"wrist.*noise"),
    ],
)
def test_mistakes_of_a_sensor_are_its_own(rig: Path, old: str, new: str, said: str) -> None:
    """The robot loads, and the sensor is among the faulty ones with a sentence that names its table."""
    robot = load_robot(_written(rig, old, new))
    assert not robot.sensors
    problem = robot.faulty["wrist"]
    with pytest.raises(InputError, match=said):
        raise problem
    assert "[sensors.wrist" in str(problem) or str(rig.with_name("arm.urdf")) in str(problem)
    with pytest.raises(InputError, match=said):
        load_rig(rig)
    with pytest.raises(InputError, match=said):
        robot.picked("wrist")


def test_what_is_no_rig_of_a_robot_is_refused(rig: Path) -> None:
    rig.write_text(ALONE)
    assert robot_of(rig) is None
    with pytest.raises(InputError, match=r"is not the rig of a robot.*Add"):
        load_robot(rig)
    with pytest.raises(InputError, match=r"robot\.stl: is a mesh, not a rig.*Write"):
        load_robot(rig.with_suffix(".stl"))
    with pytest.raises(InputError, match=r"robot\.mcap: is a log, not a rig.*Write"):
        load_rig(rig.with_suffix(".mcap"))


def test_a_sensor_is_posed_by_the_joints_and_its_surface_by_fixed_ones(rig: Path) -> None:
    robot = load_robot(_written(rig))
    (wrist,) = robot.picked(None)
    assert robot.base == "world"
    assert (wrist.frame, wrist.link, wrist.expected) == ("ft", "link6", False)
    orientation = wrist.rig.orientation
    assert (orientation.base, orientation.sensor, orientation.joints) == ("world", "ft", "/joint_states")
    assert not wrist.rig.acceleration.from_poses  # there is no payload whose inertia counts
    parts = Urdf(rig.with_name("arm.urdf")).fixed().path("ft", "link6").at(np.zeros(1))
    np.testing.assert_allclose(wrist.rig.mount().translation, parts[1][0], atol=1e-15)
    np.testing.assert_allclose(wrist.rig.mount().quaternion(), parts[0][0], atol=1e-15)
    assert set(robot.files()) >= {"urdf"}


@pytest.mark.parametrize(
    ("gravity", "names"), [("fixed", ("world", None)), ("odom", ("odom", None)), ("/imu", ("world", "/imu"))]
)
def test_gravity_is_that_of_the_base_a_frame_or_an_imu(rig: Path, gravity: str, names: tuple[str, str | None]) -> None:
    robot = load_robot(_written(rig, '"fixed"', f'"{gravity}"'))
    orientation = robot.sensors["wrist"].rig.orientation
    assert (orientation.base, orientation.imu) == names


def test_links_that_are_always_touched_make_their_sensors_expected(rig: Path) -> None:
    expected = load_robot(_written(rig, "encoder = 0.2", 'expected = ["link6"]'))
    assert expected.sensors["wrist"].expected
    own = load_robot(_written(rig, 'link = "ft"', 'link = "ft"\nexpected = true'))
    assert own.sensors["wrist"].expected


def test_one_of_several_sensors_must_be_named(rig: Path) -> None:
    second = ROBOT[ROBOT.index("[sensors") :].replace("wrist", "tip")
    rig.write_text(f"{ROBOT}\n{second}")
    with pytest.raises(InputError, match=r"several sensors: wrist, tip\. Name one with --sensor"):
        load_rig(rig)
    assert load_rig(rig, "tip").name == "tip"
    with pytest.raises(InputError, match=r"no sensor 'tap'.*tip"):
        load_rig(rig, "tap")
    assert [each.name for each in load_robot(rig).picked(("tip", "wrist"))] == ["wrist", "tip"]


def test_tables_for_all_sensors_are_those_of_each_without_its_own(rig: Path) -> None:
    own = '[sensors.tip]\nkind = "force_torque"\nlink = "link6"\ntopic = "/tip"\nfilter = { kind = "none" }\n'
    rig.write_text(f'{ROBOT}\n{own}\n[filter]\nkind = "butterworth"\ncutoff = 15\n')
    robot = load_robot(rig)
    assert robot.sensors["wrist"].rig.filter.kind == "butterworth"
    assert robot.sensors["tip"].rig.filter.kind == "none"
