"""Hold what the live page shows of a stream: the newest contacts, those of the last seconds, and figures."""

from __future__ import annotations

import time
from collections import deque

import numpy as np

from palpate.contact.contacts import Contacts
from palpate.live.stream_buffer import StreamBuffer, latencies
from palpate.setup.view import Feed
from palpate.viewer.live import SECONDS, SILENT, StreamFigures, recent

COUNTED = 0.5  # s between two counts of latencies
MOST = 1 << 13  # slots that are read at once
IMAGES = 1 << 24  # bytes of images that are read at once
SENTENCES = 12
RATED = 2.0  # s over which a rate is counted
_GATHERED = ["number", "stamp", "arrived", "ready", "rows", "contacts"]  # of a slot: no images


class Stream:
    """Data of a stream for the page: contacts of the last seconds, and figures.

    Args:
        ring: ring of the stream.
        feed: called with new slots, and whether a browser is connected.

    Attributes:
        next_one: number of the first sample that was not read yet.
        window: contacts of the last seconds; None before the first.
    """

    def __init__(self, ring: StreamBuffer, feed: Feed) -> None:
        self.ring, self._feed = ring, feed
        self.next_one = ring["answered"]
        self.window: Contacts | None = None
        size = ring.form.slot().itemsize
        self._most = max(1, min(MOST, IMAGES // size))
        self._skipped = self._sentence = 0
        self._waited = deque[tuple[float, np.ndarray]]()
        self._counts = deque[tuple[float, int]]()
        self._fresh = list[np.ndarray]()
        self._last: np.ndarray | None = None  # slot
        self._fed = True  # the layers have what somebody who watches is to see of it
        self._latency: tuple[float, tuple[float, float, float] | None] = -np.inf, None
        self._received, self._at = -1, time.monotonic()
        self._events = deque[tuple[int, str]](maxlen=SENTENCES)
        self._tare = ""

    def tare(self, browser: str) -> None:
        """Request a tare, for a browser at that address."""
        self.ring.ask_tare(f"the page ({browser})")

    def look(self, watched: bool, most: int | None = None) -> None:
        """Read new slots, at most `most`, and pass them to the feed; `watched`: a browser is connected."""
        now = time.monotonic()
        received, answered = self.ring["received"], self.ring["answered"]
        if received != self._received:
            self._received, self._at = received, now
        self._counts.append((now, received))
        while self._counts[0][0] < now - RATED:
            self._counts.popleft()
        most = most or self._most
        slots, first = self.ring.read(max(self.next_one, answered - most), most)
        self._skipped += (first - self.next_one) * watched
        self.next_one = first + len(slots)
        if len(slots):
            self._fresh.append(slots)
            self._last, self._fed = slots[-1:], watched
            self._feed(slots, watched)
        elif watched and not self._fed and self._last is not None:  # the stream stands still since before they came
            self._fed = True
            self._feed(self._last, watched)

    @property
    def silent(self) -> float:
        """Time [s] since a sample was received."""
        return time.monotonic() - self._at

    @property
    def newest(self) -> Contacts | None:
        """`Contacts` of the last sample that was read; None where it has no answer."""
        if self._last is None:
            return None
        found = self.ring.form.contacts(self._last)
        return found if len(found) else None

    def gather(self) -> None:
        """Add the slots read since the last call to the window and the figures."""
        fresh = self.count()
        if fresh is not None and len(found := self.ring.form.contacts(fresh)):
            self.window = recent(self.window, found)

    def count(self) -> np.ndarray | None:
        """Add the slots read since the last call to the figures, and return them without images; None without any."""
        now = time.monotonic()
        while self._waited and self._waited[0][0] < now - SECONDS:
            self._waited.popleft()
        if not self._fresh:
            return None
        fresh = np.concatenate([slots[_GATHERED] for slots in self._fresh])
        self._fresh.clear()
        self._waited.append((now, latencies(fresh)))
        return fresh

    def figures(self) -> StreamFigures:
        """Return the current `StreamFigures`: rate, latency, losses, events."""
        ring, now = self.ring, time.monotonic()
        events, self._sentence = ring.events(self._sentence)
        self._events.extend(events)
        self._tare = next((text for _, text in reversed(events) if "tare" in text), self._tare)
        (begun, before), (end, count) = self._counts[0], self._counts[-1]
        return StreamFigures(
            rate=(count - before) / (end - begun) if end > begun else 0.0,
            latency=self._waiting(now),
            lost=ring["lost"],
            skipped=self._skipped,
            silent=round(self.silent, 0 if self.silent > SILENT else 6),
            samples=ring["received"],
            taring=ring["asked"] > ring["done"],
            tare=self._tare,
            events=tuple(self._events),
        )

    def _waiting(self, now: float) -> tuple[float, float, float] | None:
        """Return median, 99 % and worst latency [s]; None if the stamps are unrelated to this machine's clock."""
        if now - self._latency[0] > COUNTED:
            waited = np.concatenate([np.zeros(0), *(part for _, part in self._waited)])
            middle, most, worst = np.percentile(waited, (50.0, 99.0, 100.0)).tolist() if len(waited) else [0.0] * 3
            self._latency = now, (middle, most, worst) if len(waited) else None
        return self._latency[1]
