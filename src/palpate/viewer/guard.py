"""Decide which requests and browser messages a page accepts; `viser_door` carries the decisions out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from hmac import compare_digest
from ipaddress import IPv6Address, ip_address
from math import hypot, isfinite, pi
from typing import Annotated, NamedTuple
from urllib.parse import parse_qs

from msgspec import DecodeError, Meta, Struct, ValidationError  # comes with viser
from msgspec.msgpack import Decoder

LARGEST = 1 << 24  # bytes of a message: a picture that was asked for
LARGE = 1 << 12  # bytes of any other
PIXELS = 1 << 26  # of a picture
_PNG = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR"
_REFUSED = "This page answers only at the address that its command printed.\n"
_CLOSED = "Open the complete address that the command printed, including ?token= and the text after it.\n"


class Request(NamedTuple):
    """A request to the server.

    Attributes:
        path: path with its query.
        headers: returns all values of a header.
        local: address at which the request arrived.
        port: port at which it arrived.
    """

    path: str
    headers: Callable[[str], Sequence[str]]
    local: str
    port: int

    @property
    def tokens(self) -> list[str]:
        """Tokens in the query of the address."""
        try:
            return parse_qs(self.path.partition("?")[2], max_num_fields=16).get("token", [])
        except ValueError:
            return []

    @property
    def cookies(self) -> list[str]:
        """Values of this port's cookie: pages at two ports of a machine share their cookies."""
        pairs = (pair.strip().partition("=") for header in self.headers("Cookie") for pair in header.split(";"))
        return [value for name, _, value in pairs if name == _cookie(self.port)]


@dataclass(frozen=True)
class Guard:
    """A check that accepts only requests that no browser but the owner's can send.

    A foreign page can let a browser send anything, but not under another `Origin` or, if its name was made to lead
    here, another `Host`. Another user of this machine or network has no token.

    Attributes:
        host: address that the server listens at.
        token: secret that the printed address ends with.
    """

    host: str
    token: str

    def refusal(self, request: Request) -> str:
        """Return why a request is refused, as a sentence for its sender; "" if it is accepted."""
        host, origin = request.headers("Host"), request.headers("Origin")
        if len(host) != 1 or host[0].lower() not in self._hosts(request):
            return _REFUSED
        if any(each.lower() != f"http://{host[0].lower()}" for each in origin):
            return _REFUSED
        return "" if any(map(self._right, [*request.cookies, *request.tokens])) else _CLOSED

    def entering(self, request: Request) -> str:
        """Return the Set-Cookie header for a request with the token in its address; "" for others."""
        if not any(map(self._right, request.tokens)):
            return ""
        return f"{_cookie(request.port)}={self.token}; Path=/; HttpOnly; SameSite=Strict"

    def _right(self, token: str) -> bool:
        return compare_digest(token.encode(errors="replace"), self.token.encode())

    def _hosts(self, request: Request) -> set[str]:
        """Return the names that lead here and that no stranger could make lead here."""
        names = {"localhost", "127.0.0.1", "[::1]", in_url(self.host.lower()), in_url(request.local)}
        return {f"{name}:{request.port}" for name in names} | (names if request.port == 80 else set[str]())


def in_url(host: str) -> str:
    """Return a host name or an address in the form that it has in a URL."""
    try:
        address = ip_address(host.partition("%")[0])
    except ValueError:
        return host
    if isinstance(address, IPv6Address):
        return f"[{address}]" if address.ipv4_mapped is None else str(address.ipv4_mapped)
    return str(address)


def _cookie(port: int) -> str:
    return f"palpate_{port}"


class WidgetKind(Enum):
    """The actions that widgets of the page offer to a person."""

    PRESS = "press"
    CHOOSE = "choose"
    SET = "set"
    CHECK = "check"
    WRITE = "write"


class Widget(NamedTuple):
    """The actions that a widget allows.

    Attributes:
        kind: action that it offers.
        usable: it is visible, and not disabled.
        options: allowed choices.
        low, high: bounds of a number.
    """

    kind: WidgetKind
    usable: bool = True
    options: tuple[str, ...] = ()
    low: float = 0.0
    high: float = 0.0


