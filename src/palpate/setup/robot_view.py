"""Prepare the page of a robot: its links and the contacts of all sensors in the base, picture by picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from palpate.contact.contacts import Contacts
from palpate.contact.events import Events
from palpate.errors import InputError
from palpate.files.logs.robot_motion import RobotMotion
from palpate.files.urdf import Urdf
from palpate.setup.robot import Robot
from palpate.setup.robot_pipeline import RobotPipeline
from palpate.spatial.pose import rotation_from_quaternion
from palpate.viewer.drawing import Mark
from palpate.viewer.notebook import marks_of
from palpate.viewer.robot_layer import RobotLayer, Triangles
from palpate.viewer.scene import Scene, no_contacts, prepare
from palpate.viewer.timeline import since

PICTURES = 30.0  # per second


def robot_scene(robot: Robot, log: Path, sensors: str | None = None) -> tuple[Scene, list[str]]:
    """Estimate the log of a robot, and return its scene in the base, and notes on it.

    Args:
        robot: the robot.
        log: file of the log.
        sensors: names of sensors, with commas between; None: all.

    Raises:
        InputError: the log or the rig cannot be used, or states no motion of the links.
    """
    pipeline = RobotPipeline(robot, log, "base", sensors)
    found = Contacts.joined(list(pipeline.stream()))
    time = _pictures(found)
    contacts, layer = on_pictures(found, time), _layer(robot, log, found, time)
    return prepare(None, contacts, log.name, (layer,)), [*pipeline.warnings(), *pipeline.notes()]


def _pictures(found: Contacts) -> Float[np.ndarray, " m"]:
    """Return the times of the pictures [s], evenly spaced."""
    known = found.time[np.isfinite(found.time)]
    if not len(known):
        raise InputError("no sample has a time, so nothing can be shown in turn.")
    return np.arange(known.min(), known.max() + 1 / PICTURES, 1 / PICTURES)


def in_pictures(found: Contacts) -> Contacts:
    """Return the contacts of a robot's sensors, in the base, as `on_pictures` does, at 30 pictures a second.

    Raises:
        InputError: no contact has a time, or the contacts have no origins.
    """
    return on_pictures(found, _pictures(found))


def on_pictures(found: Contacts, time: Float[np.ndarray, " m"]) -> Contacts:
    """Return contacts whose samples are pictures: of each sensor the strongest sample from a picture to the next.

    Args:
        found: contacts of a robot's sensors, in the base.
        time: (m,) [s] of the pictures, evenly spaced.

    Raises:
        InputError: the contacts have no origins.
    """
    if found.origins is None:
        raise InputError("found must have origins: only contacts of a robot are shown so.")
    rows = np.flatnonzero(found.answered & np.isfinite(found.time))
    kept = rows[_strongest(found, rows, _picture_of(found.time[rows], time))]
    shown = found[kept]
    picture = _picture_of(shown.time, time)
    empty = np.setdiff1d(np.arange(len(time)), picture)
    blank = no_contacts()[np.zeros(len(empty), dtype=np.int64)]
    joined = Contacts.joined([shown, replace(blank, origins=found.origins[np.zeros(len(empty), dtype=np.int64)])])
    picture = np.concatenate([picture, empty])
    order = np.argsort(picture, kind="stable")
    return replace(joined[order], sample=picture[order], time=time[picture[order]])


def _picture_of(stamps: Float[np.ndarray, " n"], time: Float[np.ndarray, " m"]) -> Int[np.ndarray, " n"]:
    return (np.searchsorted(time, stamps, side="right") - 1).clip(0, len(time) - 1)


def _strongest(found: Contacts, rows: Int[np.ndarray, " n"], picture: Int[np.ndarray, " n"]) -> Int[np.ndarray, " k"]:
    """Return which of the rows are of the sample with the largest force of its sensor in its picture."""
    if found.origins is None or not len(rows):
        return np.zeros(0, dtype=np.int64)
    group = picture * len(found.origins.among) + found.origins.index[rows]
    sample = group * (int(found.sample.max()) + 1) + found.sample[rows]
    samples, of_row = np.unique(sample, return_inverse=True)
    total = np.bincount(of_row, np.linalg.norm(found.force[rows], axis=1))
    groups = samples // (int(found.sample.max()) + 1)
    order = np.lexsort((total, groups))
    last = np.append(groups[order][1:] != groups[order][:-1], True)
    return np.flatnonzero(np.isin(of_row, order[last]))


def touched_robot(robot: Robot, log: Path, touches: Events) -> tuple[RobotLayer, list[Mark]]:
    """Return the robot as it stood at the strongest touch, a layer of one sample, and the touches on it.

    Each mark is where the touch was on its link, which may have been elsewhere then.

    Args:
        robot: the robot.
        log: file of the log.
        touches: of a robot's sensors, in the base, at least one.

    Raises:
        InputError: the rig names no URDF, or the log does not state where its links were.
    """
    strongest = float(touches.peak_time[touches.peak_force.argmax()])
    when = [
        path[np.linalg.norm(path[:, 1:] - at, axis=1).argmin(), 0]
        for path, at in zip(touches.paths, touches.point, strict=True)
    ]
    time = np.array([strongest, *when])
    motion, links = _motion(robot, log, np.unique(touches.link).tolist())
    marks = list[Mark]()
    for k, mark in enumerate(marks_of(touches, len(touches), since(touches.start)[0])):
        origin = touches[k]
        turns, moves = motion.at(origin.link, time[[0, k + 1]])
        shown, then = rotation_from_quaternion(turns)
        marks.append(
            replace(
                mark,
                point=shown @ then.T @ (mark.point - moves[1]) + moves[0],
                normal=shown @ then.T @ mark.normal,
                tooltip=f"{origin.sensor} on {origin.link}, {mark.tooltip}",
            )
        )
    return RobotLayer(links, *_poses(motion, links, time[:1]), {}, {}), marks


def _motion(robot: Robot, log: Path, others: Sequence[str] = ()) -> tuple[RobotMotion, dict[str, Triangles]]:
    """Return the motion of all links that have a geometry, and of others, and the triangles of these links."""
    urdf, links = drawn_links(robot)
    names, table = list(dict.fromkeys([*links, *others])), robot.table
    return RobotMotion.read(log, urdf, robot.base, names, joints=table.joints, max_gap=table.max_gap), links


def drawn_links(robot: Robot) -> tuple[Urdf, dict[str, Triangles]]:
    """Return the URDF of a robot, and link -> triangles of the links that have a geometry.

    Raises:
        InputError: the rig names no URDF, or a mesh cannot be read.
    """
    urdf = robot.urdf
    if urdf is None:
        raise InputError("a robot is drawn from its URDF, and the rig names none.", where=str(robot.path))
    bodies = {name: urdf.body(name) for name in urdf.shaped()}
    return urdf, {name: (body.vertices, body.faces) for name, body in bodies.items()}


def _poses(
    motion: RobotMotion, links: Mapping[str, Triangles], time: Float[np.ndarray, " m"]
) -> tuple[Float[np.ndarray, "m k 4"], Float[np.ndarray, "m k 3"]]:
    quaternions, positions = zip(*(motion.at(name, time) for name in links), strict=True)
    return np.stack(quaternions, axis=1), np.stack(positions, axis=1)


def _layer(robot: Robot, log: Path, found: Contacts, time: Float[np.ndarray, " m"]) -> RobotLayer:
    """Return the layer of the robot's links and sensors."""
    if found.origins is None:
        raise InputError("found must have origins: only contacts of a robot are shown so.")
    motion, links = _motion(robot, log)
    sensors, rates = dict[str, np.ndarray](), dict[str, float]()
    for k, origin in enumerate(found.origins.among):
        own: Contacts = found[np.flatnonzero(found.origins.index == k)]
        stamps: np.ndarray = own.time[np.isfinite(own.time)]
        span = float(np.ptp(stamps)) if len(stamps) > 1 else 0.0
        rates[origin.sensor] = (len(np.unique(own.sample)) - 1) / span if span > 0 else 0.0
        force = np.full(len(time), np.nan)
        force[_picture_of(stamps, time)] = 0.0
        shown = np.flatnonzero(own.answered & np.isfinite(own.time))
        picture = _picture_of(own.time[shown], time)
        np.fmax.at(force, picture, np.linalg.norm(own.force[shown], axis=1))
        sensors[origin.sensor] = force
    return RobotLayer(links, *_poses(motion, links, time), sensors, rates)
