"""Publish the contacts of a running `palpate live` to ROS 2 or as JSON to a socket."""

from __future__ import annotations

import gc
import signal
from collections.abc import Sequence
from contextlib import ExitStack, closing
from math import inf
from pathlib import Path
from time import monotonic, sleep
from typing import Protocol, runtime_checkable

import numpy as np

from palpate.contact.estimate import ROW
from palpate.errors import InputError
from palpate.live.json_lines import JsonLines, datagram_address
from palpate.live.receiver import PRIORITY, hurry, orphaned
from palpate.live.stream_buffer import SlotForm, StreamBuffer
from palpate.setup.load import load_rig
from palpate.setup.source import RigSource

RATE = 100.0  # Hz
POLL = 0.001  # s: a change of status waits no longer
LISTEN = 0.02  # s between looks for requests and events
MOST = 4096  # slots that are read at once
_ROS = "ros2"
_HINT = "Write ros2, ros2:DOMAIN, udp:HOST:PORT or unix:PATH."


@runtime_checkable
class Publisher(Protocol):
    """A publisher of contacts to listeners, for which it never waits."""

    def publish(self, slots: np.ndarray) -> list[int]:
        """Publish the contacts of the next slots (n,) of a ring, in order, and return the numbers of their samples."""
        ...

    def tare_requested(self) -> bool:
        """Return whether a listener has requested a tare since the last call."""
        ...

    def events(self) -> list[str]:
        """Return the events since the last call, one sentence each."""
        ...

    def close(self) -> None:
        """Close the publisher; may be called again."""
        ...


def _domain(to: str) -> int | None:
    """Return the domain of "ros2:DOMAIN", None of "ros2", or raise InputError."""
    _, colon, number = to.partition(":")
    if not colon:
        return None
    if not number.isdecimal() or int(number) > 232:
        raise InputError("does not name a domain of ROS 2, which is a number from 0 to 232.", where=to, hint=_HINT)
    return int(number)


def require_address(to: str) -> None:
    """Check an address to publish to.

    Args:
        to: "ros2", "ros2:DOMAIN", "udp:HOST:PORT" or "unix:PATH".

    Raises:
        InputError: the address has another form, or its host or folder does not exist.
    """
    match to.partition(":")[0]:
        case "ros2":
            _domain(to)
        case "udp" | "unix":
            datagram_address(to)
        case _:
            what = "is not a destination to which contacts can be published."
            raise InputError(what, where=f"--publish {to}", hint=_HINT)


def open_publisher(
    to: str, form: SlotForm, source: RigSource | None = None, rate: float = RATE, partner: Publisher | None = None
) -> Publisher:
    """Return an open `RosPublisher` or `JsonLines` to an address.

    Args:
        to: the address, see `require_address`.
        form: description of the ring's samples and contacts.
        source: the rig's [source], with domain and interface of ROS 2; None: domain 0 on this machine.
        rate: [Hz] of messages to ROS 2, at most; 0: every sample.
        partner: publisher of another sensor of the same robot.

    Raises:
        InputError: the address is not valid, cyclonedds is not installed, or the domain cannot be joined.
    """
    require_address(to)
    if not to.startswith(_ROS):
        return JsonLines(to, form)
    from palpate.live.publish_ros import RosPublisher  # here: it needs cyclonedds

    domain, interface = (0, "") if source is None else (source.domain, source.interface)
    stated = _domain(to)
    stated = domain if stated is None else stated
    partner = partner if isinstance(partner, RosPublisher) else None
    made = RosPublisher(form, rate or inf, stated, interface, partner)
    made.open()
    return made


