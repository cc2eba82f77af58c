"""Publish contacts as lines of JSON over UDP or a UNIX socket, a datagram for each sample."""

from __future__ import annotations

import json
import os
import socket
from math import hypot, inf, isfinite, isnan
from time import monotonic
from typing import Any

import numpy as np

from palpate.contact.estimate import ROW, Status
from palpate.contact.origins import EXPECTED
from palpate.errors import InputError
from palpate.live.stream_buffer import SlotForm

UDP, UNIX = "udp", "unix"
LONGEST = 107  # bytes of a UNIX socket's path
AGAIN = 10.0  # s between two sentences on what was dropped

_LABELS = {float(status): status.label for status in Status}
_PLACED = slice(ROW.point.start, ROW.normal.stop)
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
        form: description of the ring's samples and contacts.

    Attributes:
        sent: number of lines sent.
        dropped: number of lines without room, or too long for a datagram.

    Raises:
        InputError: the address is not valid.
    """

    def __init__(self, to: str, form: SlotForm) -> None:
        family, self._address = datagram_address(to)
        self.to, self.sent, self.dropped, self._form = to, 0, 0, form
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._say_at, self._said_of = -inf, 0

    def publish(self, slots: np.ndarray) -> list[int]:
        """Send a line for each of some slots (n,) of a ring, and return the numbers of the samples that were sent."""
        return [int(slot["number"]) - 1 for slot in slots if slot["ready"] and slot["rows"] and self._send(slot)]

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

    def _send(self, slot: np.void) -> bool:
        """Send the line of a slot, and return whether it was taken."""
        line = _ENCODER.encode(self._line(slot)).encode() + b"\n"
        try:
            self._socket.sendto(line, self._address)
        except (ConnectionRefusedError, FileNotFoundError):  # nobody listens
            return False
        except OSError:  # no room, too long, no route: the line is lost, and `events` reports it
            self.dropped += 1
            return False
        self.sent += 1
        return True

    # From the slot, not from its `Contacts`: making these takes longer than all else, and each line is late by it.
    def _line(self, slot: np.void) -> dict[str, Any]:
        rows = sorted(slot["contacts"][: slot["rows"]].tolist(), key=_weakness)
        sensor, link = self._form.origin
        return {
            **({"sensor": sensor, "link": link} if sensor else {}),
            "sample": int(slot["number"]) - 1,
            "time": int(slot["stamp"]) / 10**9,
            "status": _LABELS[rows[0][ROW.status]],
            "contacts": [self._contact(row) for row in rows if all(map(isfinite, row[_PLACED]))],
        }

    def _contact(self, row: list[float]) -> dict[str, Any]:
        (place, count), values = self._form.place, [value if isfinite(value) else None for value in row]
        return {
            "identity": (int(row[-1]) if self._form.numbered else 0) * count + place,
            "status": _LABELS[row[ROW.status]],
            "point": values[ROW.point],
            "normal": values[ROW.normal],
            "force": values[ROW.force],
            "torque": values[ROW.torque],
            "covariance": values[ROW.covariance],
            "residual": values[ROW.residual],
            **dict(zip(self._form.features, values[ROW.length :], strict=False)),
            **({EXPECTED: 1.0} if self._form.expected else {}),
        }


def _weakness(row: list[float]) -> float:
    """Return a key that sorts the strongest force [N] first, and last those without one."""
    force = hypot(*row[ROW.force])
    return inf if isnan(force) else -force
