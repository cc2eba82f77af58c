"""What talks to a page without a browser: as its owner does, as a foreign page makes a browser do, or worse."""

import socket
import threading
from collections.abc import Generator
from contextlib import closing, contextmanager, suppress
from http.client import HTTPConnection
from time import monotonic, sleep
from typing import Any
from urllib.parse import urlsplit

import viser
import zstandard
from msgspec import msgpack
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin, Subprotocol

PATIENCE = 30.0  # s
CAMERA = {  # what a browser says first: from then on viser counts it
    "type": "ViewerCameraMessage", "wxyz": (1.0, 0.0, 0.0, 0.0), "position": (0.0, 0.0, 3.0), "fov": 0.8, "near": 0.01,
    "far": 100.0, "image_height": 800, "image_width": 1280, "look_at": (0.0, 0.0, 0.0), "up_direction": (0.0, 1.0, 0.0),
}  # fmt: skip


def opened(address: str, host: str = "", origin: str = "", **headers: str) -> ClientConnection:
    """A socket of the page at an address, under another host or origin where one is given."""
    parts = urlsplit(address)
    assert parts.hostname is not None
    return connect(
        f"ws://{host or parts.netloc}/?{parts.query}",
        sock=socket.create_connection((parts.hostname, parts.port), timeout=PATIENCE),
        origin=Origin(origin) if origin else None,
        additional_headers=headers,
        subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
        max_size=None,
        compression=None,
        close_timeout=0.1,
    )


def refused(address: str, host: str = "", origin: str = "", **headers: str) -> bool:
    try:
        opened(address, host, origin, **headers).close()
    except (InvalidHandshake, EOFError, OSError):
        return True
    return False


def fetched(address: str, hosts: tuple[str, ...] = (), **headers: str) -> tuple[int, str]:
    """Status and text of an answer by HTTP; with so many headers Host."""
    parts = urlsplit(address)
    assert parts.hostname is not None
    with suppress(OSError), closing(HTTPConnection(parts.hostname, parts.port, timeout=PATIENCE)) as connection:
        connection.putrequest("GET", f"/?{parts.query}", skip_host=bool(hosts))
        for name, value in [*(("Host", host) for host in hosts), *headers.items()]:
            connection.putheader(name, value)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, answer.read().decode(errors="replace")
    return 0, ""


def closed(connection: ClientConnection) -> bool:
    end = monotonic() + PATIENCE
    with suppress(TimeoutError):
        while monotonic() < end:
            try:
                connection.recv(timeout=PATIENCE)
            except ConnectionClosed:
                return True
    return False


class Owner:
    """A client with the token, which reads as a browser does.

    Attributes:
        widgets: the name of each that can be changed, by its kind.
        words: the last content of each text.
    """

    def __init__(self, address: str) -> None:
        self.widgets, self.words = dict[str, str](), dict[str, str]()
        self.connection = opened(address)
        self.connection.send(msgpack.encode(CAMERA))
        self._over = threading.Event()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def send(self, message: Any) -> None:
        self.connection.send(message if isinstance(message, bytes | str) else msgpack.encode(message))

    @property
    def here(self) -> bool:
        return self._reader.is_alive()

    def close(self) -> None:
        self._over.set()
        self.connection.close()
        self._reader.join()

    def _read(self) -> None:
        with suppress(ConnectionClosed):
            while not self._over.is_set():
                for message in _decoded(self.connection.recv()):
                    self._take(message)

    def _take(self, message: dict[str, Any]) -> None:
        kind, name = message["type"], message.get("uuid", "")
        if kind.startswith("Gui") and "value" in message:
            self.widgets[kind] = name
        changed: dict[str, Any] = message.get("props") or message.get("updates") or {}
        content = changed.get("content")
        if isinstance(content, str):
            self.words[name] = content


@contextmanager
def owner(address: str) -> Generator[Owner]:
    """One that has the page's widgets, as far as it has any."""
    made = Owner(address)
    try:
        yield made
    finally:
        made.close()


def until(true: Any, what: str) -> None:
    end = monotonic() + PATIENCE
    while not true():
        if monotonic() > end:
            raise TimeoutError(what)
        sleep(0.02)


def _decoded(raw: Any) -> list[dict[str, Any]]:
    size, packed = (int.from_bytes(raw[at : at + 8], "little") for at in (0, 8))
    plain = zstandard.ZstdDecompressor().decompress(raw[16 : 16 + packed], max_output_size=size)
    return msgpack.decode(plain)["messages"]
