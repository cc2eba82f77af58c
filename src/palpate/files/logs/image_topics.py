"""Read the images of one topic of a log: one sample per message, in the order of the file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from palpate.files.logs.decoding import seconds
from palpate.files.logs.image_messages import image_messages
from palpate.files.logs.images import Frame, ImageLog
from palpate.files.logs.layout import ImageChannel, LogLayout
from palpate.files.logs.log import LogContents
from palpate.files.logs.topics import choose_images
from palpate.files.messages import MessageBlock, MessageFile, Topic
from palpate.opencv import opencv
from palpate.signals.recording import Recording


class ImageTopicLog(ImageLog):
    """The images of one topic as a log; times are the headers' stamps, or the recorder's if these are all 0."""

    def __init__(self, path: Path, layout: LogLayout, source: MessageFile) -> None:
        super().__init__(path, source.size, layout)
        self._source = source

    def contents(self) -> LogContents:
        """Return the topics of the log, its duration and any damage.

        Raises:
            InputError: the log cannot be read.
        """
        topics = tuple(self._source.topics())
        return LogContents(self.path, {}, topics, self._source.torn, self._source.duration)

    def blocks(self) -> Iterator[Recording]:
        """Yield the images as recordings.

        Raises:
            InputError: the log cannot be read; no topic fits, or several do; no image can be decoded; the layout
                requests anything but images; or OpenCV is not installed.
        """
        cv2 = self._begin("a log of topics that is read for images")
        topic = choose_images(self.contents(), self._layout.images or ImageChannel())
        stamped = self._source.has_stamps(topic, lambda messages: _stamps(messages, topic))
        if not stamped:
            taken = "the times at which they were recorded are used"
            self._said.append(f"messages of {topic.name!r} have no stamps: {taken}")
        yield from self._recordings(self._read(cv2, topic, stamped=stamped))

    def notes(self) -> tuple[str, ...]:
        """Return notes on the file and the images read so far, one sentence each."""
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
        InputError: the file cannot be read, or OpenCV is not installed.
    """
    cv2 = opencv()

    def size(messages: MessageBlock) -> tuple[int, int, int] | None:
        sizes = (message.size(cv2) for message in image_messages(messages, topic))
        return next((each for each in sizes if each is not None), None)

    return source.first(topic, size)


def _stamps(messages: MessageBlock, topic: Topic) -> Iterator[int]:
    return (message.stamp for message in image_messages(messages, topic) if message.stamp is not None)
