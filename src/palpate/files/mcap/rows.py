"""Make many equally long ROS 2 messages at once: rows of a structured array, for a chunk of MCAP."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import prod

import numpy as np
from jaxtyping import Int

from palpate.files.mcap.writer import MESSAGE
from palpate.spatial.arguments import takes_arrays

# Name, type code and shape of each field; the code of a string is "S" and its length in bytes, with the final NUL.
Fields = tuple[tuple[str, str, tuple[int, ...]], ...]
CDR = 0x100  # the bytes 0, 1, 0, 0: plain, little-endian


def layout(fields: Fields) -> np.dtype[np.void]:
    """Return the dtype of a message in CDR: numbers are aligned to their size, counted from the end of `encoding`."""
    placed: list[tuple[str, str, tuple[int, ...]]] = [("encoding", "<u4", ())]
    at = 0
    for name, code, shape in fields:
        kind = np.dtype(code)
        gap = -at % (1 if kind.kind == "S" else kind.itemsize)
        placed += [(f"gap {name}", f"V{gap}", ())] if gap else []
        placed.append((name, code, shape))
        at += gap + kind.itemsize * prod(shape)
    return np.dtype(placed)


def stamped(frame_id: str, fields: Fields) -> tuple[Fields, Mapping[str, object]]:
    """Return the fields of a message with a header, (name, dtype, shape) each, and a dict of shared header values."""
    frame = frame_id.encode() + b"\0"
    header: Fields = (("sec", "<i4", ()), ("nanosec", "<u4", ()), ("named", "<u4", ()), ("frame", f"S{len(frame)}", ()))
    return (*header, *fields), {"named": len(frame), "frame": frame}


class ChannelRows:
    """The messages of one channel.

    Args:
        channel: its number, from 1.
        fields: of a message.
        common: values that all messages share.

    Attributes:
        record: (1,) the template of a message.
        count: messages so far; the next sequence number.
    """

    def __init__(self, channel: int, fields: Fields, common: Mapping[str, object]) -> None:
        self.record = np.zeros(1, dtype=[*MESSAGE.descr, *layout(fields).descr])
        self.record["opcode"], self.record["channel"] = 5, channel
        self.record["length"] = self.record.itemsize - 9
        self.record["encoding"] = CDR
        for name, value in common.items():
            self.record[name] = value
        self.count = 0


@takes_arrays
def made(kinds: Sequence[ChannelRows], stamps: Sequence[Int[np.ndarray, " _"]]) -> list[np.ndarray]:
    """Return new messages of each kind, a structured array.

    Args:
        kinds: channels of the messages.
        stamps: (n,) [ns] of each kind, which has n messages.

    Raises:
        InputError: stamps has another shape.
        ValueError: there are not as many `stamps` as `kinds`.
    """
    messages: list[np.ndarray] = []
    for kind, times in zip(kinds, stamps, strict=True):
        rows = np.repeat(kind.record, len(times))
        rows["sequence"] = (kind.count + np.arange(len(times))) % 2**32
        rows["log"] = rows["publish"] = times
        if "nanosec" in (rows.dtype.names or ()):
            rows["sec"], rows["nanosec"] = np.divmod(times, 10**9)
        kind.count += len(times)
        messages.append(rows)
    return messages
