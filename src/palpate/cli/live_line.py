"""Print figures of a stream while `palpate live` runs, and when it ends."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Mapping
from datetime import datetime
from typing import NamedTuple

import numpy as np

from palpate.console.console import Quantity, announce, lines, note, title
from palpate.contact.estimate import ROW, Status
from palpate.live.stream_buffer import StreamBuffer, latencies

__all__ = ["FigureLine", "summary"]

FEW = 0.01  # of the newest samples: the first have no pose yet
LOOKED_AT = 1 << 14  # samples from which latencies are taken, at most


class FigureLine:
    """A line of figures since the last one, and new messages.

    Args:
        rings: name of a sensor -> ring of its stream; the name matters where there are several.
        token: secret that opens the page; it is printed, but is in no record.
    """

    def __init__(self, rings: Mapping[str, StreamBuffer], token: str) -> None:
        self._token, self._at = token, time.monotonic()
        self._streams = {name: _Counted(ring) for name, ring in rings.items()}

    def sentences(self) -> None:
        """Print new messages, each with its time, and of several sensors after the name."""
        for name, stream in self._streams.items():
            events, stream.event = stream.ring.events(stream.event)
            for stamp, sentence in events:
                when = datetime.fromtimestamp(stamp / 1e9).strftime("%H:%M:%S")
                if sys.stderr.isatty():
                    print("\r\x1b[K", end="", file=sys.stderr, flush=True)
                opened = self._opened(sentence)
                whose = f"{name}: " if len(self._streams) > 1 and opened == sentence else ""  # the page is of all
                announce(f"{when} {whose}{opened}")

    def _opened(self, sentence: str) -> str:
        """Return the message, with the token added to the page's address."""
        return re.sub(r"^(the page is at [^ ]*)", rf"\1/?token={self._token}", sentence)

    def line(self) -> None:
        """Print rate, contacts, latency and losses: in place on a terminal, else one below the other."""
        now = time.monotonic()
        span, self._at = max(now - self._at, 1e-9), now
        taken = {name: stream.take() for name, stream in self._streams.items()}
        words = self._of_one(taken, span) if len(taken) == 1 else self._of_robot(taken, span)
        text = "  ".join(word for word in words if word)
        if sys.stderr.isatty():
            print(f"\r\x1b[Kpalpate: {text}", end="", file=sys.stderr, flush=True)
        else:
            announce(text)

    def _of_one(self, taken: Mapping[str, _Taken], span: float) -> list[str]:
        found, ring = next(iter(taken.values())), next(iter(self._streams.values())).ring
        waited = ", ".join(f"{what} {text}" for what, text in latency(ring, found.times))
        recorded = f"{ring['recorded']:,} recorded" if ring["recorded"] else ""
        figures = [f"{found.new / span:7,.0f} Hz", contacts(found.last), waited and f"latency {waited}"]
        return [*figures, f"{ring['lost']:,} lost", recorded]

    def _of_robot(self, taken: Mapping[str, _Taken], span: float) -> list[str]:
        """Return texts on all sensors: number, contacts, the worst latency, losses, and which are silent."""
        sensors = {name: each.ring for name, each in self._streams.items() if not each.ring.form.joints}
        rate = sum(taken[name].new for name in sensors) / span
        force = {name: np.linalg.norm(touching(taken[name].last)[:, ROW.force], axis=1) for name in sensors}
        number = sum(map(len, force.values()))
        words = [f"{len(sensors)} sensors {rate:,.0f} Hz", f"{number} contact{'' if number == 1 else 's'}"]
        if number:
            name = max(force, key=lambda each: float(force[each].max(initial=0.0)))
            words[-1] += f", strongest {name} {force[name].max():.2f} N"
        waited = [latencies(taken[name].times) for name in sensors]
        worst = max((float(each.max()) for each in waited if len(each)), default=0.0)
        silent = [name for name, each in self._streams.items() if not taken[name].new and not each.ring["ended"]]
        return [
            *words,
            f"latency at worst {1e6 * worst:,.0f} us" if worst else "",
            f"{sum(ring['lost'] for ring in sensors.values()):,} lost",
            f"{recorded:,} recorded" if (recorded := sum(ring["recorded"] for ring in sensors.values())) else "",
            f"silent: {', '.join(silent)}" if silent else "",
        ]


class _Taken(NamedTuple):
    """The number of samples since the last line, the last slot, and the times of the last slots."""

    new: int
    last: np.ndarray
    times: np.ndarray