class Verdict(Enum):
    """The decision on a message: it is taken, has no effect, or ends its connection."""

    TAKE = "take"
    IGNORE = "ignore"
    CLOSE = "close"


_Vector = tuple[float, float, float]
_Side = Annotated[int, Meta(ge=0, le=1 << 15)]
_Name = Annotated[str, Meta(max_length=64)]


class _Camera(Struct, forbid_unknown_fields=True, tag_field="type", tag="ViewerCameraMessage"):
    wxyz: tuple[float, float, float, float]
    position: _Vector
    fov: float
    near: float
    far: float
    image_height: _Side
    image_width: _Side
    look_at: _Vector
    up_direction: _Vector


class _Value(Struct, forbid_unknown_fields=True):
    value: bool | int | float | Annotated[str, Meta(max_length=256)]


class _Update(Struct, forbid_unknown_fields=True, tag_field="type", tag="GuiUpdateMessage"):
    uuid: _Name
    updates: _Value


class _Picture(Struct, forbid_unknown_fields=True, tag_field="type", tag="GetRenderResponseMessage"):
    payload: bytes
    render_uuid: _Name


_DECODER = Decoder(_Camera | _Update | _Picture)


def judged(raw: object, widget: Callable[[str], Widget | None]) -> Verdict:
    """Return the `Verdict` on a message from a browser.

    A number out of bounds, as while it is typed, a widget that is hidden or disabled, and a finite camera that makes no
    view, as of a window without height, have no effect. All else that is not allowed ends the connection.

    Args:
        raw: message as received.
        widget: finds a widget by its name; None: there is none.
    """
    if not isinstance(raw, bytes):
        return Verdict.CLOSE
    try:
        message = _DECODER.decode(raw)
    except (ValidationError, DecodeError, UnicodeDecodeError, RecursionError):
        return Verdict.CLOSE
    if isinstance(message, _Picture):
        return _picture(message.payload)
    if len(raw) > LARGE:
        return Verdict.CLOSE
    if isinstance(message, _Camera):
        return _camera(message)
    found = widget(message.uuid)
    return Verdict.CLOSE if found is None else _update(found, message.updates.value)


def _camera(seen: _Camera) -> Verdict:
    numbers = (*seen.wxyz, *seen.position, *seen.look_at, *seen.up_direction, seen.fov, seen.near, seen.far)
    if not all(map(isfinite, numbers)):
        return Verdict.CLOSE
    fit = abs(hypot(*seen.wxyz) - 1.0) < 1e-3 and any(seen.up_direction) and seen.position != seen.look_at
    fit = fit and 0.0 < seen.fov < pi and 0.0 < seen.near < seen.far and seen.image_height > 0 < seen.image_width
    return Verdict.TAKE if fit else Verdict.IGNORE


def _update(widget: Widget, value: bool | int | float | str) -> Verdict:
    number = isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
    right = {
        WidgetKind.PRESS: value is True,
        WidgetKind.CHOOSE: value in widget.options,
        WidgetKind.SET: number,
        WidgetKind.CHECK: isinstance(value, bool),
        WidgetKind.WRITE: isinstance(value, str),
    }[widget.kind]
    if not right:
        return Verdict.CLOSE
    within = widget.kind is not WidgetKind.SET or widget.low <= float(value) <= widget.high
    return Verdict.TAKE if widget.usable and within else Verdict.IGNORE


def _picture(payload: bytes) -> Verdict:
    """Judge a picture by its stated size; empty means that the browser made none."""
    sides = [int.from_bytes(payload[at : at + 4]) for at in (len(_PNG), len(_PNG) + 4)]
    colours = payload[24:26] in (b"\x08\x02", b"\x08\x06")  # RGB or RGBA, eight bits each
    fit = payload.startswith(_PNG) and colours and 0 < sides[0] * sides[1] <= PIXELS
    return Verdict.TAKE if fit or not payload else Verdict.CLOSE
