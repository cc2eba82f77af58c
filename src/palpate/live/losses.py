"""Count the samples that were sent and not received, also over restarts of the receiver."""

from __future__ import annotations

from palpate.live.source import CountingSource, Source
from palpate.live.stream_buffer import StreamBuffer


class LossCount:
    """A count of losses in a ring, which continues where an earlier receiver was killed.

    Samples that arrive late are no losses. Where the sender does not count, or its counters restart, the number of
    missing samples is unknown, and the ring counts how often.

    Args:
        ring: the ring, with the samples of an earlier receiver if there was one.
        source: the open source, before its first sample.
    """

    def __init__(self, ring: StreamBuffer, source: Source) -> None:
        self._ring, self._source = ring, source if isinstance(source, CountingSource) else None
        self._late = self._unknown = 0
        self._resumed, (self._stored, *position) = ring["received"] > 0, ring.position or (0,)
        self._known = self._source is not None and len(position) > 0
        if self._source is not None and self._resumed and position:
            self._source.resume(tuple(position))

    def add(self, count: int, lost: int) -> str:
        """Count what was lost before a batch that was just stored, and return an event, a sentence, or "".

        Args:
            count: number of samples in the batch.
            lost: number of samples missing before the first of them.
        """
        ring, source = self._ring, self._source
        if source is not None:
            ring["lost"] -= source.late - self._late
            ring["unknown"] += source.unknown - self._unknown
            self._late, self._unknown = source.late, source.unknown
        event = self._missed(count, lost) if self._resumed else ""
        if source is not None:
            ring.position = (ring["received"], *source.position())
        return event

    def _missed(self, count: int, lost: int) -> str:
        """Count what was sent while no receiver ran."""
        ring, self._resumed = self._ring, False
        if not self._known or self._unknown:
            ring["unknown"] += not self._unknown
            return (
                "an unknown number of samples was sent while the receiver did not run: no counter of the device went on"
            )
        stored = ring["received"] - count - self._stored  # by the earlier receiver, after it had noted its position
        ring["lost"] -= stored
        ring["away"] += lost - stored
        return f"{lost - stored:,} samples were sent while the receiver did not run, by the device's counter"
