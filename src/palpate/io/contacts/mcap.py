"""Contacts as MCAP: what Foxglove, rerun and ROS 2 draw, and beside it a message with everything."""

from __future__ import annotations

import re

import numpy as np
from jaxtyping import Float, Int

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ContactEstimate, Status
from palpate.contact.table import pointless
from palpate.io.contacts.mcap_write import MESSAGE, Topic

__all__ = ["KIND", "Messages", "from_messages", "named_features", "topics"]

_RULE = "=" * 80
_STAMPED = f"""{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
_THREE = "float64 x\nfloat64 y\nfloat64 z\n"
_POINT = f"{_RULE}\nMSG: geometry_msgs/Point\n{_THREE}"
_VECTOR = f"{_RULE}\nMSG: geometry_msgs/Vector3\n{_THREE}"
_POSE_STAMPED = f"""std_msgs/Header header
geometry_msgs/Pose pose
{_STAMPED}{_RULE}
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
{_POINT}{_RULE}
MSG: geometry_msgs/Quaternion
{_THREE}float64 w
"""
_WRENCH_STAMPED = f"""std_msgs/Header header
geometry_msgs/Wrench wrench
{_STAMPED}{_RULE}
MSG: geometry_msgs/Wrench
geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque
{_VECTOR}"""
_CONTACT = f"""# One row of the contacts that `palpate estimate` writes. SI; NaN where there is nothing to say.
{"".join(f"uint8 {status.name}={int(status)}" + chr(10) for status in Status)}
std_msgs/Header header
int64 sample # row of the log, counted from 0
int64 contact # which contact it is: it keeps its number
int64 candidates # how many points of the surface explain the wrench
float64 time # s, as in the log: the stamp is rounded to ns, and never negative
geometry_msgs/Point point
geometry_msgs/Vector3 normal # outward, of length 1
geometry_msgs/Vector3 force # on the body
float64 torque # about the normal
float64[9] covariance # of the point, m^2, row by row
"""
_STATUS = "uint8 status\n"
KIND = "palpate_msgs/msg/Contact"
_Fields = tuple[tuple[str, str, tuple[int, ...]], ...]
_CONTACT_FIELDS: _Fields = (
    ("sample", "<i8", ()),
    ("contact", "<i8", ()),
    ("candidates", "<i8", ()),
    ("time", "<f8", ()),
    ("point", "<f8", (3,)),
    ("normal", "<f8", (3,)),
    ("force", "<f8", (3,)),
    ("torque", "<f8", ()),
    ("covariance", "<f8", (3, 3)),
)
_POSE_FIELDS: _Fields = (("position", "<f8", (3,)), ("orientation", "<f8", (4,)))
_WRENCH_FIELDS: _Fields = (("force", "<f8", (3,)), ("torque", "<f8", (3,)))
_CDR = 0x100  # the bytes 0, 1, 0, 0: plain, little-endian
_NAMED = 16  # bytes before the name of the frame
_UPPER = np.triu_indices(3)
_LATEST = 2**31 * 10**9 - 1  # ns that an int32 of seconds can say


def topics(features: tuple[str, ...] = ()) -> tuple[Topic, ...]:
    """What a file of contacts declares: every row with all its numbers, and what viewers draw."""
    added = "".join(f"float64 {name} # of the sensor, SI\n" for name in features)
    return (
        Topic("/palpate/contact/estimate", KIND, f"{_CONTACT}{added}{_STATUS}{_STAMPED}{_POINT}{_VECTOR}"),
        Topic("/palpate/contact/point", "geometry_msgs/msg/PoseStamped", _POSE_STAMPED),
        Topic("/palpate/contact/wrench", "geometry_msgs/msg/WrenchStamped", _WRENCH_STAMPED),
    )


def named_features(definition: str) -> tuple[str, ...]:
    """The features in a definition of `KIND`: its numbers between covariance and status."""
    own = definition.split(_RULE, 1)[0].partition("covariance")[2]
    return tuple(re.findall(r"^float64 (\w+)", own, re.MULTILINE))


def _contact_fields(features: tuple[str, ...]) -> _Fields:
    return (*_CONTACT_FIELDS, *((f"feature {name}", "<f8", ()) for name in features), ("status", "u1", ()))


class Messages:
    """Makes the messages of samples; one frame's name makes all messages of a topic equally long.

    Args:
        frame_id: name of the frame of the contacts, for viewers.
        features: that every row has.
    """

    def __init__(self, frame_id: str, features: tuple[str, ...] = ()) -> None:
        self._features = features
        fields = (_contact_fields(features), _POSE_FIELDS, _WRENCH_FIELDS)
        self._empty = [_empty(channel, frame_id, each) for channel, each in enumerate(fields, 1)]
        self._counts = np.zeros(len(fields), dtype=np.int64)
        self._last = 0

    def of(self, contacts: Contacts) -> tuple[np.ndarray, list[np.ndarray]]:
        """Messages of the three `topics`: their bytes, and a view of them as one structured array a topic.

        Args:
            contacts: n rows; those with a point and a normal are in the second and third topic too.
        """
        stamps = self._stamps(contacts.time)
        estimate = contacts.estimate
        placed = np.flatnonzero(np.isfinite(np.hstack([estimate.point, estimate.normal])).all(axis=1))
        picks = (np.arange(len(contacts)), placed, placed)
        raw, messages = _allocated(self._empty, [len(pick) for pick in picks])
        for rows, pick, first in zip(messages, picks, self._counts, strict=True):
            _stamp(rows, stamps[pick], int(first))
        self._counts += [len(pick) for pick in picks]
        everything, pose, wrench = messages
        everything["sample"], everything["contact"], everything["time"] = (
            contacts.sample,
            contacts.identity,
            contacts.time,
        )
        for name in ("point", "normal", "force", "torque", "covariance", "candidates", "status"):
            everything[name] = getattr(estimate, name)
        for name in self._features:
            everything[f"feature {name}"] = contacts.features.get(name, np.nan)
        everything["covariance"][:, *_UPPER[::-1]] = estimate.covariance[:, *_UPPER]  # the same numbers as in a table
        normal = estimate.normal[placed]
        pose["position"], pose["orientation"] = estimate.point[placed], _z_to(normal)
        wrench["force"], wrench["torque"] = estimate.force[placed], estimate.torque[placed, None] * normal
        return raw, messages

    def _stamps(self, time: Float[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """(n,) [ns] from 0 to what ROS can say; a time that is missing takes the one before."""
        known = np.flatnonzero(np.isfinite(time))
        seconds = time[known].clip(0, _LATEST / 1e9)
        whole = np.floor(seconds).clip(max=_LATEST // 10**9)
        nanoseconds = np.rint((seconds - whole) * 1e9).clip(0, 10**9 - 1)
        seen = np.concatenate([[self._last], whole.astype(np.int64) * 10**9 + nanoseconds.astype(np.int64)])
        stamps = seen[np.searchsorted(known, np.arange(len(time)), side="right")]
        self._last = int(seen[-1])
        return stamps


def from_messages(payloads: np.ndarray, features: tuple[str, ...] = ()) -> Contacts:
    """Contacts of messages of `KIND`, of one frame's name.

    Args:
        payloads: (n, length) bytes.
        features: that their definition names.

    Raises:
        ValueError: they are not of that type, or a row is not one of contacts.
    """
    length = payloads.shape[1]
    name = int(payloads[0, 12:16].view("<u4")[0]) if length > _NAMED else 0
    layout = _layout(name, _contact_fields(features)) if 0 < name < length else None
    if layout is None or layout.itemsize != length:
        raise ValueError(f"a message of {length} bytes is not of {KIND}")
    rows = payloads.view(layout)[:, 0]
    if not ((rows["encoding"] == _CDR) & (rows["named"] == name)).all():
        raise ValueError(f"a message is not of {KIND}")
    status = rows["status"].astype(np.int8)
    if len(odd := np.flatnonzero((status < 0) | (status >= len(Status)))):
        raise ValueError(f"unknown status {status[odd[0]]}")
    values = {name: rows[name].copy() for name in ("point", "normal", "force", "torque", "covariance", "candidates")}
    estimate = ContactEstimate(**values, residual=np.full(len(rows), np.nan), status=status)
    if (row := pointless(estimate)) is not None:
        raise ValueError(f"row {row} of a block is answered, but has no point")
    added = {name: rows[f"feature {name}"].copy() for name in features}
    return Contacts(rows["sample"].copy(), rows["time"].copy(), rows["contact"].copy(), estimate, added)


def _layout(name: int, fields: _Fields) -> np.dtype[np.void]:
    """A message whose frame's name has so many bytes with its end; CDR aligns what follows the header to 8."""
    header = [("encoding", "<u4"), ("sec", "<i4"), ("nanosec", "<u4"), ("named", "<u4"), ("frame", f"S{name}")]
    return np.dtype([*header, ("gap", f"V{-(12 + name) % 8}"), *fields])


