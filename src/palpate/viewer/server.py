"""The page: a scene in a browser, with a timeline to scrub and play. Thin: what to draw is decided in `scene`."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from importlib.util import find_spec
from time import monotonic
from typing import TYPE_CHECKING

from palpate.errors import InputError
from palpate.viewer.panel import Panel
from palpate.viewer.scene import Scene
from palpate.viewer.scene3d import Scene3D

if TYPE_CHECKING:
    from viser import ViserServer

__all__ = ["Page", "address", "listen", "quiet", "require_viser", "serve"]

TICK = 1 / 20  # s between two pictures
PORTS = 100  # tried, where one is taken


def serve(
    scene: Scene, host: str = "127.0.0.1", port: int = 8080, up: Callable[[str], None] = lambda address: None
) -> None:
    """Serve the page until Ctrl-C.

    Args:
        scene: what to show.
        host: address to listen at; only this machine can reach the default.
        port: the first to try; 0 for any.
        up: called with the page's address when it can be opened.

    Raises:
        InputError: viser is not installed, or nothing can listen there.
    """
    try:
        with Page(scene, host, port) as page:
            up(page.address)
            threading.Event().wait()
    except KeyboardInterrupt:  # how this ends
        return


def require_viser(host: str, port: int) -> None:
    """Before long work, say what would keep the page from being served.

    Raises:
        InputError: viser is not installed, or nothing can listen there.
    """
    if find_spec("viser") is None:
        raise InputError("the page needs viser.", hint="pip install 'palpate[view]'")
    _free(host, port)


class Page:
    """A scene, served from a thread of its own until `stop`; as a context manager it stops by itself.

    All that changes the picture runs in one more thread, which draws the latest request and drops those before it.
    """

    def __init__(self, scene: Scene, host: str = "127.0.0.1", port: int = 8080) -> None:
        self.scene = scene
        self._server = listen(host, port)
        self._wake = threading.Condition()
        self._seconds = float(scene.timeline.clock[scene.opening])
        self.playing = self._stopping = self._stale = False
        self.index = 0
        """The sample that is shown, counted in the scene."""
        with self._server.atomic():
            self._scene3d = Scene3D(self._server, scene)
            self._panel = Panel(self._server, scene, self)
        self._show()
        self._painter = threading.Thread(target=self._paint, name="palpate-page", daemon=True)
        self._painter.start()

    @property
    def address(self) -> str:
        """To open in a browser."""
        return address(self._server)

    def seek(self, seconds: float) -> None:
        """Go to a time since the start of the log."""
        self._request(seconds=min(max(seconds, 0.0), self.scene.timeline.duration))

    def play(self, on: bool) -> None:
        """Run, or stand still; at the end it begins anew."""
        if on and self._seconds >= self.scene.timeline.duration:
            self.seek(0.0)
        self._request(playing=on)

    def refresh(self) -> None:
        """Draw again: a setting has changed."""
        self._request()

    def step(self, which: int) -> None:
        """To the next touch (1) or the previous one (-1)."""
        timeline = self.scene.timeline
        self.seek(float(timeline.clock[timeline.touch(timeline.at(self._seconds), which)]))

    def face(self) -> None:
        """Look at the side of the strongest contact."""
        strongest = self.scene.at(self.index).contacts[0]
        if strongest.located:
            self._scene3d.face(strongest)

    def stop(self) -> None:
        """Close the page and free its port."""
        self._request(stopping=True)
        self._painter.join(timeout=5.0)
        with quiet():
            self._server.stop()

    def __enter__(self) -> Page:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _request(self, seconds: float | None = None, playing: bool | None = None, stopping: bool = False) -> None:
        with self._wake:
            self._seconds = self._seconds if seconds is None else seconds
            self.playing = self.playing if playing is None else playing
            self._stopping |= stopping
            self._stale = True
            self._wake.notify_all()

    def _paint(self) -> None:
        last = monotonic()
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._stale or self.playing)
                if self._stopping:
                    return
                self._stale = False
                now = monotonic()
                if self.playing:
                    self._advance(min(now - last, 2 * TICK))
                last = now
            self._show()
            with self._wake:
                self._wake.wait_for(lambda: self._stopping, timeout=max(0.0, TICK - (monotonic() - now)))

    def _advance(self, passed: float) -> None:
        duration = self.scene.timeline.duration
        self._seconds = min(self._seconds + self._panel.speed * passed, duration)
        self.playing = self._seconds < duration

    def _show(self) -> None:
        seconds = self._seconds
        self.index = self.scene.timeline.at(seconds)
        moment = self.scene.at(self.index)
        with self._server.atomic():
            self._scene3d.show(moment, self._panel.settings())
            self._panel.show(moment, seconds)


def address(server: ViserServer) -> str:
    """Of a server's page, to open in a browser."""
    host = server.get_host()
    host = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(host, f"[{host}]" if ":" in host else host)
    return f"http://{host}:{server.get_port()}"


def listen(host: str, port: int) -> ViserServer:
    """A server on this port, or on the next one that is free."""
    require_viser(host, port)
    from viser import ViserServer

    class Local(ViserServer):
        """Never reached from elsewhere unless the host says so."""

        def request_share_url(self, verbose: bool = True) -> str | None:
            """A stranger's page may ask for this by itself: nothing is shared with anybody's servers."""
            return None

    with quiet():
        return Local(host, _free(host, port), label="Palpate", verbose=False)


def _free(host: str, port: int) -> int:
    """The port, or the next one that can be listened at; viser itself would wait for ever where there is none."""
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
    reason = "no such port" if last is None else last.strerror or str(last)
    raise InputError(
        f"cannot listen there ({reason}).",
        where=f"{host}:{port}",
        hint="Give a --host of this machine, such as 127.0.0.1, and a --port from 1024 to 65535.",
    )


@contextmanager
def quiet() -> Generator[None]:
    """Viser announces itself on the screen; here the command speaks."""
    import rich

    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before
