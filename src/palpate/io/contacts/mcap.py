"""Contacts as MCAP: what Foxglove, rerun and ROS 2 draw, and beside it a message with everything."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from palpate.contact.estimate import ContactEstimate, Status
from palpate.io.contacts.mcap_write import MESSAGE, Topic
from palpate.io.contacts.rows import Contacts, pointless

__all__ = ["ESTIMATE", "TOPICS", "Messages", "from_messages"]

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
int64 contact # which of the sample's contacts
int64 candidates # how many points of the surface explain the wrench
float64 time # s, as in the log: the stamp is rounded to ns, and never negative
geometry_msgs/Point point
geometry_msgs/Vector3 normal # outward, of length 1
geometry_msgs/Vector3 force # on the body
float64 torque # about the normal
float64[9] covariance # of the point, m^2, row by row
float64 row # between the cells of a sheet of taxels, if one felt it
float64 column
float64 area # of the cells, m^2
uint8 status
{_STAMPED}{_POINT}{_VECTOR}"""
ESTIMATE = Topic("/palpate/contact/estimate", "palpate_msgs/msg/Contact", _CONTACT)
TOPICS = (
    ESTIMATE,
    Topic("/palpate/contact/point", "geometry_msgs/msg/PoseStamped", _POSE_STAMPED),
    Topic("/palpate/contact/wrench", "geometry_msgs/msg/WrenchStamped", _WRENCH_STAMPED),
)
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
    ("cell", "<f8", (3,)),
    ("status", "u1", ()),
)
_BEFORE: _Fields = tuple(field for field in _CONTACT_FIELDS if field[0] != "cell")  # as files of 0.2 have it
_POSE_FIELDS: _Fields = (("position", "<f8", (3,)), ("orientation", "<f8", (4,)))
_WRENCH_FIELDS: _Fields = (("force", "<f8", (3,)), ("torque", "<f8", (3,)))
_CDR = 0x100  # the bytes 0, 1, 0, 0: plain, little-endian
_NAMED = 16  # bytes before the name of the frame
_UPPER = np.triu_indices(3)
_LATEST = 2**31 * 10**9 - 1  # ns that an int32 of seconds can say


class Messages:
    """Makes the messages of samples; one frame's name makes all messages of a topic equally long.

    Args:
        frame_id: name of the frame of the contacts, for viewers.
    """

    def __init__(self, frame_id: str) -> None:
        fields = (_CONTACT_FIELDS, _POSE_FIELDS, _WRENCH_FIELDS)
        self._empty = [_empty(channel, frame_id, each) for channel, each in enumerate(fields, 1)]
        self._counts = np.zeros(len(fields), dtype=np.int64)
        self._last = 0

    def of(self, contacts: Contacts) -> tuple[np.ndarray, list[np.ndarray]]:
        """Messages of the three `TOPICS`: their bytes, and a view of them as one structured array a topic.

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
        for name in ("sample", "contact", "time"):
            everything[name] = getattr(contacts, name)
        for name in ("point", "normal", "force", "torque", "covariance", "candidates", "status"):
            everything[name] = getattr(estimate, name)
        everything["cell"] = np.nan if contacts.cell is None else contacts.cell
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


def from_messages(payloads: np.ndarray) -> Contacts:
    """Contacts of messages of `ESTIMATE`, of one frame's name.

    Args:
        payloads: (n, length) bytes.

    Raises:
        ValueError: they are not of that type, or a row is not one of contacts.
    """
    length = payloads.shape[1]
    name = int(payloads[0, 12:16].view("<u4")[0]) if length > _NAMED else 0
    layouts = [_layout(name, fields) for fields in (_CONTACT_FIELDS, _BEFORE) if 0 < name < length]
    layout = next((layout for layout in layouts if layout.itemsize == length), None)
    if layout is None:
        raise ValueError(f"a message of {length} bytes is not of {ESTIMATE.kind}")
    rows = payloads.view(layout)[:, 0]
    if not ((rows["encoding"] == _CDR) & (rows["named"] == name)).all():
        raise ValueError(f"a message is not of {ESTIMATE.kind}")
    status = rows["status"].astype(np.int8)
    if len(odd := np.flatnonzero((status < 0) | (status >= len(Status)))):
        raise ValueError(f"unknown status {status[odd[0]]}")
    values = {name: rows[name].copy() for name in ("point", "normal", "force", "torque", "covariance", "candidates")}
    estimate = ContactEstimate(**values, residual=np.full(len(rows), np.nan), status=status)
    if (row := pointless(estimate)) is not None:
        raise ValueError(f"row {row} of a block is answered, but has no point")
    names = layout.names or ()
    cell = rows["cell"].copy() if "cell" in names and not np.isnan(rows["cell"]).all() else None
    return Contacts(rows["sample"].copy(), rows["time"].copy(), rows["contact"].copy(), estimate, cell=cell)


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
