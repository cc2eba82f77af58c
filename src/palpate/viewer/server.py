"""Serve a scene as a page with a timeline to scrub and play; each browser has a separate `BrowserSession`."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from ipaddress import ip_address
from secrets import token_urlsafe
from typing import TYPE_CHECKING, TypeVar

from palpate.errors import InputError
from palpate.viewer.camera import PANEL, PHONE, VIEW
from palpate.viewer.scene import Scene
from palpate.viewer.scene3d import aim
from palpate.viewer.session import BrowserSession
from palpate.viewer.widgets import name

if TYPE_CHECKING:
    import numpy as np
    from viser import ClientHandle, ViserServer

_Page = TypeVar("_Page", bound="Served")
PORTS = 100  # tried, where one is taken
_ELSEWHERE = {socket.AF_INET: "192.0.2.1", socket.AF_INET6: "2001:db8::1"}  # addresses of nobody, for documentation


def serve(
    scene: Scene, host: str = "127.0.0.1", port: int = 8080, up: Callable[[str], None] = lambda address: None
) -> None:
    """Serve the page until Ctrl-C.

    Args:
        scene: scene to show.
        host: to listen at; only this machine reaches the default.
        port: first to try; 0: any.
        up: called with the page's address when it can be opened.

    Raises:
        InputError: viser is not installed, or nothing can listen there.
    """
    with suppress(KeyboardInterrupt), Page(scene, host, port) as page:  # Ctrl-C is how this ends
        up(page.address)
        threading.Event().wait()


def require_viser(host: str, port: int) -> None:
    """Check, before long work, that the page can be served.

    Raises:
        InputError: viser is not installed, or nothing can listen there.
    """
    if find_spec("viser") is None:
        raise InputError("the page needs viser.", hint="pip install 'palpate[view]'")
    _free(host, port)


class Served:
    """A page that background threads serve until `stop`, or the end of a `with` block.

    Only browsers that open `address`, or have opened it before, are answered; see `Guard`.

    Attributes:
        address: address to open in a browser, with its token; of a server at all addresses of this machine, the one
            that others on its network reach.
        port: free port that was found.

    Args:
        host: to listen at; only this machine reaches the default.
        port: first to try; 0: any.
        token: secret that opens the page; "": a new one.

    Raises:
        InputError: viser is not installed, or nothing can listen there.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 8080, token: str = "") -> None:
        token = token or token_urlsafe(16)
        require_viser(host, port)
        from palpate.viewer.guard import Guard  # here: what it needs comes with viser
        from palpate.viewer.viser_door import listening

        with _quiet():
            self._server: ViserServer = listening(Guard(host, token), host, _free(host, port))
        self.port = self._server.get_port()
        self.address = f"{_shown(host)}:{self.port}/?token={token}"

    def look(self, aim: Callable[[float], tuple[np.ndarray, np.ndarray]]) -> None:
        """Set the first view of each browser; `aim` maps width over height to position and target of the camera."""
        camera = self._server.initial_camera
        camera.position, camera.look_at = aim(1.0)
        camera.up, camera.fov, camera.near, camera.far = (0.0, 0.0, 1.0), VIEW, 0.01, 100.0

        def turn(client: ClientHandle) -> None:
            wide, high = client.camera.image_width, client.camera.image_height
            with client.atomic():
                client.camera.position, client.camera.look_at = aim((wide - PANEL * (wide > PHONE)) / high)

        self._server.on_client_connect(turn)

    def stop(self) -> None:
        """Close the page and free its port."""
        with _quiet():
            self._server.stop()

    def __enter__(self: _Page) -> _Page:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


class Page(Served):
    """A scene, served as `Served` is.

    Args:
        scene: scene to show.
        host: to listen at; only this machine reaches the default.
        port: first to try; 0: any.
        together: all browsers share one moment; else each has a separate one.

    Raises:
        InputError: viser is not installed, or nothing can listen there.
    """

    def __init__(self, scene: Scene, host: str = "127.0.0.1", port: int = 8080, *, together: bool = False) -> None:
        self.scene = scene
        scene.ready()
        super().__init__(host, port)
        self.look(lambda aspect: aim(scene, aspect))
        self._sessions: dict[int, BrowserSession] = {}
        if together:
            self._sessions[-1] = BrowserSession(self._server, scene)
            return
        name(self._server.gui, scene.title)
        self._server.on_client_connect(self._join)
        self._server.on_client_disconnect(self._leave)

    @property
    def session(self) -> BrowserSession:
        """The `BrowserSession` of the browser that connected last, or of all together; IndexError without one."""
        return list(self._sessions.values())[-1]

    def stop(self) -> None:
        """Close the page and free its port."""
        for session in list(self._sessions.values()):
            session.stop()
        super().stop()

    def _join(self, client: ClientHandle) -> None:
        self._sessions[client.client_id] = BrowserSession(client, self.scene.copied())

    def _leave(self, client: ClientHandle) -> None:
        if (session := self._sessions.pop(client.client_id, None)) is not None:
            session.stop()


def _shown(host: str) -> str:
    """Return the start of a URL for a host, as other machines reach it."""
    from palpate.viewer.guard import in_url  # here: what it needs comes with viser

    try:
        everywhere = ip_address(host).is_unspecified
    except ValueError:
        return f"http://{host}"
    return f"http://{in_url(_own(host) if everywhere else host)}"


def _own(everywhere: str) -> str:
    """Return this machine's address on its network, else the loopback address."""
    family = socket.AF_INET6 if ":" in everywhere else socket.AF_INET
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((_ELSEWHERE[family], 9))  # sends nothing
        except OSError:
            return "::1" if family == socket.AF_INET6 else "127.0.0.1"
        return str(probe.getsockname()[0])


def _free(host: str, port: int) -> int:
    """Return the port, or the next one that can be listened at: viser itself would wait for ever."""
    last: OSError | None = None
    for candidate in range(port, min(port + PORTS, 65536)) if port > 0 else [0] * (port == 0):
        try:
            family, kind, protocol, _, address = socket.getaddrinfo(host, candidate, type=socket.SOCK_STREAM)[0]
            with socket.socket(family, kind, protocol) as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind(address)
                return candidate
        except (OSError, OverflowError, UnicodeError) as problem:
            last = problem if isinstance(problem, OSError) else OSError(str(problem))
    reason = "the port is not valid" if last is None else last.strerror or str(last)
    raise InputError(
        f"cannot listen there ({reason}).",
        where=f"{host}:{port}",
        hint="Give a --host of this machine, such as 127.0.0.1, and a --port from 1024 to 65535.",
    )


@contextmanager
def _quiet() -> Generator[None]:
    """Silence viser's announcement on the terminal within the block."""
    import rich

    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before
