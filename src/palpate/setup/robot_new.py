"""Propose the rig of a robot: a sensor for each topic of a log that is a sensor's, on the links of a URDF."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from itertools import chain, count
from pathlib import Path

from palpate.errors import InputError
from palpate.files.logs import LogContents, contents
from palpate.files.logs.decoding import role
from palpate.files.logs.joints import JOINTS
from palpate.files.logs.opening import frames_named
from palpate.files.logs.topics import is_result
from palpate.files.logs.transforms import TREES
from palpate.files.messages import Topic
from palpate.files.models import printable
from palpate.files.urdf import Urdf
from palpate.setup.built import Guess
from palpate.setup.guess import quoted
from palpate.setup.kinds import KINDS
from palpate.setup.new import Proposal
from palpate.setup.setup import SensorKind

_LAST = re.compile(r"(.+?)(?:[/_](?:wrench|ft|skin|cells?|taxels?|tactile|data|raw|state|states|image|values?))*")
_TABLE = re.compile(r"(?m)^(# )?\[([a-z_]+)\]$")
_HEAD = """\
# A Palpate rig of a robot, guessed by `palpate rig new` from {log} and {urdf}.
# Check every line; lengths are metres.
[robot]
urdf = {path}
{packages}{joints}
base = {base}                        # link in whose frame contacts of all sensors are given: --frame base
gravity = "fixed"                    # -z of the base is down; else the topic of an IMU, or a frame of /tf
# encoder = 0.2                      # degrees: standard deviation of each joint's position
# expected = ["l_foot", "r_foot"]    # links that are always touched: no events
"""


@dataclass(frozen=True)
class _Seen:
    """A topic that is a sensor's."""

    name: str
    topic: Topic
    kind: SensorKind
    guess: Guess
    link: str
    frame: str


def propose_robot(log: Path, urdf: Urdf, folder: Path) -> Proposal:
    """Return a rig of a robot guessed from a log and a URDF, for a file in `folder`.

    Raises:
        InputError: the log cannot be read or has no topics, or no topic in it looks like a sensor's.
    """
    there = contents(log)
    if not there.topics:
        hint = "Write [robot] and [sensors.NAME] by hand, or name the touched link with --link."
        raise InputError("is a table: sensors of a robot are found by their topics.", where=str(log), hint=hint)
    seen, unknown = _sensors(log, there, urdf)
    if not seen:
        listed = ", ".join(f"{topic.name} ({topic.kind})" for topic in there.topics[:12])
        raise InputError(f"no topic of {log} is a sensor's: {listed}.", hint="Write [sensors.NAME] by hand.")
    remarks = [
        *_joints(there)[1],
        *(f"{name}: {said}" for each in seen for name, said in _remarks(each, urdf)),
        *(f"topic {topic.name!r} ({topic.kind}) is taken for no sensor's" for topic in unknown),
    ]
    text = "".join(_parts(log, there, urdf, folder, seen))
    why = f"{len(seen)} topics of {printable(log.name)} are those of sensors"
    return Proposal(text, "a robot", why, tuple(remarks))


def _sensors(log: Path, there: LogContents, urdf: Urdf) -> tuple[list[_Seen], list[Topic]]:
    """Return the topics that are sensors', and those that might be and are not recognised."""
    candidates = [topic for topic in there.topics if _may_be(topic)]
    frames = frames_named(log, candidates)
    names = _names([topic.name for topic in candidates])
    seen, unknown = list[_Seen](), list[Topic]()
    for topic in candidates:
        own = replace(there, topics=tuple(each for each in there.topics if each == topic or not _may_be(each)))
        found = ((kind, guess) for kind in KINDS.values() if (guess := kind.guess(log, own, None)) is not None)
        kind, guess = next(found, (None, None))
        frame = frames.get(topic.name, "")
        if kind is None or guess is None:
            unknown.append(topic)
        else:
            link = frame if frame in urdf.links else ""
            seen.append(_Seen(names[topic.name], topic, kind, guess, link, frame))
    return seen, unknown


def _may_be(topic: Topic) -> bool:
    """Return whether messages may be the readings of a touch sensor."""
    if not topic.count or is_result(topic.name) or topic.kind == JOINTS or topic.kind in TREES:
        return False
    known = role(topic.kind)
    return known in ("wrench", "array", "image") if known else bool(topic.definition)


