"""Draw one contact in the page's space: point, normal, force, 95 % ellipse and torque, as handles that are moved."""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int, UInt32

from palpate.spatial.arguments import takes_arrays
from palpate.viewer.scene import SMALL, Scene, ShownContact, disc, rim

if TYPE_CHECKING:
    from viser import SceneApi, SceneNodeHandle

FORCE, POINT, TORQUE = (0, 48, 120), (16, 24, 32), (130, 40, 120)
TRACE = np.array([(0, 90, 170), (170, 205, 235)])  # of a trail: now, and long ago
OTHER = (0, 120, 80)  # of contacts that are compared
FAINT = np.array((190, 205, 225))  # of the rim of an ellipse that says nothing
FAINTEST = 0.02  # of the usual torque: less is not drawn
STILL = 0.01  # sizes of the body by which a label is not moved: words that tremble cannot be read
STEEP = 0.5  # z of a normal below which the camera, which stands above, sees an arrow come from below
_FULL, _RADIUS, _STEPS = 1.5 * np.pi, 0.09, 40  # arc of the usual torque [rad], in sizes of the body
_BARB, _WIDE = 0.03, 0.014  # of the head at its end, in sizes of the body


class Marker:
    """Handles of one contact in the page's space; `slot` is its number among the contacts of a sample."""

    def __init__(self, space: SceneApi, slot: int, root: str = "", ink: tuple[int, int, int] = FORCE) -> None:
        name, nothing = f"{root}/contact/{slot}", np.zeros((1, 2, 3))
        self._ink = ink
        self._frame = space.add_frame(name, show_axes=False)
        space.add_icosphere(f"{name}/point", radius=0.008, color=POINT, cast_shadow=False)
        space.add_arrows(
            f"{name}/normal", np.array([[[0, 0, 0], [0, 0, 0.12]]]), POINT, shaft_radius=0.002, head_radius=0.006,
            head_length=0.02,
        )  # fmt: skip
        flat = np.pad(disc(*SMALL), ((0, 0), (0, 1)))
        self._disc = space.add_mesh_simple(
            f"{root}/ellipse/{slot}/disc", flat, _facets(len(flat)), color=ink, opacity=0.0, side="double",
            cast_shadow=False,
        )  # fmt: skip
        self._rim = space.add_line_segments(
            f"{root}/ellipse/{slot}/rim", nothing, ink, thickness=2.0, thickness_units="screen"
        )
        self._arc = space.add_line_segments(f"{name}/torque", nothing, TORQUE, thickness=4.0, thickness_units="screen")
        self._arrow = space.add_arrows(
            f"{root}/force/{slot}", nothing, ink, shaft_radius=0.007, head_radius=0.018, head_length=0.05
        )
        self._label = space.add_label(f"{root}/force/{slot}/label", "")
        self._anchors = ("top-center", "bottom-center") if root else ("bottom-center", "top-center")

    def show(self, scene: Scene, contact: ShownContact | None, magnification: int) -> None:
        """Move the handles to a contact of a scene; None, or a contact without a place, hides them."""
        located = contact is not None and contact.located
        for handle in (self._frame, self._arrow, self._label):
            _put(handle, visible=located)
        known = contact is not None and located and bool(np.isfinite(contact.axes).all())
        for handle in (self._disc, self._rim):
            _put(handle, visible=known)
        if contact is None or not located:
            return
        self._frame.position = scene.placed(contact.point + 1e-3 * scene.size * contact.normal)
        self._frame.wxyz = facing(contact.normal)
        if known:
            self._show_ellipse(scene, contact, magnification)
        self._show_force(scene, contact)
        self._show_torque(scene.turning(contact))

    def _show_ellipse(self, scene: Scene, contact: ShownContact, magnification: int) -> None:
        """Lay the ellipse on the body, the fainter the larger it is."""
        points = scene.placed(scene.ellipse_on_body(contact, magnification)).astype(np.float32)
        strength = fade(magnification * float(contact.axes[0]), scene.size)
        self._lay(points)
        around = rim(len(points))
        ends, opacity = points[_ends(around) - around], round(0.25 * strength, 3)
        if len(ends) < len(self._rim.points):
            self._rim.points = ends  # first, so that no end is ever without a colour
        if opacity != self._disc.opacity or around != len(self._rim.colors):
            self._disc.opacity = opacity
            ink = FAINT + strength * (np.array(self._ink) - FAINT)
            self._rim.colors = np.tile(ink.round().astype(np.uint8), (around, 2, 1))
        self._rim.points = ends

    def _lay(self, points: Float[np.ndarray, "k 3"]) -> None:
        """Set the ellipse's points such that no facet ever names a missing point."""
        more = len(points) - len(self._disc.vertices)
        if more < 0:
            self._disc.faces = _facets(len(points))
        self._disc.vertices = points
        if more > 0:
            self._disc.faces = _facets(len(points))

    def _show_force(self, scene: Scene, contact: ShownContact) -> None:
        tip = scene.placed(contact.point)
        shaft = contact.force * scene.newton / scene.size
        length = float(np.linalg.norm(shaft))
        _put(self._arrow, head_length=min(0.05, 0.6 * length), head_radius=min(0.018, 0.3 * length))
        self._arrow.points = np.stack([tip - shaft, tip])[None].astype(np.float32)
        words = scene.placed(scene.labelled(contact))
        if np.abs(words - self._label.position).max() > STILL:
            self._label.position = words
        below = contact.normal[2] < STEEP  # two results are often at one place: their labels are on two sides
        _put(self._label, anchor=self._anchors[int(below)])
        name = f"{contact.origin.link or contact.identity}: " if scene.several else ""
        _put(self._label, text=f"{name}{length * scene.size / scene.newton:.1f} N")

    def _show_torque(self, share: float) -> None:
        seen = abs(share) > FAINTEST  # NaN is not
        _put(self._arc, visible=seen)
        if seen:
            segments = arc(share)
            self._arc.points = np.concatenate([segments, barbs(segments[-1])]).astype(np.float32)


