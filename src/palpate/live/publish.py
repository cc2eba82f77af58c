"""Publish the contacts of a running `palpate live` to ROS 2 or as JSON to a socket."""

from __future__ import annotations

import gc
import signal
from contextlib import closing
from math import inf
from pathlib import Path
from time import monotonic, sleep
from typing import Protocol, runtime_checkable

from palpate.contact.contacts import Contacts
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
_HINT = "Write ros2, ros2:DOMAIN, udp:HOST:PORT or unix:PATH."


@runtime_checkable
class Publisher(Protocol):
    """A publisher of contacts to listeners, for which it never waits."""

    def publish(self, contacts: Contacts) -> list[int]:
        """Publish the contacts of the next samples, in order; without any, one that waited for the rate.

        Returns:
            The numbers of the samples that were published.
        """
        ...

    def due(self) -> float:
        """Return the time [s] until a sample is due at the rate; 0 or below: it is."""
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


def open_publisher(to: str, form: SlotForm, source: RigSource | None = None, rate: float = RATE) -> Publisher:
    """Return an open `RosPublisher` or `JsonLines` to an address.

    Args:
        to: the address, see `require_address`.
        form: description of the ring's samples and contacts.
        source: the rig's [source], with domain and interface of ROS 2; None: domain 0 on this machine.
        rate: [Hz] at most; 0: every sample.

    Raises:
        InputError: the address is not valid, cyclonedds is not installed, or the domain cannot be joined.
    """
    require_address(to)
    if not to.startswith("ros2"):
        return JsonLines(to, rate)
    from palpate.live.publish_ros import RosPublisher  # here: it needs cyclonedds

    domain, interface = (0, "") if source is None else (source.domain, source.interface)
    stated = _domain(to)
    made = RosPublisher(form.frame, form.features, rate or inf, domain if stated is None else stated, interface)
    made.open()
    return made


def publish(ring: Path, to: str, rig: Path, parent: int, rate: float = RATE, realtime: bool = False) -> None:
    """Publish the contacts of a ring from now on, until it says stop or the parent is gone; the target of a process.

    Args:
        ring: file of the ring.
        to: the address, see `require_address`.
        rig: file of the rig.
        parent: id of the parent process.
        rate: [Hz] at most; 0: every sample.
        realtime: request real-time priority, below the receiver's.

    Raises:
        InputError: the ring cannot be opened.
        SystemExit: with 1, if rig or address cannot be used; the ring stores the reason.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C and says stop
    read = StreamBuffer(ring)
    try:
        publisher = open_publisher(to, read.form, load_rig(rig).source, rate)
    except InputError as problem:
        read.say(f"nothing is published to {to}: {problem}")
        raise SystemExit(1) from problem
    if realtime:
        hurry(PRIORITY - 10)  # the receiver reports that it is not granted
    gc.collect()
    gc.freeze()  # what exists now is not collected, which would pause the loop
    with closing(read), closing(publisher):
        next_one, listened = read["answered"], 0.0
        while not read["stop"] and not orphaned(parent):
            slots, first = read.read(next_one, MOST)
            next_one = first + len(slots)
            if len(slots) or publisher.due() <= 0.0:
                read.publish(publisher.publish(read.form.contacts(slots)))
            if (now := monotonic()) - listened >= LISTEN:
                listened = now
                _listen(publisher, read, to)
            if len(slots) < MOST:
                due = publisher.due()
                sleep(min(POLL, due) if due > 0.0 else POLL)


def _listen(publisher: Publisher, ring: StreamBuffer, to: str) -> None:
    """Pass requests and events on to the ring."""
    if publisher.tare_requested():
        ring.ask_tare(f"a message to {to}")
    for sentence in publisher.events():
        ring.say(sentence)
