"""Read the page of a Net F/T: its counts per N and N m, units, rate and name."""

from __future__ import annotations

import io
import re
import socket
import time
from collections.abc import Mapping
from dataclasses import dataclass
from http.client import HTTPException, HTTPResponse
from xml.etree import ElementTree

from palpate.errors import InputError
from palpate.files.units import FORCE_UNITS, TORQUE_UNITS, known_unit, positive, to_si

PAGE = "/netftapi2.xml"
_FORCE_UNITS: Mapping[str, float] = {**FORCE_UNITS, "klbf": FORCE_UNITS["lbf"] * 1e3}
_MOST = 1 << 18  # bytes: the page of a Net F/T has some 10 kB
_NOT = "Check that address is that of a Net F/T, and web the port of its page."
UNREACHED = "Check the cable, and that this machine is in the device's network."


@dataclass(frozen=True)
class NetFtPage:
    """The values on a Net F/T's page for the calibration in use.

    Attributes:
        force, torque: counts per N and per N m.
        units: units of force and torque that the device is set to.
        rate: [Hz] at which it sends samples; None: not stated.
        product, serial: product and serial number of the calibration; may be empty.
        streaming: whether sending of samples (RDT) is switched on.
    """

    force: float
    torque: float
    units: tuple[str, str] = ("N", "N-m")
    rate: float | None = None
    product: str = ""
    serial: str = ""
    streaming: bool = True

    @classmethod
    def parsed(cls, content: bytes, where: str) -> NetFtPage:
        """Return the `NetFtPage` of a page's XML; `where` names the device in errors.

        Raises:
            InputError: it is not the page of a Net F/T, or its counts or units are not valid.
        """
        said = _elements(content, where)
        if missing := [name for name in ("cfgcpf", "cfgcpt", "scfgfu", "scfgtu") if not said.get(name)]:
            raise _foreign(f"its page does not state {', '.join(missing)}", where)
        force_unit, torque_unit = said["scfgfu"], said["scfgtu"]
        if known_unit(force_unit, _FORCE_UNITS) is None or known_unit(torque_unit, TORQUE_UNITS) is None:
            what = f"measures in units that cannot be converted, {force_unit!r} and {torque_unit!r}."
            hint = "Choose N and N-m on the page of the device, under Configurations."
            raise InputError(what, where=where, hint=hint)
        return cls(
            _counts(said, "cfgcpf", where) / to_si(force_unit, _FORCE_UNITS, where=where),
            _counts(said, "cfgcpt", where) / to_si(torque_unit, TORQUE_UNITS, where=where),
            (force_unit, torque_unit),
            positive(said.get("comrdtrate", "")) or None,
            said.get("prodname", ""),
            said.get("cfgcalsn", "") or said.get("setserial", ""),
            said.get("comrdte", "").lower() != "disabled",
        )

    @property
    def called(self) -> str:
        """Product and calibration, in words for a sentence."""
        return (self.product or "Net F/T") + (f", calibration {self.serial}" if self.serial else "")

    @property
    def scale(self) -> str:
        """Counts per N and per N m, and the units, in words for a sentence."""
        return f"{self.force:.9g} counts per N and {self.torque:.9g} per N m (it is set to {' and '.join(self.units)})"


def read_page(host: str, port: int, *, where: str, timeout: float) -> NetFtPage:
    """Read the page of a Net F/T over HTTP, and return its `NetFtPage`.

    Args:
        host: name or address of the device.
        port: TCP port of its page.
        where: name of the device in errors.
        timeout: [s] for the whole exchange.

    Raises:
        InputError: the device cannot be reached, does not answer in time, or is no Net F/T.
    """
    deadline = time.monotonic() + timeout
    try:
        with socket.create_connection((host, port), timeout=timeout) as link:
            link.sendall(f"GET {PAGE} HTTP/1.0\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode("ascii"))
            raw = _received(link, deadline, where)
    except TimeoutError as problem:
        what = f"does not answer at port {port}, where its page should be, within {timeout:g} s."
        hint = "Check its power and network, and that no firewall is in between."
        raise InputError(what, where=where, hint=hint) from problem
    except ConnectionRefusedError as problem:
        what = f"refuses connections to port {port}, where its page should be."
        raise InputError(what, where=where, hint=_NOT) from problem
    except OSError as problem:
        what = f"cannot be reached ({problem.strerror or problem})."
        raise InputError(what, where=where, hint=UNREACHED) from problem
    return NetFtPage.parsed(_body(raw, where), where)


def _foreign(why: str, where: str) -> InputError:
    return InputError(f"is not a Net F/T: {why}.", where=where, hint=_NOT)


def _received(link: socket.socket, deadline: float, where: str) -> bytes:
    """Return the complete answer; raise TimeoutError at the deadline [s]."""
    raw = bytearray()
    while (left := deadline - time.monotonic()) > 0:
        link.settimeout(left)
        piece = link.recv(1 << 16)
        raw += piece
        if not piece or _complete(raw):
            return bytes(raw)
        if len(raw) > _MOST:
            raise _foreign(f"its page is longer than {_MOST >> 10} KiB", where)
    raise TimeoutError


def _complete(raw: bytearray) -> bool:
    """Return whether the answer has as many bytes as its header states."""
    head, blank, body = bytes(raw).partition(b"\r\n\r\n")
    length = re.search(rb"(?im)^content-length:\s*(\d{1,9})\s*$", head.replace(b"\r", b""))
    return bool(blank) and length is not None and len(body) >= int(length[1])


class _Heard(io.BytesIO):
    """Received bytes in place of the socket that `HTTPResponse` expects."""

    def makefile(self, mode: str) -> io.BytesIO:
        return io.BytesIO(self.getvalue())


def _body(raw: bytes, where: str) -> bytes:
    response = HTTPResponse(_Heard(raw))  # pyright: ignore[reportArgumentType] - it asks for `makefile` alone
    try:
        response.begin()
        body = response.read()
    except (HTTPException, ValueError) as problem:
        raise _foreign("its answer is not that of a web server", where) from problem
    if response.status != 200:
        raise _foreign(f"it has no page {PAGE} (it answers {response.status})", where)
    return body


def _elements(content: bytes, where: str) -> dict[str, str]:
    """Return name in lower case -> text of its first element: printable letters, 60 at most."""
    try:
        if b"\0" in content or b"<!DOCTYPE" in content:  # entities, which may grow without end
            raise ValueError("a document type")
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as problem:  # the last: an unknown encoding
        raise _foreign(f"its page {PAGE} is not XML", where) from problem
    said: dict[str, str] = {}
    for each in root.iter():
        text = "".join(letter for letter in (each.text or "").strip() if letter.isprintable())
        said.setdefault(each.tag.rpartition("}")[2].lower(), text[:60])
    return said


def _counts(said: Mapping[str, str], name: str, where: str) -> float:
    value = positive(said[name])
    if not value:
        what = f"its page states {said[name]!r} for {name}, which is not a number of counts."
        raise InputError(what, where=where, hint=_NOT)
    return value
