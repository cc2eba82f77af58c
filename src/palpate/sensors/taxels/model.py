"""Describe a body of taxels, on a sheet or anywhere on a link: positions, normals and neighbours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import prod
from typing import Any, cast

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from palpate.calls import called_as
from palpate.errors import InputError
from palpate.sensors.taxels.response import AXES, TaxelResponse
from palpate.sensors.taxels.skin_map.model import SkinMap
from palpate.signals.recording import CELLS, LARGEST, TEMPERATURE, Recording
from palpate.spatial._arrays import Value, shaped
from palpate.spatial.arguments import frozen_value, takes_arrays

_AROUND = np.array([(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b])  # of a cell on a sheet
_CORNERS, _SIDES = [0, 2, 5, 7], [[1, 3], [1, 4], [6, 3], [6, 4]]  # of _AROUND: corners, and the two sides at each
_SHORTEST_RING = 6  # columns: fewer cannot go round a link
_SEAM = 1.6  # pitches between the ends of a sheet that are neighbours
_REACH = 1.6  # spacings within which taxels are neighbours: the corners of a square are, every other cell is not
_NEAR = 16  # taxels among which the nearest that face the same way are looked for
_CROSSED = 1.1  # of a distance squared: taxels whose squared distances to both ends sum to less lie between them
_COVERED = 0.93  # squared spacings that a cell covers: 0.87 on a lattice of triangles, 1 on one of squares


@called_as(
    "palpate.TaxelBody.anywhere(positions, normals)",
    sheet="palpate.TaxelBody.sheet(palpate.map_skin(mesh, sheet, ...))",
    anywhere="palpate.TaxelBody.anywhere(positions, normals)",
)
@frozen_value
class TaxelBody(Value):
    """Cells of a sheet, row by row, or taxels anywhere on a body, in the body's frame.

    Made by `sheet`, `anywhere` and `placed`.

    Attributes:
        positions: (k, 3) [m]; normals: (k, 3) outward, unit; areas: (k,) [m^2].
        spacing: (k,) [m] to the cells around; 1 on a sheet.
        tangents: (k, 3) unit vectors in the tangent planes, from which angles count; 0 on a sheet.
        neighbours: (k, m) indices of each cell's neighbours, -1 for none.
        steps: (k, m, 2) to each neighbour, in cells: integer rows and columns on a sheet, else in the tangent plane,
            the first along `tangents`.
        between: (k, m, 2) the cells between a cell and a neighbour across a corner; -1 where the two touch.
        usable: (k,) false where a cell is masked or, on a sheet, overlaps other cells.
        bits: 1 to 16 for integer readings; None: readings are floats.
        rows, columns: size of a sheet; 0 for taxels anywhere.
        grid: (rows + 4, columns + 4, 6) positions and normals of a sheet, two cells more at each end; None: no sheet.
        turn: number of columns after which a sheet closes to a ring; 0: never.
        notes: notes for the user, a sentence each.
        numbers: (k,) index of each taxel among the readings of a frame; None: all readings, in order.
        frame: number of readings in a frame if `numbers` is given.
        covariance: (k, 3, 3) [m^2] of the positions, 0 where not known; None: not known for any.
        response: of taxels with three axes, which lie anywhere; None: they have one.

    Raises:
        InputError: bits outside 1 to 16, or a response of another number of taxels.
    """

    positions: Float[np.ndarray, "k 3"]
    normals: Float[np.ndarray, "k 3"]
    areas: Float[np.ndarray, " k"]
    spacing: Float[np.ndarray, " k"]
    tangents: Float[np.ndarray, "k 3"]
    neighbours: Int[np.ndarray, "k m"]
    steps: Float[np.ndarray, "k m 2"]
    between: Int[np.ndarray, "k m 2"]
    usable: Bool[np.ndarray, " k"]
    bits: int | None = None
    rows: int = 0
    columns: int = 0
    grid: Float[np.ndarray, "r c 6"] | None = None
    turn: int = 0
    notes: tuple[str, ...] = ()
    numbers: Int[np.ndarray, " k"] | None = None
    frame: int = 0
    covariance: Float[np.ndarray, "k 3 3"] | None = None
    response: TaxelResponse | None = None

    def __post_init__(self) -> None:
        if self.response is not None and len(self.response) != len(self):
            what = f"the response is of {len(self.response)} taxels, but the body has {self.named()}."
            raise InputError(what, where="taxels")
        if self.bits is not None and not 1 <= self.bits <= 16:
            raise InputError(f"bits must be between 1 and 16, not {self.bits}.", where="taxels")
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    def __len__(self) -> int:
        return len(self.positions)

    @classmethod
    @takes_arrays
    def sheet(cls, place: SkinMap, *, bits: int | None = 8, masked: Sequence[tuple[int, int]] = ()) -> TaxelBody:
        """Return the `TaxelBody` of a sheet on a link: a cell has eight neighbours, also over the seam of a ring.

        Columns that overlap others are not used.

        Args:
            place: map of the sheet.
            bits: of a reading; None: readings are floats.
            masked: (row, column) of cells not to be used.

        Raises:
            InputError: fewer than two cells, a masked cell that is not on the sheet, or bits outside 1 to 16.
        """
        rows, columns = place.rows, place.columns
        if rows * columns < 2:
            raise InputError(f"a sheet needs rows and columns, not {rows} x {columns} cells.", where="taxels")
        used = _columns_used(place)
        ring = _is_ring(place, used)
        row, column = (part[:, None] for part in np.divmod(np.arange(rows * columns), columns))
        up, across = row + _AROUND[:, 0], column + _AROUND[:, 1]
        across = np.where(column < used, np.mod(across, used), -1) if ring else across
        inside = (up >= 0) & (up < rows) & (across >= 0) & (across < used) & (column < used)
        neighbours = np.where(inside, up * columns + across, -1)
        between = np.full((len(row), 8, 2), -1)
        between[:, _CORNERS] = np.where(inside[:, _CORNERS, None], neighbours[:, _SIDES], -1)
        usable = column.ravel() < used
        for cell in masked:
            if not (0 <= cell[0] < rows and 0 <= cell[1] < columns):
                raise InputError(
                    f"masked cell {tuple(cell)} does not exist: the sheet has {rows} x {columns} cells, counted from "
                    "0.",
                    where="taxels",
                )
            usable[cell[0] * columns + cell[1]] = False
        notes = list(place.notes)
        if used < columns:
            notes.append(
                f"the last {columns - used} of {columns} columns overlap others and are left out: a press there is "
                "felt twice"
            )
        if ring:
            notes.append("the sheet closes around the link: touches cross the seam")
        steps = np.broadcast_to(_AROUND.astype(np.float64), (len(row), 8, 2)).copy()
        flat = (place.centres.reshape(-1, 3).copy(), place.normals.reshape(-1, 3).copy(), place.areas.ravel().copy())
        unit = np.ones(len(row)), np.zeros((len(row), 3))  # steps are in cells; the grid says where they lead
        grid, turn = _padded(place, used, ring), used if ring else 0
        return cls(*flat, *unit, neighbours, steps, between, usable, bits, rows, columns, grid, turn, tuple(notes))

    @classmethod
    @takes_arrays
    def anywhere(
        cls,
        positions: ArrayLike,
        normals: ArrayLike,
        areas: ArrayLike | None = None,
        *,
        reach: float | None = None,
        bits: int | None = None,
        masked: Sequence[int] = (),
        along: ArrayLike | None = None,
    ) -> TaxelBody:
        """Return the `TaxelBody` of taxels anywhere: neighbours are close along it, their normals within 90 degrees.

        Args:
            positions: (k, 3) [m].
            normals: (k, 3) outward, of any length.
            areas: (k,) [m^2] that each taxel senses; None: as on a lattice.
            reach: [m] largest distance between neighbours; None: 1.6 times the local spacing.
            bits: of a reading; None: readings are floats.
            masked: indices of taxels not to be used.
            along: (3,) or (k, 3) direction of the tangents, from which angles count, and of the first axis of a taxel;
                None: from the first taxel to the last.

        Raises:
            InputError: fewer than two taxels, two at one place, a position that is not finite, a normal that is 0, an
                area or a reach that is not positive, arrays that do not fit, a masked taxel that does not exist, or
                bits outside 1 to 16.
        """
        points, outward = _placed(positions, normals)
        if reach is not None and not reach > 0:
            raise InputError(f"reach must be positive, not {reach:g} m.")
        count = len(points)
        spacing, pairs = _paired(points, outward, reach)
        both = np.concatenate([pairs, pairs[:, ::-1]])
        both = both[np.lexsort((both[:, 1], both[:, 0]))]
        degree = np.bincount(both[:, 0], minlength=count)
        slot = np.arange(len(both)) - np.repeat(np.cumsum(degree) - degree, degree)
        neighbours = np.full((count, max(int(degree.max(initial=0)), 2)), -1)
        neighbours[both[:, 0], slot] = both[:, 1]
        way = points[-1] - points[0] if along is None else np.asarray(along, dtype=np.float64)
        tangents = _tangents(outward, np.broadcast_to(way, points.shape))
        away = np.where(neighbours[..., None] < 0, 0.0, points[neighbours] - points[:, None])
        frame = np.stack([tangents, np.cross(outward, tangents)], axis=1)
        steps = np.einsum("kmc,kac->kma", away, frame) / spacing[:, None, None]
        covered = _COVERED * spacing**2 if areas is None else np.array(areas, dtype=np.float64)
        if covered.shape != (count,) or not (covered > 0).all():
            raise InputError(f"areas must be {count} positive numbers.", where="taxels")
        between, usable = _between(neighbours, away, points), _unmasked(count, masked)
        return cls(points, outward, covered, spacing, tangents, neighbours, steps, between, usable, bits)

    @classmethod
    @takes_arrays
    def placed(
        cls,
        positions: ArrayLike,
        normals: ArrayLike,
        *,
        covariance: ArrayLike | None = None,
        bits: int | None = None,
        masked: Sequence[int] = (),
        along: ArrayLike | None = None,
    ) -> TaxelBody:
        """Return a `TaxelBody` as `anywhere` does, without readings that have no taxel: their positions are NaN.

        Args:
            positions: (n, 3) [m], a row for each reading of a frame.
            normals: (n, 3) outward.
            covariance: (n, 3, 3) [m^2] of the positions, NaN where not known.
            bits: of a reading; None: readings are floats.
            masked: indices of readings not to be used.
            along: (3,) or (n, 3) as of `anywhere`.

        Raises:
            InputError: as by `anywhere`, or a normal that is not known.
        """
        points = shaped(positions, (None, 3), "positions")
        outward = shaped(normals, points.shape, "normals")
        numbers = np.flatnonzero(np.isfinite(points).all(axis=1))
        left_out = np.flatnonzero(~_unmasked(len(points), masked)[numbers]).tolist()
        way = None if along is None else np.broadcast_to(np.asarray(along, dtype=np.float64), points.shape)[numbers]
        body = cls.anywhere(points[numbers], outward[numbers], bits=bits, masked=left_out, along=way)
        if covariance is not None:
            body = replace(body, covariance=_known(np.asarray(covariance, dtype=np.float64)[numbers]))
        return body if len(numbers) == len(points) else replace(body, numbers=numbers, frame=len(points))

    @property
    def shape(self) -> tuple[int, ...]:
        """Return the shape of a frame without readings that have no taxel: (rows, columns) of a sheet, or (k,)."""
        return (self.rows, self.columns) if self.rows else (len(self),)

    def ways(self) -> Float[np.ndarray, "k 3"]:
        """Return the direction (k, 3) of a sheet's columns at each cell, of any length; any in one column."""
        if self.columns < 2:
            return np.cross(self.normals, self.normals[:, [1, 2, 0]] + 1.0)
        return np.asarray(np.gradient(self.positions.reshape(self.rows, self.columns, 3), axis=1)).reshape(-1, 3)

    @property
    def axes(self) -> int:
        """Return the number of axes along which each taxel measures: 1 or 3."""
        return 1 if self.response is None else AXES

    @property
    def calibrated(self) -> bool:
        """Return whether the taxels have three axes with a response that was measured."""
        return self.response is not None and bool(self.response.provenance)

    @property
    def one(self) -> tuple[int, ...]:
        """Return the shape of a frame in one row: (k,), or (k, 3) of taxels with three axes."""
        return (len(self),) if self.response is None else (len(self), AXES)

    def fits(self, shape: tuple[int, ...]) -> bool:
        """Return whether a frame of this shape is of this body: rows and columns of a sheet, or in one row."""
        if self.response is not None:
            return (shape[-1:] == (AXES,) or len(shape) == 1) and prod(shape) == prod(self.one)
        return shape in (self.shape, self.one)

    @property
    def top(self) -> float:
        """Return the largest possible reading [counts]; inf for floats."""
        return np.inf if self.bits is None else 2.0**self.bits - 1.0

    def name(self, cell: int) -> str:
        """Return the name of a cell in messages: "(row, column)" on a sheet, else the index of its reading."""
        cell = cell if self.numbers is None else int(self.numbers[cell])
        return f"({cell // self.columns}, {cell % self.columns})" if self.rows else str(cell)

    def named(self) -> str:
        """Return the size of the body for messages, such as "6 x 22 cells" or "120 taxels"."""
        axes = "" if self.response is None else f" of {AXES} axes"
        return f"{self.rows} x {self.columns} cells" if self.rows else f"{len(self)} taxels{axes}"

    def picked(self, frames: np.ndarray) -> np.ndarray:
        """Return frames (..., n) without readings that have no taxel, (..., k); other sizes unchanged.

        Those of three axes are (..., n, 3).
        """
        axis = -1 if self.response is None else -2
        if self.numbers is None or frames.ndim < -axis or frames.shape[axis] != self.frame:
            return frames
        return np.take(frames, self.numbers, axis=axis)

    def readings(self, recording: Recording) -> Float[np.ndarray, "n k ..."]:
        """Return a recording's readings (n, k), or (n, k, 3) of three axes, read-only; implausibly large ones are NaN.

        Of taxels with three axes, they are the loads [N] into the body, by their response.

        Raises:
            InputError: the recording has no readings of taxels, or its frames have another size.
        """
        return self.loads(recording)[0]

    def loads(self, recording: Recording) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, "n m"]]:
        """Return `readings`, and of taxels with three axes the loads [N] along the tangents, (n, 2 k); else (n, 0).

        Those along the first tangents are in front.

        Raises:
            InputError: as by `readings`.
        """
        return self.split(self.raw(recording))

    def raw(self, recording: Recording) -> Float[np.ndarray, "n k ..."]:
        """Return the readings as they are, (n, k), or (n, k, 3) of three axes, read-only; implausible ones are NaN.

        Those of three axes are corrected to one temperature if it is recorded and the response knows what it does.

        Raises:
            InputError: as by `readings`, or as by `TaxelResponse.corrected`.
        """
        if CELLS not in recording.channels:
            hint = "Name their columns (cells) or topic in the rig's [skin]."
            raise InputError("has no readings of taxels.", where=recording.source, hint=hint)
        rows = self.frames(recording.channels[CELLS], recording.source)
        if self.response is None or TEMPERATURE not in recording.channels:
            return rows
        return self.response.corrected(rows, recording.channels[TEMPERATURE][:, 0], recording.source)

    def frames(self, cells: np.ndarray, source: str = "") -> Float[np.ndarray, "n k ..."]:
        """Return frames as they are recorded as `raw` does; `source` names them in messages.

        Raises:
            InputError: frames of another size.
        """
        cells = self.picked(cells)
        if not self.fits(cells.shape[1:]):
            size = " x ".join(map(str, cells.shape[1:]))
            what = f"has frames of {size} cells, but the body has {self.named()}."
            hint = "Correct the map, the taxels or the cells in [skin]."
            if cells.shape[1:-1] in (self.shape, (len(self),)) and cells.shape[-1] == AXES:
                hint = 'Three numbers a taxel need axes = ["x", "y", "z"] in [skin].'
            raise InputError(what, where=source, hint=hint)
        rows = np.ascontiguousarray(cells).reshape(len(cells), *self.one).view()
        size = np.abs(rows)
        if not size.max(initial=0.0) <= LARGEST:  # a fault of the log; NaN too
            rows = np.where(size > LARGEST, np.nan, rows)
        rows.flags.writeable = False
        return rows

    def split(self, rows: np.ndarray) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, "n m"]]:
        """Return what `loads` does, for raw readings (n, k), or (n, k, 3) of taxels with three axes."""
        return (rows, np.zeros((len(rows), 0))) if self.response is None else self.response.loads(rows)

    def __repr__(self) -> str:
        size = " x ".join(f"{1e3 * side:.4g}" for side in np.ptp(self.positions, axis=0)) if len(self) else "0 x 0 x 0"
        layout = f"{self.rows} x {self.columns}, " if self.rows else ""
        return f"TaxelBody({layout}{len(self):,} taxels, {np.count_nonzero(self.usable):,} usable, {size} mm)"


