"""Targets for what a device, a browser or another process sends while a command runs."""

from __future__ import annotations

import socket
from collections.abc import Callable
from contextlib import closing, suppress
from functools import cache, partial
from pathlib import Path

import numpy as np

from palpate.errors import PalpateError
from palpate.live.cobs import CobsFrames
from palpate.live.lines import LineFrames
from palpate.live.netft import SAMPLE, START, NetFt
from palpate.live.netft_page import NetFtPage
from palpate.live.source import Batch
from palpate.live.stream_buffer import StreamBuffer
from palpate.viewer.guard import Guard, Request, Widget, WidgetKind, judged

HOST = "127.0.0.1"
WIDGETS = {
    "press": Widget(WidgetKind.PRESS),
    "choose": Widget(WidgetKind.CHOOSE, options=("a", "b")),
    "set": Widget(WidgetKind.SET, low=0.0, high=1.0),
    "check": Widget(WidgetKind.CHECK),
    "write": Widget(WidgetKind.WRITE, usable=False),
}
"""Name -> a widget of the fuzzed page."""
TOKEN = "secret"


def frames(count: int, make: Callable[[], CobsFrames | LineFrames]) -> Callable[[bytes], None]:
    """Return the target that feeds a decoder of samples of `count` numbers, in pieces as the first four bytes say."""

    def target(data: bytes) -> None:
        decoder, at = make(), 4
        values, lost = np.empty((64, count)), np.empty(64, dtype=np.int64)
        while at < len(data):
            size = 1 + data[at % 4] % 61
            decoder.feed(data[at : at + size])
            at += size
            while decoder.take(values, lost):
                pass
        decoder.faults(), decoder.awaited(), decoder.position()

    return target


@cache
def _device() -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind((HOST, 0))
    return made


def net_ft(data: bytes) -> None:
    """Receive datagrams of a Net F/T: samples of 36 bytes, and one of another length where a byte before is odd."""
    device = _device()
    source = NetFt(HOST, device.getsockname()[1])
    source._host, source._page = HOST, NetFtPage(1e6, 1e6, rate=1e3)
    source._begin()
    source._send(START)
    batch, at, to = Batch(source.shape), 0, (HOST, source._socket.getsockname()[1])
    with closing(source):
        while at < len(data):
            size = data[at] // 2 if data[at] % 2 else SAMPLE.itemsize
            device.sendto(data[at + 1 : at + 1 + size], to)
            at += 1 + size
            if data[at - 1 : at] < b"\x80":
                source.receive(batch, 0.0)
        while source.receive(batch, 0.0):
            pass
        source.events(), source.position()


def net_ft_page(data: bytes) -> None:
    """Read the page of a Net F/T, as XML and as the answer of its server."""
    from palpate.live.netft_page import _body

    for read in (NetFtPage.parsed, _body):
        with suppress(PalpateError):
            read(data, HOST)


def page(data: bytes) -> None:
    """Judge a message of a browser."""
    judged(data, WIDGETS.get)


def door(data: bytes) -> None:
    """Judge a request: its path, then its headers, a line each."""
    path, *lines = data.decode("latin-1").split("\n")
    pairs = [line.partition(":") for line in lines]
    headers = partial(_values, [(name.lower(), value.strip()) for name, _, value in pairs])
    for host in ("localhost", "::"):
        request, guard = Request(path, headers, HOST, 8080), Guard(host, TOKEN)
        entering = guard.entering(request)
        if TOKEN not in path and not any(TOKEN in value for value in headers("cookie")):
            assert guard.refusal(request)
            assert not entering


def _values(headers: list[tuple[str, str]], name: str) -> list[str]:
    return [value for key, value in headers if key == name.lower()]


def ring(path: Path) -> Callable[[bytes], None]:
    """Return the target that opens bytes as a ring and reads its samples."""

    def target(data: bytes) -> None:
        path.write_bytes(data)
        with suppress(PalpateError):
            found = StreamBuffer(path)
            found.form.contacts(found.read(0, 64)[0]), found.events(0), found.published()

    return target
