"""Draw moments of a scene as pictures of a film: the same moment gives the same pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from palpate.opencv import opencv
from palpate.viewer._style import DARK, MUTED, RULE, mixed
from palpate.viewer.camera import VIEW
from palpate.viewer.heat import BARE, FineMesh, colours
from palpate.viewer.ink import Ink
from palpate.viewer.marker import FORCE, OTHER
from palpate.viewer.rendered import Rendered, ViewPoint, rendered
from palpate.viewer.scene import Scene, SceneMoment, ShownContact, rim
from palpate.viewer.scene3d import aim

SIZE = (960, 720)
RATE = 25  # pictures a second
TRAIL = 3.0  # s
_TURN = 0.6  # s in which one side fades into the other, before that is touched
_HEAD, _TOP = 72, 540  # px of words, and down to the end of the body; the curve of the force is below
_HIGH = _TOP - _HEAD
_LEFT, _RIGHT, _FOOT = 64, 24, 40  # px about the curve
_SOFT = 1.5  # pixels of the body's picture along each of the film's: edges without steps
_SHADES = 6  # of a trail
_BESIDE = 14.0  # px from an arrow to the nearest edge of its label


class ScenePicture:
    """A drawing of any moment of a scene; the body is drawn once for each side that is touched.

    A body that moves, such as a robot, is drawn in each picture, and seen from one side.

    Args:
        scene: the scene to draw.

    Raises:
        InputError: OpenCV is not installed.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene, self._cv2 = scene, opencv()
        self._ink = Ink(self._cv2)
        self._moving = scene.moving
        self._stops, self._cameras = _sides(scene) if self._moving is None else (np.zeros(1), [_opening(scene)])
        self._bodies: dict[int, _Side] = {}
        self._curve = self._drawn_curve()

    @property
    def times(self) -> Float[np.ndarray, " n"]:
        """Times of the pictures of a film at real speed, (n,) [s] since the start."""
        return np.arange(int(self.scene.timeline.duration * RATE) + 1) / RATE

    def draw(self, seconds: float) -> UInt8[np.ndarray, "720 960 3"]:
        """Return the picture at a time [s] since the start, (720, 960, 3) in blue, green, red."""
        scene = self.scene
        moment = scene.at(scene.timeline.at(seconds))
        side, body = self._seen(seconds) if self._moving is None else self._moved(self._moving.body_at(moment.index))
        picture = np.full((SIZE[1], SIZE[0], 3), 255, dtype=np.uint8)
        picture[_HEAD:_TOP], picture[_TOP:] = body, self._curve
        top = picture[_HEAD:_TOP]
        if self._moving is None:
            self._draw_trail(top, moment, side)
        for contact in moment.contacts:
            self._draw_contact(top, contact, side, FORCE)
        other = scene.meanwhile(seconds)
        for contact in () if other is None else other.contacts:
            self._draw_contact(top, contact, side, OTHER)
        self._draw_now(picture, seconds)
        self._caption(picture, moment)
        return picture

    def _seen(self, seconds: float) -> tuple[_Side, UInt8[np.ndarray, "h w 3"]]:
        """Return the side of the current or next touch, and the body's picture, fading between sides."""
        at = max(int(np.searchsorted(self._stops, seconds, side="right")) - 1, 0)
        one, share = self._side(at), 0.0
        if at + 1 < len(self._stops):
            share = float(np.clip(1 - (self._stops[at + 1] - seconds) / _TURN, 0.0, 1.0))
        if share == 0.0:
            return one, one.picture
        other = self._side(at + 1)
        return other if share > 0.5 else one, self._cv2.addWeighted(one.picture, 1 - share, other.picture, share, 0)

    def _side(self, at: int) -> _Side:
        """Return a side by its number; the last two are kept."""
        if at not in self._bodies:
            camera = self._cameras[at]
            self._bodies = {k: side for k, side in self._bodies.items() if k >= at - 1}
            self._bodies[at] = self._drawn(camera, self._rendered(camera))
        return self._bodies[at]

    def _moved(self, body: FineMesh) -> tuple[_Side, UInt8[np.ndarray, "h w 3"]]:
        """Return a body where it is now, and its picture."""
        camera, bare = self._cameras[0], np.tile(np.array(BARE, dtype=np.uint8), (len(body.vertices), 1))
        drawn = rendered(camera, self.scene.placed(body.vertices), body.normals, body.faces, bare)
        side = self._drawn(camera, drawn)
        return side, side.picture

    def _drawn(self, camera: ViewPoint, drawn: Rendered) -> _Side:
        small = np.ascontiguousarray(self._ink.shrunk(drawn.picture, (SIZE[0], _HIGH))[:, :, ::-1])
        return _Side(camera, drawn, small)

    def _rendered(self, camera: ViewPoint) -> Rendered:
        """Return the body with its heat, else the layers' places as dots."""
        scene, body = self.scene, self.scene.body
        if body is not None:
            heat = scene.heat / max(float(scene.heat.max()), 1e-12)
            return rendered(camera, scene.placed(body.vertices), body.normals, body.faces, colours(heat))
        width, height = camera.size
        made = Rendered(np.full((height, width, 3), 255, dtype=np.uint8), np.full((height, width), np.inf))
        for place in np.concatenate([np.zeros((0, 3)), *(layer.places for layer in scene.layers)]):
            at = camera.seen(scene.placed(place)[None])[0]
            self._ink.disc(made.picture, at[:2], 6.0 * _SOFT, BARE)
        return made

    def _draw_trail(self, picture: np.ndarray, moment: SceneMoment, side: _Side) -> None:
        segments, age = self.scene.trail(moment.index, TRAIL)
        if not len(segments):
            return
        seen = side.camera.seen(self.scene.placed(segments).reshape(-1, 3))
        shown = side.body.visible(seen, 0.01).reshape(-1, 2).all(axis=1)
        shade = np.minimum((_SHADES * age).astype(np.int64), _SHADES - 1)
        for k in range(_SHADES - 1, -1, -1):
            ends = seen.reshape(-1, 2, 3)[shown & (shade == k), :, :2] / _SOFT
            self._ink.lines(picture, ends, mixed(FORCE, 0.7 * (k + 0.5) / _SHADES), 2)

    def _draw_contact(self, picture: np.ndarray, contact: ShownContact, side: _Side, ink: tuple[int, int, int]) -> None:
        """Draw ellipse, arrow, pale if hidden by the body, and force."""
        if not contact.located:
            return
        scene = self.scene
        tip = scene.placed(contact.point)
        shaft = contact.force * scene.newton / scene.size
        seen = side.camera.seen(np.stack([tip - shaft, tip + 2e-3 * contact.normal]))
        hidden = not bool(side.body.visible(seen[1:], 0.01)[0])
        if np.isfinite(contact.axes).all():
            self._draw_ellipse(picture, contact, side, ink)
        ends = seen[:, :2] / _SOFT
        self._ink.arrow(picture, ends, mixed(ink, 0.75 if hidden else 0.0))
        words = f"{float(np.linalg.norm(contact.force)):.1f} N"
        half = np.array([self._ink.width(words, 0.5) / 2, 6.0])
        along = (ends[1] - ends[0]) / max(float(np.linalg.norm(ends[1] - ends[0])), 1.0)
        aside = np.array([along[1], -along[0]]) * (1.0 if along[1] >= 0 else -1.0)  # to the right of it, or above
        at = ends[0] + (_BESIDE + np.abs(aside) @ half) * aside
        self._ink.middle(picture, words, np.clip(at, half + 4, [SIZE[0], _HIGH] - half - 4), 0.5, ink)

    def _draw_ellipse(self, picture: np.ndarray, contact: ShownContact, side: _Side, ink: tuple[int, int, int]) -> None:
        points = self.scene.ellipse_on_body(contact, self.scene.magnification)
        around = rim(len(points))
        seen = side.camera.seen(self.scene.placed(points[-around:]))
        shown = side.body.visible(seen, 0.01)
        edges = np.stack([seen, np.roll(seen, -1, axis=0)], axis=1)[shown & np.roll(shown, -1)]
        self._ink.lines(picture, edges[:, :, :2] / _SOFT, ink, 2)

    def _place(self, seconds: np.ndarray | float, force: np.ndarray | float) -> Float[np.ndarray, "*n 2"]:
        """Return the pixel in the strip below the body of a time [s] and a force [N]."""
        wide, high = SIZE[0] - _LEFT - _RIGHT, SIZE[1] - _TOP - _FOOT - 12
        x = _LEFT + wide * np.asarray(seconds) / max(self.scene.timeline.duration, 1e-9)
        return np.stack([x, 12 + high * (1 - np.asarray(force) / self._most)], axis=-1)

    def _drawn_curve(self) -> UInt8[np.ndarray, "180 960 3"]:
        """Return the strip of the force over time."""
        clock, values = self.scene.curves()
        total = values[:, 0] if self.scene.several else values[:, 1]
        self._most = max(float(np.nanmax(total, initial=0.0)), 1e-9)
        strip = np.full((SIZE[1] - _TOP, SIZE[0], 3), 255, dtype=np.uint8)
        for force, words in ((0.0, "0 N"), (self._most, f"{self._most:.3g} N")):
            ends = self._place(np.array([0.0, self.scene.timeline.duration]), np.full(2, force))
            self._ink.line(strip, ends, mixed(RULE, 0.0), 1)
            self._ink.text(strip, words, (6, round(ends[0, 1]) + 5), 0.42, mixed(MUTED, 0.0))
        known = np.isfinite(total)
        if known.any():
            self._ink.line(strip, self._place(clock[known], total[known]), FORCE, 1)
        return strip

    def _draw_now(self, picture: np.ndarray, seconds: float) -> None:
        ends = self._place(np.array([seconds, seconds]), np.array([0.0, self._most])) + np.array([0.0, _TOP])
        self._ink.line(picture, ends, (204, 51, 17), 2)
        self._ink.text(picture, f"{seconds:.1f} s", (_LEFT, SIZE[1] - 12), 0.5, DARK)
        whole = f"of {self.scene.timeline.duration:.1f} s"
        self._ink.text(picture, whole, (SIZE[0] - _RIGHT - self._ink.width(whole, 0.5), SIZE[1] - 12), 0.5, DARK)

    def _caption(self, picture: np.ndarray, moment: SceneMoment) -> None:
        ink, strongest = self._ink, moment.contacts[0]
        ink.text(picture, ink.cut(self.scene.title, 0.6, 520), (24, 34), 0.6, DARK)
        said = strongest.status.words
        if strongest.located:
            place = ", ".join(f"{value:.1f}" for value in 1e3 * strongest.point)
            said += f": {float(np.linalg.norm(strongest.force)):.2f} N at ({place}) mm"
        if strongest.origin.sensor and strongest.located:
            said = f"{strongest.origin.sensor} on {strongest.origin.link}: {said}"
        ink.text(picture, said, (24, 60), 0.5, mixed(MUTED, 0.0))
        if self.scene.other is not None:
            beside = ink.cut(self.scene.other.title, 0.5, 400)
            ink.text(picture, beside, (SIZE[0] - 24 - ink.width(beside, 0.5), 34), 0.5, OTHER)


