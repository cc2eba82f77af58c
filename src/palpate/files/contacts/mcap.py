"""Convert contacts to and from MCAP messages: one with all numbers, and some that Foxglove, rerun and ROS 2 draw."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ContactEstimate, Status
from palpate.contact.origins import Origin, Origins
from palpate.contact.table import ORIGIN, pointless
from palpate.errors import InputError
from palpate.files.mcap.rows import CDR, ChannelRows, Fields, layout, made, stamped
from palpate.files.mcap.writer import WrittenTopic
from palpate.files.message_types import RULE, described, written_topic
from palpate.spatial.arguments import takes_arrays

__all__ = [
    "KIND",
    "LATEST",
    "POSE_FIELDS",
    "WRENCH_FIELDS",
    "ContactMessages",
    "topics",
]

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
_ORIGIN = "string sensor # of a robot\nstring link # that is touched\n"
KIND = "palpate_msgs/msg/Contact"
_CONTACT_FIELDS: Fields = (
    *((name, "<i8", ()) for name in ("sample", "contact", "candidates")),
    ("time", "<f8", ()),
    *((name, "<f8", (3,)) for name in ("point", "normal", "force")),
    ("torque", "<f8", ()),
    ("covariance", "<f8", (3, 3)),
)
POSE_FIELDS: Fields = (("position", "<f8", (3,)), ("orientation", "<f8", (4,)))
WRENCH_FIELDS: Fields = (("force", "<f8", (3,)), ("torque", "<f8", (3,)))
_NAMED = 16  # bytes before the name of the frame
_UPPER = np.triu_indices(3)
LATEST = 2**31 * 10**9 - 1  # ns: the largest stamp whose seconds fit an int32


def topics(features: tuple[str, ...] = (), origins: Sequence[Origin] = ()) -> tuple[WrittenTopic, ...]:
    """Return the topics of a file of contacts: one with all numbers of each row, two for viewers.

    A robot has these three for each of its `origins`.
    """
    added = "".join(f"float64 {name} # of the sensor, SI\n" for name in features)
    inner = ("std_msgs/Header", "geometry_msgs/Point", "geometry_msgs/Vector3")
    definition = described(f"{_CONTACT}{added}{_STATUS}{_ORIGIN if origins else ''}", inner)
    return tuple(
        topic
        for room in [f"/palpate/{each.sensor}" for each in origins] or ["/palpate/contact"]
        for topic in (
            WrittenTopic(f"{room}/estimate", KIND, definition),
            written_topic(f"{room}/point", "geometry_msgs/PoseStamped"),
            written_topic(f"{room}/wrench", "geometry_msgs/WrenchStamped"),
        )
    )


def _named_features(definition: str) -> tuple[str, ...]:
    """Return the names of the features in a definition of `KIND`."""
    own = definition.split(RULE, 1)[0].partition("covariance")[2]
    return tuple(re.findall(r"^float64 (\w+)", own, re.MULTILINE))


def _contact_fields(features: tuple[str, ...], names: Sequence[int] = ()) -> Fields:
    """Return the fields of `KIND`; `names` are the bytes of a robot's sensor and link, with the final NUL."""
    added: Fields = tuple((f"feature {name}", "<f8", ()) for name in features)
    origin = [
        field
        for name, length in zip(ORIGIN, names, strict=False)
        for field in ((f"{name} length", "<u4", ()), (name, f"S{length}", ()))
    ]
    return (*_CONTACT_FIELDS, *added, ("status", "u1", ()), *origin)