def publish(
    rings: Sequence[Path],
    to: str,
    rig: Path,
    sensor: str | None,
    parent: int,
    rate: float = RATE,
    realtime: bool = False,
) -> None:
    """Publish the contacts of rings from now on, until they say stop or the parent is gone; the target of a process.

    Args:
        rings: file of the ring, or those of a robot's sensors.
        to: the address, see `require_address`.
        rig: file of the rig.
        sensor: name of a sensor of the rig, whose [source] states domain and interface of ROS 2.
        parent: id of the parent process.
        rate: [Hz] at most; 0: every sample.
        realtime: request real-time priority, below the receiver's.

    Raises:
        InputError: a ring cannot be opened.
        SystemExit: with 1, if rig or address cannot be used; the first ring stores the reason.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C and says stop
    opened = [StreamBuffer(ring) for ring in rings]
    try:
        source = load_rig(rig, sensor).source
        streams = list[_Published]()
        for ring in opened:
            partner = streams[0].publisher if streams else None
            throttle = Throttle(ring.form, rate) if rate and not to.startswith(_ROS) else None
            streams.append(_Published(ring, open_publisher(to, ring.form, source, rate, partner), throttle))
    except InputError as problem:
        opened[0].say(f"nothing is published to {to}: {problem}")
        raise SystemExit(1) from problem
    if realtime:
        hurry(PRIORITY - 10)  # the receiver reports that it is not granted
    gc.collect()
    gc.freeze()  # what exists now is not collected, which would pause the loop
    with ExitStack() as stack:
        for each in streams:
            stack.enter_context(closing(each.ring))
            stack.enter_context(closing(each.publisher))
        listened = 0.0
        while not opened[0]["stop"] and not orphaned(parent):
            behind = [each.pass_on() for each in streams]
            if (now := monotonic()) - listened >= LISTEN:
                listened = now
                _listen(streams, to)
            if not any(behind):
                sleep(min(POLL, *(each.wait() for each in streams)))


class Throttle:
    """Choose the samples to publish: at once those that change status or identities, else the newest at a rate.

    Args:
        form: description of the ring's samples and contacts.
        rate: [Hz] at most, but for changes.
    """

    def __init__(self, form: SlotForm, rate: float) -> None:
        self._columns = [ROW.status, *([form.width - 1] if form.numbered else [])]
        self._period, self._due = 1.0 / rate, -inf
        self._state: list[list[float]] = []  # of the last sample: columns of each contact
        self._newest: np.ndarray | None = None  # the last sample, unless it was chosen

    def wait(self) -> float:
        """Return the time [s] until a sample is due at the rate; infinite if none waits."""
        return inf if self._newest is None else max(self._due - monotonic(), 0.0)

    def choose(self, slots: np.ndarray) -> np.ndarray:
        """Return those of the next slots (n,) that are to be published now, or one that waited for the rate."""
        slots, changes = slots[slots["ready"] > 0], list[int]()
        states = slots["contacts"][:, :, self._columns].tolist()
        for k, (state, count) in enumerate(zip(states, slots["rows"].tolist(), strict=True)):
            if state[:count] != self._state:
                self._state = state[:count]
                changes.append(k)
        if len(slots):
            self._newest = None if changes and changes[-1] == len(slots) - 1 else slots[-1:]
        now = monotonic()
        if changes:
            self._due = now + self._period
        elif self._newest is not None and now >= self._due:
            self._due = max(self._due + self._period, now)  # late ones do not lower the rate
            slots, self._newest = self._newest, None
            return slots
        return slots[changes]


class _Published:
    """A ring whose contacts are published; without a throttle all of them are passed to the publisher."""

    def __init__(self, ring: StreamBuffer, publisher: Publisher, throttle: Throttle | None) -> None:
        self.ring, self.publisher, self._throttle, self._next = ring, publisher, throttle, ring["answered"]

    def wait(self) -> float:
        """Return the time [s] until a sample that waits is due; infinite if none does."""
        return inf if self._throttle is None else self._throttle.wait()

    def pass_on(self) -> bool:
        """Publish new contacts, and return whether more may wait."""
        slots, first = self.ring.read(self._next, MOST)
        self._next = first + len(slots)
        chosen = slots if self._throttle is None else self._throttle.choose(slots)
        if len(chosen):
            self.ring.publish(self.publisher.publish(chosen))
        return len(slots) == MOST


def _listen(streams: Sequence[_Published], to: str) -> None:
    """Pass requests and events on to the rings; a tare is one of all sensors."""
    requested = [each.publisher.tare_requested() for each in streams]
    for each in streams:
        if any(requested):
            each.ring.ask_tare(f"a message to {to}")
        for sentence in each.publisher.events():
            each.ring.say(sentence)
