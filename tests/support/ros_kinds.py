"""Messages of ROS 2 drawn at random, made and read by rosbags: nothing of Palpate."""

from __future__ import annotations

from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from palpate.files.message_types import DEFINITIONS

ROS2 = get_typestore(Stores.ROS2_HUMBLE)
_CONTACT = """std_msgs/Header header
int64 sample
int64 contact
int64 candidates
float64 time
geometry_msgs/Point point
geometry_msgs/Vector3 normal
geometry_msgs/Vector3 force
float64 torque
float64[9] covariance
uint8 status
"""
ROS2.register(get_types_from_msg(_CONTACT, "palpate_msgs/msg/Contact"))
ROS2.register(
    get_types_from_msg(
        "std_msgs/Header header\npalpate_msgs/Contact[] contacts\nstring[] features\nfloat64[] values",
        "palpate_msgs/msg/ContactArray",
    )
)
TYPES: Any = ROS2.types
_BASE, _NAME, _ARRAY = 1, 2, 3


def full(kind: str) -> str:
    """'std_msgs/Header' -> 'std_msgs/msg/Header'."""
    return kind.replace("/", "/msg/")


def drawn(kind: str, rng: np.random.Generator) -> Any:
    """A message of a type, as `TYPES` names it, with something in every member."""
    _, members = ROS2.fielddefs[kind]
    return TYPES[kind](**{name: _value(what, rng) for name, what in members})


def _value(what: Any, rng: np.random.Generator) -> Any:
    node, of = what
    if node == _NAME:
        return drawn(of, rng)
    if node == _BASE:
        return _base(of[0], rng)
    inner, size = of
    count = size if node == _ARRAY else int(rng.integers(0, 4))
    values = [_value(inner, rng) for _ in range(count)]
    numbers = inner[0] == _BASE and inner[1][0] not in ("string", "bool")
    return np.array(values, dtype=inner[1][0]) if numbers else values


def _base(name: str, rng: np.random.Generator) -> Any:
    if name == "string":
        return "abcdefghij"[: int(rng.integers(0, 10))]
    if name == "bool":
        return bool(rng.integers(2))
    if name.startswith("float"):
        return float(np.dtype(name).type(rng.normal()))
    limits = np.iinfo(name)
    return int(rng.integers(limits.min, limits.max, endpoint=True, dtype=name))


def packed(kind: str, message: Any) -> bytes:
    """As bytes."""
    return bytes(ROS2.serialize_cdr(message, full(kind)))


def packed_tree(*transforms: Any) -> bytes:
    """A message of /tf with these, as bytes."""
    return packed("tf2_msgs/TFMessage", TYPES["tf2_msgs/msg/TFMessage"](list(transforms)))


def read(kind: str, data: bytes) -> Any:
    """From bytes."""
    return ROS2.deserialize_cdr(data, full(kind))


def members(kind: str) -> list[tuple[str, str]]:
    """Name and type of each member, of which arrays say how long they are, in the words of `DEFINITIONS`."""
    return [(name, _said(what)) for name, what in ROS2.fielddefs[full(kind)][1]]


def _said(what: Any) -> str:
    node, of = what
    if node in (_BASE, _NAME):
        return (of[0] if node == _BASE else of).replace("/msg/", "/").replace("octet", "uint8")
    return f"{_said(of[0])}[{of[1] if node == _ARRAY else ''}]"


KINDS = sorted(DEFINITIONS)
