"""A commented rig to start from, guessed from a log and a mesh; what was guessed is said."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from palpate.errors import InputError
from palpate.io.logs import contents
from palpate.io.models import printable
from palpate.io.rig.guess import mesh_size, quoted
from palpate.io.rig.kind import Guess, SensorKind
from palpate.io.rig.kinds import KINDS
from palpate.io.rig.rig import check_rig

__all__ = ["Proposal", "guess_sensor", "propose_rig"]

_SURFACE = """\
[surface]
mesh = {mesh}
unit = "{unit}"                        # of the mesh file: m, cm, mm, um, in; it makes the surface {size:.4g} mm across
crease = 30                          # degrees: normals are smooth within it, split across it; 0 is faceted
# Where the surface sits in the sensor's frame, from a drawing; `palpate calibrate mounting` makes it right.
pose = {{ xyz = [0, 0, 0], quaternion_xyzw = [0, 0, 0, 1] }}
# region = {{ box = [[-0.01, -0.01, 0], [0.01, 0.01, 0.02]] }}   # m: if only a part of the mesh can be touched

"""
_NO_SURFACE = """\
[surface]                            # no mesh was given: say what is touched, lengths in m
kind = "sphere"                      # or mesh, plane, cylinder, elliptic_cylinder, ellipsoid, paraboloid, superquadric
radius = 0.01

"""
_REST = """
# [filter]                           # `palpate inspect LOG --spectrum spectrum.html` proposes one
# kind = "butterworth"               # or "kalman" (q, r), or "zero_phase" for logs
# cutoff = 10                        # Hz
"""
_ESTIMATE = """
[estimate]
method = "soft_finger"
friction = 1.0                       # bounds the tangent of the angle between force and normal
torsion = 0.005                      # m: bounds |torque about the normal| / |normal force|
# contact = { on = 0.5, off = 0.3 }  # N; without it both follow from the noise
# tare = 1.0                         # s: the log starts so long unloaded, and its mean is taken off
"""


@dataclass(frozen=True)
class Proposal:
    """A rig's text, which sensor it is for and why, and what its reader should check."""

    text: str
    called: str
    why: str
    remarks: tuple[str, ...]


def guess_sensor(
    log: Path, mesh: Path | None = None, sensor: str | None = None, rate: float | None = None
) -> tuple[SensorKind, Guess] | None:
    """The first kind of sensor that a log looks like; None where it looks like none. `rate` [Hz], where it is known.

    Raises:
        InputError: it is no log, or its names contradict each other.
    """
    there = contents(log)
    if rate is not None:
        there = replace(there, stated=replace(there.stated, rate=rate))
    for kind in KINDS.values():
        if sensor in (None, kind.name) and (guess := kind.guess(log, there, mesh)) is not None:
            return kind, guess
    return None


def propose_rig(
    log: Path, mesh: Path | None, folder: Path, sensor: str | None = None, rate: float | None = None
) -> Proposal:
    """Guess a rig that will stand in `folder`.

    Raises:
        InputError: the log cannot be read, or nothing in it looks like a sensor, or the rig would not load.
    """
    found = guess_sensor(log, mesh, sensor, rate)
    if found is None:
        raise InputError(
            f"looks like none of {', '.join(kind.called for kind in KINDS.values())}: {_listed(log)}.",
            where=str(log),
            hint="Name columns time, fx, fy, fz, tx, ty, tz, or write the rig by hand.",
        )
    kind, guess = found
    if guess.lacking:
        raise InputError(
            f"{guess.lacking}.", where=str(log), hint="Add --rate HZ, of the samples, if they come evenly."
        )
    text = "".join(_parts(log, mesh, folder, kind, guess))
    _require_sound(text, folder / "rig.toml")
    written = contents(log).written
    remarks = [*([f"the table is {written}"] if written else []), *guess.remarks]
    if mesh is not None and (unit := mesh_size(mesh))[0] != "m":
        remarks.append(f"the mesh is taken to be in {unit[0]}, which makes it {unit[1] * 1e3:.4g} mm across")
    return Proposal(text, kind.called, guess.why, tuple(remarks))


def _listed(log: Path) -> str:
    """What it has, in short."""
    there = contents(log)
    names = [*there.names, *(f"{topic.name} ({topic.kind})" for topic in there.topics)]
    return ", ".join(names[:12]) + (", ..." if len(names) > 12 else "") if names else "it is empty"


def _parts(log: Path, mesh: Path | None, folder: Path, kind: SensorKind, guess: Guess) -> Iterator[str]:
    of = printable(log.name) + ("" if mesh is None else f" and {printable(mesh.name)}")
    yield f"# A Palpate rig, guessed by `palpate rig new` from {of}. Check every line; lengths are metres.\n"
    yield f"# Taken for {kind.called}: {printable(guess.why)}.\n"
    if mesh is not None:
        unit, size = mesh_size(mesh)
        path = Path(os.path.relpath(mesh.resolve(), folder.resolve())).as_posix()
        yield _SURFACE.format(mesh=quoted(path), unit=unit, size=1e3 * size)
    elif kind.needs_surface:
        yield _NO_SURFACE
    yield guess.text
    yield _REST
    if kind.needs_surface:
        yield _ESTIMATE


def _require_sound(text: str, path: Path) -> None:
    """Before it is written: odd names of files or columns must not make a rig that does not load."""
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as problem:
        raise InputError(
            f"a name of a column or of the mesh cannot stand in a rig ({problem}).", where=str(path), hint="Rename it."
        ) from problem
    check_rig(table, path)