@takes_arrays
def facing(way: Float[np.ndarray, "3"]) -> tuple[float, float, float, float]:
    """Return the quaternion w, x, y, z that turns z to a direction by the shortest way.

    Raises:
        InputError: way has another shape.
    """
    x, y, z = (way / np.linalg.norm(way)).tolist()
    if z < -1.0 + 1e-9:
        return 0.0, 1.0, 0.0, 0.0
    length = math.sqrt(2.0 * (1.0 + z))
    return 0.5 * length, -y / length, x / length, 0.0


def _put(handle: SceneNodeHandle, **values: bool | float | str) -> None:
    """Set the attributes that have changed: a handle takes 0.1 ms to find out."""
    for name, value in values.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)


def arc(share: float) -> Float[np.ndarray, "_ 2 3"]:
    """Return segments of an arc about z, (40, 2, 3), right-handed for a positive share of the usual torque.

    Its length is in proportion to the share, at most a full turn; the unit is the size of the body.
    """
    turn = np.clip(_FULL * share, -2 * np.pi, 2 * np.pi) * np.linspace(0.0, 1.0, _STEPS + 1)
    points = np.stack([_RADIUS * np.cos(turn), _RADIUS * np.sin(turn), np.full_like(turn, 0.01)], axis=1)
    return np.stack([points[:-1], points[1:]], axis=1)


@takes_arrays
def barbs(last: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "4 2 3"]:
    """Return four segments (4, 2, 3) that make the last one of a level line an arrow.

    Raises:
        InputError: last has another shape.
    """
    tip = last[1]
    x, y, _ = ((tip - last[0]) / np.linalg.norm(tip - last[0])).tolist()
    side = _WIDE * np.array([[y, -x, 0.0], [-y, x, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    return np.stack([np.tile(tip, (4, 1)), tip - [_BARB * x, _BARB * y, 0.0] + side], axis=1)


def fade(long: float, size: float) -> float:
    """Return the strength of an ellipse: 1 up to a half-axis of a quarter of the body, then falling to 0.15."""
    return float(np.clip(0.25 * size / max(long, 1e-12), 0.15, 1.0))


@cache
def _ends(around: int) -> Int[np.ndarray, "k 2"]:
    """Return the first and last point of each side of a polygon."""
    return (np.arange(around)[:, None] + np.arange(2)) % around


@cache
def _facets(count: int) -> UInt32[np.ndarray, "f 3"]:
    """Return the facets between the rings of a `disc` of `count` points."""
    around, after = _ends(step := rim(count)).T
    parts = [np.stack([np.zeros(step, int), 1 + around, 1 + after], axis=1)]
    for inner in range(1, count - step, step):
        outer = inner + step
        parts.append(np.stack([inner + around, outer + around, outer + after], axis=1))
        parts.append(np.stack([inner + around, outer + after, inner + after], axis=1))
    return np.concatenate(parts).astype(np.uint32)
