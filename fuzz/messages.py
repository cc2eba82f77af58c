"""The target for messages of ROS, from a topic or a log: wrenches, poses, transforms, joint states, arrays, images.

An input is the type (its place among `KINDS`) and the encoding, a byte each, then each message after its length (two
bytes, little-endian). The type `DEFINED` is one that Palpate does not know; its definition is the first message.
"""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from palpate.errors import PalpateError
from palpate.files.logs.cursor import Cursor
from palpate.files.logs.decoding import ARRAYS, FIXED, IMAGE, decode, role, shape_of
from palpate.files.logs.image_messages import IMAGES, image_messages
from palpate.files.logs.joints import JOINTS, joint_names, joint_positions
from palpate.files.logs.message_fields import field_of, paths_of
from palpate.files.logs.transforms import TREES
from palpate.files.messages import MessageBlock, Topic
from palpate.live.poses import LivePoses
from palpate.opencv import opencv

DEFINED = "own_msgs/Own"
KINDS = (*FIXED, *ARRAYS, *TREES, JOINTS, *IMAGES, DEFINED)
ENCODINGS = ("cdr", "ros1")


def packed(kind: str, raws: list[bytes], encoding: str = "cdr") -> bytes:
    """Return the input of the target for messages of a type."""
    head = bytes([KINDS.index(kind), ENCODINGS.index(encoding)])
    return head + b"".join(len(raw).to_bytes(2, "little") + raw for raw in raws)


def _unpacked(data: bytes) -> tuple[str, str, list[bytes]]:
    raws, at = list[bytes](), 2
    while at < len(data):
        size = int.from_bytes(data[at : at + 2], "little")
        raws.append(data[at + 2 : at + 2 + size])
        at += 2 + size
    return KINDS[data[0] % len(KINDS)], ENCODINGS[data[1] % 2], raws


def messages(data: bytes) -> None:
    """Decode messages of one type in every way in which a log or a live source does."""
    if len(data) < 2:
        return
    kind, encoding, raws = _unpacked(data)
    definition = raws.pop(0).decode("latin-1") if kind == DEFINED and raws else ""
    length = np.array([len(raw) for raw in raws], dtype=np.int64)
    time = 10**7 * np.arange(len(raws))
    for name in ("/a", "/tf_static"):
        topic = Topic(name, kind, encoding, definition=definition)
        block = MessageBlock(
            b"".join(raws), {0: topic}, np.zeros(len(raws), np.int64), time, np.cumsum(length) - length, length
        )
        with suppress(PalpateError):
            _read(block, topic)


def _read(block: MessageBlock, topic: Topic) -> None:
    kind = topic.kind
    if (kind in ARRAYS or kind == IMAGE) and (shape := shape_of(block, topic)):
        decode(block, topic, shape)
    elif kind in FIXED:
        decode(block, topic)
    if kind in TREES or role(kind) == "pose":
        poses = LivePoses(("base", "sensor") if kind in TREES else None)
        poses.add(block)
        poses.at(block.time), poses.events()
    elif kind == JOINTS:
        joint_positions(block, topic, joint_names(block, topic))
    elif kind in IMAGES:
        for message in image_messages(block, topic):
            message.size(opencv())
    elif kind == DEFINED:
        for path in paths_of(topic):
            if (field := field_of(topic, path)) is not None:
                counts = field.count(Cursor(block, topic.encoding))
                decode(block, topic, (1 + int(counts.max(initial=0)) % 1000,), field)
                decode(block, topic, (max(1, int(counts.min(initial=1000))),), field)
