"""Prepare the page of a robot: its links and the contacts of all sensors in the base, picture by picture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from palpate.contact.contacts import Contacts
from palpate.errors import InputError
from palpate.files.logs.robot_motion import RobotMotion
from palpate.setup.robot import Robot
from palpate.setup.robot_pipeline import RobotPipeline
from palpate.viewer.robot_layer import RobotLayer, Triangles
from palpate.viewer.scene import Scene, no_contacts, prepare

PICTURES = 30.0  # per second
LARGEST = 10  # factor by which ellipses are drawn larger: beside a robot those of many are small


def robot_scene(robot: Robot, log: Path, sensors: str | None = None) -> tuple[Scene, list[str]]:
    """Estimate the log of a robot, and return its scene in the base, and notes on it.

    Args:
        robot: the robot.
        log: file of the log.
        sensors: names of sensors, with commas between; None: all.

    Raises:
        InputError: the log or the rig cannot be used, or states no motion of the links.
    """
    pipeline = RobotPipeline(robot, log, "base", None if sensors is None else tuple(sensors.split(",")))
    found = Contacts.joined(list(pipeline.stream()))
    time = _pictures(found)
    contacts, layer = on_pictures(found, time), _layer(robot, log, found, time)
    scene = prepare(None, contacts, log.name, (layer,))
    scene = replace(scene, magnification=min(scene.magnification, LARGEST))
    return scene, [*pipeline.warnings(), *pipeline.notes()]


def _pictures(found: Contacts) -> Float[np.ndarray, " m"]:
    """Return the times of the pictures [s], evenly spaced."""
    known = found.time[np.isfinite(found.time)]
    if not len(known):
        raise InputError("no sample has a time, so nothing can be shown in turn.")
    return np.arange(known.min(), known.max() + 1 / PICTURES, 1 / PICTURES)


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


def _layer(robot: Robot, log: Path, found: Contacts, time: Float[np.ndarray, " m"]) -> RobotLayer:
    """Return the layer of the robot's links and sensors."""
    urdf, table = robot.urdf, robot.table
    if urdf is None or found.origins is None:
        raise InputError("a robot is drawn from its URDF, and the rig names none.", where=str(robot.path))
    links = dict[str, Triangles]()
    for name in urdf.shaped():
        body = urdf.body(name)
        links[name] = (body.vertices, body.faces)
    motion = RobotMotion.read(log, urdf, robot.base, list(links), joints=table.joints, max_gap=table.max_gap)
    poses = [motion.at(name, time) for name in links]
    sensors, rates = dict[str, np.ndarray](), dict[str, float]()
    for k, origin in enumerate(found.origins.among):
        own: Contacts = found[np.flatnonzero(found.origins.index == k)]
        stamps: np.ndarray = own.time[np.isfinite(own.time)]
        span = float(np.ptp(stamps)) if len(stamps) > 1 else 0.0
        rates[origin.sensor] = len(np.unique(own.sample)) / span if span > 0 else 0.0
        force = np.full(len(time), np.nan)
        force[_picture_of(stamps, time)] = 0.0
        shown = np.flatnonzero(own.answered & np.isfinite(own.time))
        picture = _picture_of(own.time[shown], time)
        np.fmax.at(force, picture, np.linalg.norm(own.force[shown], axis=1))
        sensors[origin.sensor] = force
    quaternions, positions = (np.stack([pose[i] for pose in poses], axis=1) for i in (0, 1))
    return RobotLayer(links, quaternions, positions, sensors, rates)
