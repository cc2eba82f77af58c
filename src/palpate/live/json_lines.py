"""Publish contacts as lines of JSON over UDP or a UNIX socket, a datagram for each sample."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Iterator
from math import isfinite
from time import monotonic
from typing import Any

import numpy as np

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import Status
from palpate.errors import InputError

UDP, UNIX = "udp", "unix"
LONGEST = 107  # bytes of a UNIX socket's path
AGAIN = 10.0  # s between two sentences on what was dropped

_ENCODER = json.JSONEncoder(allow_nan=False, separators=(",", ":"))  # made once: making one costs as much as a line

Address = str | tuple[str, int] | tuple[str, int, int, int]


def datagram_address(to: str) -> tuple[socket.AddressFamily, Address]:
    """Return (family, address) of the socket to send to; the address is a path, or (host, port, ...).

    Args:
        to: "udp:HOST:PORT" or "unix:PATH".

    Raises:
        InputError: the address has another form, the host is unknown, the path is too long, or its folder is missing.
    """
    kind, _, rest = to.partition(":")
    if kind == UNIX:
        return _unix(rest, to)
    host, _, port = rest.rpartition(":")
    if kind != UDP or not host or not port.isdecimal() or not 0 < int(port) < 2**16:
        raise InputError("is not an address for datagrams.", where=to, hint="Write udp:HOST:PORT or unix:PATH.")
    try:
        family, _, _, _, address = socket.getaddrinfo(host.strip("[]"), int(port), type=socket.SOCK_DGRAM)[0]
    except (OSError, UnicodeError) as problem:
        reason = problem.strerror if isinstance(problem, OSError) else "not a host name"
        raise InputError(f"names a host that cannot be found ({reason}).", where=to) from problem
    return family, address  # pyright: ignore[reportReturnType] - of these two families an address has host and port


def _unix(path: str, to: str) -> tuple[socket.AddressFamily, Address]:
    if not path or len(os.fsencode(path)) > LONGEST or "\0" in path:
        raise InputError(f"needs a path of 1 to {LONGEST} bytes.", where=to, hint="Write unix:PATH.")
    if not os.path.isdir(os.path.dirname(path) or "."):
        raise InputError("is in a folder that does not exist.", where=to, hint="Make the folder first.")
    return socket.AF_UNIX, path


class JsonLines:
    """A publisher of one JSON object per datagram, which ends with a newline; numbers that are not finite are null.

    ```json
    {"sample": 1200, "time": 1700000001.2, "status": "contact", "contacts": [{"identity": 0, "status": "contact",
     "point": [m], "normal": [], "force": [N], "torque": N m, "covariance": [9, m^2, row by row], "residual": , ...}]}
    ```

    `contacts` are those that have a place, the strongest first, each with the sensor's features in SI; `status` is that
    of the strongest, or says why there is none. Lines that the network or a slow listener cannot take are dropped.
    Those of a robot begin with the names of "sensor" and "link", in whose frame they are.

    Args:
        to: "udp:HOST:PORT" or "unix:PATH", a datagram socket that the listener makes.
        rate: [Hz] at most, of the newest samples; one that changes the status or the identities is sent at once. 0:
            every sample.

    Attributes:
        sent: number of lines sent.
        dropped: number of lines without room, or too long for a datagram.

    Raises:
        InputError: the address is not valid.
    """

    def __init__(self, to: str, rate: float = 100.0) -> None:
        family, self._address = datagram_address(to)
        self.to, self.sent, self.dropped = to, 0, 0
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._period = 1.0 / rate if rate else 0.0
        self._due = self._say_at = -np.inf
        self._said_of = 0
        self._state: tuple[object, ...] | None = None
        self._waiting: tuple[Contacts, int, int] | None = None  # rows of the newest sample

    def publish(self, contacts: Contacts) -> list[int]:
        """Send those samples that are due at the rate, and return their numbers.

        Args:
            contacts: the contacts of the next samples, in order; without any, a sample that waited for the rate is
                sent.
        """
        samples = list[int]()
        for start, end, last in _each(contacts, every=not self._period):
            state = (*contacts.status[start:end].tolist(), *contacts.identity[start:end].tolist())
            if state != self._state or not self._period:
                samples += self._send(contacts, start, end)
                self._state, self._waiting, self._due = state, None, monotonic() + self._period
            elif last:
                self._waiting = contacts, start, end
        if self._waiting is not None and self.due() <= 0.0:
            self._due = max(self._due + self._period, monotonic())  # late ones do not lower the rate
            samples += self._send(*self._waiting)
            self._waiting = None
        return samples

    def due(self) -> float:
        """Return the time [s] until a sample is due at the rate; 0 or below: it is."""
        return self._due - monotonic()

    def tare_requested(self) -> bool:
        """Return False, because listeners cannot request a tare."""
        return False

    def events(self) -> list[str]:
        """Return a sentence on the lines dropped since the last one, every 10 s at most; else []."""
        now = monotonic()
        if self.dropped == self._said_of or now < self._say_at:
            return []
        more, self._said_of, self._say_at = self.dropped - self._said_of, self.dropped, now + AGAIN
        return [f"{self.to}: {more} lines were dropped, because the receiver was too slow; {self.sent} were sent"]

    def close(self) -> None:
        """Close the socket; may be called again."""
        self._socket.close()

    def _send(self, contacts: Contacts, start: int, end: int) -> list[int]:
        """Send a line of some rows, and return the sample's number; nothing if it was not taken."""
        if end - start < len(contacts):
            contacts = contacts[start:end]
        line = _ENCODER.encode(_object(contacts)).encode() + b"\n"
        try:
            self._socket.sendto(line, self._address)
        except (ConnectionRefusedError, FileNotFoundError):  # nobody listens
            return []
        except OSError:  # no room, too long, no route: the line is lost, and `events` reports it
            self.dropped += 1
            return []
        self.sent += 1
        return [int(contacts.sample[0])]


