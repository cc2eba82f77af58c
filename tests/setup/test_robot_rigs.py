"""What calibrations write into the rig of a robot goes into the tables of their sensor; the rest of the text stays."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from claims.evidence import robot
from claims.evidence.logs_written import write_mcap
from palpate.errors import InputError
from palpate.files.urdf import Urdf
from palpate.setup.edit import update_drift, update_offset, update_pose
from palpate.setup.load import load_rig, load_robot
from palpate.setup.robot_new import propose_robot
from palpate.spatial.pose import Pose
from tests.support.arms import write_arm

ROBOT = """\
# two sensors
[robot]
urdf = "arm.urdf"
joints = "/joint_states"
gravity = "fixed"

[sensors.wrist]
kind = "force_torque"               # with a surface of its own
link = "ft"
surface = { kind = "sphere", radius = 0.02 }
topic = "/wrist"

[sensors.tip]
kind = "force_torque"
link = "link6"
surface = { kind = "sphere", radius = 0.01 }
topic = "/tip"
"""


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    arm = write_arm(tmp_path)
    arm.rename(tmp_path / "arm.urdf")
    path = tmp_path / "robot.toml"
    path.write_text(ROBOT)
    return path


def test_calibrations_write_into_the_tables_of_their_sensor(rig: Path) -> None:
    pose = Pose.from_quaternion([0, 0, 0.6, 0.8], [0.01, 0.02, 0.03])
    update_offset(rig, rig, 0.0125, comment="s", sensor="wrist")
    update_pose(rig, rig, pose, 1e-8 * np.eye(6), comment="from a test", sensor="tip")
    update_drift(rig, rig, {"walk": {"force": 0.01, "torque": 0.001}}, {"walk": "N"}, "tip")
    text = rig.read_text()
    assert text.startswith(ROBOT[:200])
    made = tomllib.loads(text)
    assert made["robot"] == tomllib.loads(ROBOT)["robot"]
    wrist, tip = (load_rig(rig, name) for name in ("wrist", "tip"))
    assert wrist.orientation.offset == 0.0125
    assert (wrist.orientation.base, wrist.orientation.sensor) == ("world", "ft")
    assert tip.orientation.offset == 0.0
    np.testing.assert_array_equal(tip.mount().translation, pose.translation)
    assert tip.drift is not None
    assert wrist.drift is None
    with pytest.raises(InputError, match=r"only within its folder.*Write"):
        update_offset(rig, rig.parent / "other" / "robot.toml", 0.0, sensor="wrist")


def test_a_sensor_that_is_stated_badly_leaves_the_others(rig: Path) -> None:
    rig.write_text(ROBOT.replace('kind = "force_torque"\nlink = "link6"', 'kind = "force_torqe"\nlink = "link6"'))
    robot = load_robot(rig)
    assert list(robot.sensors) == ["wrist"]
    assert "force_torque" in str(robot.faulty["tip"])
    assert "[sensors.tip]" in str(robot.faulty["tip"])
    with pytest.raises(InputError, match=r"force_torqe.*Did"):
        load_rig(rig, "tip")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (('link = "ft"', 'link = "fd"'), r"\[sensors\.wrist\].*no link 'fd'|no link 'fd'.*ft"),
        (('topic = "/tip"', 'topic = "/wrist"'), r"'wrist' and 'tip' both read the topic '/wrist'.*Give"),
        (('gravity = "fixed"\n', ""), r"robot: gravity is missing"),
        (('"/joint_states"', '"/joint_states"\nbase = "torso"'), r"no link 'torso'.*Available"),
        (("[robot]", "[robot]\njoint = 1"), r"unknown key 'joint'.*Did"),
    ],
)
def test_mistakes_are_named(rig: Path, change: tuple[str, str], said: str) -> None:
    """In the whole rig, or where the table of one sensor is wrong, when that sensor is asked for."""
    rig.write_text(ROBOT.replace(*change))
    with pytest.raises(InputError, match=said):
        load_rig(rig, "wrist")


def test_a_link_without_geometry_may_be_expected_to_be_touched(rig: Path) -> None:
    """A skin alone is the body there: the link is stated, and nothing is drawn on it."""
    skin = '[sensors.foot]\nkind = "skin"\nlink = "link5"\nrows = 4\ncolumns = 4\npitch = 0.005\ntopic = "/foot"\n'
    rig.write_text(ROBOT.replace('gravity = "fixed"', 'gravity = "fixed"\nexpected = ["link5"]') + skin)
    robot = load_robot(rig)
    assert not robot.faulty
    assert [each.name for each in robot.sensors.values() if each.expected] == ["foot"]


def test_one_sensor_is_not_picked_from_several_that_are_named(rig: Path) -> None:
    assert [each.name for each in load_robot(rig).picked("tip,wrist")] == ["wrist", "tip"]
    with pytest.raises(InputError, match=r"several sensors: tip, wrist.*Name"):
        load_rig(rig, "tip,wrist")


def test_links_are_proposed_from_frames_and_near_names(rig: Path) -> None:
    """A link without geometry is touched at the one that is fixed to it; what is not known is for a person to write."""
    ball = '<link name="ft"><visual><geometry><sphere radius="0.02"/></geometry></visual></link>'
    urdf, log = rig.with_name("arm.urdf"), rig.with_name("log.mcap")
    urdf.write_text(urdf.read_text().replace('<link name="ft"/>', ball))
    frames = {"/l6/wrench": "sensor", "/pad/wrench": "", "/tip/wrench": "link6", "/z/f": "link6", "/z_f": "link6"}
    stamped = [(0, topic, robot.wrench(0, np.ones(6), frame)) for topic, frame in frames.items()]
    write_mcap(log, stamped, dict.fromkeys(frames, robot.KINDS[robot.WRENCH]))
    made = propose_robot(log, Urdf(urdf), rig.parent)
    for said in (
        "l6: its frame 'sensor' is not a link: write its link (link6 is near in name)",
        "pad: its messages name no frame: write its link",
        "tip: link 'link6' has no geometry: 'ft', which is fixed to it, is taken for the touched link",
    ):
        assert said in made.remarks
    sensors = tomllib.loads(made.text)["sensors"]
    stated = [(each.get("link"), each.get("surface")) for each in sensors.values()]
    assert stated == [(None, None), (None, None), *[("link6", {"link": "ft"})] * 3]
    assert list(sensors) == ["l6", "pad", "tip", "z_f", "z_f_2"]
