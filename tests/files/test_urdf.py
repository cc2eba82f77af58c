"""Links of a URDF as surfaces and as frames: as pinocchio and pytransform3d place them; what is missing is said.

The robots are those of `claims.evidence.made_robots`.
"""

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from claims.evidence.made_robots import (
    ARM,
    GRIPPER,
    MESHES,
    MOUNTED,
    MOVED,
    mounting_apart,
    poses_apart,
    vertices_apart,
    volume,
    write_mesh,
    write_robots,
)
from palpate.cli import main
from palpate.errors import InputError
from palpate.files.arm import load_arm
from palpate.files.urdf import Kinematics, Urdf
from palpate.setup import load_rig
from palpate.setup.body import GivenBody
from palpate.surfaces import Mesh
from tests.support.arms import JOINTS, joint, write_arm
from tests.support.collada import write_collada


@pytest.fixture
def robots(tmp_path: Path) -> dict[str, Path]:
    """Their files, in a folder of the test's."""
    return write_robots(tmp_path)


@pytest.mark.parametrize(("robot", "link", "kind", "packages"), MESHES)
def test_vertices_are_where_pinocchio_puts_them(
    robots: dict[str, Path], tmp_path: Path, robot: str, link: str, kind: str, packages: str
) -> None:
    """Lengths of 0.1 m; trigonometry of the angles rounds by some 1e-16 of that."""
    assert vertices_apart(robots[robot], link, kind, tmp_path / packages) < 1e-12


def test_primitives_are_their_shapes(robots: dict[str, Path]) -> None:
    """Vertices on the surface to rounding; the volume is less by what chords cut off."""
    tip, box = Urdf(robots["gripper"]).body("tip"), Urdf(robots["arm"]).body("tool", "collision")
    whole = 4 / 3 * np.pi * 0.01**3 + np.pi * 0.01**2 * 0.02
    assert volume(tip) == pytest.approx(
        whole, rel=2e-3
    )  # (2 pi / 96)^2 / 6 = 7e-4 of the cylinder, as much of the sphere
    assert tip.vertices[:, 2].max() == pytest.approx(0.03, abs=1e-12)
    assert tip.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-12)
    assert np.ptp(box.vertices, axis=0) == pytest.approx([0.02, 0.04, 0.06], abs=1e-12)
    assert volume(box) == pytest.approx(0.02 * 0.04 * 0.06, rel=1e-12)


@pytest.mark.parametrize(("robot", "base", "sensor", "joints"), MOVED)
def test_kinematics_are_those_of_pytransform3d(
    robots: dict[str, Path], robot: str, base: str, sensor: str, joints: tuple[str, ...]
) -> None:
    assert poses_apart(robots[robot], base, sensor, joints, 25) < 1e-12


@pytest.mark.parametrize(("robot", "link", "sensor"), MOUNTED)
def test_the_mounting_is_that_of_the_fixed_joints(robots: dict[str, Path], robot: str, link: str, sensor: str) -> None:
    assert mounting_apart(robots[robot], link, sensor) < 1e-12


def test_a_joint_that_turns_leaves_no_mounting(robots: dict[str, Path]) -> None:
    assert GivenBody.of(robots["gripper"], "tip").mounting("ft") is None


def test_a_rig_reads_the_link_as_its_surface(robots: dict[str, Path], tmp_path: Path) -> None:
    rows = "\n".join(f"{k / 10},{k % 3},1,2,0.1,0.2,0.{k % 7}" for k in range(60))
    (tmp_path / "log.csv").write_text(f"time,fx,fy,fz,tx,ty,tz\n{rows}\n", encoding="utf-8")
    rig = tmp_path / "rigs" / "rig.toml"
    rig.parent.mkdir()
    arguments = ["rig", "new", str(tmp_path / "log.csv"), str(robots["gripper"]), "--link", "right", "-o", str(rig)]
    assert main([*arguments, "--package", f"fingers={tmp_path / 'checkout-1.2'}"]) == 0
    made = load_rig(rig)
    assert made.surface.packages == {"fingers": "../checkout-1.2"}
    surface = made.resolve().link.surface()
    assert isinstance(surface, Mesh)
    body = Urdf(robots["gripper"]).body("right")
    assert np.abs(surface.bounds - [body.vertices.min(axis=0), body.vertices.max(axis=0)]).max() < 1e-12
    assert {name: path.resolve() for name, path in made.files().items()} == {
        "urdf": robots["gripper"],
        "mesh": tmp_path / "checkout-1.2/finger.stl",
    }
    assert main(["inspect", str(rig)]) == 0
    assert main(["inspect", str(robots["gripper"])]) == 0


