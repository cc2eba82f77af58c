"""Propose a commented rig, guessed from a log and a body, with remarks on each guess."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from palpate.errors import InputError
from palpate.files.logs import LogContents, contents
from palpate.files.logs.decoding import role
from palpate.files.models import printable
from palpate.files.units import near
from palpate.setup.body import GivenBody
from palpate.setup.built import Guess
from palpate.setup.kinds import KINDS
from palpate.setup.rig import check_rig
from palpate.setup.setup import SensorKind

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
    """A proposed rig as `text`, the words for its sensor, why it was guessed, and remarks to check."""

    text: str
    called: str
    why: str
    remarks: tuple[str, ...]


def guess_sensor(
    log: Path,
    body: GivenBody | None = None,
    *,
    sensor: str | None = None,
    topic: str | None = None,
    rate: float | None = None,
    poses: Path | None = None,
) -> tuple[SensorKind, Guess] | None:
    """Return the first kind of sensor that a log looks like, and the guess; None if it looks like no kind.

    Args:
        log: a log of any sensor.
        body: the body that is touched.
        sensor: name of the only kind to try; None: all.
        topic: the only topic of its role to read; None: all.
        rate: [Hz] of the samples of a table.
        poses: second table, with the sensor's poses.

    Raises:
        InputError: the file is no log, the topic does not exist or has no readings, a rate is given for
            messages, or a second table for images, or that has no poses, or units are unknown or contradict each other.
    """
    there = _only(contents(log), topic)
    if rate is not None:
        if there.topics:
            hint = "Leave --rate out: it is for tables."
            raise InputError("is a log of messages, which have stamps.", where=str(log), hint=hint)
        there = replace(there, stated=replace(there.stated, rate=rate))
    if poses is not None:
        if not there.names and not there.topics:
            what = "holds images, to which poses of a table cannot be joined."
            raise InputError(what, where=str(log), hint="Leave --poses out.")
        there = replace(there, poses=contents(poses))
    for kind in KINDS.values():
        if sensor in (None, kind.name) and (guess := kind.guess(log, there, body)) is not None:
            return kind, guess
    return None


def _only(there: LogContents, name: str | None) -> LogContents:
    """Return the contents without other topics of the named topic's role; raise InputError without it."""
    if name is None:
        return there
    if not there.topics:
        raise InputError("is a table, and has no topics.", where=str(there.path), hint="Leave --topic out.")
    named = next((topic for topic in there.topics if topic.name == name), None)
    if named is None:
        hint = near(name, [topic.name for topic in there.topics])
        raise InputError(f"there is no topic {name!r}.", where=str(there.path), hint=hint)
    if role(named.kind) not in ("wrench", "array"):
        what = f"topic {name!r} holds {named.kind}, which cannot be a sensor's readings."
        hint = "Wrenches are geometry_msgs/Wrench or WrenchStamped; voltages and frames are arrays or images."
        raise InputError(what, where=str(there.path), hint=hint)
    kept = [topic for topic in there.topics if topic.name == name or role(topic.kind) != role(named.kind)]
    return replace(there, topics=tuple(kept))


def propose_rig(
    log: Path,
    body: GivenBody | None,
    folder: Path,
    *,
    sensor: str | None = None,
    topic: str | None = None,
    rate: float | None = None,
    poses: Path | None = None,
) -> Proposal:
    """Return a rig guessed from a log and a body, for a file rig.toml in `folder`.

    Args:
        log: a log of any sensor.
        body: the body that is touched; None: the rig gets a sphere to be replaced.
        folder: where relative paths start.
        sensor: name of the only kind to try; None: all.
        topic: the only topic of its role to read; None: all.
        rate: [Hz] of the samples of a table.
        poses: second table, with the sensor's poses.

    Raises:
        InputError: as `guess_sensor`; nothing in the log looks like a sensor, its times are not known, or the rig would
            not load.
    """
    body = None if body is None else replace(body, folder=folder)
    found = guess_sensor(log, body, sensor=sensor, topic=topic, rate=rate, poses=poses)
    if found is None:
        what = f"is not a log of any of {', '.join(kind.called for kind in KINDS.values())}: {_listed(log)}."
        hint = "Name columns time, fx, fy, fz, tx, ty, tz (arrays by numpy.savez), or write the rig by hand."
        raise InputError(what, where=str(log), hint=hint)
    kind, guess = found
    if guess.lacking:
        hint = "Add --rate HZ if the samples are evenly spaced in time."
        raise InputError(f"{guess.lacking}.", where=str(log), hint=hint)
    text = "".join(_parts(log, body, kind, guess))
    _require_sound(text, folder / "rig.toml")
    written = contents(log).written
    form, of_body = [f"the table is {written}"] if written else [], [] if body is None else body.remarks(guess.frame)
    return Proposal(text, kind.called, guess.why, (*form, *guess.remarks, *of_body))


def _listed(log: Path) -> str:
    """Return the first names of a log's columns and topics for a sentence."""
    there = contents(log)
    arrays = (f"{name} (rows of {' x '.join(map(str, s))})" if s else name for name, s in there.names.items())
    names = [*arrays, *(f"{topic.name} ({topic.kind})" for topic in there.topics)]
    return ", ".join(names[:12]) + (", ..." if len(names) > 12 else "") if names else "it is empty"


def _parts(log: Path, body: GivenBody | None, kind: SensorKind, guess: Guess) -> Iterator[str]:
    of = printable(log.name) + ("" if body is None else f" and {printable(body.path.name)}")
    yield f"# A Palpate rig, guessed by `palpate rig new` from {of}. Check every line; lengths are metres.\n"
    yield f"# Taken for {kind.called}: {printable(guess.why)}.\n"
    if body is not None:
        yield body.text(guess.frame)
    elif kind.needs_surface:
        yield _NO_SURFACE
    yield guess.text
    yield _REST
    if kind.needs_surface:
        yield _ESTIMATE


def _require_sound(text: str, path: Path) -> None:
    """Raise InputError if the text would not load as a rig, as with odd names of files or columns."""
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as problem:
        what = f"a name of a column or of the mesh cannot be written in a rig ({problem})."
        raise InputError(what, where=str(path), hint="Rename it.") from problem
    check_rig(table, path)
