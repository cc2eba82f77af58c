"""A commented rig to start from, guessed from a log and a mesh; what was guessed is said."""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from palpate.contact.plausibility import lines_of_action
from palpate.errors import InputError
from palpate.io.logs import contents, read_recording
from palpate.io.logs.decoding import role
from palpate.io.logs.guess import guess_orientation, guess_position, guess_time, guess_wrench
from palpate.io.logs.layout import ORIENTATION_COLUMNS, Layout
from palpate.io.models import printable
from palpate.io.rig.rig import check_rig
from palpate.io.units import TORQUE_UNITS
from palpate.sensors.noise import estimate_noise
from palpate.surfaces.mesh import UNITS, Mesh

__all__ = ["Proposal", "propose_rig"]

_PLAUSIBLE = (2e-3, 5.0)  # m: from a fingertip to a robot's link
_LEAST_NOISE = 1e-6  # N, N m: a log that never changes does not make a noise of nothing
_EPOCHS = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))  # times of day above these cannot be seconds

_TEXT = """\
# A Palpate rig, guessed by `palpate rig new` from {log} and {mesh_name}. Check every line; lengths are metres.
[surface]
mesh = {mesh}
unit = "{unit}"                        # of the mesh file: m, cm, mm, um, in{unit_remark}
crease = 30                          # degrees: normals are smooth within it, split across it; 0 is faceted
# Where the surface sits in the sensor's frame, from a drawing; `palpate calibrate mounting` makes it right.
pose = {{ xyz = [0, 0, 0], quaternion_xyzw = [0, 0, 0, 1] }}
# region = {{ box = [[-0.01, -0.01, 0], [0.01, 0.01, 0.02]] }}   # m: if only a part of the mesh can be touched

{time}[force_torque]
{wrench}
units = {{ force = "N", torque = "{torque_unit}" }}{torque_remark}
axes = ["x", "y", "z"]               # which logged axis is the sensor's x, y, z; "-x" flips
# left_handed = true                 # if axes has to mirror: a driver that swaps two axes, or reports the reaction
frame = "sensor"                     # or "base", which needs an orientation
noise = {{ force = {force_noise}, torque = {torque_noise} }}   # of one reading: from the log's own steps
# range = {{ force = 200, torque = 10 }}     # of the sensor: a reading at it is saturated
# payload = "payload.toml"           # written by: palpate calibrate payload

{orientation}
# [filter]                           # `palpate inspect LOG --spectrum spectrum.html` proposes one
# kind = "butterworth"               # or "kalman" (q, r), or "zero_phase" for logs
# cutoff = 10                        # Hz

[estimate]
method = "soft_finger"
friction = 1.0                       # bounds the tangent of the angle between force and normal
torsion = 0.005                      # m: bounds |torque about the normal| / |normal force|
# contact = {{ on = 0.5, off = 0.3 }}  # N; without it both follow from the noise
# tare = 1.0                         # s: the log starts so long unloaded, and its mean is taken off
"""


@dataclass(frozen=True)
class Proposal:
    """A rig's text, and what its reader should check."""

    text: str
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class _Found:
    """How to read the log, and what stands in the rig of it: [time], the wrench's line, [orientation]."""

    layout: Layout
    time: str
    wrench: str
    orientation: str
    remarks: tuple[str, ...]


def propose_rig(log: Path, mesh: Path, folder: Path) -> Proposal:
    """Guess a rig that will stand in `folder`.

    Raises:
        InputError: the log cannot be read, or nothing in it looks like force and torque, or the rig would not load.
    """
    found = _topics_of(log) or _columns_of(log)
    unit, size = _mesh_unit(mesh)
    recording = read_recording(log, found.layout)
    wrenches = recording.wrenches()
    noise = estimate_noise(wrenches)
    torque_unit = _torque_unit(wrenches, size)
    noise = np.ones(6) if noise is None else noise * np.repeat([1.0, TORQUE_UNITS[torque_unit]], 3)
    noise = np.maximum(noise, _LEAST_NOISE)
    remarks = [*found.remarks, *recording.notes]
    if torque_unit != "N m":
        remarks.append("the torques only fit the body if they are N mm: check units.torque")
    if unit != "m":
        remarks.append(f"the mesh is taken to be in {unit}, which makes it {size * 1e3:.4g} mm across")
    text = _TEXT.format(
        log=printable(log.name),
        mesh_name=printable(mesh.name),
        mesh=_toml(Path(os.path.relpath(mesh.resolve(), folder.resolve())).as_posix()),
        unit=unit,
        unit_remark=f"; it makes the surface {size * 1e3:.4g} mm across",
        time=found.time,
        wrench=found.wrench,
        torque_unit=torque_unit,
        torque_remark="" if torque_unit == "N m" else "   # guessed: as N m they do not fit the body",
        force_noise=f"{float(noise[:3].max()):.2g}",
        torque_noise=f"{float(noise[3:].max()):.2g}",
        orientation=found.orientation,
    )
    _require_sound(text, folder / "rig.toml")
    return Proposal(text, tuple(remarks))