def _known(covariance: Float[np.ndarray, "k 3 3"]) -> Float[np.ndarray, "k 3 3"] | None:
    """Replace unknown covariances (k, 3, 3) by 0; return None if none is known."""
    known = np.asarray(np.isfinite(covariance).all(axis=(1, 2)), dtype=bool)
    return np.where(known[:, None, None], covariance, 0.0) if known.any() else None


def _columns_used(place: SkinMap) -> int:
    """Return the number of columns before those that overlap others, where both layers feel a press."""
    over = place.overlap.mean(axis=0) > 0.5
    over[: place.columns // 2] = False
    last = np.flatnonzero(over)
    return int(last[0]) if len(last) and over[last[0] :].all() else place.columns


def _is_ring(place: SkinMap, used: int) -> bool:
    """Return whether the last column in use lies next to the first."""
    if used < _SHORTEST_RING:
        return False
    gap = np.linalg.norm(place.centres[:, 0] - place.centres[:, used - 1], axis=-1)
    return bool(np.median(gap) < _SEAM * place.pitch[1])


def _padded(place: SkinMap, used: int, ring: bool) -> Float[np.ndarray, "r c 6"]:
    """Extend centres and normals by two cells at each end, over the seam of a ring or by a parabola."""
    values = np.concatenate([place.centres, place.normals], axis=2)
    if ring:
        columns = np.concatenate([values[:, used - 2 : used], values[:, :used], values[:, :2]], axis=1)
    else:
        columns = _continued(_continued(values.swapaxes(0, 1))).swapaxes(0, 1)
    return np.ascontiguousarray(_continued(_continued(columns)))


def _continued(values: Float[np.ndarray, "n k 6"]) -> Float[np.ndarray, "m k 6"]:
    """Extend the first axis by one cell at each end, by a parabola or a line."""
    if len(values) == 1:
        return np.concatenate([values, values, values])
    if len(values) == 2:
        return np.concatenate([2 * values[:1] - values[1:], values, 2 * values[1:] - values[:1]])
    before = 3 * values[0] - 3 * values[1] + values[2]
    after = 3 * values[-1] - 3 * values[-2] + values[-3]
    return np.concatenate([before[None], values, after[None]])


def _unmasked(count: int, masked: Sequence[int]) -> Bool[np.ndarray, " k"]:
    """Return whether taxels are not masked; raise an InputError if a masked one does not exist."""
    for taxel in masked:
        if not 0 <= taxel < count:
            raise InputError(f"masked taxel {taxel} does not exist: there are {count}, counted from 0.", where="taxels")
    return ~np.isin(np.arange(count), masked)


def _placed(positions: ArrayLike, normals: ArrayLike) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"]]:
    """Return positions [m] and unit normals; raise an InputError if they do not fit each other."""
    points, outward = np.array(positions, dtype=np.float64), np.array(normals, dtype=np.float64)
    if points.ndim != 2 or points.shape[1:] != (3,) or points.shape != outward.shape or len(points) < 2:
        raise InputError(f"positions {points.shape} and normals {outward.shape} must both be (k, 3).", where="taxels")
    length = np.linalg.norm(outward, axis=1, keepdims=True)
    if not (np.isfinite(points).all() and np.isfinite(length).all() and (length > 0).all()):
        raise InputError("positions and normals must be finite, and normals must not be 0.", where="taxels")
    return points, outward / length


def _paired(
    points: Float[np.ndarray, "k 3"], normals: Float[np.ndarray, "k 3"], reach: float | None
) -> tuple[Float[np.ndarray, " k"], Int[np.ndarray, "p 2"]]:
    """Return the local spacing of the taxels (k,) [m], and pairs of neighbours (p, 2)."""
    from scipy.spatial import cKDTree  # here: scipy is slow to import

    tree = cKDTree(points)
    far, which = cast("tuple[Any, Any]", tree.query(points, k=min(_NEAR, len(points))))
    if not np.isfinite(far).all():
        raise InputError(
            "the taxels are too far from each other to have neighbours: positions must be in metres.", where="taxels"
        )
    if (far[:, 1] == 0).any():
        raise InputError(f"taxel {int(which[far[:, 1] == 0][0, 0])} is at the place of another taxel.", where="taxels")
    facing = np.einsum("kc,kjc->kj", normals, normals[which]) > 0
    near = np.sort(np.where(facing & (far > 0), far, np.inf), axis=1)[:, 1:3]  # the second and the third
    alike = np.isfinite(near).all(axis=1)
    usual = float(np.median(near[alike].mean(axis=1))) if alike.any() else float(np.median(far[:, 1]))
    spacing = np.where(alike, np.where(np.isfinite(near), near, 0.0).mean(axis=1), usual)
    limit = np.full(len(points), reach) if reach is not None else _REACH * spacing
    pairs = tree.query_pairs(float(limit.max()), output_type="ndarray")
    one, other = pairs.T
    cosine = np.einsum("pc,pc->p", normals[one], normals[other])
    way = np.linalg.norm(points[one] - points[other], axis=1) / np.sinc(np.arccos(np.clip(cosine, -1, 1)) / 2 / np.pi)
    return spacing, pairs[(cosine > 0) & (way <= 0.5 * (limit[one] + limit[other]))]


def _tangents(normals: Float[np.ndarray, "k 3"], axes: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3"]:
    """Return unit tangents (k, 3), as parallel to axes as the body allows; any where one is normal."""
    along = axes / np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-300)
    first = along - np.sum(normals * along, axis=1, keepdims=True) * normals
    lying = np.linalg.norm(first, axis=1) < 1e-3
    first[lying] = np.cross(normals[lying], np.roll(normals[lying], 1, axis=1) + np.arange(1.0, 4.0))
    return first / np.linalg.norm(first, axis=1, keepdims=True)


def _between(
    neighbours: Int[np.ndarray, "k m"], away: Float[np.ndarray, "k m 3"], points: Float[np.ndarray, "k 3"]
) -> Int[np.ndarray, "k m 2"]:
    """Return the neighbours between a cell and another: inside, or nearly on, the ball that the two span."""
    square = np.where(neighbours < 0, np.inf, (away**2).sum(axis=2))
    across = ((away[:, :, None] - away[:, None]) ** 2).sum(axis=3)  # from neighbour to neighbour
    round_about = square[:, None, :] + across + np.where(np.eye(neighbours.shape[1], dtype=bool), np.inf, 0.0)
    nearest = np.argsort(round_about, axis=2, kind="stable")[:, :, :2]
    limit = _CROSSED * np.where(square == np.inf, 0.0, square)[..., None]
    found = np.take_along_axis(round_about, nearest, axis=2) <= limit
    cells = np.take_along_axis(np.broadcast_to(neighbours[:, None], round_about.shape), nearest, axis=2)
    cells = np.where(found, cells, cells[..., :1])
    return np.where(found[..., :1], cells, -1)
