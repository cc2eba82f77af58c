"""Read the messages of a ROS 1 or 2 bag through rosbags, and of a folder of MCAP files without it."""

from __future__ import annotations

import re
from collections.abc import Collection, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from palpate.errors import InputError, importing_extra
from palpate.files.inputs import open_input
from palpate.files.mcap.reader import McapFile
from palpate.files.messages import MessageBlock, MessageFile, Topic, merged

_MOST, _BYTES = 1 << 13, 1 << 22  # messages and bytes of a batch


def open_folder(path: Path) -> MessageFile:
    """Return the messages of a ROS 2 bag, a folder; one of MCAP files needs no metadata.yaml.

    Raises:
        InputError: the folder cannot be read, holds no bag, or holds MCAP files of several recordings.
    """
    try:
        files = [file for file in path.iterdir() if file.is_file()]
    except OSError as problem:
        raise InputError(f"cannot be read ({problem}).", where=str(path)) from problem
    parts = sorted((file for file in files if file.suffix == ".mcap"), key=natural)
    if len({re.sub(r"_\d+$", "", part.stem) for part in parts}) > 1:
        listed = ", ".join(part.name for part in parts[:5])
        what = f"holds MCAP files of several recordings: {listed}."
        raise InputError(what, where=str(path), hint="Name one of these.")
    if parts:
        return _Parts(path, [McapFile(part) for part in parts])
    if path / "metadata.yaml" not in files:
        what = "is a folder without metadata.yaml, so it is not a ROS 2 bag."
        raise InputError(what, where=str(path), hint="Name the log's file in it, such as its video.")
    return BagFile(path)


def natural(path: Path) -> tuple[str | int, ...]:
    """Return a sort key for a file's name, by which bag_2 comes before bag_10."""
    return tuple(int(part) if part.isdigit() else part for part in re.split(r"(\d+)", path.name))


class _Parts(MessageFile):
    """The MCAP files of one recording, read one after the other."""

    def __init__(self, path: Path, parts: list[McapFile]) -> None:
        super().__init__(path, sum(part.size for part in parts))
        self._parts = parts

    def topics(self) -> list[Topic]:
        found = merged(topic for part in self._parts for topic in part.topics())
        self.duration = sum(part.duration for part in self._parts)
        self._say_torn()
        return found

    def messages(self, names: Collection[str] = ()) -> Generator[MessageBlock]:
        done = 0
        for part in self._parts:
            for messages in part.messages(names):
                self.position = done + part.position
                yield messages
            done += part.size
        self._say_torn()

    def _say_torn(self) -> None:
        self.torn = "; ".join(f"{part.path.name}: {part.torn}" for part in self._parts if part.torn)

    def notes(self) -> tuple[str, ...]:
        return tuple(f"{part.path.name}: {note}" for part in self._parts for note in part.notes())


class BagFile(MessageFile):
    """A .bag file, a .db3 file or a folder of these; rosbags can read only an undamaged one.

    Raises:
        OSError: it does not exist, or its size cannot be read.
    """

    def __init__(self, path: Path) -> None:
        files = [path] if path.is_file() else [file for file in path.iterdir() if file.is_file()]
        super().__init__(path, sum(file.stat().st_size for file in files))

    def topics(self) -> list[Topic]:
        """Return the topics that the bag lists, with their message counts.

        Raises:
            InputError: the bag cannot be read, or rosbags is not installed.
        """
        with self._opened() as bag:
            self.duration = bag.duration / 1e9
            return _topics(bag)

    def messages(self, names: Collection[str] = ()) -> Generator[MessageBlock]:
        """Yield the messages of the topics in `names`, or of all if it is empty, in blocks.

        Raises:
            InputError: the bag is damaged, or rosbags is not installed.
        """
        self.position = 0
        with self._opened() as bag:
            topics = {key: topic for key, topic in enumerate(_topics(bag)) if not names or topic.name in names}
            keys = {topic.name: key for key, topic in topics.items()}
            wanted = [connection for connection in bag.connections if connection.topic in keys]
            total, done = sum(topic.count for topic in topics.values()), 0
            batch: list[tuple[int, int, bytes]] = []
            size = 0
            for connection, time, raw in bag.messages(wanted) if wanted else ():
                batch.append((keys[connection.topic], time, raw))
                size += len(raw)
                if len(batch) == _MOST or size > _BYTES:
                    done += len(batch)
                    self.position = min(self.size, self.size * done // max(total, 1))
                    yield _joined(batch, topics)
                    batch, size = [], 0
            self.position = self.size
            if batch:
                yield _joined(batch, topics)

    @contextmanager
    def _opened(self) -> Generator[Any]:
        """Yield rosbags' reader; its errors become InputErrors."""
        if self.path.is_file():
            open_input(self.path).close()
        with importing_extra("bags need rosbags", "ros", where=str(self.path)):
            from rosbags.rosbag1 import Reader as Reader1
            from rosbags.rosbag2 import Reader as Reader2
        try:
            with (Reader1 if self.path.suffix == ".bag" else Reader2)(self.path) as bag:
                yield bag
        except Exception as problem:
            what = f"is a bag that cannot be read ({type(problem).__name__}: {' '.join(str(problem).split())[:200]})."
            hint = "Repair a recording that was not finished with `rosbag reindex` or `ros2 bag reindex`."
            raise InputError(what, where=str(self.path), hint=hint) from problem


def _topics(bag: Any) -> list[Topic]:
    encoding = "ros1" if "rosbag1" in type(bag).__module__ else "cdr"
    return merged(
        Topic(each.topic, each.msgtype.replace("/msg/", "/"), encoding, each.msgcount, _definition(each))
        for each in bag.connections
    )


def _definition(connection: Any) -> str:
    """Return the definition of a type in the form of .msg files; "" if the bag has none."""
    stated = connection.msgdef
    return stated.data if stated.format.name == "MSG" else ""


def _joined(batch: list[tuple[int, int, bytes]], topics: dict[int, Topic]) -> MessageBlock:
    keys, times, raws = zip(*batch, strict=True)
    length = np.array([len(raw) for raw in raws])
    return MessageBlock(b"".join(raws), topics, np.array(keys), np.array(times), np.cumsum(length) - length, length)