def _require_sound(text: str, path: Path) -> None:
    """Before it is written: odd names of files or columns must not make a rig that does not load."""
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as problem:
        raise InputError(
            f"a name of a column or of the mesh cannot stand in a rig ({problem}).", where=str(path), mend="Rename it."
        ) from problem
    check_rig(table, path)


def _mesh_unit(path: Path) -> tuple[str, float]:
    """The unit that makes the body as large as a body is, millimetres before others, and its size [m]."""
    raw = Mesh.load(path, unit="m").size
    for unit in ("mm", "m", "cm", "um"):
        if _PLAUSIBLE[0] <= raw * UNITS[unit] <= (2.0 if unit == "mm" else _PLAUSIBLE[1]):
            return unit, raw * UNITS[unit]
    return "m", raw


def _topics_of(log: Path) -> _Found | None:
    """Of a log that has topics; None where it has columns."""
    known = contents(log).topics
    if not known:
        return None
    wrenches, poses = (
        [topic.name for topic in known if topic.count and role(topic.kind) == wanted] for wanted in ("wrench", "pose")
    )
    if not wrenches:
        raise InputError("no topic holds wrenches.", where=str(log), mend="`palpate inspect` lists the topics.")
    several = [
        f"{len(names)} topics hold {what}: {', '.join(names)}; the first is taken"
        for what, names in (("wrenches", wrenches), ("poses", poses))
        if len(names) > 1
    ]
    lines = ["[orientation]", f"topic = {_toml(poses[0] if poses else '/pose')}   # poses of the sensor in the base"]
    lines.append("offset = 0.0                         # s added to their stamps; written by `palpate calibrate clock`")
    orientation = "".join(f"{'' if poses else '# '}{line}\n" for line in lines)
    layout = Layout(wrench_topic=wrenches[0], orientation_topic=poses[0] if poses else None)
    return _Found(layout, "", f"topic = {_toml(wrenches[0])}", orientation, tuple(several))


def _columns_of(log: Path) -> _Found:
    names = list(contents(log).names)
    wrench, time = guess_wrench(names), guess_time(names)
    if wrench is None or time is None:
        what = "time" if wrench is not None else "the three forces and three torques"
        raise InputError(
            f"no columns look like {what}: {', '.join(names[:12])}.",
            where=str(log),
            mend="Name them time, fx, fy, fz, tx, ty, tz, or write the rig by hand.",
        )
    layout = Layout(time=time, wrench=wrench)
    layout = replace(layout, time_unit=_time_unit(read_recording(log, layout).time))
    text = f'[time]\ncolumn = {_toml(time)}\nunit = "{layout.time_unit}"                         # s, ms, us, ns\n\n'
    orientation, said = _orientation(names)
    return _Found(layout, text, f"columns = {_toml(wrench)}", orientation, tuple(said))


def _time_unit(time: np.ndarray) -> str:
    largest = np.nanmax(np.abs(time), initial=0.0)
    return next((unit for limit, unit in _EPOCHS if largest > limit), "s")


def _torque_unit(wrenches: np.ndarray, size: float) -> str:
    """N mm if N m puts the lines of action off the body, and N mm does not; the bias is taken off first."""
    free = wrenches - np.nanmedian(wrenches, axis=0)
    for unit in ("N m", "N mm"):
        scaled = free * np.repeat([1.0, TORQUE_UNITS[unit]], 3)
        if not lines_of_action(scaled, np.zeros(3), 10 * size).doubt:  # the mounting is not known yet
            return unit
    return "N m"


def _orientation(names: Sequence[str]) -> tuple[str, list[str]]:
    quaternion, position = guess_orientation(names), guess_position(names)
    if quaternion is None:
        return '# [orientation]\n# columns = ["qx", "qy", "qz", "qw"]   # sensor in base: a payload needs it\n', []
    lines = ["[orientation]", f"columns = {_toml(quaternion)}   # sensor in base: x, y, z, w"]
    if position is not None:
        lines.append(f"position = {_toml(position)}   # sensor in base [m]: only for --frame base")
    if quaternion == ORIENTATION_COLUMNS:
        return "\n".join(lines) + "\n", []
    remark = f"{quaternion[0]!r} ... may be the sensor's orientation: it stands in the rig as a comment"
    return "\n".join(f"# {line}" for line in lines) + "\n", [remark]


def _toml(value: str | Sequence[str]) -> str:
    """Text or a list of texts; JSON's strings are TOML's, but for DEL."""
    return json.dumps(value if isinstance(value, str) else list(value), ensure_ascii=False).replace("\x7f", "\\u007f")
