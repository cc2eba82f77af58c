"""Moments of a scene as pictures for a film, drawn without a screen: the same moment, the same pixels."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, UInt8

from palpate.sensors.markers import opencv
from palpate.viewer._style import MUTED, RULE
from palpate.viewer.arena import DARK, mixed
from palpate.viewer.heat import PALETTE, colours
from palpate.viewer.ink import Ink
from palpate.viewer.marker import FORCE, OTHER
from palpate.viewer.rendered import Camera, Rendered, rendered
from palpate.viewer.scene import Moment, Scene, ShownContact, before, rim
from palpate.viewer.scene3d import VIEW, aim

__all__ = ["RATE", "SIZE", "ScenePicture"]

SIZE = (960, 720)
RATE = 25  # pictures a second
TRAIL = 3.0  # s
_TURN = 0.6  # s that the camera takes to the other side, before it is touched
_TOP = 540  # px of the body; the curve of the force is below
_LEFT, _RIGHT, _FOOT = 64, 24, 40  # px about the curve
_SOFT = 2  # pixels of the body's picture along each of the film's where the camera rests: edges without steps


class ScenePicture:
    """Draws any moment of a scene; the body is drawn again where the camera has moved.

    Args:
        scene: to draw.

    Raises:
        InputError: OpenCV is not installed.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene, self._cv2 = scene, opencv()
        self._ink = Ink(self._cv2)
        self._stops, self._sides = _sides(scene)
        self._body: tuple[Camera, Rendered] | None = None
        self._curve = self._drawn_curve()

    @property
    def times(self) -> Float[np.ndarray, " n"]:
        """(n,) [s] since the start, of every picture of a film as fast as what happened."""
        return np.arange(int(self.scene.timeline.duration * RATE) + 1) / RATE

    def draw(self, seconds: float) -> UInt8[np.ndarray, "720 960 3"]:
        """The picture at a time since the start: blue, green, red."""
        scene = self.scene
        moment = scene.at(scene.timeline.at(seconds))
        camera = self._camera(seconds)
        body = self._seen(camera)
        picture = np.empty((SIZE[1], SIZE[0], 3), dtype=np.uint8)
        picture[:_TOP] = self._cv2.resize(body.picture, (SIZE[0], _TOP), interpolation=self._cv2.INTER_AREA)[:, :, ::-1]
        picture[_TOP:] = self._curve
        top = picture[:_TOP]
        self._draw_trail(top, moment, camera, body)
        for contact in moment.contacts:
            self._draw_contact(top, contact, camera, body, FORCE)
        other = scene.meanwhile(seconds)
        for contact in () if other is None else other.contacts:
            self._draw_contact(top, contact, camera, body, OTHER)
        self._draw_now(picture, seconds)
        self._caption(picture, moment)
        return picture

    def _camera(self, seconds: float) -> Camera:
        """On the side of the touch that is, or comes next; it turns in the second before that begins."""
        at = int(np.searchsorted(self._stops, seconds, side="right")) - 1
        direction, resting = self._sides[max(at, 0)], True
        if at + 1 < len(self._stops) and at >= 0:
            share = float(np.clip(1 - (self._stops[at + 1] - seconds) / _TURN, 0.0, 1.0))
            resting = share in (0.0, 1.0)
            direction = _between(direction, self._sides[at + 1], share * share * (3 - 2 * share))
        position, target = aim(self.scene, aspect=SIZE[0] / _TOP)
        distance = float(np.linalg.norm(position - target))
        soft = _SOFT if resting else 1  # nobody sees steps of what turns, and it is drawn anew in every picture
        return Camera(target + distance * direction, target, float(VIEW), (soft * SIZE[0], soft * _TOP))

    def _seen(self, camera: Camera) -> Rendered:
        kept = self._body
        if kept is not None and np.array_equal(kept[0].position, camera.position):
            return kept[1]
        made = self._rendered(camera)
        self._body = camera, made
        return made

    def _rendered(self, camera: Camera) -> Rendered:
        """The body with its heat; what layers show of it as dots where it has no mesh."""
        scene, body = self.scene, self.scene.body
        if body is not None:
            heat = scene.heat / max(float(scene.heat.max()), 1e-12)
            return rendered(camera, scene.placed(body.vertices), body.normals, body.faces, colours(heat))
        width, height = camera.size
        made = Rendered(np.full((height, width, 3), 255, dtype=np.uint8), np.full((height, width), np.inf))
        for place in np.concatenate([np.zeros((0, 3)), *(layer.places for layer in scene.layers)]):
            at = camera.seen(scene.placed(place)[None])[0]
            self._ink.disc(made.picture, at[:2], 6.0 * width / SIZE[0], _grey())
        return made

    def _draw_trail(self, picture: np.ndarray, moment: Moment, camera: Camera, body: Rendered) -> None:
        segments, age = self.scene.trail(moment.index, TRAIL)
        if not len(segments):
            return
        soft = camera.size[0] / SIZE[0]
        seen = camera.seen(self.scene.placed(segments).reshape(-1, 3))
        shown = body.visible(seen, 0.01).reshape(-1, 2).all(axis=1)
        for k in np.flatnonzero(shown):
            self._ink.line(picture, seen.reshape(-1, 2, 3)[k, :, :2] / soft, mixed(FORCE, 0.7 * age[k]), 2)

    def _draw_contact(
        self, picture: np.ndarray, contact: ShownContact, camera: Camera, body: Rendered, ink: tuple[int, int, int]
    ) -> None:
        """Ellipse and arrow, pale where the body is before them."""
        if not contact.located:
            return
        scene = self.scene
        tip = scene.placed(contact.point)
        shaft = contact.force * scene.newton / scene.size
        soft = camera.size[0] / SIZE[0]
        seen = camera.seen(np.stack([tip - shaft, tip + 2e-3 * contact.normal]))
        hidden = not bool(body.visible(seen[1:], 0.01)[0])
        if np.isfinite(contact.axes).all():
            self._draw_ellipse(picture, contact, camera, body, ink)
        self._ink.arrow(picture, seen[:, :2] / soft, mixed(ink, 0.75 if hidden else 0.0))
        at = seen[0, :2] / soft
        force = float(np.linalg.norm(contact.force))
        self._ink.text(picture, f"{force:.1f} N", (round(at[0]) + 6, round(at[1]) - 6), 0.5, ink)

    def _draw_ellipse(
        self, picture: np.ndarray, contact: ShownContact, camera: Camera, body: Rendered, ink: tuple[int, int, int]
    ) -> None:
        """Its rim where it is seen, laid on the body."""
        points = self.scene.ellipse_on_body(contact, self.scene.magnification)
        around = rim(len(points))
        soft, seen = camera.size[0] / SIZE[0], camera.seen(self.scene.placed(points[-around:]))
        shown = body.visible(seen, 0.01)
        for k in np.flatnonzero(shown & np.roll(shown, -1)):
            ends = seen[[k, (k + 1) % around], :2] / soft
            self._ink.line(picture, ends, ink, 2)

    def _place(self, seconds: np.ndarray | float, force: np.ndarray | float) -> Float[np.ndarray, "*n 2"]:
        """Pixels below the body, of a time and a force."""
        wide, high = SIZE[0] - _LEFT - _RIGHT, SIZE[1] - _TOP - _FOOT - 12
        x = _LEFT + wide * np.asarray(seconds) / max(self.scene.timeline.duration, 1e-9)
        return np.stack([x, 12 + high * (1 - np.asarray(force) / self._most)], axis=-1)

    def _drawn_curve(self) -> UInt8[np.ndarray, "180 960 3"]:
        """Force over time, with lines at its least and its greatest."""
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
        self._ink.text(picture, f"{seconds:.2f} s", (_LEFT, SIZE[1] - 12), 0.5, DARK)
        whole = f"of {self.scene.timeline.duration:.2f} s"
        self._ink.text(picture, whole, (SIZE[0] - _RIGHT - self._ink.width(whole, 0.5), SIZE[1] - 12), 0.5, DARK)

    def _caption(self, picture: np.ndarray, moment: Moment) -> None:
        """Title, and what the strongest contact is."""
        ink, strongest = self._ink, moment.contacts[0]
        ink.text(picture, ink.cut(self.scene.title, 0.6, 520), (24, 34), 0.6, DARK)
        said = strongest.status.label.replace("_", " ")
        if strongest.located:
            place = ", ".join(f"{value:.1f}" for value in 1e3 * strongest.point)
            said += f": {float(np.linalg.norm(strongest.force)):.2f} N at ({place}) mm"
        ink.text(picture, said, (24, 60), 0.5, mixed(MUTED, 0.0))
        if self.scene.beside is not None:
            ink.text(picture, ink.cut(self.scene.beside.title, 0.5, 520), (24, 84), 0.5, OTHER)