def test_ros_says_where_packages_are(robots: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for variable, folder in (("ROS_PACKAGE_PATH", "one"), ("AMENT_PREFIX_PATH", "two/share")):
        write_mesh(tmp_path / folder / "away" / "m.stl", 5)
        monkeypatch.setenv(variable, str(tmp_path / folder.split("/")[0]))
        found = Urdf(robots["portal"]).resolve("package://away/m.stl")
        assert found == tmp_path / folder / "away" / "m.stl"
        monkeypatch.delenv(variable)


@pytest.mark.parametrize("up", [None, "X_UP", "Y_UP", "Z_UP"])
def test_a_link_has_its_collada_files_unit_and_axes(tmp_path: Path, up: str | None) -> None:
    """RViz, Gazebo and MoveIt apply <unit> and ignore <up_axis>, and robots' meshes are made for that."""
    write_collada(tmp_path / "box.dae", "0.0254", up)
    shape = '<visual><geometry><mesh filename="box.dae" scale="1 2 1"/></geometry></visual>'
    robot = f'<robot name="r"><link name="b">{shape}</link></robot>'
    (tmp_path / "r.urdf").write_text(robot, "utf-8")
    body = Urdf(tmp_path / "r.urdf").body("b")
    assert np.ptp(body.vertices, axis=0) == pytest.approx([0.0254, 0.1016, 0.0762], abs=1e-8)  # float32 in trimesh
    notes = [f"box.dae states {up}"] if up in ("X_UP", "Y_UP") else []
    assert [note.split(",")[0] for note in body.mesh("b").notes] == notes
    assert set(body.notes) <= set(GivenBody.of(tmp_path / "r.urdf", "b").remarks(""))


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("arm_description/meshes", "nowhere/meshes", "package 'nowhere' is not found.*--package nowhere=FOLDER"),
        ("tool.stl", "tol.stl", "meshes/tol.stl' is missing: there is no file .*tol.stl"),
        ("package://arm_description/meshes/tool.stl", "http://x/tool.stl", "x/tool.stl' is not the address of a file"),
        ('<link name="tool">', '<link name="toool">', "joint 'e' does not join two links"),
        ('scale="0.001 0.002 0.0005"', 'scale="0.001"', "scale of link 'tool' must be 3 finite numbers .*not '0.001'"),
        ('rpy="0.4 -1.2 2.5"', 'rpy="0.4 x 2.5"', "rpy of link 'tool' must be 3 finite numbers"),
        ("<robot", '<robot xmlns:xacro="http://x"><xacro:arg name="a"/></robot><robot', "not a URDF that can be read"),
        (
            '<link name="bare"/>',
            '<link name="bare"/><xacro:macro xmlns:xacro="http://www.ros.org/wiki/xacro"/>',
            "written in xacro.*xacro robot.urdf",
        ),
        ("robot", "model", "describes a 'model', not a robot"),
    ],
)
def test_what_is_missing_is_a_sentence(robots: dict[str, Path], old: str, new: str, word: str) -> None:
    path = robots["arm"]
    path.write_text(ARM.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=rf"arm\.urdf: .*{word}"):
        Urdf(path).body("tool")


def test_what_is_asked_for_wrongly_is_a_sentence(robots: dict[str, Path], tmp_path: Path) -> None:
    arm, gripper = Urdf(robots["arm"]), Urdf(robots["gripper"])
    with pytest.raises(InputError, match=r"no link 'tol'.*Did you mean 'tool'"):
        arm.body("tol")
    with pytest.raises(InputError, match=r"link 'bare' has no geometry.*Available: 'tool'"):
        arm.body("bare")
    with pytest.raises(InputError, match=r"link 'left' has no visual geometry.*Did"):
        gripper.body("left", "visual")
    with pytest.raises(InputError, match=r"has several links\. Name one with --link: tool"):
        GivenBody.of(robots["arm"])
    with pytest.raises(InputError, match=r"the file does not exist.*Available"):
        Urdf(tmp_path / "none.urdf")
    with pytest.raises(InputError, match=r"no link 'tol'.*Did"):
        Kinematics(arm, "base", "tol")
    floating = ARM.replace('name="b" type="revolute"', 'name="b" type="floating"')
    robots["arm"].write_text(floating, encoding="utf-8")
    with pytest.raises(InputError, match=r"joint 'b', between 'base' and 'tool', is floating.*Choose"):
        Kinematics(Urdf(robots["arm"]), "base", "tool")
    twice = GRIPPER.replace('mimic joint="slide"', 'mimic joint="slid"')
    robots["gripper"].write_text(twice, encoding="utf-8")
    with pytest.raises(InputError, match=r"urdf: joint 'follow' follows 'slid', which does not move by itself"):
        Kinematics(Urdf(robots["gripper"]), "palm", "ft")


