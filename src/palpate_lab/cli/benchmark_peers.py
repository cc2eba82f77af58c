"""The benchmark's peers, and the input that each gets from a task; their mathematics is in `palpate_lab.peers`."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from palpate.spatial.pose import Pose, rotation_from_quaternion
from palpate.surfaces.mesh import Mesh
from palpate.surfaces.quadric import EllipticCylinder
from palpate_lab.benchmark.files import Task
from palpate_lab.cli.benchmark_entrants import Entrant, Prepare, live_entrant
from palpate_lab.peers import skin_peers
from palpate_lab.peers.image_peers import nearest_image, shrunk
from palpate_lab.peers.to_wrenches import contact_wrenches, linear_map, payload_and_bias
from palpate_lab.peers.wrench_peers import WRENCH_PEERS, Answer

TOUCHED = 0.5  # N: from which a log's wrench is one
WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")
PRESSED = 0.3  # N: from which the bench's force counts
BENCH_REST = 1.5  # s of each of its runs

ToWrench = Callable[[np.ndarray], np.ndarray]  # a reading to the wrench (6,) of what touches, in the body's frame
SKIN_PEERS = {
    "centre of all taxels": skin_peers.all_taxels,
    "patches of taxels": skin_peers.patches,
    "patches, minimum norm of the wrench": skin_peers.patches_and_wrench,
}


def peers() -> tuple[Entrant, ...]:
    """Return all peers, a tuple of `Entrant`; each is called with one reading after the other."""
    wrenches = ((name, partial(_on_wrenches, made)) for name, made in WRENCH_PEERS.items())
    skins = ((name, partial(_on_skin, made)) for name, made in SKIN_PEERS.items())
    every: list[tuple[str, Prepare]] = [*wrenches, *skins, ("calibration image most alike", _on_images)]
    return tuple(live_entrant(prepare, name) for name, prepare in every)


def _on_wrenches(made: Callable[[Mesh], Answer], task: Task) -> Callable[[np.ndarray], Any] | None:
    """Prepare a peer that takes wrenches; logs are turned into wrenches by plain least squares first."""
    if task.kind not in _TO_WRENCH:
        return None
    to_wrench, least = _TO_WRENCH[task.kind](task), 0.0 if task.kind == "wrench" else TOUCHED
    fingertip = task.kind == "load_cells"
    locate = made(_tip(task).mesh() if fingertip else task.mesh())

    def answer(reading: np.ndarray) -> np.ndarray | None:
        wrench = to_wrench(reading)
        return np.r_[locate(wrench), wrench[:3]] if np.linalg.norm(wrench[:3]) > least else None

    return answer


def _same(task: Task) -> ToWrench:
    del task
    return lambda reading: reading


def _compensated(task: Task) -> ToWrench:
    free = task.table("free_motion.csv")
    rotations = rotation_from_quaternion(np.column_stack([free[name] for name in ("qx", "qy", "qz", "qw")]))
    known = payload_and_bias(np.column_stack([free[name] for name in WRENCH]), rotations)
    back = _to_body(task)

    def to_wrench(reading: np.ndarray) -> np.ndarray:
        rotation = rotation_from_quaternion(reading[7:11])
        return back @ contact_wrenches(reading[None, 1:7], rotation[None], known)[0]

    return to_wrench


def _to_body(task: Task) -> np.ndarray:
    """Return the (6, 6) matrix that takes wrenches from the sensor's frame to the body's."""
    pose = task.facts["pose"]
    return np.linalg.inv(Pose.from_quaternion(pose["quaternion_xyzw"], pose["xyz"]).wrench_matrix())


def _from_cells(task: Task) -> ToWrench:
    bench = task.table("bench.csv")
    cells = [name for name in task.columns if name != "time"]
    volts, time = np.column_stack([bench[name] for name in cells]), bench["time"]
    runs = np.split(np.arange(len(time)), np.flatnonzero(np.diff(time) > 1.0) + 1)
    for rows in runs:
        volts[rows] -= volts[rows[time[rows] < time[rows[0]] + BENCH_REST]].mean(axis=0)
    force = np.column_stack([bench[f"ref_f{axis}"] for axis in "xyz"])
    centre = np.column_stack([bench[f"ref_{axis}"] for axis in "xyz"])
    pressed = np.linalg.norm(force, axis=1) > PRESSED
    points = _tip(task).project(centre[pressed])[0]
    matrix = linear_map(volts[pressed], points, force[pressed])
    zero = _at_rest(task)
    return lambda reading: (reading[1:] - zero[1:]) @ matrix


_TO_WRENCH: dict[str, Callable[[Task], ToWrench]] = {"wrench": _same, "log": _compensated, "load_cells": _from_cells}


def _tip(task: Task) -> EllipticCylinder:
    return EllipticCylinder(task.facts["a"], task.facts["b"], 0.016, upper=True)


def _at_rest(task: Task) -> np.ndarray:
    """Return the mean of the readings of the first seconds, which are untouched."""
    rows = np.stack(list(task.readings()))
    return rows[rows[:, 0] < 0.8 * task.facts["rest"]].mean(axis=0)


def _on_skin(
    made: Callable[[skin_peers.CellPlaces], skin_peers.Frames], task: Task
) -> Callable[[np.ndarray], Any] | None:
    if task.kind != "skin":
        return None
    cells, curve, zero = task.table("cells.csv"), task.table("response.csv"), _at_rest(task)
    centres, normals = (np.column_stack([cells[f"{n}{axis}"] for axis in "xyz"]) for n in ("", "n"))
    answer, back = made(skin_peers.CellPlaces(centres, normals)), _to_body(task)

    def answer_frame(reading: np.ndarray) -> np.ndarray:
        forces = np.interp(reading[7:] - zero[7:], curve["counts"], curve["force"])
        rows = answer(forces, back @ (reading[1:7] - zero[1:7]))
        return rows[np.argsort(-np.linalg.norm(rows[:, 3:], axis=1))[: task.most]]

    return answer_frame


def _on_images(task: Task) -> Callable[[np.ndarray], Any] | None:
    if task.kind != "marker_ring":
        return None
    known = task.table("calibration/truth.csv")
    seen = np.stack([shrunk(image) for image in task.images("calibration/frames")])
    angle = np.radians(known["angle_deg"])
    outward = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    along = np.column_stack([-np.sin(angle), np.cos(angle), 0.0 * angle])
    force = known["shear_n"][:, None] * along - known["force_n"][:, None] * outward
    return nearest_image(seen, np.column_stack([task.facts["radius"] * outward, force]))
