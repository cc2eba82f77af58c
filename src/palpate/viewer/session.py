"""Control what one browser, or all together, see of a scene: the moment, playing, and the latest request."""

from __future__ import annotations

import re
import threading
from time import monotonic
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8

from palpate.viewer.panel import Panel
from palpate.viewer.scene import Scene
from palpate.viewer.scene3d import Scene3D
from palpate.viewer.timeline import next_of

if TYPE_CHECKING:
    from viser import ClientHandle, ViserServer

TICK = 1 / 20  # s between two pictures
_NUMBER = re.compile(r"-?\d+(\.\d*)?(e-?\d\d?)?")


class BrowserSession:
    """The view of one browser, or of all together, on a scene.

    A thread draws the latest request and drops those before it.

    Args:
        at: the browser, or the server if all see the same.
        scene: scene whose moments are shown.
    """

    def __init__(self, at: ViserServer | ClientHandle, scene: Scene) -> None:
        self.scene, self._at = scene, at
        self._wake = threading.Condition()
        self._seconds = float(scene.timeline.clock[scene.opening])
        self.playing = self._stopping = self._stale = False
        self.index = 0
        """Number of the shown sample in the scene."""
        with at.atomic():
            self.scene3d = Scene3D(at, scene)
            self._panel = Panel(at.gui, scene, self.ask)
        self._show()
        self._painter = threading.Thread(target=self._paint, name="palpate-page", daemon=True)
        self._painter.start()

    def seek(self, seconds: float) -> None:
        """Go to a time [s] since the start of the log, limited to its duration."""
        self._request(seconds=min(max(seconds, 0.0), self.scene.timeline.duration))

    def play(self, on: bool) -> None:
        """Start or stop playing; at the end it starts from the beginning."""
        if on and self._seconds >= self.scene.timeline.duration:
            self.seek(0.0)
        self._request(playing=on)

    def ask(self, what: str, client: ClientHandle | None = None) -> None:
        """Carry out a request of the panel, a key or a click; ignore all others.

        Args:
            what: "play", "seek 1.5", "touch -1" (previous) or "touch 1" (next), "sample 1", "refresh"; of one browser
                "face" (turn to the strongest contact), "frame" (to the body), "save" (a picture).
            client: browser that made the request.
        """
        verb, _, value = what.partition(" ")
        timeline = self.scene.timeline
        if verb == "refresh":
            self._request()
        elif verb == "play":
            self.play(not self.playing)
        elif verb in ("touch", "sample") and value in ("1", "-1"):
            among = timeline.touches if verb == "touch" else timeline.in_touch
            self.seek(float(timeline.clock[next_of(among, timeline.at(self._seconds), int(value))]))
        elif verb == "seek" and _NUMBER.fullmatch(value):  # from a browser: not to be believed
            self.seek(float(value))
        elif verb == "face" and client is not None:
            self._face(client)
        elif verb == "frame" and client is not None:
            self.scene3d.face(client)
        elif verb == "save" and client is not None:
            self._save(client)

    def _face(self, client: ClientHandle) -> None:
        strongest = self.scene.at(self.index).contacts[0]
        if strongest.located:
            self.scene3d.face(client, strongest)

    def _save(self, client: ClientHandle) -> None:
        """Send a browser its picture of the scene, or a notification without one."""
        camera = client.camera
        try:
            shown = client.get_render(camera.image_height, camera.image_width, transport_format="png", timeout=30.0)
        except (RuntimeError, TimeoutError):
            client.add_notification("No picture", "The browser made no picture; try again while its window is visible.")
            return
        import imageio.v3  # comes with viser

        made = imageio.v3.imwrite("<bytes>", _on_white(shown), extension=".png")
        title = "".join(letter if letter.isalnum() else "_" for letter in self.scene.title) or "palpate"
        client.send_file_download(f"{title}_{self._seconds:.3f}s.png", made, save_immediately=True)

    def stop(self) -> None:
        """Stop drawing and end the thread."""
        self._request(stopping=True)
        self._painter.join(timeout=5.0)

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
        with self._at.atomic():
            self.scene3d.show(moment, self._panel.settings())
            self._panel.show(moment, seconds, self.playing)


def _on_white(shown: UInt8[np.ndarray, "h w c"]) -> UInt8[np.ndarray, "h w 3"]:
    """Return the picture (h, w, 3) with white where it is transparent."""
    share = shown[..., 3:] / 255.0 if shown.shape[2] == 4 else np.ones((*shown.shape[:2], 1))
    return (shown[..., :3] * share + 255.0 * (1.0 - share)).round().astype(np.uint8)
