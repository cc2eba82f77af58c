"""Links of a URDF as surfaces and as frames: as pinocchio and pytransform3d place them; what is missing is said.

Three robots in the manner of public ones: an arm with a tool in its own package, a gripper of mirrored fingers of which
one follows the other, and a portal with a continuous joint whose meshes lie beside the file.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from pytransform3d.urdf import UrdfTransformManager

from palpate.cli import main
from palpate.errors import InputError
from palpate.io.rig import load_rig
from palpate.io.rig.body import Body
from palpate.io.urdf import Kinematics, LinkBody, Urdf
from palpate.spatial.pose import rotation_from_quaternion
from palpate.surfaces import Mesh

pin: Any = import_module("pinocchio")


def _joint(name: str, kind: str, parent: str, child: str, origin: str = "", more: str = "") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin {origin}/>{more}'
        '<limit lower="-9" upper="9" effort="1" velocity="1"/></joint>'
    )


def _axis(text: str) -> str:
    return f'<axis xyz="{text}"/>'


ARM = f"""<robot name="arm"><link name="base"/><link name="upper"/><link name="fore"/><link name="ft"/>
<link name="bare"/>
<link name="tool">
  <visual><origin xyz="0.01 -0.02 0.03" rpy="0.4 -1.2 2.5"/><geometry>
    <mesh filename="package://arm_description/meshes/tool.stl" scale="0.001 0.002 0.0005"/></geometry></visual>
  <collision><geometry><box size="0.02 0.04 0.06"/></geometry></collision>
</link>
{_joint("a", "revolute", "base", "upper", 'xyz="0 0 0.3" rpy="0.1 0.2 0.3"', _axis("0 0 1"))}
{_joint("b", "revolute", "upper", "fore", 'xyz="0.4 0 0"', _axis("0.6 0.8 0"))}
{_joint("c", "fixed", "fore", "ft", 'xyz="0 0 0.05" rpy="0 0 0.7"')}
{_joint("d", "fixed", "ft", "bare", 'xyz="0 0.01 0.02" rpy="1.5 0 0"')}
{_joint("e", "fixed", "bare", "tool", 'xyz="0.03 0 0.1" rpy="-0.3 0.6 0.2"')}
</robot>"""

GRIPPER = f"""<robot name="gripper"><link name="palm"/><link name="ft"/>
<link name="left"><collision><origin xyz="0 0 0.01"/><geometry>
  <mesh filename="package://fingers/finger.stl" scale="0.001 0.001 0.001"/></geometry></collision></link>
<link name="right"><collision><origin xyz="0 0 0.01"/><geometry>
  <mesh filename="package://fingers/finger.stl" scale="0.001 -0.001 0.001"/></geometry></collision></link>
<link name="tip">
  <visual><origin xyz="0 0 0.02"/><geometry><sphere radius="0.01"/></geometry></visual>
  <visual><origin xyz="0 0 0.01"/><geometry><cylinder radius="0.01" length="0.02"/></geometry></visual>
</link>
{_joint("slide", "prismatic", "palm", "left", 'xyz="0 0.01 0"', _axis("0 1 0"))}
{
    _joint(
        "follow",
        "prismatic",
        "palm",
        "right",
        'xyz="0 -0.01 0" rpy="0 0 0.2"',
        _axis("0 -1 0") + '<mimic joint="slide" multiplier="-1.5" offset="0.02"/>',
    )
}
{_joint("mount", "fixed", "right", "ft", 'xyz="0 0 0.03"')}
{_joint("turn", "revolute", "ft", "tip", 'xyz="0 0 0.03"', _axis("1 0 0"))}
</robot>"""

PORTAL = f"""<robot name="portal"><link name="floor"/><link name="beam"/><link name="column"/>
<link name="probe">
  <visual name="one"><geometry><mesh filename="probe one.stl"/></geometry></visual>
  <visual name="two"><origin xyz="0 0 0.1" rpy="0 1.57 0"/><geometry>
    <mesh filename="file://{{folder}}/two.stl"/></geometry></visual>
