"""Make message types of ROS 2 known to DDS."""

from __future__ import annotations

from functools import cache
from typing import Any

from palpate.errors import InputError
from palpate.files.message_types import DEFINITIONS
from palpate.files.units import near


class Raw:
    """The bytes of one message for cyclonedds, which sets `sample_info` of a received one: the time of sending."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.sample_info: Any = None


def ros_type_name(name: str) -> str:
    """Return the name in ROS of a type of DDS: "geometry_msgs::msg::dds_::Wrench_" -> "geometry_msgs/Wrench".

    Another form stays as it is.
    """
    package, between, last = name.partition("::msg::dds_::")
    return f"{package}/{last.removesuffix('_')}" if between else name


@cache
def idl_type(kind: str) -> Any:
    """Return the class by which cyclonedds knows a message type; its messages stay bytes, as in `Raw`.

    Raises:
        InputError: the type is none of `DEFINITIONS`.
        ImportError: cyclonedds is not installed.
    """
    from cyclonedds.idl import make_idl_struct

    if kind not in DEFINITIONS:
        hint = near(kind, DEFINITIONS)
        raise InputError(f"messages of {kind} cannot be read or written.", where="ROS 2", hint=hint)
    members = {name: _member(what) for what, name in (each.split(" ") for each in DEFINITIONS[kind].split(", "))}
    package, _, name = kind.partition("/")
    made: Any = make_idl_struct(f"{name}_", f"{package}::msg::dds_::{name}_", members, dataclassify=False)
    made.__init__ = Raw.__init__
    made.serialize = _serialize
    made.deserialize = made.deserialize_key = classmethod(_deserialize)  # a key comes when a publisher leaves
    return made


def _serialize(self: Any, **_: object) -> bytes:
    return self.data


def _deserialize(cls: Any, data: bytes, **_: object) -> Any:
    return cls(data)


def _member(what: str) -> Any:
    from cyclonedds.idl import types

    name, bracket, size = what.partition("[")
    if bracket:
        inner = _member(name)
        return types.sequence[inner] if size == "]" else types.array[inner, int(size[:-1])]
    if "/" in name:
        return idl_type(name)
    return {"string": str, "bool": bool}.get(name) or getattr(types, name)
