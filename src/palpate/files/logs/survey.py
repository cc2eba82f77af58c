"""List the frames, poses and joints in a log of topics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from palpate.files.logs.cursor import Cursor
from palpate.files.logs.decoding import FIXED, decode, has_header, role
from palpate.files.logs.joints import JOINTS, joint_names
from palpate.files.logs.message_fields import defines_header
from palpate.files.logs.transforms import SeenEdge, TransformTree, frame_name, tree_topics
from palpate.files.messages import MessageBlock, MessageFile, Topic


@dataclass
class Survey:
    """The frames, poses and joints in a log of topics.

    Attributes:
        frames: the tree of /tf.
        named: topic of wrenches or poses -> frame of its header and child frame, or "".
        poses: topic of poses -> their number, and if they move.
        joints: topic of joint states -> names of the joints.
    """

    frames: TransformTree
    named: dict[str, tuple[str, str]] = field(default_factory=dict[str, tuple[str, str]])
    poses: dict[str, SeenEdge] = field(default_factory=dict[str, SeenEdge])
    joints: dict[str, list[str]] = field(default_factory=dict[str, list[str]])

    def add(self, messages: MessageBlock, topics: Mapping[str, Topic]) -> None:
        """Add a block of messages; `topics` are those of wrenches, poses and joint states, by name."""
        self.frames.add(messages)
        for name, topic in topics.items():
            own = messages.of(topic)
            if topic.kind == JOINTS:
                self.joints[name] = self.joints.get(name) or joint_names(own, topic)
            elif len(own.length):
                self.named[name] = self.named.get(name) or _frames_of(own, topic)
                if role(topic.kind) == "pose":
                    stamps, values, sound = decode(own, topic)
                    self.poses.setdefault(name, SeenEdge()).add(values[sound], stamps[sound], static=False)


def survey_of(source: MessageFile) -> Survey:
    """Read a file of messages once, and return the frames, poses and joints in it.

    Raises:
        InputError: the file cannot be read, or needs a library that is not installed.
    """
    there = [topic for topic in source.topics() if topic.encoding in ("cdr", "ros1") and topic.count]
    wanted = {topic.name: topic for topic in there if topic.kind == JOINTS or role(topic.kind) in ("wrench", "pose")}
    trees = tree_topics(there)
    found = Survey(TransformTree(topics=tuple(trees)))
    for messages in source.messages([*wanted, *(topic.name for topic in trees)]) if wanted or trees else ():
        found.add(messages, wanted)
    return found


def frame_named(source: MessageFile, topic: Topic) -> str:
    """Return the frame that the header of a topic's first readable message names; "" if there is none.

    Raises:
        InputError: the file cannot be read.
    """
    if not (has_header(topic.kind) or defines_header(topic)):
        return ""
    return source.first(topic, lambda messages: frame_in(messages, topic)) or ""


def frame_in(messages: MessageBlock, topic: Topic) -> str | None:
    """Return the frame that the header of the first readable of messages of a topic names; None if none is readable."""
    cursor = Cursor(messages, topic.encoding)
    _, at, length = cursor.header()
    first = np.flatnonzero(cursor.sound)[:1]
    return next((frame_name(cursor.data[at[k] : at[k] + length[k]]) for k in first), None)


def _frames_of(messages: MessageBlock, topic: Topic) -> tuple[str, str]:
    """Return the header's frame and the child frame of the first readable message; "" for none."""
    cursor = Cursor(messages, topic.encoding)
    texts = [cursor.text() if k else cursor.header()[1:] for k in range(FIXED[topic.kind].strings)]
    first = np.flatnonzero(cursor.sound)[:1]
    names = [frame_name(messages.data[at[k] : at[k] + length[k]]) for k in first for at, length in texts]
    frame, child = [*names, "", ""][:2]
    return frame, child
