"""Draw taxels on the page as patches coloured by their forces, and a sheet unrolled as an image."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from palpate.errors import InputError
from palpate.sensors.taxels.model import TaxelBody
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import quaternion_from_rotation
from palpate.spatial.shown import three_digits
from palpate.viewer.heat import colours, linear
from palpate.viewer.legend import bar
from palpate.viewer.marker import FORCE
from palpate.viewer.samples import sheet_places
from palpate.viewer.scene import Scene

if TYPE_CHECKING:
    from viser import BatchedMeshHandle, ClientHandle, GuiApi, GuiImageHandle, ViserServer

PIXELS = 18  # of a cell of the unrolled sheet
LIFT = 3e-4  # m: cells stand out from the body
GAP = 0.94  # of a cell's side is drawn
CLEAR = 0.9  # of the way to the nearest cell that one anywhere on a body is wide
CORNERS = 0.5 * np.array([(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)])  # of a patch
FACES = np.array([(0, 1, 2), (0, 2, 3)])


@takes_arrays
class TaxelLayer:
    """A layer of the page that draws cells on a body as patches.

    Args:
        body: the k cells.
        forces: (n, k) [N], a row for each sample of the log; None: not known.
        live: the forces come from a stream, through `feed`.

    Raises:
        InputError: forces of another shape.
    """

    def __init__(
        self,
        body: TaxelBody,
        forces: Float[np.ndarray, "n k"] | Float32[np.ndarray, "n k"] | None = None,
        live: bool = False,
    ) -> None:
        if forces is not None and (forces.ndim != 2 or forces.shape[1] != len(body)):
            raise InputError(f"forces must have shape (n, {len(body)}), not {forces.shape}.")
        self._body, self._forces = body, forces
        self._fed = np.zeros(len(body)) if live else None
        strong = 0.0 if forces is None or not len(forces) else float(np.quantile(forces.max(axis=1), 0.99))
        self.most = max(strong, 1e-6)
        """Force [N] that is drawn darkest."""
        self._sheet: GuiImageHandle | None = None

    @property
    def covers(self) -> bool:
        """Return True: the cells cover the body."""
        return True

    @property
    def places(self) -> Float[np.ndarray, "k 3"]:
        """Return the positions of the cells, (k, 3) [m]."""
        return self._body.positions

    def draw(self, server: ViserServer | ClientHandle, scene: Scene) -> None:
        """Draw all cells in the server's scene, visible from both sides."""
        rotations, sides = _patches(self._body)
        if not self._body.rows and len(self._body) > 1:  # places and areas are measured: squares could overlap
            from scipy.spatial import KDTree

            away = np.asarray(KDTree(self._body.positions).query(self._body.positions, k=2)[0])
            sides = np.minimum(sides, CLEAR * away[:, 1:])
        self._cells: BatchedMeshHandle = server.scene.add_batched_meshes_simple(
            "/taxels",
            CORNERS,
            FACES,
            batched_wxyzs=np.roll(quaternion_from_rotation(rotations), 1, axis=1),
            batched_positions=scene.placed(self._body.positions + LIFT * self._body.normals),
            batched_scales=GAP * sides / scene.size,
            batched_colors=self._colours(np.zeros(len(self._body))),
            side="double",
            lod="off",
            cast_shadow=False,
        )

    def panel(self, gui: GuiApi) -> None:
        """Add a checkbox that hides the cells, and the image of the unrolled sheet."""
        seen = gui.add_checkbox("cells", True, hint="hide them to see the body below")
        seen.on_update(lambda event: setattr(self._cells, "visible", seen.value))
        if self._body.rows and self._known:
            flat = unrolled(np.zeros((self._body.rows, self._body.columns)), self.most, np.zeros((0, 2)))
            self._sheet = gui.add_image(flat, label="sheet, unrolled, row 0 below; ring: contact")

    def feed(self, force: Float[np.ndarray, " k"]) -> None:
        """Take the present forces (k,) [N] of the cells; the largest so far is drawn darkest.

        Raises:
            InputError: force has another shape.
        """
        self._fed, self.most = force, max(self.most, float(np.nan_to_num(force).max(initial=0.0)))

    def show(self, scene: Scene, index: int) -> None:
        """Colour the cells, and the image of the unrolled sheet, by their forces at a sample."""
        if not self._known:
            return
        force = self._force(scene, index)
        self._cells.batched_colors = self._colours(force)
        if self._sheet is not None:
            self._sheet.image = unrolled(force.reshape(self._body.rows, -1), self.most, _dots(scene, index))

    def rows(self, scene: Scene, index: int) -> list[tuple[str, str]]:
        """Return (name, text) pairs of the sum of the cells' forces and the largest one [N]; [] if not known."""
        if not self._known:
            return []
        force = self._force(scene, index)
        return [
            ("all cells, sum", f"{three_digits(force.sum())} N"),
            ("strongest cell", f"{three_digits(force.max())} N"),
        ]

    def legend(self) -> list[str]:
        """Return a list of one HTML string, a colour bar up to the force `most` [N]; [] if no forces are known."""
        return [bar("cell", self.most, "N")] if self._known else []

    @property
    def _known(self) -> bool:
        return self._forces is not None or self._fed is not None

    def _force(self, scene: Scene, index: int) -> Float[np.ndarray, " k"]:
        """Return each cell's force (k,) [N] at a sample; 0 where the log has none."""
        if self._fed is not None:
            return self._fed
        sample = int(scene.contacts.sample[scene.starts[index]])
        if self._forces is None or sample >= len(self._forces):
            return np.zeros(len(self._body))
        return self._forces[sample].astype(np.float64)

    def _colours(self, force: Float[np.ndarray, " k"]) -> UInt8[np.ndarray, "k 3"]:
        return linear(colours(np.clip(np.nan_to_num(force) / self.most, 0.0, 1.0)))