@takes_arrays
class ContactMessages:
    """Converter of contacts to messages of the `topics`.

    Args:
        frame_id: name of the frame of the contacts, for viewers; of a robot's, the name for each `Origin`.
        features: names of the features of every row.
        channel: number of the first channel.
    """

    def __init__(self, frame_id: str | Mapping[Origin, str], features: tuple[str, ...] = (), channel: int = 1) -> None:
        self._features = features
        self._robot = not isinstance(frame_id, str)
        frames: Mapping[Origin, str] = {Origin(): frame_id} if isinstance(frame_id, str) else frame_id
        self._kinds = dict[Origin, list[ChannelRows]]()
        for origin, frame in frames.items():
            names = [name.encode() + b"\0" for name in origin] if self._robot else []
            fields, common = stamped(frame, _contact_fields(features, [len(name) for name in names]))
            for key, name in zip(ORIGIN, names, strict=False):
                common = {**common, key: name, f"{key} length": len(name)}
            first = 3 * len(self._kinds) + channel
            viewers = (stamped(frame, each) for each in (POSE_FIELDS, WRENCH_FIELDS))
            kinds = [(fields, common), *viewers]
            self._kinds[origin] = [ChannelRows(first + k, *each) for k, each in enumerate(kinds)]
        self._last = 0

    def of(self, contacts: Contacts, stamps: Int[np.ndarray, " n"] | None = None) -> list[np.ndarray]:
        """Return the messages of contacts, a structured array per topic.

        Args:
            contacts: n rows; only those with a point and a normal are in the second and third topic.
            stamps: (n,) [ns] where they are known more exactly than by the times.

        Raises:
            InputError: stamps has another shape, or a row is of a sensor without a frame.
        """
        stamps = self._stamps(contacts.time) if stamps is None else stamps
        if not self._robot:
            return self._messages(contacts, stamps, *self._kinds.values())
        if contacts.origins is None:
            raise InputError("contacts must have origins: the file is of a robot's sensors.")
        messages = list[np.ndarray]()
        for k, origin in enumerate(contacts.origins.among):
            rows = np.flatnonzero(contacts.origins.index == k)
            if len(rows):
                if origin not in self._kinds:
                    raise InputError(f"the sensor {origin.sensor!r} has no frame among those of the file.")
                messages += self._messages(contacts[rows], stamps[rows], self._kinds[origin])
        return messages

    def _messages(
        self, contacts: Contacts, stamps: Int[np.ndarray, " n"], kinds: list[ChannelRows]
    ) -> list[np.ndarray]:
        """Return the messages of one sensor's contacts."""
        estimate = contacts.estimate
        placed = np.flatnonzero(np.isfinite(np.hstack([estimate.point, estimate.normal])).all(axis=1))
        messages = everything, pose, wrench = made(kinds, [stamps, stamps[placed], stamps[placed]])
        everything["sample"], everything["contact"] = contacts.sample, contacts.identity
        everything["time"] = contacts.time
        for name in ("point", "normal", "force", "torque", "covariance", "candidates", "status"):
            everything[name] = getattr(estimate, name)
        for name in self._features:
            everything[f"feature {name}"] = contacts.features.get(name, np.nan)
        everything["covariance"][:, *_UPPER[::-1]] = estimate.covariance[:, *_UPPER]  # the same numbers as in a table
        normal = estimate.normal[placed]
        pose["position"], pose["orientation"] = estimate.point[placed], _z_to(normal)
        wrench["force"], wrench["torque"] = estimate.force[placed], estimate.torque[placed, None] * normal
        return messages

    def _stamps(self, time: Float[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """Return stamps [ns], clipped to ROS's range; one that is missing is the one before."""
        known = np.flatnonzero(np.isfinite(time))
        seconds = time[known].clip(0, LATEST / 1e9)
        whole = np.floor(seconds).clip(max=LATEST // 10**9)
        nanoseconds = np.rint((seconds - whole) * 1e9).clip(0, 10**9 - 1)
        seen = np.concatenate([[self._last], whole.astype(np.int64) * 10**9 + nanoseconds.astype(np.int64)])
        stamps = seen[np.searchsorted(known, np.arange(len(time)), side="right")]
        self._last = int(seen[-1])
        return stamps


def from_messages(payloads: np.ndarray, definition: str) -> Contacts:
    """Return the contacts in messages of `KIND` from one topic, (n, length) bytes as uint8.

    `definition` is the text that states the fields of `KIND` in their file.

    Raises:
        ValueError: a message is not of this type, has an unknown status, or is an answered row without a point.
    """
    length, features = payloads.shape[1], _named_features(definition)
    first = payloads[0].tobytes()
    name = int.from_bytes(first[12:16], "little") if length > _NAMED else 0
    kind = layout(stamped("x" * (name - 1), _contact_fields(features))[0]) if 0 < name < length else None
    if kind is not None and _ORIGIN in definition:
        kind = _with_origin(first, kind, name, features)
    if kind is None or kind.itemsize != length:
        raise ValueError(f"a message of {length} bytes is not of type {KIND}")
    rows = payloads.view(kind)[:, 0]
    if not ((rows["encoding"] == CDR) & (rows["named"] == name)).all():
        raise ValueError(f"a message is not of type {KIND}")
    status = rows["status"].astype(np.int8)
    if len(odd := np.flatnonzero((status < 0) | (status >= len(Status)))):
        raise ValueError(f"unknown status {status[odd[0]]}")
    values = {name: rows[name].copy() for name in ("point", "normal", "force", "torque", "covariance", "candidates")}
    estimate = ContactEstimate(**values, residual=np.full(len(rows), np.nan), status=status)
    if (row := pointless(estimate)) is not None:
        raise ValueError(f"row {row} of a block has a status that needs a point, but has no point")
    added = {name: rows[f"feature {name}"].copy() for name in features}
    origins = None
    if "sensor" in (kind.names or ()):
        names = ([text.rstrip(b"\0").decode(errors="replace") for text in rows[key].tolist()] for key in ORIGIN)
        origins = Origins.of_names(*names)
    made = rows["sample"].copy(), rows["time"].copy(), rows["contact"].copy(), estimate, added
    return Contacts(*made, origins=origins)


def _with_origin(
    message: bytes, before: np.dtype[np.void], frame: int, features: tuple[str, ...]
) -> np.dtype[np.void] | None:
    """Return the layout of a message that ends with two names after the fields of `before`; None if it does not fit."""
    lengths, at = list[int](), before.itemsize
    for _ in ORIGIN:
        at += -(at - 4) % 4  # counted from the end of `encoding`
        lengths.append(int.from_bytes(message[at : at + 4], "little"))
        at += 4 + lengths[-1]
    if at != len(message) or 0 in lengths:
        return None
    return layout(stamped("x" * (frame - 1), _contact_fields(features, lengths))[0])


def _z_to(normal: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 4"]:
    """Return the shortest rotations (n, 4), x, y, z, w, that turn z into `normal`."""
    x, y, z = normal[:, 0], normal[:, 1], normal[:, 2]
    above = np.where(z > 0, 1 + z, (x * x + y * y) / (1 - z.clip(max=0)))  # 1 + z, without cancellation near z = -1
    quaternion = np.stack([-y, x, np.zeros_like(x), above], axis=1)
    length = np.linalg.norm(quaternion, axis=1, keepdims=True)
    return np.where(length > 0, quaternion, [1.0, 0.0, 0.0, 0.0]) / np.where(length > 0, length, 1.0)
