"""A simulated session as a robot records it: /tf, /tf_static, joint states and two wrenches, written by rosbags.

The wrist has three joints, about z, y and x, so that any orientation of the sensor is one of its postures.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from pytransform3d.urdf import UrdfTransformManager
from scipy.spatial.transform import Rotation

from claims.command import must
from claims.evidence.logs_written import ROS2, header, pose, vector, write_ros2
from claims.evidence.logs_written import wrench_stamped as wrench
from palpate.signals.recording import ORIENTATION, POSITION, Recording
from palpate.spatial.pose import rotation_from_quaternion
from palpate_lab.simulation.session import Session

TYPES: Any = ROS2.types
WRENCH, OTHER = "/ft_sensor/wrench", "/gripper_ft/wrench"
KINDS = {
    WRENCH: "geometry_msgs/msg/WrenchStamped",
    OTHER: "geometry_msgs/msg/WrenchStamped",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/camera/object_pose": "geometry_msgs/msg/PoseStamped",
    "/vision/marker": "geometry_msgs/msg/PoseStamped",
}
FLANGE_SENSOR = Rotation.from_euler("z", 30, degrees=True)  # how the sensor is turned on the flange
SHIFTS = {
    "shoulder": (0.0, 0.0, 0.4),
    "elbow": (0.1, 0.0, 0.3),
    "flange": (0.2, 0.05, 0.0),
    "ft_sensor": (0.0, 0.0, 0.05),
}
MOVING = (("base_link", "shoulder", "z"), ("shoulder", "elbow", "y"), ("elbow", "flange", "x"))
GROUND = (1.0, 2.0, 0.0)  # m: of the base in the world
TOOL = (0.0, 0.0, 0.085)  # m: of the probe in the sensor, by the drawing
EVERY = 2  # samples: transforms and joint states come at half the rate
URDF = (Path(__file__).parent / "robots/wrist.urdf").read_text(encoding="utf-8")  # of these joints and places


@dataclass(frozen=True)
class Posture:
    """Angles [rad] of the three joints that turn the sensor as a recording says; (n, 3)."""

    angles: np.ndarray

    @classmethod
    def of(cls, quaternions: np.ndarray) -> Posture:
        return cls(np.unwrap((Rotation.from_quat(quaternions) * FLANGE_SENSOR.inv()).as_euler("ZYX"), axis=0))

    def positions(self) -> np.ndarray:
        """(n, 3) [m] of the sensor's origin in the base, written out."""
        a, b, c = (Rotation.from_euler(axis, angle[:, None]) for axis, angle in zip("zyx", self.angles.T, strict=True))
        at = np.array(SHIFTS["shoulder"]) + a.apply(SHIFTS["elbow"]) + (a * b).apply(SHIFTS["flange"])
        return at + (a * b * c).apply(SHIFTS["ft_sensor"])


def write_robot(session: Session, folder: Path) -> None:
    """free_motion and touches as bags, robot.urdf, and its package beside it."""
    meshes = folder / "probe_description" / "meshes"
    meshes.mkdir(parents=True)
    trimesh.Trimesh(1e3 * session.vertices, session.faces, process=False).export(meshes / "probe.stl")
    (folder / "robot.urdf").write_text(URDF, encoding="utf-8")
    for name, log in (("free_motion", session.free_motion), ("touches", session.touches)):
        write_bag(folder / name, messages(log))


def apart(recording: Recording, log: Recording) -> float:
    """[m], and of the elements of the rotation, of the poses at the stamps of /tf from the simulated ones in the world.

    Euler angles and back are a few roundings, positions of 3 m a few 1e-16 of them.
    """
    at = slice(0, None, EVERY)
    turned, true = (rotation_from_quaternion(each.channels[ORIENTATION][at]) for each in (recording, log))
    wanted = Posture.of(log.channels[ORIENTATION]).positions()[at] + GROUND
    off = (turned - true, recording.channels[POSITION][at] - wanted)
    return max(float(np.abs(each).max()) for each in off)


def apart_from_library(recording: Recording, log: Recording, path: Path) -> float:
    """The same of every tenth, from the poses that pytransform3d gives the URDF at those angles of the joints."""
    manager: Any = UrdfTransformManager()
    manager.load_urdf(path.read_text(encoding="utf-8"), package_dir="unused")
    angles = Posture.of(log.channels[ORIENTATION]).angles
    rotation, worst = rotation_from_quaternion(recording.channels[ORIENTATION]), 0.0
    for k in range(0, len(angles), 10 * EVERY):
        for (_, child, _), angle in zip(MOVING, angles[k], strict=True):
            manager.set_joint(f"{child}_joint", angle)
        wanted = manager.get_transform("ft_sensor", "world")
        off = (rotation[k] - wanted[:3, :3], recording.channels[POSITION][k] - wanted[:3, 3])
        worst = max(worst, *(float(np.abs(each).max()) for each in off))
    return worst


