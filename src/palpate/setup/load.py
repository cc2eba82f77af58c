"""Read the file of a rig: of one sensor, or of a robot with [robot] and any number of [sensors.NAME]."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import fields
from os import PathLike
from pathlib import Path
from typing import Any, cast

import numpy as np

from palpate.calls import called_as
from palpate.errors import InputError
from palpate.files.models import load_toml
from palpate.files.schema import parse
from palpate.files.units import near
from palpate.files.urdf import Urdf
from palpate.setup.kinds import KINDS
from palpate.setup.rig import ESTIMATE, Rig, check_rig
from palpate.setup.robot import Robot, RobotSensor, RobotTable
from palpate.signals.recording import FORCE
from palpate.spatial.pose import Pose

TF, FIXED = "/tf", "fixed"
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_TABLES = tuple(each.name for each in fields(Rig) if each.name not in ("sensors", "folder", "name"))
_SOURCES = {"columns", "file", "topic", "base", "sensor", "urdf"}  # keys of [orientation] that name other poses
_OWN = {"kind": str, "link": str, "expected": bool}
_NO_RIG = {
    "a mesh": (".stl", ".obj", ".ply", ".dae"),
    "a log": (".csv", ".parquet", ".npy", ".npz", ".mcap", ".bag", ".db3"),
}


@called_as('palpate.load_rig("rig.toml")')
def load_rig(path: str | PathLike[str], sensor: str | None = None) -> Rig:
    """Read a rig file; errors name the place in the file and the nearest valid key.

    Args:
        path: the file.
        sensor: name of the sensor, if the rig is of a robot with several, or of its table in a rig of one.

    Raises:
        InputError: the file cannot be read or is not TOML, a key or a needed table is misspelt or missing, a value has
            another type or is out of bounds, tables contradict each other, or the robot has no such sensor or several
            and none is named.
    """
    document = _document(path)
    if not _is_robot(document):
        rig = check_rig(document, Path(path))
        if sensor is not None:
            rig.kind(sensor)
        return rig
    robot = _robot(document, Path(path))
    names = [*robot.sensors, *robot.faulty] if sensor is None else sensor.split(",")
    if len(names) > 1:
        what = f"is the rig of a robot with several sensors: {', '.join(names)}."
        raise InputError(what, where=str(path), hint="Name one with --sensor.")
    return robot.picked(names[0])[0].rig


def load_robot(path: str | PathLike[str]) -> Robot:
    """Read the rig of a robot; errors name the place in the file and the nearest valid key.

    A sensor whose tables cannot be used is among the `faulty` ones of the robot, with its error.

    Tables outside [robot] and [sensors.NAME], such as [time] or [source], are for all sensors that have none of these.

    Raises:
        InputError: the file cannot be read or is not TOML, it is not of a robot or has no sensors, two sensors read one
            topic, or [robot] has an unknown key or a value that is refused, or contradicts the URDF.
    """
    document = _document(path)
    if not _is_robot(document):
        hint = "Add [sensors.NAME] with kind and link for each sensor."
        raise InputError("is not the rig of a robot.", where=str(path), hint=hint)
    return _robot(document, Path(path))


def robot_of(path: str | PathLike[str]) -> Robot | None:
    """Return the robot of a rig file; None if the rig is of one sensor.

    Raises:
        InputError: as for `load_robot`.
    """
    document = _document(path)
    return _robot(document, Path(path)) if _is_robot(document) else None


def _document(path: str | PathLike[str]) -> dict[str, Any]:
    path = Path(path)
    for what, suffixes in _NO_RIG.items():
        if path.suffix.lower() in suffixes:
            raise InputError(f"is {what}, not a rig.", where=str(path), hint=f"Write {ESTIMATE}.")
    return load_toml(path)


def _is_robot(document: Mapping[str, Any]) -> bool:
    return "robot" in document or "sensors" in document


def _robot(document: Mapping[str, Any], path: Path) -> Robot:
    own: Any = document.get("robot", {})
    if not isinstance(own, dict):
        raise InputError(f"robot must be a table, not {own!r:.60}.", where=str(path))
    table = parse(cast("dict[str, Any]", own), RobotTable, file=str(path), key="robot")
    stated: Any = document.get("sensors", {})
    if not isinstance(stated, dict) or not stated:
        hint = "Add [sensors.NAME] with kind and link for each sensor."
        raise InputError("the robot has no sensors.", where=str(path), hint=hint)
    shared = {name: value for name, value in document.items() if name not in ("robot", "sensors")}
    for name in shared:
        if name not in _TABLES:
            raise InputError(f"unknown key {name!r}.", where=str(path), hint=near(name, ["robot", "sensors", *_TABLES]))
    urdf = table.read_urdf(path.parent)
    sensors, faulty = dict[str, RobotSensor](), dict[str, InputError]()
    for name, own in cast("dict[str, Any]", stated).items():
        try:
            sensors[name] = _Expanded(name, own, shared, table, urdf, path).sensor()
        except InputError as problem:  # the other sensors can be used
            faulty[name] = problem
    robot = Robot(table, sensors, faulty, path, urdf)
    if urdf is not None:
        for link in (robot.base, *table.expected):
            urdf.require(link)
    _require_topics(robot)
    return robot


def _require_topics(robot: Robot) -> None:
    """Raise InputError if two sensors read the same topic."""
    seen = dict[str, str]()
    for name, each in robot.sensors.items():
        for table in each.rig.sensors.values():
            topic = getattr(table, "topic", None)
            if topic is not None and topic in seen:
                what = f"the sensors {seen[topic]!r} and {name!r} both read the topic {topic!r}."
                raise InputError(what, where=str(robot.path), hint="Give each its own topic.")
            if topic is not None:
                seen[topic] = name


class _Expanded:
    """The table of one sensor of a robot, written out as a rig of one sensor."""

    def __init__(
        self, name: str, stated: Any, shared: Mapping[str, Any], robot: RobotTable, urdf: Urdf | None, path: Path
    ) -> None:
        self._name, self._robot, self._urdf, self._path = name, robot, urdf, path
        self._where = f"{path}: [sensors.{name}]"
        if not _NAME.fullmatch(name) or not isinstance(stated, dict):
            what = f"{name!r} must be a name of letters, digits and _, and a table."
            raise InputError(what, where=str(path), hint="Write [sensors.left_wrist], for one.")
        own = dict(cast("dict[str, Any]", stated))
        for key, kind in _OWN.items():
            if key in own and not isinstance(own[key], kind):
                words = "true or false" if kind is bool else "text in quotes"
                raise InputError(f"{key} must be {words}, not {own[key]!r}.", where=self._where)
        self._kind, self._link, self._expected = (own.pop(key, None) for key in _OWN)
        self._tables = {**shared, **{key: own.pop(key) for key in list(own) if key in _TABLES or key in KINDS}}
        self._add_kind(own)

    def _add_kind(self, own: dict[str, Any]) -> None:
        """Add the table of the sensor's kind."""
        named = [key for key in self._tables if key in KINDS]
        for key in named:
            if not isinstance(self._tables[key], dict):
                what = f"{key} must be a table, not {self._tables[key]!r}."
                raise InputError(what, where=self._where, hint=f"Write [sensors.{self._name}.{key}] above its keys.")
        if self._kind is None and not named:
            hint = f"Write kind = one of {', '.join(KINDS)}."
            raise InputError("kind, of the sensor, is missing.", where=self._where, hint=hint)
        if self._kind is None and own:
            raise InputError(f"unknown key {next(iter(own))!r}.", where=self._where, hint="Write kind = ...")
        if self._kind is not None and self._kind not in KINDS:
            raise InputError(f"there is no kind {self._kind!r}.", where=self._where, hint=near(self._kind, KINDS))
        if self._kind is not None and (own or not KINDS[self._kind].parts):
            self._tables[self._kind] = {**self._tables.get(self._kind, {}), **own}

    def sensor(self) -> RobotSensor:
        """Return the sensor.

        Raises:
            InputError: a key is misspelt or missing or its value is refused, or the URDF has no such link.
        """
        if self._link is not None and self._urdf is not None:
            self._urdf.require(self._link)
        touched = self._surface()
        kinds = [KINDS[name] for name in self._tables if name in KINDS]
        lost = any(kind.needs_surface for kind in kinds) and "surface" not in self._tables
        if lost and self._link is None and self._urdf is not None:
            hint = (
                'Add link = "NAME": the link in whose frame it reports; also surface = { link = ... } if not touched.'
            )
            raise InputError("the link of the sensor is not stated.", where=self._where, hint=hint)
        if self._link is not None and any(FORCE in kind.channels for kind in kinds):
            stated = self._tables.get("orientation", {})
            if isinstance(stated, dict) and not _SOURCES & stated.keys():
                poses = self._orientation()
                self._tables["orientation"] = {**poses, **cast("dict[str, Any]", stated)}
                if poses and "imu" not in poses and any("payload" in self._tables.get(k.name, {}) for k in kinds):
                    self._tables.setdefault("acceleration", {"from_poses": True})  # of the payload's inertia
        try:
            rig = check_rig(self._tables, self._path, self._name)
        except InputError as problem:
            where = str(problem.where).removeprefix(str(self._path)).removeprefix(": ")
            place = f"{self._where[:-1]}.{where}]" if where and "." in where else self._where
            raise InputError(problem.what, where=place, hint=problem.hint) from problem
        link = touched or self._link or ""
        expected = bool(self._expected) or link in self._robot.expected
        return RobotSensor(self._name, rig, self._link, link, expected)

    def _surface(self) -> str:
        """Write out the surface as a link of the URDF, posed in the sensor's frame; return the link's name or ""."""
        stated: Any = self._tables.get("surface", {})
        if not isinstance(stated, dict) or {"mesh", "kind", "urdf"} & stated.keys() or self._urdf is None:
            return ""
        surface = dict(cast("dict[str, Any]", stated))
        link = str(surface.get("link", self._link))
        if "link" not in surface and (self._link is None or link not in self._urdf.shaped()):
            return ""  # a skin alone may be the body; what needs a surface asks for it
        if self._link is not None and self._link != link and "pose" not in surface:
            pose = self._fixed(self._urdf, self._link, link)
            surface["pose"] = {"xyz": pose.translation.tolist(), "quaternion_xyzw": pose.quaternion().tolist()}
        packages = dict(self._robot.packages)
        self._tables["surface"] = {"urdf": self._robot.urdf, "link": link, "packages": packages, **surface}
        return link

    def _fixed(self, urdf: Urdf, frame: str, link: str) -> Pose:
        """Return the constant pose of a link in the sensor's frame."""
        moving = urdf.chain(frame, link)
        if moving:
            what = f"joint {moving[0].name!r} moves the touched link {link!r} against the sensor's frame {frame!r}."
            raise InputError(what, where=self._where, hint="Write as surface a link that is fixed to the sensor.")
        path = urdf.fixed().path(frame, link)
        return Pose.from_quaternion(*(each[0] for each in path.at(np.zeros(1))))

    def _orientation(self) -> dict[str, Any]:
        """Return the [orientation] of a sensor whose link the joints move."""
        if self._urdf is None or self._robot.joints is None or self._link is None:
            return {}
        base, gravity = self._robot.base or self._urdf.root(self._urdf.links[0]), self._robot.gravity
        frames = {"base": base, "sensor": self._link, "max_gap": self._robot.max_gap}
        if not isinstance(self._robot.joints, str):  # columns of a table, which has nothing else to turn the base
            moving = {joint.mimics or joint.name for joint in self._urdf.chain(base, self._link)}
            columns = {name: column for name, column in self._robot.joints.items() if name in moving}
            return {**frames, "urdf": self._robot.urdf, "joints": columns} if gravity == FIXED else {}
        if gravity is not None and gravity.startswith("/"):
            frames |= {"imu": gravity}
        elif gravity != FIXED:
            frames |= {"base": gravity}
        if self._robot.joints == TF:
            return frames
        return {**frames, "urdf": self._robot.urdf, "joints": self._robot.joints}