def _empty(channel: int, frame_id: str, fields: _Fields) -> np.ndarray:
    """One record with what all of a topic's have in common."""
    name = frame_id.encode() + b"\0"
    record = np.zeros(1, dtype=[*MESSAGE.descr, *_layout(len(name), fields).descr])
    record["opcode"], record["channel"] = 5, channel
    record["length"] = record.itemsize - 9
    record["encoding"] = _CDR
    record["named"], record["frame"] = len(name), name
    return record


def _allocated(empty: list[np.ndarray], counts: list[int]) -> tuple[np.ndarray, list[np.ndarray]]:
    """Bytes of so many copies of each record, one after the other, and their parts."""
    ends = np.cumsum([count * record.itemsize for record, count in zip(empty, counts, strict=True)])
    raw = np.empty(ends[-1], dtype=np.uint8)
    pieces = np.split(raw, ends[:-1])
    for piece, record in zip(pieces, empty, strict=True):
        piece.reshape(-1, record.itemsize)[:] = record.view(np.uint8)  # field by field takes longer than all the rest
    return raw, [piece.view(record.dtype) for piece, record in zip(pieces, empty, strict=True)]


def _stamp(rows: np.ndarray, stamps: Int[np.ndarray, " n"], first: int) -> None:
    rows["sequence"] = (first + np.arange(len(stamps))) % 2**32
    rows["log"] = rows["publish"] = stamps
    rows["sec"], rows["nanosec"] = np.divmod(stamps, 10**9)


def _z_to(normal: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 4"]:
    """(n, 4) x, y, z, w: the shortest rotation that turns z into `normal`; half a turn about x where that is -z."""
    x, y, z = normal[:, 0], normal[:, 1], normal[:, 2]
    above: Float[np.ndarray, " n"] = np.where(
        z > 0, 1 + z, (x * x + y * y) / (1 - z.clip(max=0))
    )  # 1 + z, without cancellation near z = -1
    quaternion = np.stack([-y, x, np.zeros_like(x), above], axis=1)
    length = np.linalg.norm(quaternion, axis=1, keepdims=True)
    return np.where(length > 0, quaternion, [1.0, 0.0, 0.0, 0.0]) / np.where(length > 0, length, 1.0)