@dataclass(frozen=True, eq=False)
class _Side:
    """The body from one side: as rendered, and as the film's picture."""

    camera: ViewPoint
    body: Rendered
    picture: UInt8[np.ndarray, "h w 3"]


def _sides(scene: Scene) -> tuple[Float[np.ndarray, " k"], list[ViewPoint]]:
    """Return when each touch begins [s since the start], and its camera; at least one."""
    touches = scene.touches
    known = [k for k in range(len(touches)) if np.isfinite(touches.normal[k]).all()]
    starts = np.array([max(scene.seconds_at(float(touches.start[k])), 0.0) for k in known])
    order = np.argsort(starts, kind="stable")
    peaks = [scene.timeline.at(scene.seconds_at(float(touches.peak_time[known[k]]))) for k in order] or [scene.opening]
    cameras = [_camera(scene, scene.at(index).contacts) for index in peaks]
    return np.append(0.0, starts[order]), [cameras[0], *cameras] if known else cameras


def _opening(scene: Scene) -> ViewPoint:
    """Return the camera of the sample that is shown first."""
    return _camera(scene, scene.at(scene.opening).contacts)


def _camera(scene: Scene, contacts: Sequence[ShownContact]) -> ViewPoint:
    size = SIZE[0], _HIGH
    position, target = aim(scene, size[0] / size[1], contacts, covered=0.0)
    return ViewPoint(position, target, VIEW, (round(_SOFT * size[0]), round(_SOFT * size[1])))
