"""Does a log look like wrenches of a six-axis force/torque sensor, and how are they read?"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.contact.plausibility import lines_of_action
from palpate.errors import InputError
from palpate.io.logs import LogContents, read_recording
from palpate.io.logs.guess import guess_time, guess_wrench
from palpate.io.logs.layout import Layout
from palpate.io.rig.kind import Guess
from palpate.io.rig.words import mesh_size, orientation_table, pose_table, quoted, time_table, time_unit, topics_of
from palpate.io.units import TORQUE_UNITS
from palpate.sensors.noise import estimate_noise

__all__ = ["guess_force_torque"]

_LEAST_NOISE = 1e-6  # N, N m: a log that never changes does not make a noise of nothing
_TEXT = """\
[force_torque]
{wrench}
units = {{ force = "N", torque = "{torque_unit}" }}{torque_remark}
axes = ["x", "y", "z"]               # which logged axis is the sensor's x, y, z; "-x" flips
# left_handed = true                 # if axes has to mirror: a driver that swaps two axes, or reports the reaction
frame = "sensor"                     # or "base", which needs an orientation
noise = {{ force = {force_noise}, torque = {torque_noise} }}   # of one reading: from the log's own steps
# range = {{ force = 200, torque = 10 }}     # of the sensor: a reading at it is saturated
# payload = "payload.toml"           # written by: palpate calibrate payload

{orientation}"""


def guess_force_torque(log: Path, contents: LogContents, mesh: Path | None) -> Guess | None:
    """Columns or a topic of forces and torques."""
    found = _topics_of(contents) if contents.topics else _columns_of(log, contents)
    if found is None:
        return None
    wrenches = read_recording(log, found.layout).wrenches()
    size = None if mesh is None else mesh_size(mesh)[1]
    torque_unit = "N m" if size is None else _torque_unit(wrenches, size)
    noise = estimate_noise(wrenches)
    noise = np.ones(6) if noise is None else noise * np.repeat([1.0, TORQUE_UNITS[torque_unit]], 3)
    noise = np.maximum(noise, _LEAST_NOISE)
    text = found.text.format(
        torque_unit=torque_unit,
        torque_remark="" if torque_unit == "N m" else "   # guessed: as N m they do not fit the body",
        force_noise=f"{float(noise[:3].max()):.2g}",
        torque_noise=f"{float(noise[3:].max()):.2g}",
    )
    remarks = found.remarks
    if torque_unit != "N m":
        remarks = (*remarks, "the torques only fit the body if they are N mm: check units.torque")
    return replace(found, text=text, remarks=remarks)


def _filled(wrench: str, orientation: str, time: str = "") -> str:
    """The text with its last fields left open, so that names with braces survive."""
    own = [part.replace("{", "{{").replace("}", "}}") for part in (wrench, orientation, time)]
    text = _TEXT.replace("{wrench}", own[0]).replace("{orientation}", own[1])
    return own[2] + text


def _topics_of(contents: LogContents) -> Guess | None:
    wrenches, poses = topics_of(contents, "wrench"), topics_of(contents, "pose")
    if not wrenches:
        return None
    remarks = [
        f"{len(names)} topics hold {what}: {', '.join(names)}; the first is taken"
        for what, names in (("wrenches", wrenches), ("poses", poses))
        if len(names) > 1
    ]
    layout = Layout(wrench_topic=wrenches[0], orientation_topic=poses[0] if poses else None)
    why = f"topic {wrenches[0]!r} holds forces and torques"
    return Guess(why, layout, _filled(f"topic = {quoted(wrenches[0])}", pose_table(poses)), tuple(remarks))


def _columns_of(log: Path, contents: LogContents) -> Guess | None:
    names = list(contents.names)
    wrench, time = guess_wrench(names), guess_time(names)
    if wrench is None:
        return None
    if time is None:
        raise InputError(
            f"no columns look like time: {', '.join(names[:12])}.",
            where=str(log),
            hint="Name them time, fx, fy, fz, tx, ty, tz, or write the rig by hand.",
        )
    layout = Layout(time=time, wrench=wrench)
    layout = replace(layout, time_unit=time_unit(read_recording(log, layout).time))
    orientation, remarks = orientation_table(names)
    text = _filled(f"columns = {quoted(wrench)}", orientation, time_table(time, layout.time_unit))
    return Guess(f"columns {', '.join(wrench)} look like forces and torques", layout, text, tuple(remarks))


def _torque_unit(wrenches: np.ndarray, size: float) -> str:
    """N mm if N m puts the lines of action off the body, and N mm does not; the bias is taken off first."""
    free = wrenches - np.nanmedian(wrenches, axis=0)
    for unit in ("N m", "N mm"):
        scaled = free * np.repeat([1.0, TORQUE_UNITS[unit]], 3)
        if not lines_of_action(scaled, np.zeros(3), 10 * size).doubt:  # the mounting is not known yet
            return unit
    return "N m"
