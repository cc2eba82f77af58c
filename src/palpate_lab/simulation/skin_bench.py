"""A bench for taxel sheets: pressure on a sheet round a link, and the readings of the sheet and of cameras.

The truth is the geometry of the patches, never a map or an estimate: a patch is placed in the coordinates of the
unrolled sheet, which a cylinder and a plane bear without strain, and integrated at points of its disc.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, pi

import numpy as np
from jaxtyping import Float

from palpate.sensors.taxels.skin_map.model import SkinMap
from palpate.signals.recording import CELLS, Recording
from palpate.spatial._arrays import frozen

_RINGS = 40  # of points in a patch one cell wide, twice as many in each: a cell's share errs by less than 1 %
LOW, HIGH = 100.0, 11.5  # counts per newton of a 1 cm^2 cell: 10 a kPa at first, then so that 200 kPa is the range
JOINT = 0.283  # N: 10 of the 90 pF, and so of the 255 counts, belong to the sensitive range [skin map, table 1]


@dataclass(frozen=True)
class Rolled:
    """A flat sheet laid round a cylinder about z, columns round it, or unrolled (radius inf, normal z).

    Args:
        rows, columns: number of cells.
        pitch: distance between cells [m].
        radius: radius of the sensing layer [m].
    """

    rows: int = 6
    columns: int = 22
    pitch: float = 0.01
    radius: float = 0.0355

    def at(
        self, row: Float[np.ndarray, "*batch"], column: Float[np.ndarray, "*batch"]
    ) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3"]]:
        """Return points [m] and outward unit normals, both (*batch, 3), at rows and columns.

        Cell centres have integers.
        """
        along = (row - (self.rows - 1) / 2) * self.pitch
        around = column * self.pitch
        if np.isinf(self.radius):
            zero = np.zeros_like(along)
            return np.stack([around, along, zero], axis=-1), np.stack([zero, zero, zero + 1.0], axis=-1)
        angle = around / self.radius
        normal = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
        return self.radius * normal + along[..., None] * [0.0, 0.0, 1.0], normal

    @property
    def period(self) -> float:
        """Number of columns once round; inf where the sheet is flat."""
        return inf if np.isinf(self.radius) else 2 * pi * self.radius / self.pitch

    def layout(self) -> SkinMap:
        """Return a perfect map of the sheet, a `SkinMap`."""
        row, column = np.meshgrid(np.arange(self.rows), np.arange(self.columns), indexing="ij")
        centres, normals = self.at(row.astype(np.float64), column.astype(np.float64))
        return SkinMap(centres, normals, np.full((self.rows, self.columns), self.pitch**2), (self.pitch, self.pitch))


@dataclass(frozen=True)
class Patch:
    """A pressure on a disc of the sheet: Hertz's, p sqrt(1 - r^2/a^2), or flat.

    Args:
        row, column: position of its middle, in cells.
        radius: a, in cells.
        force: integral of the pressure [N].
        flat: True for the same pressure everywhere.
    """

    row: float
    column: float
    radius: float
    force: float
    flat: bool = False

    def points(self) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
        """Return rows and columns of points that bear equal areas, (n, 2), and the force [N] on each."""
        count = int(_RINGS * max(0.5, min(2 * self.radius, 4.0)))
        ring = np.sqrt((np.arange(count) + 0.5) / count)
        angle = pi * (np.arange(2 * count) + 0.5) / count
        turned = angle[None] + 2.399963 * np.arange(count)[:, None]  # rings in step would lie on lines
        r = np.broadcast_to(ring[:, None], turned.shape)
        places = self.radius * np.stack([r * np.cos(turned), r * np.sin(turned)], axis=-1).reshape(-1, 2)
        weight = np.ones(r.size) if self.flat else np.sqrt(1.0 - r.ravel() ** 2)
        return places + np.array([self.row, self.column]), self.force * weight / weight.sum()


@dataclass(frozen=True, eq=False)
class Press:
    """Loads and wrenches of patches at one moment.

    Attributes:
        loads: (rows, columns) force [N] on each cell along its normal.
        point: (k, 3) [m] middle of each patch, on the sensing layer.
        normal: (k, 3) outward normal there.
        force: (k, 3) [N] of each patch on the body.
        torque: (k, 3) [N m] about the origin of the link.
    """

    loads: Float[np.ndarray, "rows columns"]
    point: Float[np.ndarray, "k 3"]
    normal: Float[np.ndarray, "k 3"]
    force: Float[np.ndarray, "k 3"]
    torque: Float[np.ndarray, "k 3"]


def press(sheet: Rolled, patches: Sequence[Patch]) -> Press:
    """Press patches on a sheet, and return the `Press`.

    Parts of a patch next to the sheet press the link, and no cell. A sheet that overlaps feels twice.
    """
    loads = np.zeros((sheet.rows, sheet.columns))
    forces, torques = np.zeros((len(patches), 3)), np.zeros((len(patches), 3))
    for k, patch in enumerate(patches):
        places, force = patch.points()
        points, normals = sheet.at(places[:, 0], places[:, 1])
        push = -force[:, None] * normals
        forces[k], torques[k] = push.sum(axis=0), np.cross(points, push).sum(axis=0)
        for turn in (-1, 0, 1) if np.isfinite(sheet.period) else (0,):
            around = places[:, 1] + turn * (sheet.period if turn else 0.0)
            row, column = np.rint(places[:, 0]).astype(int), np.rint(around).astype(int)
            on = (row >= 0) & (row < sheet.rows) & (column >= 0) & (column < sheet.columns)
            loads += np.bincount(row[on] * sheet.columns + column[on], force[on], loads.size).reshape(loads.shape)
    middle = np.array([[patch.row, patch.column] for patch in patches]).reshape(-1, 2)
    point, normal = sheet.at(middle[:, 0], middle[:, 1])
    return Press(frozen(loads), point, normal, forces, torques)


@dataclass(frozen=True, eq=False)
class PaperSheet:
    """A model of the paper's sheet: 8 bits, a sensitive range and a strong one, cells with slightly different gains.

    Attributes:
        rest: (rows, columns) counts without load.
        gain: (rows, columns), 1 for a cell like the calibrated one.
        noise: standard deviation before rounding [counts].
        top: largest reading.
    """

    rest: Float[np.ndarray, "rows columns"]
    gain: Float[np.ndarray, "rows columns"]
    noise: float = 1.0
    top: float = 255.0

    @staticmethod
    def counts(force: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
        """Return the counts above rest of a cell of 1 cm^2 under a force [N] [skin map, table 1]."""
        low = np.minimum(force, JOINT)
        return LOW * low + HIGH * (force - low)


def paper_sheet(sheet: Rolled, rng: np.random.Generator, *, noise: float = 1.0, unequal: float = 0.02) -> PaperSheet:
    """Draw a `PaperSheet` like the paper's: rest 3 to 8 counts, gains of standard deviation `unequal`."""
    shape = (sheet.rows, sheet.columns)
    return PaperSheet(
        frozen(rng.uniform(3.0, 8.0, shape)), frozen(1.0 + unequal * rng.standard_normal(shape)), noise=noise
    )


