"""Move groups of taxels rigidly, on a surface or free in space: modules, or single taxels."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.sensors.taxels.modules import ModuleLayout
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.spatial.pose import Pose, skew
from palpate.surfaces.geodesic import walk
from palpate.surfaces.surface import Surface

_STEP = np.array([2e-5, 2e-5, 1e-3])  # m, m, rad: of the differences that stand for derivatives
_ROUNDS = 25  # of the fit of modules to places
_STILL = 1e-9  # m
_CIRCLING = 1e-4, 0.9  # m, rad: steps so short that shrink by less go round about an edge between two facets
_FOLDED = 0.2  # of the spacing: a bend takes off less, unless its radius is below 1.3 times the spacing
_STIFF = 100.0  # times the square of a stretch, against those of distances from places
_HALVED = 8  # steps: from the module's size to a hundredth
_FAR = 1e-3  # m, rad: of a step after which derivatives are taken anew

Vectors = Float[np.ndarray, "k 3"]


@frozen_value
class Units:
    """The u units that move rigidly and the k taxels on them; a taxel without a unit has no place.

    On a surface a unit has three unknowns, along its heading, across it and about its normal [m, m, rad], and a module
    is laid on the surface by geodesics. Without one it has six: its middle [m] and a rotation vector [rad] about it.
    Single taxels do not turn: two or three.

    Attributes:
        layout: flat places of the taxels on their units.
        centre: (u, 3) [m]; frame: (u, 3, 3), columns heading, across, outward.
        surface: on which they lie; None: they are free in space.
    """

    layout: ModuleLayout
    centre: Float[np.ndarray, "u 3"]
    frame: Float[np.ndarray, "u 3 3"]
    surface: Surface | None = None

    def __len__(self) -> int:
        return len(self.centre)

    @property
    def alone(self) -> bool:
        """Return True if every unit is a single taxel."""
        return len(self.taxels) == len(self)

    @property
    def freedom(self) -> int:
        """Return the number of unknowns of a unit: on a surface 3, or 2 for single taxels; else 6, or 3."""
        return (2 if self.alone else 3) if self.surface is not None else (3 if self.alone else 6)

    def each(self, length: float, angle: float) -> Float[np.ndarray, " f"]:
        """Return (f,) with `length` for each unknown of a unit that is a length, else `angle`."""
        lengths = 2 if self.surface is not None else 3
        return np.array([length] * lengths + [angle] * (self.freedom - lengths))

    @property
    def taxels(self) -> Int[np.ndarray, " t"]:
        """Return the indices (t,) of the taxels that have a place."""
        return np.flatnonzero((self.layout.module >= 0) & np.isfinite(self.layout.places).all(axis=1))

    @cached_property
    def places(self) -> tuple[Vectors, Vectors]:
        """Return positions (k, 3) [m] and outward normals (k, 3); NaN for a taxel without a unit."""
        rows = self.taxels
        unit, flat = self.layout.module[rows], self.layout.places[rows]
        points, normals = np.full((2, len(self.layout), 3), np.nan)
        ways = np.einsum("kij,kj->ki", self.frame[unit][:, :, :2], flat)
        if self.surface is None or self.alone:
            points[rows], normals[rows] = self.centre[unit] + ways, self.frame[unit][:, :, 2]
        else:
            points[rows], normals[rows], _ = walk(self.surface, self.centre[unit], ways)
        points.flags.writeable = normals.flags.writeable = False
        return points, normals

    def moved(self, by: Float[np.ndarray, "u f"]) -> Units:
        """Return `Units` that are moved by their unknowns, (u, f) [m, rad].

        Raises:
            InputError: by has another shape.
        """
        if self.surface is None:
            moved = replace(self, centre=self.centre + by[:, :3])
            if self.alone:
                return moved
            return replace(moved, frame=Pose.from_rotation_vector(by[:, 3:], by[:, :3]).rotation @ self.frame)
        ways = np.einsum("uij,uj->ui", self.frame[:, :, :2], by[:, :2])
        centre, normals, heading = walk(self.surface, self.centre, ways)
        moved = np.asarray(np.isfinite(heading).all(axis=1), dtype=bool)
        frame = frame_about(normals, np.where(moved[:, None], heading, self.frame[:, :, 0]))
        # the heading arrives as it left, turned against the way it went
        angle = np.where(moved, np.arctan2(by[:, 1], by[:, 0]), 0.0) - (0.0 if self.alone else by[:, 2])
        first = np.cos(angle)[:, None] * frame[:, :, 0] - np.sin(angle)[:, None] * frame[:, :, 1]
        return replace(self, centre=centre, frame=frame_about(normals, first))

    @cached_property
    def jacobian(self) -> Float[np.ndarray, "k 3 f"]:
        """Return derivatives (k, 3, f) of each taxel's place by its unit's unknowns; 0 without a unit."""
        found = np.zeros((len(self.layout), 3, self.freedom))
        rows = self.taxels
        unit = self.layout.module[rows]
        if self.alone:
            found[rows] = self.frame[unit][:, :, : self.freedom] if self.surface is not None else np.eye(3)
            return found
        if self.surface is None:
            found[rows, :, :3] = np.eye(3)
            found[rows, :, 3:] = -skew(self.places[0][rows] - self.centre[unit])
            return found
        steps = np.concatenate([np.diag(_STEP), -np.diag(_STEP)])  # all at once: a walk costs by the call
        ends = self.repeated(6).moved(np.repeat(steps, len(self), axis=0)).places[0].reshape(6, -1, 3)[:, rows]
        found[rows] = np.moveaxis((ends[:3] - ends[3:]) / (2.0 * _STEP)[:, None, None], 0, 2)
        return found

    @property
    def stretch(self) -> Float[np.ndarray, "k 3"]:
        """Return by how much [m] a taxel is farther from its three nearest on its module than on the flat one, (k, 3).

        A bend takes off d^3 / 24 R^2, an edge far more. It is 0 for taxels without a unit, and where there are fewer.
        """
        found, taxels = np.zeros((len(self.layout), 3)), self.taxels
        unit = self.layout.module[taxels]
        ends = np.cumsum(np.bincount(unit, minlength=len(self)))
        for rows in np.split(taxels[np.argsort(unit, kind="stable")], ends[:-1]):
            flat, bent = (
                np.linalg.norm(each[rows, None] - each[rows], axis=2) for each in (self.layout.places, self.places[0])
            )
            near = np.argsort(flat, axis=1)[:, 1:4]
            found[rows, : near.shape[1]] = np.take_along_axis(bent - flat, near, axis=1)
        return found

    @property
    def folded(self) -> Bool[np.ndarray, " u"]:
        """Return a bool (u,) for each unit, True for a module that an edge of the surface folds or tears."""
        worst = np.zeros(len(self))
        rows = self.taxels
        np.maximum.at(worst, self.layout.module[rows], np.abs(self.stretch[rows]).max(axis=1, initial=0.0))
        return worst > _FOLDED * self.layout.spacing

    def repeated(self, times: int) -> Units:
        """Return `Units` so many times, one after the other."""
        shift = np.repeat(np.arange(times), len(self.layout)) * len(self)
        module = np.tile(self.layout.module, times)
        layout = ModuleLayout(np.tile(self.layout.places, (times, 1)), np.where(module >= 0, module + shift, -1))
        return Units(layout, np.tile(self.centre, (times, 1)), np.tile(self.frame, (times, 1, 1)), self.surface)

    def away(self, start: Units) -> Float[np.ndarray, "u f"]:
        """Return the unknowns (u, f) [m, rad] by which each unit has moved from a start, to first order."""
        gap = self.centre - start.centre
        if self.surface is None:
            if self.alone:
                return gap
            turn = self.frame @ np.swapaxes(start.frame, 1, 2)
            return np.concatenate([gap, Pose(turn, np.zeros((len(self), 3))).rotation_vector()], axis=1)
        flat = np.einsum("uij,ui->uj", start.frame[:, :, :2], gap)
        if self.alone:
            return flat
        seen = frame_about(self.frame[:, :, 2], start.frame[:, :, 0])
        heading = np.einsum("uij,ui->uj", seen[:, :, :2], self.frame[:, :, 0])
        return np.concatenate([flat, np.arctan2(heading[:, 1], heading[:, 0])[:, None]], axis=1)


def across(normals: Vectors) -> Float[np.ndarray, "k 3 2"]:
    """Return two unit axes (k, 3, 2) of the tangent plane at each unit normal (k, 3), right-handed with it."""
    first = np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)])
    first = first / np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normals, first)], axis=2)


@takes_arrays
def frame_about(normals: Vectors, along: Vectors) -> Float[np.ndarray, "k 3 3"]:
    """Return frames (k, 3, 3): third columns along normals (k, 3), first ones as near as possible to `along` (k, 3)."""
    outward = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    first = along - np.einsum("kc,kc->k", along, outward)[:, None] * outward
    length = np.linalg.norm(first, axis=1, keepdims=True)
    first = np.where(length > 1e-9, first / np.maximum(length, 1e-9), across(outward)[:, :, 0])
    return np.stack([first, np.cross(outward, first), outward], axis=2)


@takes_arrays
def single(places: Vectors, surface: Surface | None, outward: Vectors | None = None) -> Units:
    """Return `Units`, one for each taxel with a place; `outward` (k, 3) are its normals without a surface."""
    rows = np.flatnonzero(np.isfinite(places).all(axis=1))
    module, flat = np.full(len(places), -1), np.full((len(places), 2), np.nan)
    module[rows], flat[rows] = np.arange(len(rows)), 0.0
    centre, normals = places[rows], np.tile([0.0, 0.0, 1.0], (len(rows), 1)) if outward is None else outward[rows]
    if surface is not None and len(rows):
        centre, normals, _ = surface.project(centre)
    frame = frame_about(normals, np.tile([1.0, 0.0, 0.0], (len(rows), 1)))
    return Units(ModuleLayout(flat, module), centre, frame, surface)


def placed(layout: ModuleLayout, places: Vectors) -> Bool[np.ndarray, " k"]:
    """Return a bool (k,) for each taxel, True if it is on a module and both its places are known."""
    known = np.isfinite(places).all(axis=1) & np.isfinite(layout.places).all(axis=1)
    return np.asarray(known & (layout.module >= 0), dtype=bool)


@takes_arrays
def fitted(
    layout: ModuleLayout, places: Vectors, surface: Surface | None, weights: Float[np.ndarray, " k"] | None = None
) -> Units:
    """Fit modules to the places of their taxels by least squares; return them as `Units`.

    Args:
        layout: flat places of the taxels; three or more of each module must have a place, which is not checked.
        places: (k, 3) [m] of the taxels, NaN if not known.
        surface: on which the modules lie; None: they are free in space.
        weights: (k,) of the places; None: equal.

    Raises:
        InputError: weights has another shape.
    """
    share = np.where(placed(layout, places), 1.0 if weights is None else np.maximum(weights, 0.0), 0.0)
    units = _start(layout, places, surface, share)
    matrix, far, before = np.zeros(0), True, np.inf
    for _ in range(_ROUNDS):
        matrix = units.jacobian if far else matrix
        step = _solved(units, matrix, np.nan_to_num(places - units.places[0]), share)
        units, longest = units.moved(step), float(np.abs(step).max(initial=0.0))
        far = longest > _FAR
        if longest < _STILL or _CIRCLING[1] * before < longest < _CIRCLING[0]:
            break
        before = longest
    return _unfolded(units, places, share)


def _unfolded(units: Units, places: Vectors, share: Float[np.ndarray, " k"]) -> Units:
    """Return units whose folded modules are moved to where they are not, and as near as possible to their places.

    Least squares end at any edge that they meet, so steps to all sides, halved in turn, look beyond.
    """
    folded = np.zeros(len(units), dtype=np.bool_) if units.surface is None or units.alone else units.folded
    if not folded.any():
        return units
    some = _picked(units, folded)
    reach = float(np.nanmax(np.linalg.norm(some.layout.places, axis=1)))
    sides = np.stack(np.meshgrid(*[[0.0, -1.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    for size in reach / 2.0 ** np.arange(_HALVED):
        step = size * np.array([1.0, 1.0, 1.0 / reach])
        tried = some.repeated(len(sides)).moved(np.repeat(step * sides, len(some), axis=0))
        gap = np.nansum((tried.places[0] - np.tile(places, (len(sides), 1))) ** 2, axis=1) * np.tile(share, len(sides))
        cost = _of_units(tried, gap) + _STIFF * _of_units(tried, (tried.stretch**2).sum(axis=1))
        best = cost.reshape(len(sides), -1).argmin(axis=0) * len(some) + np.arange(len(some))
        some = replace(some, centre=tried.centre[best], frame=tried.frame[best])
    centre, frame = units.centre.copy(), units.frame.copy()
    centre[folded], frame[folded] = some.centre, some.frame
    return replace(units, centre=centre, frame=frame)


def _picked(units: Units, which: Bool[np.ndarray, " u"]) -> Units:
    """Return units without the others; the layout keeps its indices."""
    number = np.append(np.where(which, np.cumsum(which) - 1, -1), -1)
    layout = ModuleLayout(units.layout.places, number[units.layout.module])
    return replace(units, layout=layout, centre=units.centre[which], frame=units.frame[which])


def _of_units(units: Units, values: Float[np.ndarray, " k"]) -> Float[np.ndarray, " u"]:
    """Return the sums of values of the taxels of each unit."""
    return np.bincount(units.layout.module[units.taxels], values[units.taxels], len(units))


def _solved(
    units: Units, matrix: Float[np.ndarray, "k 3 f"], gap: Vectors, share: Float[np.ndarray, " k"]
) -> Float[np.ndarray, "u f"]:
    """Return the step of each unit that brings its taxels nearest to their places."""
    size, rows = units.freedom, units.taxels
    square, right = np.zeros((len(units), size, size)), np.zeros((len(units), size))
    unit = units.layout.module[rows]
    np.add.at(square, unit, np.einsum("k,kia,kib->kab", share[rows], matrix[rows], matrix[rows]))
    np.add.at(right, unit, np.einsum("k,kia,ki->ka", share[rows], matrix[rows], gap[rows]))
    scale = np.trace(square, axis1=1, axis2=2)[:, None, None] * 1e-12 + 1e-30
    raised: Float[np.ndarray, "u f f"] = square + scale * np.eye(size)
    return np.linalg.solve(raised, right[..., None])[..., 0]


def _start(layout: ModuleLayout, places: Vectors, surface: Surface | None, share: Float[np.ndarray, " k"]) -> Units:
    """Return modules by the rotation that fits best."""
    centre, frame = np.zeros((layout.modules, 3)), np.tile(np.eye(3), (layout.modules, 1, 1))
    for number in range(layout.modules):
        rows = np.flatnonzero((layout.module == number) & (share > 0))
        weight = share[rows][:, None] / share[rows].sum()
        flat, seen = layout.places[rows], places[rows]
        middle, origin = (weight * seen).sum(axis=0), (weight * flat).sum(axis=0)
        solid = np.column_stack([flat - origin, np.zeros(len(rows))])
        both = (seen - middle).T @ (weight * solid)
        if surface is not None:
            onto, normal, _ = surface.project(middle[None])
            middle = onto[0]
            base = frame_about(normal, np.array([[1.0, 0.0, 0.0]]))[0]
            small = base[:, :2].T @ both[:, :2]
            angle = np.arctan2(small[1, 0] - small[0, 1], small[0, 0] + small[1, 1])
            first = np.cos(angle) * base[:, 0] + np.sin(angle) * base[:, 1]
            frame[number] = frame_about(normal, first[None])[0]
        else:
            left, _, right = np.linalg.svd(both)
            frame[number] = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
        centre[number] = middle - frame[number][:, :2] @ origin
    if surface is not None:
        centre = surface.project(centre)[0]
    return Units(layout, centre, frame, surface)