def _sides(scene: Scene) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k 3"]]:
    """When each touch begins [s since the start], and from where it is seen; one side at least."""
    touches = scene.touches
    known = [k for k in range(len(touches)) if np.isfinite(touches.normal[k]).all()]
    if not known:
        position, target = aim(scene)
        way = position - target
        return np.zeros(1), (way / np.linalg.norm(way))[None]
    stops = np.array([max(scene.seconds_at(float(touches.start[k])), 0.0) for k in known])
    order = np.argsort(stops, kind="stable")
    sides = np.array([before(touches.normal[known[k]]) for k in order])
    return np.append(0.0, stops[order]), np.concatenate([sides[:1], sides])


def _between(one: Float[np.ndarray, "3"], other: Float[np.ndarray, "3"], share: float) -> Float[np.ndarray, "3"]:
    """A direction on the way from one to another, turned about the vertical and raised."""
    turn = np.arctan2(one[1], one[0])
    apart = (np.arctan2(other[1], other[0]) - turn + np.pi) % (2 * np.pi) - np.pi
    rise = (1 - share) * np.arcsin(np.clip(one[2], -1, 1)) + share * np.arcsin(np.clip(other[2], -1, 1))
    turn = turn + share * apart
    return np.array([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)])


def _grey() -> tuple[int, int, int]:
    red, green, blue = (round(float(value)) for value in PALETTE[0])
    return red, green, blue