def read_out(
    model: PaperSheet,
    loads: Float[np.ndarray, "n rows columns"],
    rng: np.random.Generator,
    *,
    rate: float = 50.0,
    start: float = 0.0,
    wraps: bool = False,
) -> Recording:
    """Convert loads [N] to samples: noise, integer counts, and the end of the range.

    There readings stay, or wrap around. Returns a `Recording` with the counts (n, rows, columns) as channel CELLS.
    """
    exact = model.rest + model.gain * model.counts(loads) + model.noise * rng.standard_normal(loads.shape)
    counts = np.rint(exact)
    counts = np.mod(counts, model.top + 1.0) if wraps else np.clip(counts, 0.0, model.top)
    return Recording(start + np.arange(len(loads)) / rate, {CELLS: counts}, source="bench")


@dataclass(frozen=True)
class Wand:
    """A wand with a round tip, and the cameras that watch it and the link.

    Args:
        radius: radius of the tip [m].
        arm: distance of the markers from the middle of each body [m]: closer ones turn it worse.
        height: height of the wand's markers above the tip [m].
        noise: noise of a marker along each axis [m].
        occlusion: probability that a marker is not seen; with fewer than three there is no pose.
    """

    radius: float = 0.004
    arm: float = 0.04
    height: float = 0.12
    noise: float = 0.0002
    occlusion: float = 0.1

    def markers(self) -> Float[np.ndarray, "4 3"]:
        """Return the markers (4, 3) [m] in the frame of the wand: its tip's centre, z to the markers."""
        flat = self.arm * np.array([[1.0, 0, 0], [-0.5, 0.8, 0], [-0.4, -0.9, 0], [0.1, 0.1, 0.8]])
        return flat + np.array([0.0, 0.0, self.height])


def wand_poses(
    wand: Wand, point: Float[np.ndarray, "n 3"], normal: Float[np.ndarray, "n 3"], rng: np.random.Generator
) -> Float[np.ndarray, "n 7"]:
    """Return position [m] and quaternion x, y, z, w, (n, 7), of the wand in the link's frame as cameras find it.

    Rows in which it is lost are NaN.

    The wand stands on the point, its axis along the normal; the link has four markers too, whose errors turn all.
    """
    from scipy.spatial.transform import Rotation

    support = wand.arm * np.array([[1.0, 0, -1.5], [-0.5, 0.9, -1.5], [-0.5, -0.9, -1.5], [0.3, 0.2, -2.2]])
    found = np.full((len(point), 7), np.nan)
    for k in range(len(point)):
        side = np.cross(normal[k], [0.3, 0.5, 0.8])
        side /= np.linalg.norm(side)
        turn = np.column_stack([side, np.cross(normal[k], side), normal[k]])
        centre = point[k] + wand.radius * normal[k]
        seen_wand, seen_link = rng.random(4) >= wand.occlusion, rng.random(4) >= wand.occlusion
        if seen_wand.sum() < 3 or seen_link.sum() < 3:
            continue
        on_wand = wand.markers() @ turn.T + centre + wand.noise * rng.standard_normal((4, 3))
        on_link = support + wand.noise * rng.standard_normal((4, 3))
        wand_in_world = _fitted(wand.markers()[seen_wand], on_wand[seen_wand])
        link_in_world = _fitted(support[seen_link], on_link[seen_link])
        back = link_in_world[0].T
        found[k, :3] = back @ (wand_in_world[1] - link_in_world[1])
        found[k, 3:] = Rotation.from_matrix(back @ wand_in_world[0]).as_quat()
    return found


def _fitted(
    known: Float[np.ndarray, "m 3"], seen: Float[np.ndarray, "m 3"]
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Return rotation and translation that take markers to their seen positions (Kabsch 1976)."""
    middle, there = known.mean(axis=0), seen.mean(axis=0)
    u, _, vt = np.linalg.svd((known - middle).T @ (seen - there))
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))])
    turn = vt.T @ flip @ u.T
    return turn, there - turn @ middle
