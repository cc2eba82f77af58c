"""Guess the source of the sensor's pose in a log of topics: the tree of /tf, joint states or a topic of poses."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

from palpate.errors import InputError
from palpate.files.logs.layout import LogLayout
from palpate.files.logs.survey import Survey
from palpate.files.logs.topics import NONE
from palpate.files.units import near
from palpate.setup.body import GivenBody
from palpate.setup.guess import frames_table, pose_table, quoted

_OTHERS = re.compile(
    r"camera|object|marker|apriltag|aruco|target|goal|detect|human|person|head|odom|map\b|initialpose|cloud",
    re.IGNORECASE,
)
_FRAMES = """\
# base = "base_link"                 # in place of topic: two frames of /tf
# sensor = "ft_sensor"
"""


@dataclass(frozen=True)
class PoseGuess:
    """A guess at the source of the sensor's pose: layout of the log, [orientation] as TOML, and remarks to check."""

    layout: LogLayout
    text: str
    remarks: list[str]


def guess_pose(survey: Survey, layout: LogLayout, body: GivenBody | None) -> PoseGuess:
    """Guess the tree of /tf if it has the wrench's frame, else joint states, else a topic of poses.

    Args:
        survey: the frames, joints and poses in the log.
        layout: the layout that names the wrench's topic.
        body: the body that is touched, whose URDF the joint states move; None: not known.
    """
    frame, _ = survey.named.get(str(layout.wrench_topic), ("", ""))
    joints = _joints(survey, frame, body)
    found, remarks = _tree(survey, frame)
    if found is not None:
        if joints is not None:
            remarks.append("joint states could give the pose too; /tf is used")
        if unused := [name for name in survey.poses if name]:
            remarks.append(f"topics of poses are not used: {', '.join(unused)}")
        return PoseGuess(replace(layout, frames=found), frames_table(*found, "frames of /tf"), remarks)
    if joints is not None:
        read = replace(joints.layout, wrench_topic=layout.wrench_topic)
        return replace(joints, layout=read, remarks=[*remarks, *joints.remarks])
    made = _topic(survey, layout, frame)
    text = made.text + (_FRAMES if survey.frames.edges else "")
    return replace(made, text=text, remarks=[*remarks, *made.remarks])


def _tree(survey: Survey, frame: str) -> tuple[tuple[str, str] | None, list[str]]:
    """Return the frames (base, sensor) in the tree of /tf, None if it cannot be used, and remarks."""
    if not survey.frames.edges:
        return None, []
    tree, wrench = survey.frames.tree(), f"the wrench's frame {frame!r}"
    if frame not in tree.frames:
        why = f"{wrench} is not in it" if frame else "the wrench's header names no frame"
        return None, [
            f"/tf is not used: {why}; name the sensor's frame, and a base, in [orientation]. {near(frame, tree.frames)}"
        ]
    try:
        up = tree.up(frame)
    except InputError as problem:
        return None, [f"/tf is not used: {problem}"]
    if len(up) == 1:
        return None, [
            f"/tf is not used: {wrench} is the root of its tree. If the wrench is written in the base, set frame = "
            f'"base" in [force_torque], and name the sensor\'s frame and the base in [orientation]'
        ]
    base = up[len(up) - 1]
    others = f"; another base can be {', '.join(up[1:-1])}" if len(up) > 2 else ""
    said = [f"the sensor is {wrench}, the base {base!r}, the root of its tree in /tf{others} (base in [orientation])"]
    if not survey.frames.moving(up):
        said.append(f"nothing between {base!r} and {frame!r} moves in /tf: check that {frame!r} is the sensor's frame")
    return (base, frame), said


def _joints(survey: Survey, frame: str, body: GivenBody | None) -> PoseGuess | None:
    """Guess that joint states move the URDF; None unless one topic has all joints from the sensor up to the root."""
    if body is None or body.urdf is None or frame not in body.urdf.links:
        return None
    try:
        root = body.urdf.root(frame)
        needed = {joint.mimics or joint.name for joint in body.urdf.chain(root, frame)}
    except InputError:
        return None
    topics = [name for name, there in survey.joints.items() if needed and needed <= {*there}]
    if not topics:
        return None
    topic = topics[0]
    moved = f"urdf = {body.relative(body.path)}\njoints = {quoted(topic)}   # joint states\n"
    text = frames_table(root, frame, "links of the URDF", moved)
    said = f"the sensor is link {frame!r} of the URDF, the base its root {root!r}, the joints those of {topic!r}"
    several = f"{len(topics)} topics have states of these joints: {', '.join(topics)}; the first is used (see joints)"
    remarks = [said, several] if len(topics) > 1 else [said]
    return PoseGuess(LogLayout(frames=(root, frame), urdf=body.path, joints_topic=topic), text, remarks)


def _topic(survey: Survey, layout: LogLayout, frame: str) -> PoseGuess:
    doubts = {name: list(_doubts(survey, name, frame)) for name in survey.poses}
    fitting = [name for name, why in doubts.items() if not why]
    foreign = [f"{name!r} ({'; '.join(why)})" for name, why in doubts.items() if why]
    if fitting:
        fitting.sort(key=lambda name: not survey.poses[name].moves)  # topics whose poses move come first
        verb = "is" if len(foreign) == 1 else "are"
        remarks = [f"{', '.join(foreign)} {verb} probably not of the sensor"] if foreign else []
        if len(fitting) > 1:
            remarks.append(f"{len(fitting)} topics hold poses: {', '.join(fitting)}; the first is used")
        first = survey.poses[fitting[0]]
        if not first.moves and first.count > 1:
            remarks.append(f"the pose on {fitting[0]!r} never changes: check that it is the sensor's")
        return PoseGuess(replace(layout, orientation_topic=fitting[0]), pose_table(fitting), remarks)
    if not doubts:
        return PoseGuess(layout, pose_table([]), [])
    text = f'[orientation]\ntopic = "{NONE}"                       # of poses of the sensor in the base\n'
    listed = ", ".join(foreign)
    said = f"no topic of poses is used: {listed}; if one is of the sensor, name it as topic in [orientation]"
    return PoseGuess(replace(layout, orientation_topic=NONE), text, [said])


def _doubts(survey: Survey, name: str, frame: str) -> Iterator[str]:
    """Yield the reason why the poses of a topic are probably not the sensor's, if there is one."""
    parent, child = survey.named.get(name, ("", ""))
    for what, text in (("its name", name), ("its frame", parent), ("its child frame", child)):
        if match := _OTHERS.search(text):
            yield f"{what} contains {match[0]!r}"
            return
    if frame and child and child != frame:
        yield f"it is of {child!r}, but the wrench is of {frame!r}"
    elif frame and parent == frame:
        yield "it is written in the sensor's own frame"
