"""Read numbers from messages of any type by a field path, with the definition that the log has of the type."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Int

from palpate.files.logs.cursor import Cursor
from palpate.files.messages import Topic

_CODES = {
    **{"bool": "u1", "byte": "u1", "char": "u1", "time": "u4", "duration": "u4", "float32": "f4", "float64": "f8"},
    **{f"{kind}{8 * size}": f"{kind[0]}{size}" for kind in ("int", "uint") for size in (1, 2, 4, 8)},
}
_PAIRS = ("time", "duration")  # of ROS 1: two numbers each
_MEMBER = re.compile(r"([\w/]+)(?:<=\d+)?(\[(?:<=)?(\d*)\])?\s+(\w+)\s*(?:#.*)?")
_PART = re.compile(r"(\w+)(?:\[(\d*)\])?")
_DEEPEST = 4  # messages in messages
_MOST = 1 << 12  # messages in a list


@dataclass(frozen=True)
class _Member:
    """A member of a message: type, name, and count: None for one, 0 for a list of any length, n for n."""

    kind: str
    name: str
    count: int | None = None

    @property
    def code(self) -> str | None:
        """NumPy's code of a number; None for strings and messages."""
        return _CODES.get(self.kind)


_Types = Mapping[str, Sequence[_Member]]


@lru_cache(maxsize=64)
def _types(definition: str, kind: str) -> _Types:
    """Return the members of each type in a definition, in which the topic's own type `kind` comes first.

    A type that contains itself, or has two members of one name, is left out, and so is what contains it.
    """
    found: dict[str, list[_Member]] = {}
    for k, text in enumerate(re.split(r"^=+\s*$", definition, flags=re.MULTILINE)):
        name, body = kind, text
        if k:
            head, _, body = text.strip().partition("\n")
            name = head.removeprefix("MSG:").strip()
        matches = [_MEMBER.fullmatch(line.strip()) for line in body.splitlines()]
        found[name.replace("/msg/", "/")] = [_member(match, name) for match in matches if match]
    unread = {name: own for name, own in found.items() if len({each.name for each in own}) == len(own)}
    sound = dict[str, list[_Member]]()
    while more := [
        name for name in unread if all(each.kind in sound or each.kind not in found for each in unread[name])
    ]:
        sound |= {name: unread.pop(name) for name in more}
    return sound


def _member(match: re.Match[str], inside: str) -> _Member:
    kind, count = match[1].replace("/msg/", "/"), None
    if match[2] is not None:
        count = int(match[3]) if match[3] and "<=" not in match[2] else 0
    if kind == "Header":
        kind = "std_msgs/Header"
    elif "/" not in kind and kind not in _CODES and kind not in ("string", "wstring"):
        kind = f"{inside.partition('/')[0]}/{kind}"
    return _Member(kind, match[4], count)


def paths_of(topic: Topic) -> list[str]:
    """Return the field paths of the lists of numbers in a topic's messages, such as `data` or `sensors[0].values`."""
    types = _types(topic.definition, topic.kind)
    return list(_paths(types, topic.kind, _DEEPEST)) if topic.definition else []


def _paths(types: _Types, kind: str, deepest: int) -> Iterator[str]:
    for member in types.get(kind, ()) if deepest else ():
        if member.code is not None and member.count is not None:
            yield member.name
        if member.kind not in types or member.kind == "std_msgs/Header":
            continue
        index = "" if member.count is None else "[0]"
        yield from (f"{member.name}{index}.{path}" for path in _paths(types, member.kind, deepest - 1))
        if member.count is not None:
            numbers = (each for each in types[member.kind] if each.code is not None and each.count is None)
            yield from (f"{member.name}[].{each.name}" for each in numbers)


def defines_header(topic: Topic) -> bool:
    """Return whether the definition of a topic's type begins with a header."""
    members = _types(topic.definition, topic.kind).get(topic.kind, ()) if topic.definition else ()
    return [member.kind for member in members[:1]] == ["std_msgs/Header"]


