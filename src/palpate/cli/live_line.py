"""Print figures of a stream while `palpate live` runs, and when it ends."""

from __future__ import annotations

import re
import sys
import time
from datetime import datetime

import numpy as np

from palpate.console.console import Quantity, announce, lines
from palpate.contact.estimate import ROW, Status
from palpate.live.stream_buffer import StreamBuffer, latencies

__all__ = ["FigureLine", "summary"]

LOOKED_AT = 1 << 14  # samples from which latencies are taken


class FigureLine:
    """A line of figures since the last one, and new messages.

    Args:
        ring: ring of the stream.
        token: secret that opens the page; it is printed, but is in no record.
    """

    def __init__(self, ring: StreamBuffer, token: str) -> None:
        self._ring, self._event, self._token = ring, 0, token
        self._count, self._at = ring["answered"], time.monotonic()

    def sentences(self) -> None:
        """Print new messages, each with its time."""
        events, self._event = self._ring.events(self._event)
        for stamp, sentence in events:
            when = datetime.fromtimestamp(stamp / 1e9).strftime("%H:%M:%S")
            if sys.stderr.isatty():
                print("\r\x1b[K", end="", file=sys.stderr, flush=True)
            announce(f"{when} {self._opened(sentence)}")

    def _opened(self, sentence: str) -> str:
        """Return the message, with the token added to the page's address."""
        return re.sub(r"^(the page is at [^ ]*)", rf"\1/?token={self._token}", sentence)

    def line(self) -> None:
        """Print rate, contacts, latency and losses: in place on a terminal, else one below the other."""
        ring, now = self._ring, time.monotonic()
        count = ring["answered"]
        rate = (count - self._count) / max(now - self._at, 1e-9)
        slots, _ = ring.read(max(self._count, count - LOOKED_AT), LOOKED_AT)
        self._count, self._at = count, now
        waited = ", ".join(f"{what} {text}" for what, text in latency(ring, slots))
        words = [f"{rate:7,.0f} Hz", contacts(slots), waited and f"latency {waited}", f"{ring['lost']:,} lost"]
        if recorded := ring["recorded"]:
            words.append(f"{recorded:,} recorded")
        text = "  ".join(word for word in words if word)
        if sys.stderr.isatty():
            print(f"\r\x1b[Kpalpate: {text}", end="", file=sys.stderr, flush=True)
        else:
            announce(text)


def contacts(slots: np.ndarray) -> str:
    """Return text on the last of some slots: number of contacts, largest force [N], its place [mm]; or the status."""
    if not len(slots):
        return "no samples"
    rows = slots["contacts"][-1][: int(slots["rows"][-1])]
    status = rows[:, ROW.status]
    touching = rows[(status == Status.CONTACT) | (status == Status.AMBIGUOUS)]
    if not len(touching):
        return Status(int(status[0])).words if len(rows) else "not answered"
    force = np.linalg.norm(touching[:, ROW.force], axis=1)
    x, y, z = 1e3 * touching[int(np.argmax(force)), ROW.point]
    several = f"{len(touching)} contacts, strongest " if len(touching) > 1 else "contact "
    return f"{several}{force.max():.2f} N at ({x:.1f}, {y:.1f}, {z:.1f}) mm"


def latency(ring: StreamBuffer, slots: np.ndarray) -> list[tuple[str, str]]:
    """Return names and texts of the latencies of some slots, from arrival to contact and to publication, if known."""
    known = (("sample to contact", latencies(slots)), ("sample to published", ring.published()))
    return [(what, _percentiles(waited)) for what, waited in known if len(waited)]


def _percentiles(waited: np.ndarray) -> str:
    middle, most, worst = (1e6 * np.percentile(waited, share) for share in (50, 99, 100))
    return f"{middle:,.0f} us (99 %: {most:,.0f}, worst {worst:,.0f})"


def summary(ring: StreamBuffer) -> None:
    """Print the figures of a stream that has ended: what became of every sample that was sent, and latencies."""
    received, answered, recorded, lost = (ring[word] for word in ("received", "answered", "recorded", "lost"))
    lines([("samples", Quantity(f"{received:,} received, {answered:,} answered", received))])
    lines([("lost", Quantity(_losses(ring), lost))])
    if recorded:
        lines([("recorded", Quantity(f"{recorded:,} samples, {ring['bytes'] / 1e6:,.1f} MB", recorded))])
    slots, _ = ring.read(answered - LOOKED_AT, LOOKED_AT)
    lines(latency(ring, slots))


def _losses(ring: StreamBuffer) -> str:
    """Return text on the samples that were sent and not received, by the sender's counter."""
    text = f"{ring['lost']:,} samples"
    if away := ring["away"]:
        text += f", {away:,} of them while the receiver did not run"
    if unknown := ring["unknown"]:
        text += f", and {unknown:,} times an unknown number: a device or receiver restarted, and no counter went on"
    return text
