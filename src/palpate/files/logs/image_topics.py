"""Read the images of one topic of a log: one sample per message, in the order of the file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from palpate.files.logs.decoding import seconds
from palpate.files.logs.image_messages import image_messages
from palpate.files.logs.images import Frame, ImageLog
from palpate.files.logs.layout import ImageChannel, LogLayout
from palpate.files.logs.log import LogContents
from palpate.files.logs.topics import choose_images
from palpate.files.messages import MessageFile, Topic
from palpate.opencv import opencv
from palpate.signals.recording import Recording

__all__ = ["ImageTopicLog", "first_size"]

_FIRST = 2  # stamps that say whether a topic has any: a clock may begin at 0


class ImageTopicLog(ImageLog):
    """The images of a topic as a log; times are the stamps of the headers, or of the recorder if these are all 0."""

    def __init__(self, path: Path, layout: LogLayout, source: MessageFile) -> None:
        super().__init__(path, source.size, layout)
        self._source = source

    def contents(self) -> LogContents:
        """Return `LogContents` with the topics of the log, its duration and any damage.

        Raises:
            InputError: the log cannot be read.
        """
        topics = tuple(self._source.topics())
        return LogContents(self.path, {}, topics, self._source.torn, self._source.duration)

    def blocks(self) -> Iterator[Recording]:
        """Yield the images as recordings.

        Raises:
            InputError: no topic fits, no image can be decoded, the layout requests anything else than images, or OpenCV
                is not installed.
        """
        cv2 = self._begin("a log of topics that is read for images")
        topic = choose_images(self.contents(), self._layout.images or ImageChannel())
        stamped = _has_stamps(self._source, topic)
        if not stamped:
            taken = "the times at which they were recorded are used"
            self._said.append(f"messages of {topic.name!r} have no stamps: {taken}")
        yield from self._frames.blocks(self._read(cv2, topic, stamped=stamped))

    def notes(self) -> tuple[str, ...]:
        """Return notes on the file and its images so far, one sentence each."""
        return (*self._source.notes(), *super().notes())

    def _read(self, cv2: Any, topic: Topic, *, stamped: bool) -> Iterator[Frame]:
        count = 0
        for piece in self._source.messages([topic.name]):
            self.position = self._source.position
            messages = piece.of(topic)
            for recorded, message in zip(seconds(messages.time), image_messages(messages, topic), strict=True):
                count += 1
                time = float(recorded)
                if stamped:
                    time = np.nan if message.stamp is None else float(seconds(np.array([message.stamp]))[0])
                yield time, message.image(cv2), f"message {count}"
        self.torn = self._source.torn


def first_size(source: MessageFile, topic: Topic) -> tuple[int, int, int] | None:
    """Return height, width and channels of the first readable image of a topic; None if it has none.

    Raises:
        InputError: OpenCV is not installed.
    """
    cv2 = opencv()
    with closing(source.messages([topic.name])) as pieces:
        for piece in pieces:
            for message in image_messages(piece.of(topic), topic):
                if (size := message.size(cv2)) is not None:
                    return size
    return None


def _has_stamps(source: MessageFile, topic: Topic) -> bool:
    found: list[int] = []
    with closing(source.messages([topic.name])) as pieces:
        for piece in pieces:
            found += [each.stamp for each in image_messages(piece.of(topic), topic) if each.stamp is not None]
            if len(found) >= _FIRST:
                break
    return any(found[:_FIRST]) or not found