def readme(folder: Path) -> list[str]:
    """The README's commands on what `write_session` and `write_robot` wrote, and what `evaluate` says, in lines.

    The one line to change by hand is the payload's.
    """
    rig, touches, free, marks = (str(folder / name) for name in ("my_rig.toml", "touches", "free_motion", "marks.csv"))
    must("rig", "new", touches, str(folder / "robot.urdf"), "--link", "probe", "-o", rig)
    must("calibrate", "payload", free, "--rig", rig, "-o", str(folder / "payload.toml"))
    text = Path(rig).read_text(encoding="utf-8")
    Path(rig).write_text(text.replace('# payload = "payload.toml"', 'payload = "payload.toml"'), encoding="utf-8")
    must("calibrate", "mounting", touches, "--rig", rig, "--marks", marks, "-o", rig)
    must("inspect", touches)
    must("estimate", touches, "--rig", rig, "-o", str(folder / "contacts.csv"))
    return must("evaluate", str(folder / "contacts.csv"), str(folder / "truth.csv")).splitlines()


def write_bag(path: Path, stamped: Iterator[tuple[int, str, Any]], kinds: dict[str, str] = KINDS) -> None:
    write_ros2(path, sorted(stamped, key=lambda each: each[0]), kinds=kinds)


def messages(log: Recording) -> Iterator[tuple[int, str, Any]]:
    """Of one log. /tf_static comes once, after the first wrench, with stamps of zero."""
    stamps = np.rint(log.time * 1e9).astype(np.int64).tolist()
    for k, row in enumerate(log.wrenches().tolist()):
        yield stamps[k], WRENCH, wrench(stamps[k], row, "ft_sensor")
        yield stamps[k], OTHER, wrench(stamps[k], [0.1 * k for _ in range(6)], "gripper_ft")
    still = [
        transform(0, "world", "base_link", GROUND),
        transform(0, "/flange", "ft_sensor", SHIFTS["ft_sensor"], FLANGE_SENSOR.as_quat()),
        transform(0, "ft_sensor", "probe", TOOL),
        transform(0, "world", "camera", (0.0, 1.0, 1.0)),
    ]
    yield stamps[3], "/tf_static", TYPES["tf2_msgs/msg/TFMessage"](still)
    posture = Posture.of(log.channels[ORIENTATION])
    for k in range(0, len(stamps), EVERY):
        yield stamps[k], "/tf", tree(stamps[k], posture.angles[k])
        yield stamps[k], "/joint_states", joints(stamps[k], posture.angles[k])
        yield stamps[k], "/camera/object_pose", posed(stamps[k], "camera", k)
        yield stamps[k], "/vision/marker", posed(stamps[k], "camera", 0)


def transform(
    stamp: int, parent: str, child: str, shift: Sequence[float], turn: Sequence[float] | np.ndarray = (0, 0, 0, 1)
) -> Any:
    turned = TYPES["geometry_msgs/msg/Quaternion"](*map(float, turn))
    made = TYPES["geometry_msgs/msg/Transform"](vector(shift), turned)
    return TYPES["geometry_msgs/msg/TransformStamped"](header(stamp, parent), child, made)


def tree(stamp: int, angles: np.ndarray) -> Any:
    """The three joints as transforms, with one that stands still and is on /tf_static too."""
    moving = [
        transform(stamp, parent, child, SHIFTS[child], Rotation.from_euler(axis, angle).as_quat())
        for (parent, child, axis), angle in zip(MOVING, angles.tolist(), strict=True)
    ]
    return TYPES["tf2_msgs/msg/TFMessage"]([*moving, transform(stamp, "ft_sensor", "probe", TOOL)])


def joints(stamp: int, angles: np.ndarray) -> Any:
    """In an order of their own, with a gripper between them."""
    names = [f"{child}_joint" for _, child, _ in MOVING]
    names, position = [names[2], "finger", *names[:2]], np.array([angles[2], 0.01, *angles[:2]])
    return TYPES["sensor_msgs/msg/JointState"](header(stamp, ""), names, position, np.zeros(4), np.zeros(4))


def posed(stamp: int, frame: str, k: int) -> Any:
    made = pose(np.array([0.0, 0.0, 0.0, 1.0]), np.array([1e-3 * k, 0.0, 0.0]))
    return TYPES["geometry_msgs/msg/PoseStamped"](header(stamp, frame), made)
