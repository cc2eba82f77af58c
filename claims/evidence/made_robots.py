"""Robots as URDF, and how far surfaces, mountings and kinematics are from those of pinocchio and pytransform3d.

Three robots in the manner of public ones: an arm with a tool in its own package, a gripper of mirrored fingers of which
one follows the other, and a portal with a continuous joint whose meshes lie beside the file.
"""

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from pytransform3d.urdf import UrdfTransformManager

from palpate.files.urdf import Kinematics, LinkBody, Urdf
from palpate.setup.body import GivenBody
from palpate.spatial.pose import rotation_from_quaternion

pin: Any = import_module("pinocchio")


ROBOTS = Path(__file__).parent / "robots"
ARM, GRIPPER, PORTAL = ((ROBOTS / f"{name}.urdf").read_text(encoding="utf-8") for name in ("arm", "gripper", "portal"))
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
        ("portal", "portal/portal.urdf", PORTAL),
    ):
        found[name] = folder / path
        found[name].parent.mkdir(parents=True)
        found[name].write_text(text.replace("{folder}", str(folder / "portal")), encoding="utf-8")
    write_mesh(folder / "src/arm_description/meshes/tool.stl", 0)
    write_mesh(folder / "checkout-1.2/finger.stl", 1)
    (folder / "checkout-1.2/package.xml").write_text("<package><name>fingers</name></package>", encoding="utf-8")
    write_mesh(folder / "portal/probe one.stl", 2)
    write_mesh(folder / "portal/two.stl", 3)
    (folder / "links").mkdir()
    (folder / "links/fingers").symlink_to(folder / "checkout-1.2")
    return found


def write_mesh(path: Path, seed: int) -> None:
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
    quaternion, position = (each[:, 0] for each in made.poses(values[:, [joints.index(name) for name in made.joints]]))
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