class _Counted:
    """A ring, and what of it was printed."""

    def __init__(self, ring: StreamBuffer) -> None:
        self.ring, self.event, self._count = ring, 0, ring["answered"]

    def take(self) -> _Taken:
        """Return what was answered since the last call."""
        count, before = self.ring["answered"], self._count
        self._count = count
        last = self.ring.read(max(before, count - 1), 1)[0]
        return _Taken(count - before, last, _times(self.ring, before))


def _times(ring: StreamBuffer, since: int = 0) -> np.ndarray:
    """Return the times of the newest slots from sample `since` on, as `latencies` takes them."""
    return ring.read(max(since, ring["answered"] - LOOKED_AT), LOOKED_AT, fields=("arrived", "ready"))[0]


def touching(slots: np.ndarray) -> np.ndarray:
    """Return the rows of the contacts in the last of some slots, (k, width)."""
    rows = slots["contacts"][-1:].reshape(-1, slots["contacts"].shape[-1])[: int(slots["rows"][-1:].sum())]
    status = rows[:, ROW.status]
    return rows[(status == Status.CONTACT) | (status == Status.AMBIGUOUS)]


def contacts(slots: np.ndarray) -> str:
    """Return text on the last of some slots: number of contacts, largest force [N], its place [mm]; or the status."""
    if not len(slots):
        return "no samples"
    found = touching(slots)
    if not len(found):
        known = slots["rows"][-1] > 0
        return Status(int(slots["contacts"][-1][0, ROW.status])).words if known else "not answered"
    force = np.linalg.norm(found[:, ROW.force], axis=1)
    x, y, z = 1e3 * found[int(np.argmax(force)), ROW.point]
    several = f"{len(found)} contacts, strongest " if len(found) > 1 else "contact "
    return f"{several}{force.max():.2f} N at ({x:.1f}, {y:.1f}, {z:.1f}) mm"


def latency(ring: StreamBuffer, times: np.ndarray) -> list[tuple[str, str]]:
    """Return names and texts of the latencies of some slots, from arrival to contact and to publication, if known."""
    known = (("sample to contact", latencies(times)), ("sample to published", ring.published()))
    return [(what, _percentiles(waited)) for what, waited in known if len(waited)]


def _percentiles(waited: np.ndarray) -> str:
    middle, most, worst = (1e6 * np.percentile(waited, share) for share in (50, 99, 100))
    return f"{middle:,.0f} us (99 %: {most:,.0f}, worst {worst:,.0f})"


def summary(ring: StreamBuffer, name: str = "") -> None:
    """Print the figures of a stream that has ended: what became of every sample that was sent, and latencies.

    Args:
        ring: ring of the stream.
        name: of a robot's sensor.
    """
    if name:
        title(name)
    received, answered, recorded, lost = (ring[word] for word in ("received", "answered", "recorded", "lost"))
    lines([("samples", Quantity(f"{received:,} received, {answered:,} answered", received))])
    lines([("lost", Quantity(_losses(ring), lost))])
    if recorded:
        size = f", {ring['bytes'] / 1e6:,.1f} MB" if ring["bytes"] and not name else ""  # a robot's: of one ring alone
        lines([("recorded", Quantity(f"{recorded:,} samples{size}", recorded))])
    lines(latency(ring, _times(ring)))
    if not ring.form.joints:
        note(_without_answer(ring))


def _without_answer(ring: StreamBuffer) -> list[str]:
    """Return a sentence on the newest samples that could not be used, in a list; [] if all could."""
    slots, _ = ring.read(ring["answered"] - LOOKED_AT, LOOKED_AT, fields=("rows", "contacts"))
    status = slots["contacts"][slots["rows"] > 0, 0, ROW.status].astype(int)
    counts = {each: int(np.count_nonzero(status == each)) for each in (Status.NO_POSE, Status.INVALID)}
    why = " and ".join(f"{count:,} {each.words}" for each, count in counts.items() if count > FEW * len(status))
    return [f"of the last {len(status):,} samples, {why}: they have no contacts"] if why else []


def _losses(ring: StreamBuffer) -> str:
    """Return text on the samples that were sent and not received, by the sender's counter."""
    text = f"{ring['lost']:,} samples"
    if away := ring["away"]:
        text += f", {away:,} of them while the receiver did not run"
    if unknown := ring["unknown"]:
        text += f", and {unknown:,} times an unknown number: a device or receiver restarted, and no counter went on"
    return text