def _names(topics: Sequence[str]) -> dict[str, str]:
    """Return topic -> a name for its sensor that no other has."""
    found = dict[str, str]()
    for topic in topics:
        match, every = _LAST.fullmatch(topic.strip("/")), topic.strip("/") or "sensor"
        names = [re.sub(r"\W", "_", each) for each in (match[1] if match else every, every)]
        names = [name if name[0].isalpha() else f"s_{name}" for name in names]
        numbered = (f"{names[1]}_{k}" for k in count(2))
        found[topic] = next(name for name in chain(names, numbered) if name not in found.values())
    return found


def _joints(there: LogContents) -> tuple[str, list[str]]:
    """Return the line that names the joint states, and remarks."""
    topics = [topic.name for topic in there.topics if topic.kind == JOINTS and topic.count]
    if topics:
        more = [f"several topics hold joint states: {', '.join(topics)}; the first is named"] if topics[1:] else []
        return f"joints = {quoted(topics[0])}", more
    if any(topic.kind in TREES for topic in there.topics):
        return 'joints = "/tf"', ["the log has no joint states: the links' poses are taken from /tf"]
    return '# joints = "/joint_states"', ["the log has no joint states and no /tf: contacts have no base frame"]


def _remarks(sensor: _Seen, urdf: Urdf) -> Iterator[tuple[str, str]]:
    """Yield (name, sentence) on what is missing of a sensor."""
    if not sensor.link:
        why = "its messages name no frame" if not sensor.frame else f"its frame {sensor.frame!r} is not a link"
        close = get_close_matches(sensor.name, urdf.links, n=3, cutoff=0.4)
        yield sensor.name, f"{why}: write its link{f' ({close[0]} is near in name)' if close else ''}"
    elif sensor.kind.needs_surface and (touched := _touched(urdf, sensor.link)) != sensor.link:
        why = f"link {sensor.link!r} has no geometry"
        what = f"{touched!r}, which is fixed to it, is taken for the touched link" if touched else "write a surface"
        yield sensor.name, f"{why}: {what}"
    for said in (sensor.guess.lacking, *sensor.guess.remarks):
        if said:
            yield sensor.name, said


def _touched(urdf: Urdf, link: str) -> str:
    """Return a link if it has a geometry, else the nearest one below it that is fixed to it and has one, or ""."""
    below, shaped = [link], urdf.shaped()
    for name in below:  # which grows
        if name in shaped:
            return name
        below += [joint.child for joint in urdf.joints if joint.kind == "fixed" and joint.parent == name]
    return ""


def _parts(log: Path, there: LogContents, urdf: Urdf, folder: Path, seen: Sequence[_Seen]) -> Iterator[str]:
    def relative(path: Path) -> str:
        return quoted(Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix())

    pairs = [f"{quoted(name)} = {relative(where)}" for name, where in urdf.packages.items()]
    packages = f"packages = {{ {', '.join(pairs)} }}\n" if pairs else ""
    yield _HEAD.format(
        log=printable(log.name),
        urdf=printable(urdf.path.name),
        path=relative(urdf.path),
        packages=packages,
        joints=_joints(there)[0],
        base=quoted(urdf.root(urdf.links[0])),
    )
    for each in seen:
        yield f"\n{_sensor_text(each, urdf)}"


def _sensor_text(sensor: _Seen, urdf: Urdf) -> str:
    """Return the tables of a sensor: those of a rig of one sensor, under its name."""
    place = f"sensors.{sensor.name}"
    lines = [f"[{place}]", f"# {printable(sensor.guess.why)}", f'kind = "{sensor.kind.name}"']
    lines.append(f"link = {quoted(sensor.link)}" if sensor.link else '# link = "..."   # the frame in which it reports')
    if sensor.link and sensor.kind.needs_surface and (touched := _touched(urdf, sensor.link)) != sensor.link:
        lines.append(f"{'' if touched else '# '}surface = {{ link = {quoted(touched or '...')} }}   # the touched link")
    text = sensor.guess.text.split("# [orientation]")[0].replace(f"[{sensor.kind.name}]\n", "", 1).strip()
    body = _TABLE.sub(lambda match: f"{match[1] or ''}[{place}.{match[2]}]", text)
    return "\n".join([*lines, body]) + "\n"