def test_without_pinocchio_joint_states_are_refused(robots: dict[str, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(import_module("sys").modules, "pinocchio", None)
    with pytest.raises(InputError, match=r"joint states need pinocchio.*palpate\[urdf\]"):
        Kinematics(Urdf(robots["arm"]), "base", "tool")
    assert len(Urdf(robots["arm"]).body("tool").faces)  # surface and mounting do without


def test_a_library_that_is_there_and_does_not_load_is_not_to_be_installed_again(
    robots: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on a bare system, where pinocchio finds no libgomp."""
    (tmp_path / "pinocchio.py").write_text("raise ImportError('libgomp.so.1: cannot open shared object file')")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(import_module("sys").modules, "pinocchio", raising=False)
    with pytest.raises(InputError, match=r"is installed but does not load \(libgomp.so.1.*Install") as refusal:
        Kinematics(Urdf(robots["arm"]), "base", "tool")
    assert "pip" not in str(refusal.value)


MISSING = [
    ({"base": "bse"}, "there is no link 'bse'. Did you mean 'base'"),
    ({"sensor": "tf"}, "there is no link 'tf'"),
    ({"joints": ["joint7", *JOINTS[1:]]}, "there is no joint 'joint7' in the chain. Did you mean"),
    ({"joints": JOINTS[:5]}, "urdf: joint 'joint6' also moves the sensor and must be named"),
    ({"joints": JOINTS[::-1]}, "not in the order of the chain. Write joint1, joint2"),
    ({"base": "world", "sensor": "base"}, "have no moving joint between them"),
]


@pytest.mark.parametrize(("changed", "said"), MISSING)
def test_what_is_missing_is_said(tmp_path: Path, changed: dict[str, Any], said: str) -> None:
    given: dict[str, Any] = {"base": "base", "sensor": "ft", **changed}
    with pytest.raises(InputError, match=said.replace(".", r"\.")):
        load_arm(write_arm(tmp_path), **given)


BROKEN = [
    (joint("j", "revolute", "a", "b", limit='lower="-2.5" upper="2.6" effort="1"'), "joint 'j' has no speed limit"),
    (joint("j", "revolute", "a", "b", limit='lower="2.5" upper="-2.6" velocity="1"'), "joint 'j' has an empty range"),
    (joint("j", "revolute", "a", "b", limit='velocity="1"'), "joint 'j' has an empty range"),
    (
        joint("j", "revolute", "a", "b", limit='lower="-2.5" upper="wide" velocity="1"'),
        "urdf: upper of the limit of joint 'j' must be 1 finite numbers",
    ),
    (joint("j", "revolute", "a", "b", limit=""), "joint 'j' has no limit.*Add"),
    (joint("j", "revolute", "a", "b", more='<axis xyz="0 0 0"/>'), "joint 'j' has no axis.*Check"),
    (joint("j", "floating", "a", "b", limit=""), "is floating, which one number cannot state.*Choose"),
    (
        joint("k", "revolute", "x", "a") + joint("j", "revolute", "a", "b", more='<mimic joint="k"/>'),
        "joint 'j' follows 'k' and cannot be commanded.*Choose",
    ),
]


@pytest.mark.parametrize(("joints", "said"), BROKEN)
def test_a_joint_that_cannot_be_commanded_is_refused(tmp_path: Path, joints: str, said: str) -> None:
    links = '<link name="x"/><link name="a"/><link name="b"/>'
    path = write_arm(tmp_path, f'<robot name="r">{links}{joints}</robot>')
    with pytest.raises(InputError, match=said):
        load_arm(path, "x" if "mimic" in joints else "a", "b")
