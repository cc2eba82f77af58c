"""One contact in the page's space: point, normal, force, 95 % ellipse and torque, as handles that are moved."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from palpate.viewer.scene import Scene, ShownContact

if TYPE_CHECKING:
    from viser import SceneApi, SceneNodeHandle

__all__ = ["FORCE", "Marker", "arc"]

FORCE, POINT, TORQUE = (0, 48, 120), (16, 24, 32), (130, 40, 120)
FAINTEST = 0.02  # of the usual torque: less is not drawn
_FULL, _RADIUS, _STEPS = 1.5 * np.pi, 0.09, 40  # arc of the usual torque [rad], in sizes of the body
_CIRCLE = np.stack([np.cos(np.linspace(0, 2 * np.pi, 65)), np.sin(np.linspace(0, 2 * np.pi, 65)), np.zeros(65)], axis=1)


class Marker:
    """The number `slot` of the contacts that a sample may have."""

    def __init__(self, space: SceneApi, slot: int) -> None:
        name, nothing = f"/contact/{slot}", np.zeros((1, 2, 3))
        self._frame = space.add_frame(name, show_axes=False)
        space.add_icosphere(f"{name}/point", radius=0.008, color=POINT, cast_shadow=False)
        space.add_arrows(
            f"{name}/normal", np.array([[[0, 0, 0], [0, 0, 0.12]]]), POINT, shaft_radius=0.002, head_radius=0.006,
            head_length=0.02,
        )  # fmt: skip
        self._disc = space.add_mesh_simple(
            f"{name}/disc", _CIRCLE, _fan(65), color=FORCE, opacity=0.25, side="double", cast_shadow=False
        )
        self._rim = space.add_line_segments(
            f"{name}/ellipse", np.stack([_CIRCLE[:-1], _CIRCLE[1:]], axis=1), FORCE, thickness=2.0,
            thickness_units="screen",
        )  # fmt: skip
        self._arc = space.add_line_segments(f"{name}/torque", nothing, TORQUE, thickness=4.0, thickness_units="screen")
        self._head = space.add_arrows(
            f"{name}/torque_head", nothing, TORQUE, shaft_radius=0.002, head_radius=0.014, head_length=0.03
        )
        self._arrow = space.add_arrows(
            f"/force/{slot}", nothing, FORCE, shaft_radius=0.007, head_radius=0.018, head_length=0.05
        )
        self._label = space.add_label(f"/force/{slot}/label", "", anchor="bottom-center")

    def show(self, scene: Scene, contact: ShownContact | None, magnification: int) -> None:
        """Move it to a contact of a scene; None, or one without a place, hides it."""
        located = contact is not None and contact.located
        for handle in (self._frame, self._arrow, self._label):
            _put(handle, visible=located)
        if contact is None or not located:
            return
        x, y, z, w = contact.turn.tolist()
        self._frame.position = scene.placed(contact.point + 1e-3 * scene.size * contact.normal)
        self._frame.wxyz = (w, x, y, z)
        known = bool(np.isfinite(contact.axes).all())
        _put(self._disc, visible=known)
        _put(self._rim, visible=known)
        if known:
            long, short = (magnification * contact.axes / scene.size).tolist()
            self._disc.scale = self._rim.scale = (long, short, 1.0)
        self._show_force(scene, contact)
        self._show_torque(contact.torque / scene.torque if scene.torque > 0 else 0.0)

    def _show_force(self, scene: Scene, contact: ShownContact) -> None:
        """An arrow that pushes with its tip."""
        tip = scene.placed(contact.point)
        shaft = contact.force * scene.newton / scene.size
        length = float(np.linalg.norm(shaft))
        _put(self._arrow, head_length=min(0.05, 0.6 * length), head_radius=min(0.018, 0.3 * length))
        self._arrow.points = np.stack([tip - shaft, tip])[None].astype(np.float32)
        self._label.position = tip - shaft - (0.03 * shaft / length if length > 0 else 0.0)
        name = f"{contact.identity}: " if scene.several else ""
        self._label.text = f"{name}{np.linalg.norm(contact.force):.1f} N"

    def _show_torque(self, share: float) -> None:
        """An arc about the normal that ends in a head, as long as the share of the usual torque."""
        seen = abs(share) > FAINTEST  # NaN is not
        _put(self._arc, visible=seen)
        _put(self._head, visible=seen)
        if not seen:
            return
        segments = arc(share)
        self._arc.points = segments[:-2].astype(np.float32)
        last = segments[-1, 1] - segments[-1, 0]
        tip = segments[-1, 1] + 0.03 * last / np.linalg.norm(last)
        self._head.points = np.stack([segments[-3, 1], tip])[None].astype(np.float32)


def _put(handle: SceneNodeHandle, **values: bool | float) -> None:
    """Set what has changed: a handle takes 0.1 ms to find out that nothing has."""
    for name, value in values.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)


def arc(share: float) -> Float[np.ndarray, "_ 2 3"]:
    """Segments about z, right-handed where positive, as long as the share of the usual torque; at most a full turn."""
    turn = np.clip(_FULL * share, -2 * np.pi, 2 * np.pi) * np.linspace(0.0, 1.0, _STEPS + 1)
    points = np.stack([_RADIUS * np.cos(turn), _RADIUS * np.sin(turn), np.full_like(turn, 0.01)], axis=1)
    return np.stack([points[:-1], points[1:]], axis=1)


def _fan(count: int) -> np.ndarray:
    return np.stack([np.zeros(count - 2, int), np.arange(1, count - 1), np.arange(2, count)], axis=1)
