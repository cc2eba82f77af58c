"""Simulate an ATI Net F/T on this machine: its page over HTTP and its samples over UDP."""

from __future__ import annotations

import select
import socket
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.errors import InputError
from palpate.live.netft import BIAS, HEADER, REQUEST, SAMPLE, START, STOP
from palpate.live.netft_page import PAGE
from palpate.live.netft_status import SATURATED

_HOST = "127.0.0.1"
_PER_UNIT = 1_000_000  # counts per N and per N m, the usual setting
_LARGEST = 2**31 - 1
_MOST_LISTENERS = 16
_WORD = 1 << 32


class NetFtDevice:
    """A simulated Net F/T for several listeners; see `palpate.live.source.Device`.

    It obeys the commands for realtime streaming (2), stop (0) and bias (0x42). A value that is NaN, or beyond 2147 N or
    N m, is sent with the status of a saturated transducer.

    Args:
        port: UDP port of the samples; 0: any free port.
        web: TCP port of the page; 0: any free port.
        rate: [Hz] that the page states.

    Attributes:
        port, web: the ports in use, once open.
    """

    def __init__(self, port: int = 0, web: int = 0, *, rate: float = 7000.0) -> None:
        self.port, self.web, self._rate = port, web, rate
        self._lock = threading.Lock()
        self._listeners: dict[tuple[str, int], list[int]] = {}  # address -> samples sent, samples asked for
        self._measured = 0  # samples so far
        self._counts: Int[np.ndarray, "6"] = np.zeros(6, dtype=np.int64)  # last, before the bias is taken off
        self._bias: Int[np.ndarray, "6"] = np.zeros(6, dtype=np.int64)
        self._closing: list[Callable[[], object]] = []

    def open(self) -> str:
        """Begin to listen on 127.0.0.1, and return the [source] of a rig as TOML.

        Raises:
            InputError: a port is taken, or may not be used.
        """
        self.close()
        try:
            self._bind()
        except InputError:
            self.close()
            raise
        return f'[source]\nkind = "netft"\naddress = "{_HOST}"\nport = {self.port}\nweb = {self.web}\n'

    def send(self, stamp: Int[np.ndarray, " n"], values: Float[np.ndarray, "n k"]) -> int:
        """Send samples to all listeners, and return the largest number sent to one; 0 if nobody listens.

        Args:
            stamp: ignored: a Net F/T sends no stamps.
            values: (n, 6) force [N] and torque [N m].
        """
        exact = np.rint(values * _PER_UNIT)
        good: Bool[np.ndarray, " n"] = np.all(np.abs(exact) <= _LARGEST, axis=1)  # not NaN either
        counts = np.where(good[:, None], exact, 0.0).astype(np.int64)
        samples = np.zeros(len(values), dtype=SAMPLE)
        with self._lock:
            samples["counts"] = np.clip(counts - self._bias, -_LARGEST, _LARGEST)
            samples["status"] = np.where(good, 0, SATURATED)
            samples["ft"] = (self._measured + 1 + np.arange(len(values))) % _WORD
            self._measured += len(values)
            if good.any():
                self._counts = counts[good][-1]
            return max((self._stream(address, samples) for address in list(self._listeners)), default=0)

    def close(self) -> None:
        """Stop the device and free its ports; may be called again."""
        for stop in self._closing:
            stop()
        self._closing.clear()
        self._listeners.clear()

    def _bind(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._closing.append(self._socket.close)
        with _taken("UDP", self.port):
            self._socket.bind((_HOST, self.port))
        self.port = self._socket.getsockname()[1]
        with _taken("TCP", self.web):
            server = ThreadingHTTPServer((_HOST, self.web), _answers(self._xml()))
        self.web = server.server_address[1]
        self._closing.append(server.server_close)
        ending = threading.Event()
        commands = threading.Thread(target=self._obey, args=(ending,), daemon=True)
        pages = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
        for thread in (commands, pages):
            thread.start()
        self._closing[:0] = [ending.set, server.shutdown, commands.join, pages.join]

    def _obey(self, ending: threading.Event) -> None:
        poll = select.poll()
        poll.register(self._socket, select.POLLIN)
        while not ending.is_set():
            if poll.poll(50):
                request, address = self._socket.recvfrom(64)
                if len(request) == REQUEST.size:
                    header, command, count = REQUEST.unpack(request)
                    if header == HEADER:
                        self._command(address, command, count)

    def _command(self, address: tuple[str, int], command: int, count: int) -> None:
        with self._lock:
            if command == START:
                self._listeners.pop(address, None)
                while len(self._listeners) >= _MOST_LISTENERS:  # the oldest: one that died never says stop
                    del self._listeners[next(iter(self._listeners))]
                self._listeners[address] = [0, count]
            elif command == STOP:
                self._listeners.pop(address, None)
            elif command == BIAS:
                self._bias = self._counts

    def _stream(self, address: tuple[str, int], samples: np.ndarray) -> int:
        """Send a listener as many samples as it requested, and return how many."""
        sent, asked = self._listeners[address]
        count = len(samples) if not asked else min(len(samples), asked - sent)
        samples["rdt"] = (sent + 1 + np.arange(len(samples))) % _WORD
        raw, size = memoryview(samples.tobytes()), SAMPLE.itemsize
        for k in range(count):
            self._socket.sendto(raw[k * size : (k + 1) * size], address)
        self._listeners[address][0] += count
        if asked and sent + count >= asked:
            del self._listeners[address]
        return count

    def _xml(self) -> bytes:
        return f"""<?xml version="1.0" encoding="UTF-8"?>
<netft>
<prodname>Palpate stand-in for a Net F/T</prodname>
<setserial>FT00000</setserial>
<cfgcalsn>FT00000</cfgcalsn>
<cfgcpf>{_PER_UNIT}</cfgcpf>
<cfgcpt>{_PER_UNIT}</cfgcpt>
<scfgfu>N</scfgfu>
<scfgtu>N-m</scfgtu>
<comrdte>Enabled</comrdte>
<comrdtrate>{self._rate:.0f}</comrdtrate>
</netft>
""".encode()


def _answers(page: bytes) -> type[BaseHTTPRequestHandler]:
    """Return a request handler that serves one page."""

    class Handler(BaseHTTPRequestHandler):
        timeout = 2.0  # s, for a client that connects and requests nothing

        def do_GET(self) -> None:
            """Send the page, or status 404 for any other path."""
            found = self.path.partition("?")[0] == PAGE
            self.send_response(200 if found else 404)
            self.send_header("Content-Type", "text/xml")
            self.send_header("Content-Length", str(len(page) if found else 0))
            self.end_headers()
            if found:
                self.wfile.write(page)

        def log_message(self, format: str, *args: object) -> None:
            """Log nothing, instead of a line on the terminal."""

    return Handler


@contextmanager
def _taken(kind: str, port: int) -> Generator[None]:
    """Turn an OSError of a port that cannot be used into an InputError."""
    try:
        yield
    except OSError as problem:
        what = f"{kind} port {port} cannot be used ({problem.strerror or problem})."
        hint = "Name another port, or 0 for any free one; ports below 1024 need root."
        raise InputError(what, where=_HOST, hint=hint) from problem
