"""`palpate calibrate payload`: what hangs on the sensor, and the sensor's zero, from free motion."""

from __future__ import annotations

import re
from typing import Annotated

import numpy as np
from tyro.conf import FlagCreatePairsOff, arg

from palpate.calibration.payload import identify_payload
from palpate.calibration.poses import average_poses
from palpate.cli.console import lines, note, title
from palpate.cli.options import FileOption, Log, Output
from palpate.errors import InputError
from palpate.io.atomic import keep_inputs
from palpate.io.logs import read_recording
from palpate.io.logs.layout import Layout
from palpate.io.models import provenance, write_model
from palpate.io.models.payload import of_payload
from palpate.io.rig import load_rig
from palpate.sensors.force_torque import STANDARD_GRAVITY, Payload
from palpate.sensors.recording import ORIENTATION
from palpate.spatial.pose import rotation_from_quaternion

__all__ = ["calibrate_payload"]

_HINTS = {
    "base frame": 'frame = "base" under [force_torque] in the rig, or --base-frame here',
    "y and z swapped": 'axes = ["x", "z", "y"] and left_handed = true under [force_torque] in the rig',
    "sign reversed": 'axes = ["-x", "-y", "-z"] and left_handed = true under [force_torque] in the rig',
    "inverse rotations": "the log must hold the sensor in the base: negate qx, qy, qz",
}


def calibrate_payload(
    log: Log,
    /,
    output: Output,
    rig: FileOption = None,
    gravity: Annotated[str, arg(metavar="X,Y,Z")] = "free",
    magnitude: Annotated[float, arg(metavar="X")] = STANDARD_GRAVITY,
    base_frame: Annotated[bool, FlagCreatePairsOff] = False,
) -> None:
    """Identify weight, centre of mass and biases from a log in which nothing is touched.

    Hold some seven poses that differ about more than one axis. Stretches at rest are averaged; where there are none,
    all samples are used.

    Args:
        log: CSV or Parquet with time,fx,fy,fz,tx,ty,tz,qx,qy,qz,qw (sensor in base); MCAP or a ROS bag with
            WrenchStamped and PoseStamped; or as the rig says.
        output: payload.toml to write.
        rig: TOML that says where the log keeps what.
        gravity: its direction in the base as x,y,z (0,0,-1 when z points up), or free: identified too.
        magnitude: of gravity [m/s^2].
        base_frame: the wrenches are written in the base frame (a rig says it as frame = "base").
    """
    setup = None if rig is None else load_rig(rig)
    keep_inputs(output, (log, rig, None if setup is None else setup.files().get("mesh")))
    layout = Layout() if setup is None else setup.layout("force_torque")
    recording = read_recording(log, layout)
    if ORIENTATION not in recording.channels:
        raise InputError(
            "the log has no orientation, without which the weight cannot be told from the bias.",
            where=str(log),
            hint="A table needs columns qx, qy, qz, qw (sensor in base), messages a topic of poses or /tf; the rig's "
            "[orientation] names them (columns, topic, base and sensor).",
        )
    rotations = rotation_from_quaternion(recording.channels[ORIENTATION])
    wrenches, poses, counts = average_poses(recording.wrenches(), rotations)
    averaged = bool(counts.max() > 1)
    record = provenance({"log": log, "rig": rig}, {"gravity": gravity})
    payload = identify_payload(
        wrenches,
        poses,
        gravity=_direction(gravity),
        magnitude=magnitude,
        hypothesis="base frame" if base_frame or layout.frame == "base" else "as is",
        of="poses" if averaged else "samples",
        provenance=record,
    )
    write_model(output, payload)
    title(f"{log} -> {output}")
    used = f"{len(counts)} poses at rest of {int(counts.sum()):,} samples" if averaged else "each on its own"
    lines([("samples", f"{len(recording):,}; used: {used}"), *of_payload(payload)])
    note([*recording.notes, *payload.notes])
    note(_hints(payload), kind="hint")


def _hints(payload: Payload) -> list[str]:
    """What to write where, for each explanation that the calibration names."""
    named = {name for text in payload.notes for name in re.findall(r"hypothesis='([^']*)'", text)}
    return [hint for name, hint in _HINTS.items() if any(name in hypothesis for hypothesis in named)]


def _direction(text: str) -> np.ndarray | None:
    if text == "free":
        return None
    try:
        direction = np.array([float(part) for part in text.split(",")])
    except ValueError:
        direction = np.zeros(0)
    if direction.shape != (3,) or not direction.any():
        raise InputError(f"--gravity {text!r} is no direction.", hint="Write x,y,z, such as 0,0,-1, or free.")
    return direction
