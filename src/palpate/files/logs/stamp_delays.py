"""Find how long after their stamps messages were recorded, which shows a clock that is off."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice

import numpy as np

from palpate.files.logs.cursor import Cursor
from palpate.files.logs.decoding import has_header
from palpate.files.logs.message_fields import defines_header
from palpate.files.messages import MessageFile

_BLOCKS = 50  # of the file that are looked at


def stamp_delays(source: MessageFile, names: Sequence[str]) -> dict[str, float]:
    """Return topic -> median time [s] from a message's stamp to its recording, of topics with headers.

    Messages at the start of the log are looked at.

    Raises:
        InputError: the file cannot be read.
    """
    headed = [
        topic for topic in source.topics() if topic.name in names and (has_header(topic.kind) or defines_header(topic))
    ]
    waited: dict[str, list[np.ndarray]] = {topic.name: [] for topic in headed}
    for messages in islice(source.messages(list(waited)), _BLOCKS) if headed else ():
        for topic in headed:
            own = messages.of(topic)
            cursor = Cursor(own, topic.encoding)
            stamp, _, _ = cursor.header()
            known = cursor.sound & (stamp > 0)
            waited[topic.name].append((own.time - stamp)[known] / 1e9)
    joined = {name: np.concatenate([np.empty(0), *parts]) for name, parts in waited.items()}
    return {name: float(np.median(each)) for name, each in joined.items() if len(each)}