def _each(contacts: Contacts, every: bool) -> Iterator[tuple[int, int, bool]]:
    """Yield (start, end, last) of a sample's rows where the state may change, of the last sample, or of `every` one."""
    sample, status, identity = contacts.sample, contacts.status, contacts.identity
    starts = [0, *(1 + np.flatnonzero(sample[1:] != sample[:-1])).tolist()][: len(contacts)]
    wanted = range(len(starts))
    if len(starts) == len(contacts) and not every:  # a row a sample, as a rule
        changed = (status[1:] != status[:-1]) | (identity[1:] != identity[:-1])
        wanted = sorted({*wanted[:1], *(1 + np.flatnonzero(changed)).tolist(), *wanted[-1:]})
    ends = [*starts[1:], len(contacts)]
    for k in wanted:
        yield starts[k], ends[k], k + 1 == len(starts)


def _object(contacts: Contacts) -> dict[str, Any]:
    found = contacts if len(contacts) == 1 else contacts[_strongest_first(contacts)]
    return {
        **_origin(found),
        "sample": int(found.sample[0]),
        "time": _number(found.time[0]),
        "status": Status(int(found.status[0])).label,
        "contacts": [_contact(found, row) for row in np.flatnonzero(found.located).tolist()],
    }


def _origin(found: Contacts) -> dict[str, str]:
    """Return the names of a robot's sensor and of its link; {} for a rig of one sensor."""
    if found.origins is None:
        return {}
    return found.origins.among[int(found.origins.index[0])]._asdict()


def _strongest_first(contacts: Contacts) -> np.ndarray:
    return np.argsort(-np.nan_to_num(np.linalg.norm(contacts.force, axis=1), nan=-1.0), kind="stable")


def _contact(found: Contacts, row: int) -> dict[str, Any]:
    return {
        "identity": int(found.identity[row]),
        "status": Status(int(found.status[row])).label,
        "point": _numbers(found.point[row]),
        "normal": _numbers(found.normal[row]),
        "force": _numbers(found.force[row]),
        "torque": _number(found.torque[row]),
        "covariance": _numbers(found.covariance[row].ravel()),
        "residual": _number(found.residual[row]),
        **{name: _number(values[row]) for name, values in found.features.items()},
    }


def _number(value: float) -> float | None:
    return float(value) if isfinite(value) else None


def _numbers(values: np.ndarray) -> list[float | None]:
    return [_number(value) for value in values.tolist()]