def _dots(scene: Scene, index: int) -> Float[np.ndarray, "c 2"]:
    """Return row and column, (c, 2), of each contact of a sample on the sheet."""
    places = sheet_places(scene.contacts[scene.rows(index)])
    return np.zeros((0, 2)) if places is None else places[np.isfinite(places).all(axis=1)]


def _patches(body: TaxelBody) -> tuple[Float[np.ndarray, "k 3 3"], Float[np.ndarray, "k 3"]]:
    """Return frames (k, 3, 3) and sides (k, 3), (length, width, 1) [m], of rectangles with the areas of the cells.

    On a sheet the length is the distance from row to row; else cells are squares.
    """
    normals, side = body.normals, np.sqrt(body.areas)
    along = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    if body.rows > 1:
        steps = np.asarray(np.gradient(body.positions.reshape(body.rows, -1, 3), axis=0)).reshape(-1, 3)
        length: Float[np.ndarray, " k"] = np.linalg.norm(steps, axis=1)
        usable = length > 0
        side, along = np.where(usable, length, side), np.where(usable[:, None], steps, along)
    return tangent_frames(normals, along), np.column_stack([side, body.areas / side, np.ones(len(side))])


def tangent_frames(normals: Float[np.ndarray, "k 3"], along: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3 3"]:
    """Return rotations (k, 3, 3): the first columns are `along` in the tangent planes, the third the unit normals."""
    across = np.cross(normals, along)
    across = across / np.linalg.norm(across, axis=1, keepdims=True)
    return np.stack([np.cross(across, normals), across, normals], axis=2)


def cell_mesh(body: TaxelBody) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Return all cells as a mesh: vertices (4 k, 3) [m] and faces (2 k, 3)."""
    frames, sides = _patches(body)
    corners = body.positions[:, None] + np.einsum("kij,kcj->kci", frames, CORNERS * sides[:, None])
    faces = 4 * np.arange(len(body))[:, None, None] + FACES
    return corners.reshape(-1, 3), faces.reshape(-1, 3).astype(np.int64)


@takes_arrays
def unrolled(
    force: Float[np.ndarray, "rows columns"], most: float, contacts: Float[np.ndarray, "c 2"]
) -> UInt8[np.ndarray, "h w 3"]:
    """Return the sheet as an RGB image (h, w, 3), the last row on top, with a dark dot at each contact.

    Args:
        force: (rows, columns) [N].
        most: force [N] that is drawn darkest.
        contacts: (c, 2) row and column.

    Raises:
        InputError: arrays of other shapes.
    """
    shade = colours(np.clip(np.nan_to_num(force.ravel()) / most, 0.0, 1.0)).reshape(*force.shape, 3)
    picture = np.repeat(np.repeat(shade, PIXELS, axis=0), PIXELS, axis=1)
    picture[::PIXELS], picture[:, ::PIXELS] = 255, 255
    down, across = np.indices(picture.shape[:2])
    for row, column in contacts:
        away = (down / PIXELS - 0.5 - row) ** 2 + (across / PIXELS - 0.5 - column) ** 2
        picture[away < 0.1] = 255
        picture[away < 0.05] = FORCE
    return picture[::-1].copy()