def field_of(topic: Topic, path: str, axes: tuple[str, ...] = ()) -> FieldPath | None:
    """Return the reader of a field path; None if the messages of the topic have no such list of numbers.

    With axes, the path may be that of a list of messages ("taxels[]"), each with a number of every axis.
    """
    generic, known = re.sub(r"\[\d+\]", "[0]", path.removesuffix("[]")), paths_of(topic)
    listed = bool(axes) and {f"{generic}[].{axis}" for axis in axes} <= {*known}
    return FieldPath(topic, path.removesuffix("[]"), axes if listed else ()) if listed or generic in known else None


class FieldPath:
    """A reader of one list of numbers in the messages of one type.

    Attributes:
        stamped: whether the messages begin with a header.
    """

    def __init__(self, topic: Topic, path: str, members: tuple[str, ...] = ()) -> None:
        self._types, self._kind, self._members = _types(topic.definition, topic.kind), topic.kind, members
        self._parts = [(match[1], match[2]) for match in _PART.finditer(path)]
        self.stamped = defines_header(topic)

    def count(self, cursor: Cursor) -> Int[np.ndarray, " n"]:
        """Return how many numbers each message has."""
        return self._read(cursor, self._kind, self._parts, None)[:, 0]

    def read(self, cursor: Cursor, count: int) -> np.ndarray:
        """Return numbers (n, count) as stored; `sound` of the cursor marks messages with another count."""
        return self._read(cursor, self._kind, self._parts, count)

    def _read(
        self, cursor: Cursor, kind: str, parts: Sequence[tuple[str, str | None]], count: int | None
    ) -> np.ndarray:
        (name, index), rest = parts[0], parts[1:]
        for member in self._types[kind]:
            if member.name != name:
                self._skip(cursor, member)
                continue
            if member.count is None:
                return self._read(cursor, member.kind, rest, count)
            held = self._held(cursor, member)
            if member.code is None and index:
                cursor.sound &= held > int(index)
                for _ in range(int(index)):
                    self._skip(cursor, _Member(member.kind, ""))
                return self._read(cursor, member.kind, rest, count)
            held = held * max(1, len(self._members))
            if count is None:
                return held[:, None]
            cursor.sound &= held == count
            if member.code is not None:
                return cursor.numbers(member.code, count)
            names = self._members or (rest[0][0],)
            each = [self._some(cursor, member.kind, names) for _ in range(count // len(names))]
            return np.concatenate(each, axis=1)
        raise KeyError(name)

    def _some(self, cursor: Cursor, kind: str, names: tuple[str, ...]) -> np.ndarray:
        """Return numbers (n, k) of a message by the names of its members, and go on to its end."""
        found = np.zeros((len(cursor.at), len(names)))
        for member in self._types[kind]:
            if member.name in names and member.code is not None:
                found[:, names.index(member.name)] = cursor.numbers(member.code, 1)[:, 0]
            else:
                self._skip(cursor, member)
        return found

    def _held(self, cursor: Cursor, member: _Member) -> Int[np.ndarray, " n"]:
        """Return how many of a list there are, and go on to the first."""
        return cursor.number() if not member.count else np.full(len(cursor.at), member.count)

    def _skip(self, cursor: Cursor, member: _Member) -> None:
        count = np.ones(len(cursor.at), dtype=np.int64) if member.count is None else self._held(cursor, member)
        if member.code is not None:
            cursor.skip(int(member.code[1]), count * (1 + (member.kind in _PAIRS)))
            return
        cursor.sound &= count <= _MOST
        for k in range(int(count[cursor.sound].max(initial=0))):
            _where(cursor, cursor.sound & (count > k), lambda: self._pass(cursor, member.kind))

    def _pass(self, cursor: Cursor, kind: str) -> None:
        """Skip a string or a message."""
        if kind in self._types:
            for member in self._types[kind]:
                self._skip(cursor, member)
        elif kind == "string":
            cursor.text()
        else:
            cursor.sound &= False


def _where(cursor: Cursor, mask: Bool[np.ndarray, " n"], read: Callable[[], None]) -> None:
    """Advance the messages of a mask only."""
    at, sound = cursor.at, cursor.sound.copy()
    read()
    cursor.at, cursor.sound = np.where(mask, cursor.at, at), np.where(mask, cursor.sound, sound)