</link>
{_joint("x", "prismatic", "floor", "beam", 'rpy="0 0 0.5"', _axis("1 0 0"))}
{_joint("spin", "continuous", "beam", "column", 'xyz="0 0 1"', _axis("0 0.28 0.96"))}
{_joint("end", "fixed", "column", "probe", 'xyz="0.1 0.2 0.3" rpy="0.1 0.2 0.3"')}
</robot>"""


def _stl(path: Path, seed: int) -> np.ndarray:
    """A lopsided mesh on disk, and its vertices as the file has them: float32."""
    path.parent.mkdir(parents=True, exist_ok=True)
    mesh = trimesh.creation.icosphere(subdivisions=1, radius=20.0)
    mesh.vertices += np.random.default_rng(seed).normal(0, 2.0, mesh.vertices.shape)
    mesh.export(path)
    return np.asarray(trimesh.load(path, process=False).vertices)


@pytest.fixture
def robots(tmp_path: Path) -> dict[str, Path]:
    """Each as its makers lay it out: beside its package, above it, or alone."""
    found: dict[str, Path] = {}
    for name, path, text in (
        ("arm", "src/arm_description/urdf/arm.urdf", ARM),
        ("gripper", "checkout-1.2/urdf/gripper.urdf", GRIPPER),
        ("portal", "portal/portal.urdf", PORTAL.replace("{folder}", str(tmp_path / "portal"))),
    ):
        found[name] = tmp_path / path
        found[name].parent.mkdir(parents=True)
        found[name].write_text(text, encoding="utf-8")
    _stl(tmp_path / "src/arm_description/meshes/tool.stl", 0)
    _stl(tmp_path / "checkout-1.2/finger.stl", 1)
    (tmp_path / "checkout-1.2/package.xml").write_text("<package><name>fingers</name></package>", encoding="utf-8")
    _stl(tmp_path / "portal/probe one.stl", 2)
    _stl(tmp_path / "portal/two.stl", 3)
    return found


def _placed(path: Path, link: str, kind: Any, packages: list[Path]) -> np.ndarray:
    """Vertices of a link in its frame, as pinocchio places, scales and finds its meshes."""
    model = pin.buildModelFromUrdf(str(path))
    shapes = pin.buildGeomFromUrdf(model, str(path), kind, package_dirs=[str(each) for each in packages])
    frame = model.getFrameId(link, pin.FrameType.BODY)
    found: list[np.ndarray] = []
    for shape in shapes.geometryObjects:
        if shape.parentFrame == frame:
            points = np.asarray(trimesh.load(shape.meshPath, process=False).vertices) * shape.meshScale
            place = model.frames[frame].placement.actInv(shape.placement)
            found.append(points @ place.rotation.T + place.translation)
    return np.concatenate(found)


@pytest.mark.parametrize(
    ("robot", "link", "kind", "package"),
    [
        ("arm", "tool", "VISUAL", "src"),
        ("gripper", "left", "COLLISION", "links"),
        ("gripper", "right", "COLLISION", "links"),
        ("portal", "probe", "VISUAL", "portal"),
    ],
)
def test_vertices_are_where_pinocchio_puts_them(
    robots: dict[str, Path], tmp_path: Path, robot: str, link: str, kind: str, package: str
) -> None:
    """Lengths of 0.1 m; trigonometry of the angles rounds by some 1e-16 of that."""
    (tmp_path / "links").mkdir()
    (tmp_path / "links/fingers").symlink_to(tmp_path / "checkout-1.2")
    body = Urdf(robots[robot]).body(link)
    wanted = _placed(robots[robot], link, getattr(pin.GeometryType, kind), [tmp_path / package])
    assert np.abs(body.vertices - wanted).max() < 1e-12
    assert body.geometry == kind.lower()
    assert _volume(body) > 0  # normals point out, of the mirrored finger too


def _volume(body: LinkBody) -> float:
    a, b, c = np.moveaxis(body.vertices[body.faces], 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def test_primitives_are_their_shapes(robots: dict[str, Path]) -> None:
    """Vertices on the surface to rounding; the volume is less by what chords cut off."""
    tip, box = Urdf(robots["gripper"]).body("tip"), Urdf(robots["arm"]).body("tool", "collision")
    whole = 4 / 3 * np.pi * 0.01**3 + np.pi * 0.01**2 * 0.02
    assert _volume(tip) == pytest.approx(
        whole, rel=2e-3
    )  # (2 pi / 96)^2 / 6 = 7e-4 of the cylinder, as much of the sphere
    assert tip.vertices[:, 2].max() == pytest.approx(0.03, abs=1e-12)
    assert tip.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-12)
    assert np.ptp(box.vertices, axis=0) == pytest.approx([0.02, 0.04, 0.06], abs=1e-12)
    assert _volume(box) == pytest.approx(0.02 * 0.04 * 0.06, rel=1e-12)


@pytest.mark.parametrize(
    ("robot", "base", "sensor", "joints"),
    [
        ("arm", "base", "tool", ("a", "b")),
        ("arm", "tool", "upper", ("b",)),
        ("gripper", "palm", "tip", ("slide", "turn")),
        ("gripper", "left", "ft", ("slide",)),
        ("portal", "floor", "probe", ("x", "spin")),
    ],
)
def test_kinematics_are_those_of_pytransform3d(
    robots: dict[str, Path], robot: str, base: str, sensor: str, joints: tuple[str, ...]
) -> None:
    """It knows no mimic joints, so that one is set to what it follows."""
    made = Kinematics(Urdf(robots[robot]), base, sensor)
    values = np.random.default_rng(4).uniform(-3, 3, (25, len(joints)))
    assert sorted(made.joints) == sorted(joints)
    order = [made.joints.index(name) for name in joints]
    quaternion, position = made.poses(values[:, np.argsort(order)])
    manager = UrdfTransformManager()
    manager.load_urdf(robots[robot].read_text(encoding="utf-8"), package_dir="unused")
    rotation = rotation_from_quaternion(quaternion)
    for k, row in enumerate(values):
        for name, value in zip(joints, row, strict=True):
            manager.set_joint(name, value)
            if name == "slide":
                manager.set_joint("follow", -1.5 * value + 0.02)
        wanted = manager.get_transform(sensor, base)
        assert np.abs(rotation[k] - wanted[:3, :3]).max() < 1e-12
        assert np.abs(position[k] - wanted[:3, 3]).max() < 1e-12


def test_the_mounting_is_that_of_the_fixed_joints(robots: dict[str, Path]) -> None:
    """Pinocchio's frames at any posture, and pytransform3d's."""
    pose = Body.of(robots["arm"], "tool").mounting("ft")
    assert pose is not None
    model = pin.buildModelFromUrdf(str(robots["arm"]))
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.array([0.3, -0.8]))
    sensor, tool = (data.oMf[model.getFrameId(name, pin.FrameType.BODY)] for name in ("ft", "tool"))
    wanted = sensor.actInv(tool)
    assert np.abs(pose.rotation - wanted.rotation).max() < 1e-12
    assert np.abs(pose.translation - wanted.translation).max() < 1e-12
    manager = UrdfTransformManager()
    manager.load_urdf(ARM, package_dir="unused")
    assert np.abs(manager.get_transform("tool", "ft")[:3, 3] - pose.translation).max() < 1e-12
    assert Body.of(robots["gripper"], "tip").mounting("ft") is None  # a joint that turns lies between


def test_a_rig_reads_the_link_as_its_surface(robots: dict[str, Path], tmp_path: Path) -> None:
    rows = "\n".join(f"{k / 10},{k % 3},1,2,0.1,0.2,0.{k % 7}" for k in range(60))
    (tmp_path / "log.csv").write_text(f"time,fx,fy,fz,tx,ty,tz\n{rows}\n", encoding="utf-8")
    rig = tmp_path / "rigs" / "rig.toml"
    rig.parent.mkdir()
    arguments = ["rig", "new", str(tmp_path / "log.csv"), str(robots["gripper"]), "--link", "right", "-o", str(rig)]
    assert main([*arguments, "--package", f"fingers={tmp_path / 'checkout-1.2'}"]) == 0
    made = load_rig(rig)
    assert made.surface is not None
    assert made.surface.packages == {"fingers": "../checkout-1.2"}
    surface = made.surface.load(made.folder)
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
        _stl(tmp_path / folder / "away" / "m.stl", 5)
        monkeypatch.setenv(variable, str(tmp_path / folder.split("/")[0]))
        found = Urdf(robots["portal"]).resolve("package://away/m.stl")
        assert found == tmp_path / folder / "away" / "m.stl"
        monkeypatch.delenv(variable)


def test_a_collada_file_says_its_unit(tmp_path: Path) -> None:
    box = trimesh.creation.box(extents=(10.0, 20.0, 30.0))
    raw = trimesh.exchange.dae.export_collada(box)
    text = raw.decode() if isinstance(raw, bytes) else raw
    (tmp_path / "box.dae").write_text(
        text.replace("<asset>", '<asset><unit name="millimeter" meter="0.001"/>'), "utf-8"
    )
    robot = (
        '<robot name="r"><link name="b"><visual><geometry><mesh filename="box.dae"/></geometry></visual></link></robot>'
    )
    (tmp_path / "r.urdf").write_text(robot, "utf-8")
    vertices = Urdf(tmp_path / "r.urdf").body("b").vertices
    assert np.ptp(vertices, axis=0) == pytest.approx([0.01, 0.02, 0.03], abs=1e-9)  # float32 in the file


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("arm_description/meshes", "nowhere/meshes", "package 'nowhere' is not found.*--package nowhere=FOLDER"),
        ("tool.stl", "tol.stl", "mesh 'package://arm_description/meshes/tol.stl' is not there: no file .*tol.stl"),
        ("package://arm_description/meshes/tool.stl", "http://x/tool.stl", "mesh 'http://x/tool.stl' is not a file"),
        ('<link name="tool">', '<link name="toool">', "joint 'e' does not join two links"),
        ('scale="0.001 0.002 0.0005"', 'scale="0.001"', "scale of link 'tool' must be 3 numbers, not '0.001'"),
        ('rpy="0.4 -1.2 2.5"', 'rpy="0.4 x 2.5"', "rpy of link 'tool' must be 3 numbers"),
        ("<robot", '<robot xmlns:xacro="http://x"><xacro:arg name="a"/></robot><robot', "no URDF that can be read"),
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
    with pytest.raises(InputError, match=r"link 'bare' has no geometry.*There is 'tool'"):
        arm.body("bare")
    with pytest.raises(InputError, match="link 'left' has no visual geometry"):
        gripper.body("left", "visual")
    with pytest.raises(InputError, match=r"has several links\. Name one with --link: tool"):
        Body.of(robots["arm"])
    with pytest.raises(InputError, match="no URDF that can be read"):
        Urdf(tmp_path / "none.urdf")
    with pytest.raises(InputError, match="no link 'tol'"):
        Kinematics(arm, "base", "tol")
    floating = ARM.replace('name="b" type="revolute"', 'name="b" type="floating"')
    robots["arm"].write_text(floating, encoding="utf-8")
    with pytest.raises(InputError, match="joint 'b', between 'base' and 'tool', is floating"):
        Kinematics(Urdf(robots["arm"]), "base", "tool")
    twice = GRIPPER.replace('mimic joint="slide"', 'mimic joint="slid"')
    robots["gripper"].write_text(twice, encoding="utf-8")
    with pytest.raises(InputError, match="joint 'follow' follows 'slid', which does not move by itself"):
        Kinematics(Urdf(robots["gripper"]), "palm", "ft")


def test_without_pinocchio_joint_states_are_refused(robots: dict[str, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(import_module("sys").modules, "pinocchio", None)
    with pytest.raises(InputError, match=r"joint states need pinocchio.*palpate\[urdf\]"):
        Kinematics(Urdf(robots["arm"]), "base", "tool")
    assert len(Urdf(robots["arm"]).body("tool").faces)  # surface and mounting do without
