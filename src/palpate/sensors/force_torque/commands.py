"""`palpate calibrate payload`: identify the payload and the sensor's bias from free motion."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from tyro.conf import FlagCreatePairsOff, arg

from palpate.console.calibration import Calibration, CalibrationResult
from palpate.console.options import FileOption, Log, Output
from palpate.errors import InputError
from palpate.files.logs import read_recording
from palpate.files.logs.layout import LogLayout
from palpate.sensors.force_torque.calibrate import identify_payload
from palpate.sensors.force_torque.files import of_payload
from palpate.sensors.force_torque.poses import average_poses
from palpate.signals.payload import STANDARD_GRAVITY, Payload
from palpate.signals.recording import ORIENTATION
from palpate.spatial.pose import rotation_from_quaternion

__all__ = ["CalibratePayload"]

_HINTS = {
    "base frame": 'frame = "base" under [force_torque] in the rig, or --base-frame here',
    "y and z swapped": 'axes = ["x", "z", "y"] and left_handed = true under [force_torque] in the rig',
    "sign reversed": 'axes = ["-x", "-y", "-z"] and left_handed = true under [force_torque] in the rig',
    "inverse rotations": "the log must hold the sensor in the base: negate qx, qy, qz",
}


@dataclass(frozen=True)
class CalibratePayload(Calibration):
    """Identify mass, center of mass and bias: gravity compensation.

    Hold some seven poses that differ about more than one axis. Stretches at rest are averaged; where there are none,
    all samples are used.

    Args:
        log: CSV or Parquet with time,fx,fy,fz,tx,ty,tz,qx,qy,qz,qw (sensor in base); MCAP or a ROS bag with
            WrenchStamped and PoseStamped; or as the rig says.
        output: payload.toml to write.
        rig: TOML with the columns, topics and units of the log.
        gravity: its direction in the base as x,y,z (0,0,-1 when z points up), or free: identified too.
        magnitude: of gravity [m/s^2].
        base_frame: the wrenches are written in the base frame (a rig says it as frame = "base").
    """

    replaces = "force_torque.payload"
    log: Log
    output: Output
    rig: FileOption = None
    gravity: Annotated[str, arg(metavar="X,Y,Z")] = "free"
    magnitude: Annotated[float, arg(metavar="X")] = STANDARD_GRAVITY
    base_frame: Annotated[bool, FlagCreatePairsOff] = False

    def identify(self) -> CalibrationResult:
        """Return a `CalibrationResult` with the payload that is fitted to the averages of poses at rest.

        Raises:
            InputError: rig or log cannot be read, the log has no orientation or no complete sample, `gravity` is not a
                direction, or `magnitude` is not positive.
            NotIdentifiable: the poses do not separate the payload's parameters.
        """
        layout = LogLayout() if self.rig is None else self.stated.layout("force_torque")
        recording = read_recording(self.log, layout)
        if ORIENTATION not in recording.channels:
            raise InputError(
                "the log has no orientation, and without it the weight cannot be told from the bias.",
                where=str(self.log),
                hint="Add columns qx, qy, qz, qw (sensor in base) to a table, or a topic of poses or /tf to messages; "
                "name them in the rig's [orientation] (columns, topic, base and sensor).",
            )
        rotations = rotation_from_quaternion(recording.channels[ORIENTATION])
        wrenches, poses, counts = average_poses(recording.wrenches(), rotations)
        averaged = bool(counts.max() > 1)
        payload = identify_payload(
            wrenches,
            poses,
            gravity=_direction(self.gravity),
            magnitude=self.magnitude,
            hypothesis="base frame" if self.base_frame or layout.frame == "base" else "as is",
            of="poses" if averaged else "samples",
            provenance=self.record(gravity=self.gravity),
        )
        used = f"{len(counts)} poses at rest of {int(counts.sum()):,} samples" if averaged else "each on its own"
        return CalibrationResult(
            [
                ("samples", f"{len(recording):,}; used: {used}"),
                *of_payload(payload),
                ("left out", payload.provenance["left_out"]),
            ],
            payload,
            notes=[*recording.notes, *payload.notes],
            hints=_hints(payload),
        )


def _hints(payload: Payload) -> list[str]:
    """Return the rig's settings that correct the log for the hypotheses that the payload's notes name."""
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
        raise InputError(f"--gravity must be a direction, not {text!r}.", hint="Write x,y,z, like 0,0,-1, or free.")
    return direction
