"""What load cells add to the page's space: the cells, coloured by what they carry, and the torque as an arc."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from palpate.contact.estimate import ContactEstimate
from palpate.sensors.load_cells import LoadCells
from palpate.viewer.heat import colours
from palpate.viewer.scene import Moment, Scene

if TYPE_CHECKING:
    from viser import BoxHandle, LabelHandle, SceneApi

__all__ = ["CellBoxes", "Twist", "arc", "loads"]

TORQUE = (130, 40, 120)
PULLED = 0.22  # sizes of the body by which cells are drawn below their places: else it would hide them
BOX = 0.35  # of the distance between neighbours
FAINTEST = 0.02  # of the usual torque: less is not drawn
_FULL, _RADIUS, _STEPS = 1.5 * np.pi, 0.09, 40  # arc of the usual torque [rad], in sizes of the body
_STRONG = 0.95  # quantile of what counts as usual


def loads(
    cells: LoadCells,
    point: Float[np.ndarray, "*batch 3"],
    normal: Float[np.ndarray, "*batch 3"],
    force: Float[np.ndarray, "*batch 3"],
    torque: Float[np.ndarray, "*batch"],
) -> Float[np.ndarray, "*batch k"]:
    """Lengths of the cells' readings [V] that a contact makes: what the model says, so that a dead cell has one too."""
    wrench = np.concatenate([force, np.cross(point, force) + torque[..., None] * normal], axis=-1)
    readings = wrench @ cells.matrix.T
    return np.linalg.norm(readings.reshape(*readings.shape[:-1], -1, 3), axis=-1)


def arc(share: float) -> Float[np.ndarray, "_ 2 3"]:
    """Segments about z, right-handed where positive, as long as the share of the usual torque; at most a full turn."""
    turn = np.clip(_FULL * share, -2 * np.pi, 2 * np.pi) * np.linspace(0.0, 1.0, _STEPS + 1)
    points = np.stack([_RADIUS * np.cos(turn), _RADIUS * np.sin(turn), np.full_like(turn, 0.01)], axis=1)
    return np.stack([points[:-1], points[1:]], axis=1)


class CellBoxes:
    """A box for each cell whose place is known, pulled away from the body, darker where it carries more."""

    def __init__(self, space: SceneApi, scene: Scene, cells: LoadCells) -> None:
        self._cells = cells
        found = scene.estimate[np.flatnonzero(scene.timeline.touched)]
        carried = loads(cells, found.point, found.normal, found.force, np.nan_to_num(found.torque))
        self._most = float(np.quantile(carried.max(axis=1), _STRONG)) if len(carried) else 1.0
        places = (cells.positions - scene.mesh.centre) / scene.mesh.size
        down = places.mean(axis=0)
        length = float(np.linalg.norm(down))
        down = down / length if length > 0 else np.array([0.0, 0.0, -1.0])
        apart = np.linalg.norm(places[:, None] - places, axis=2) + 10.0 * np.eye(len(places))
        side = BOX * float(apart.min())
        self._drawn: list[tuple[BoxHandle, LabelHandle]] = []
        for number, place in enumerate(places + PULLED * down, start=1):
            box = space.add_box(f"/cells/{number}", dimensions=(side, side, 0.6 * side), position=place)
            label = space.add_label(f"/cells/{number}/name", "", position=(0.0, 0.0, -side))
            self._drawn.append((box, label))

    def show(self, moment: Moment) -> None:
        """Colour them for a moment."""
        carried = np.zeros(self._cells.cells)
        if moment.located:
            torque = np.array(np.nan_to_num(moment.torque))  # nan_to_num makes a scalar of an array without axes
            carried = loads(self._cells, moment.point, moment.normal, moment.force, torque)
        shades = colours(np.clip(carried / max(self._most, 1e-12), 0.0, 1.0))
        for number, (box, label) in enumerate(self._drawn):
            red, green, blue = shades[number].tolist()
            box.color = (red, green, blue)
            label.text = f"cell {number + 1}: {1e3 * carried[number]:.0f} mV"


class Twist:
    """The torque about the normal, as an arc about it that ends in a head; it lives in the frame of the contact."""

    def __init__(self, space: SceneApi, estimate: ContactEstimate) -> None:
        known = np.abs(estimate.torque[np.isfinite(estimate.torque)])
        self._usual = float(np.quantile(known, _STRONG)) if len(known) else 0.0
        nothing = np.zeros((1, 2, 3))
        self._line = space.add_line_segments(
            "/contact/torque", nothing, TORQUE, thickness=4.0, thickness_units="screen"
        )
        self._head = space.add_arrows(
            "/contact/torque_head", nothing, TORQUE, shaft_radius=0.002, head_radius=0.014, head_length=0.03
        )

    def show(self, moment: Moment) -> None:
        """Turn as far as the torque of a moment says."""
        share = moment.torque / self._usual if self._usual > 0 and np.isfinite(moment.torque) else 0.0
        seen = abs(share) > FAINTEST
        self._line.visible = self._head.visible = seen
        if not seen:
            return
        segments = arc(share)
        self._line.points = segments[:-2].astype(np.float32)
        last = segments[-1, 1] - segments[-1, 0]
        tip = segments[-1, 1] + 0.03 * last / np.linalg.norm(last)
        self._head.points = np.stack([segments[-3, 1], tip])[None].astype(np.float32)
