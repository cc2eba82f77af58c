"""Write a robot's runs: its description and meshes, logs of all sensors and joints, and the true contacts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from palpate_lab.simulation.bags import Stamped, header, joint_states, nanoseconds, wrenches, write_bag
from palpate_lab.simulation.robot.plan import RATE, RobotTouch
from palpate_lab.simulation.robot.run import RobotRun
from palpate_lab.simulation.robot.sensors import (
    BareFace,
    LabRobot,
    PadPatch,
    Sensor,
    SheetPatch,
    TouchedPart,
    WristSensor,
)
from palpate_lab.simulation.robot.tree import meshed, mjcf, moving, urdf
from palpate_lab.simulation.shapes import EllipsoidBody

START = 100.0  # s: the time of the first sample
JOINTS = "/joint_states"
_FACETS = 8000  # of a fingertip
_TAXELS = "lab_msgs/msg/Taxels"
_DEFINED = {_TAXELS: "std_msgs/Header header\nint16[] values\n"}
_KINDS: dict[type[Sensor], str] = {
    SheetPatch: "sensor_msgs/msg/Image",
    PadPatch: _TAXELS,
    WristSensor: "geometry_msgs/msg/WrenchStamped",
}
_VOLTAGES = "std_msgs/msg/Float64MultiArray"
_AXES = ("x", "y", "z")
_DIGITS = 7  # behind the point, of s, m, N and N m


def topic_of(sensor: Sensor) -> str:
    """Return the topic of a sensor's readings."""
    what = (
        "wrench"
        if isinstance(sensor, WristSensor)
        else "skin"
        if isinstance(sensor, SheetPatch | PadPatch)
        else "cells"
    )
    return f"/{sensor.name}/{what}"


def write_robot(robot: LabRobot, folder: Path) -> None:
    """Write robot.urdf with its meshes, and robot.xml, the same as MJCF."""
    import trimesh

    for path, shape in meshed(robot.links).items():
        (folder / path).parent.mkdir(exist_ok=True)
        x, y, z = shape.size
        vertices, faces = EllipsoidBody((x, y, z)).mesh(_FACETS)
        trimesh.Trimesh(vertices, faces, process=False).export(folder / path)
    (folder / "robot.urdf").write_text(urdf(robot.name, robot.links), encoding="utf-8")
    (folder / "robot.xml").write_text(mjcf(robot.name, robot.links, robot.sites()), encoding="utf-8")


def write_robot_log(robot: LabRobot, run: RobotRun, path: Path) -> None:
    """Write the readings of all sensors and the joint states as MCAP.

    Raises:
        InputError: rosbags is not installed.
    """
    kinds = {topic_of(each): _KINDS.get(type(each), _VOLTAGES) for each in robot.sensors}
    names = [link.joint for link in moving(robot.links)]

    def made(types: Any) -> Iterable[Iterable[Stamped]]:
        yield joint_states(types, JOINTS, START + run.joint_time, names, run.joints[:, 0], run.joints[:, 1])
        for sensor in robot.sensors:
            time, values = run.readings[sensor.name]
            yield _messages(types, sensor, START + time, values)

    write_bag(path, {JOINTS: "sensor_msgs/msg/JointState", **kinds}, made, _DEFINED)


def write_robot_truth(robot: LabRobot, run: RobotRun, path: Path) -> None:
    """Write a row for each contact, frame and sensor that feels it.

    Columns are the time [s], sensor and link, the number, kind and share of the touch, and point [m], normal, force [N]
    and torque about the normal [N m] in the link's frame; then point, normal and force in the base (base_px ...).
    """
    import polars

    parts = [robot.regions[each.region].parts[each.part] for each in run.touches]
    touch: list[int] = run.contacts.touch.tolist()
    rows = [(k, name) for k, number in enumerate(touch) for name in _felt(robot, run.touches[number])]
    true = run.contacts.of(np.array([k for k, _ in rows], dtype=np.int64))
    names = [each.name for each in robot.links]
    link = np.array([names.index(part.link) for part in parts], dtype=np.int64)[true.touch]
    turn, origin = (each[true.frame, link] for each in run.poses)
    point, normal, force = (np.einsum("nij,nj->ni", turn, each) for each in (true.point, true.normal, true.force))
    table: dict[str, Any] = {"time": START + true.frame / RATE, "sensor": [name for _, name in rows]}
    table |= {"link": [names[k] for k in link], "touch": true.touch}
    table |= {"kind": [run.touches[k].kind for k in true.touch], "share": true.share}
    table |= _columns("", true.point, true.normal, true.force) | {"torque": true.torsion}
    polars.DataFrame(table | _columns("base_", point + origin, normal, force)).write_csv(path, float_precision=_DIGITS)


def _columns(prefix: str, *values: Float[np.ndarray, "m 3"]) -> dict[str, np.ndarray]:
    """Return the columns px, py, pz, nx, ... of points, normals and forces."""
    named = zip("pnf", values, strict=True)
    return {f"{prefix}{letter}{axis}": each[:, k] for letter, each in named for k, axis in enumerate(_AXES)}


def _felt(robot: LabRobot, touch: RobotTouch) -> list[str]:
    """Return the names of the sensors that feel a touch."""
    region = robot.regions[touch.region]
    part: TouchedPart = region.parts[touch.part]
    names = ["" if isinstance(part, BareFace) else part.name, region.wrist]
    return [name for name in names if name]


def _messages(types: Any, sensor: Sensor, time: Float[np.ndarray, " n"], values: np.ndarray) -> Iterator[Stamped]:
    topic = topic_of(sensor)
    if isinstance(sensor, WristSensor):
        yield from wrenches(types, topic, time, values, sensor.link)
    elif isinstance(sensor, SheetPatch):
        rows, columns = values.shape[1:]
        image, head = types["sensor_msgs/msg/Image"], (rows, columns, "mono8", 0, columns)
        for stamp, row in zip(nanoseconds(time), values.astype(np.uint8).reshape(len(values), -1), strict=True):
            yield stamp, topic, image(header(types, stamp, sensor.link), *head, row)
    elif isinstance(sensor, PadPatch):
        taxels = types[_TAXELS]
        for stamp, row in zip(nanoseconds(time), values.astype(np.int16).reshape(len(values), -1), strict=True):
            yield stamp, topic, taxels(header(types, stamp, sensor.link), row)
    else:
        array, layout = types[_VOLTAGES], types["std_msgs/msg/MultiArrayLayout"]([], 0)
        for stamp, row in zip(nanoseconds(time), values, strict=True):
            yield stamp, topic, array(layout, row)
