"""Run the page of `palpate live --view`: a process that reads the ring and feeds a page in the browser."""

from __future__ import annotations

import gc
import signal
import time
from collections import deque
from datetime import datetime
from pathlib import Path

import numpy as np

from palpate.contact.contacts import Contacts
from palpate.errors import PalpateError
from palpate.live.receiver import orphaned
from palpate.live.stream_buffer import StreamBuffer, latencies
from palpate.setup import load_rig
from palpate.setup.view import Feed, layers_of, view_of
from palpate.viewer.live import SECONDS, SILENT, LivePage, StreamFigures, recent

TICK = 1 / 30  # s between two pictures
IDLE = 0.25  # s between two looks at the ring while nobody watches
SHARE = 0.1  # of a core, at most
SAVED = 0.05  # s of a core that may be taken at once
REPORTED = 0.25  # s between two figures
COUNTED = 0.5  # s between two counts of latencies
MOST = 1 << 13  # slots that are read at once
IMAGES = 1 << 24  # bytes of images that are read at once
SENTENCES = 12
RATED = 2.0  # s over which a rate is counted
_GATHERED = ["number", "stamp", "arrived", "ready", "rows", "contacts"]  # of a slot: no images


def show(ring: Path, rig: Path, sensor: str | None, host: str, port: int, token: str, parent: int) -> None:
    """Serve the page, in a separate process, until the ring requests the stop or the parent is gone.

    An error of the rig or the page is written into the ring as a sentence; then the process waits for the end.

    Args:
        ring: file of the stream.
        rig: rig of the stream.
        sensor: name of the sensor, if the rig is of a robot.
        host: address to serve at.
        port: the first to try; if it is taken, the next free one is used.
        token: secret that opens the page; it is not written into the ring.
        parent: id of the parent process.

    Raises:
        InputError: the ring cannot be opened.
        GeometryError: the mesh has no usable surface, or an implicit surface cannot be drawn.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's, which says stop
    read = StreamBuffer(ring)
    try:
        setup = load_rig(rig, sensor).resolve(read.form.sensor)
        view, layers = view_of(setup.kind), layers_of(setup, live=read.form.shape)
        stream = Stream(read, view.feed(setup, lambda: read["done"], layers))
        with LivePage(view.body(setup), layers, rig.stem, stream.tare, host, port, token) as page:
            gc.collect()
            gc.freeze()  # or it looks through all that is here to stay, again and again
            taken = "" if port in (0, page.port) else f" (port {port} is taken)"
            read.say(f"the page is at {page.address.partition('/?')[0]}{taken}")
            _serve(page, stream, parent)
    except PalpateError as problem:
        read.say(f"the page cannot be shown: {problem}")
        _wait(read, parent)
    finally:
        read.close()


def _wait(ring: StreamBuffer, parent: int) -> None:
    """Wait until the end, as a new process would meet the same error."""
    while not ring["stop"] and not orphaned(parent):
        time.sleep(IDLE)


def _serve(page: LivePage, stream: Stream, parent: int) -> None:
    """Read the ring, and draw new contacts while a browser is connected, with a limited share of a core."""
    reported, drawn, saved = -np.inf, -1, SAVED
    due = last = time.monotonic()
    spent = time.process_time()
    while not stream.ring["stop"] and not orphaned(parent):
        begun, watched = time.monotonic(), page.watched
        stream.look(watched)
        with page.at_once():
            if watched and stream.next_one != drawn and (newest := stream.newest) is not None:
                page.show(newest)
                drawn = stream.next_one
            if begun - reported >= REPORTED:
                stream.gather()
                reported = begun
                if watched:
                    page.tell(stream.window, stream.figures())
        now = time.process_time()
        saved += SHARE * (begun - last) - (now - spent)
        saved = min(max(saved, -SHARE * IDLE), SAVED)  # no debt of minutes, once a slow spell is over
        last, spent = begun, now
        pause = max(TICK, -saved / SHARE) if watched else IDLE
        due = max(due + pause, begun)  # where the last picture came late, the next one makes up for it
        time.sleep(max(0.001, due - time.monotonic()))


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
        self._events = deque[tuple[str, str]](maxlen=SENTENCES)
        self._tare = ""

    def tare(self, browser: str) -> None:
        """Request a tare, for a browser at that address."""
        self.ring.ask_tare(f"the page ({browser})")

    def look(self, watched: bool) -> None:
        """Read new slots and pass them to the feed; `watched`: a browser is connected."""
        now = time.monotonic()
        received, answered = self.ring["received"], self.ring["answered"]
        if received != self._received:
            self._received, self._at = received, now
        self._counts.append((now, received))
        while self._counts[0][0] < now - RATED:
            self._counts.popleft()
        since = max(self.next_one, answered - self._most)
        slots, first = self.ring.read(since, self._most)
        self._skipped += first - self.next_one
        self.next_one = first + len(slots)
        if len(slots):
            self._fresh.append(slots)
            self._last, self._fed = slots[-1:], watched
            self._feed(slots, watched)
        elif watched and not self._fed and self._last is not None:  # the stream stands still since before they came
            self._fed = True
            self._feed(self._last, watched)

    @property
    def newest(self) -> Contacts | None:
        """`Contacts` of the last sample that was read; None where it has no answer."""
        if self._last is None:
            return None
        found = self.ring.form.contacts(self._last)
        return found if len(found) else None

    def gather(self) -> None:
        """Add the slots read since the last call to the window and the figures."""
        now = time.monotonic()
        while self._waited and self._waited[0][0] < now - SECONDS:
            self._waited.popleft()
        if not self._fresh:
            return
        fresh = np.concatenate([slots[_GATHERED] for slots in self._fresh])
        self._fresh.clear()
        self._waited.append((now, latencies(fresh)))
        if len(found := self.ring.form.contacts(fresh)):
            self.window = recent(self.window, found)

    def figures(self) -> StreamFigures:
        """Return the current `StreamFigures`: rate, latency, losses, events."""
        ring, now = self.ring, time.monotonic()
        events, self._sentence = ring.events(self._sentence)
        for stamp, sentence in events:
            self._events.append((datetime.fromtimestamp(stamp / 1e9).strftime("%H:%M:%S"), sentence))
            self._tare = sentence if "tare" in sentence else self._tare
        (begun, before), (end, count) = self._counts[0], self._counts[-1]
        return StreamFigures(
            rate=(count - before) / (end - begun) if end > begun else 0.0,
            latency=self._waiting(now),
            lost=ring["lost"],
            skipped=self._skipped,
            silent=round(now - self._at, 0 if now - self._at > SILENT else 6),
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
