"""Robots as URDF, and how far surfaces, mountings and kinematics are from those of pinocchio and pytransform3d.

Three robots in the manner of public ones: an arm with a tool in its own package, a gripper of mirrored fingers of which
one follows the other, and a portal with a continuous joint whose meshes lie beside the file.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from pytransform3d.urdf import UrdfTransformManager

from palpate.files.urdf import Kinematics, LinkBody, Urdf
from palpate.setup.body import GivenBody
from palpate.spatial.pose import rotation_from_quaternion

__all__ = [
    "ARM",
    "GRIPPER",
    "MESHES",
    "MOUNTED",
    "MOVED",
    "PORTAL",
    "mounting_apart",
    "poses_apart",
    "vertices_apart",
    "volume",
    "write_mesh",
    "write_robots",
]

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

MESHES = (  # robot, link, geometry, and the folder of its packages
    ("arm", "tool", "VISUAL", "src"),
    ("gripper", "left", "COLLISION", "links"),
    ("gripper", "right", "COLLISION", "links"),
    ("portal", "probe", "VISUAL", "portal"),
)
MOUNTED = (("arm", "tool", "ft"), ("gripper", "right", "ft"), ("portal", "probe", "column"))
MOVED = (  # robot, base, sensor, and the joints between them
    ("arm", "base", "tool", ("a", "b")),
    ("arm", "tool", "upper", ("b",)),
    ("gripper", "palm", "tip", ("slide", "turn")),
    ("gripper", "left", "ft", ("slide",)),
    ("portal", "floor", "probe", ("x", "spin")),
)


def write_robots(folder: Path) -> dict[str, Path]:
    """Each as its makers lay it out: beside its package, above it, or alone."""
    found: dict[str, Path] = {}
    for name, path, text in (
        ("arm", "src/arm_description/urdf/arm.urdf", ARM),
        ("gripper", "checkout-1.2/urdf/gripper.urdf", GRIPPER),
        ("portal", "portal/portal.urdf", PORTAL.replace("{folder}", str(folder / "portal"))),
    ):
        found[name] = folder / path
        found[name].parent.mkdir(parents=True)
        found[name].write_text(text, encoding="utf-8")
    write_mesh(folder / "src/arm_description/meshes/tool.stl", 0)
    write_mesh(folder / "checkout-1.2/finger.stl", 1)
    (folder / "checkout-1.2/package.xml").write_text("<package><name>fingers</name></package>", encoding="utf-8")
    write_mesh(folder / "portal/probe one.stl", 2)
    write_mesh(folder / "portal/two.stl", 3)
    (folder / "links").mkdir()
    (folder / "links/fingers").symlink_to(folder / "checkout-1.2")
    return found


def write_mesh(path: Path, seed: int) -> None:
    """A lopsided ball."""
    path.parent.mkdir(parents=True, exist_ok=True)
    mesh = trimesh.creation.icosphere(subdivisions=1, radius=20.0)
    mesh.vertices += np.random.default_rng(seed).normal(0, 2.0, mesh.vertices.shape)
    mesh.export(path)


def volume(body: LinkBody) -> float:
    """[m^3], below zero if normals point in."""
    a, b, c = np.moveaxis(body.vertices[body.faces], 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def vertices_apart(path: Path, link: str, kind: str, packages: Path) -> float:
    """[m] between the vertices of a link's surface and where pinocchio puts them; inf if its normals point in."""
    body = Urdf(path).body(link)
    wanted = _placed(path, link, getattr(pin.GeometryType, kind), [packages])
    good = body.geometry == kind.lower() and volume(body) > 0
    return float(np.abs(body.vertices - wanted).max()) if good else np.inf


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


def mounting_apart(path: Path, link: str, sensor: str) -> float:
    """[m], and of the elements of the rotation, of a link in the sensor's frame, from both libraries."""
    pose = GivenBody.of(path, link).mounting(sensor)
    if pose is None:
        return np.inf
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.randomConfiguration(model))  # fixed joints know no posture
    frame, tool = (data.oMf[model.getFrameId(name, pin.FrameType.BODY)] for name in (sensor, link))
    wanted = frame.actInv(tool)
    other = _manager(path).get_transform(link, sensor)
    off = [pose.rotation - wanted.rotation, pose.rotation - other[:3, :3]]
    off += [pose.translation - wanted.translation, pose.translation - other[:3, 3]]
    return max(float(np.abs(each).max()) for each in off)


def poses_apart(path: Path, base: str, sensor: str, joints: tuple[str, ...], count: int) -> float:
    """[m], and of the elements of the rotation, of random postures, from pytransform3d's.

    It knows no mimic joints, so that one is set to what it follows.
    """
    made, manager = Kinematics(Urdf(path), base, sensor), _manager(path)
    if sorted(made.joints) != sorted(joints):
        return np.inf
    values = np.random.default_rng(4).uniform(-3, 3, (count, len(joints)))
    quaternion, position = made.poses(values[:, [joints.index(name) for name in made.joints]])
    rotation, worst = rotation_from_quaternion(quaternion), 0.0
    for k, row in enumerate(values):
        for name, value in zip(joints, row, strict=True):
            manager.set_joint(name, value)
            if name == "slide":
                manager.set_joint("follow", -1.5 * value + 0.02)
        wanted = manager.get_transform(sensor, base)
        worst = max(worst, np.abs(rotation[k] - wanted[:3, :3]).max(), np.abs(position[k] - wanted[:3, 3]).max())
    return float(worst)


def _manager(path: Path) -> Any:
    manager = UrdfTransformManager()
    manager.load_urdf(path.read_text(encoding="utf-8"), package_dir="unused")
    return manager
