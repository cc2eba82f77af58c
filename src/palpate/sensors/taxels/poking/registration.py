"""Find where a link's surface lies among places of taxels: the pose that brings the places nearest to it.

Poses are T_surface_places while they are sought. Starts bring a patch of neighbouring places onto points all over the
surface, in all turns; from the best of them, Gauss-Newton steps shorten the distances of all places.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from palpate.calibration._screws import name_motions
from palpate.calibration.touch_error import spread_in_time
from palpate.calibration.validation import Validation, cross_validate
from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.poking.rigid_groups import frame_about
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.spatial.pose import Pose, skew
from palpate.surfaces.mesh import UNITS, Mesh
from palpate.surfaces.surface import Surface

FEWEST = 7  # places: each gives one distance, for six unknowns
LINE = 0.02  # width over length of places that lie on one line
STARTS, TURNS, PATCH = 256, 12, 12  # points on the surface; turns at each; places of the patch brought there
STEPS = (1, 10, 400), (6, 24, 24)  # steps, by how many places, and how many poses go on
LAST = 60  # steps by all places
STILL = 1e-7  # m: the steps that end it
ALIKE = 1.25  # times the best rms: poses that fit as well
ELSEWHERE = 3e-3  # m (rms over places): poses that differ by less are one, and one known worse is named
GOOD = 0.02  # of the extent of the places: an rms that leaves no doubt about the unit
BETTER = 0.5  # of the rms: a unit or hand that fits so much better contradicts the stated one
SIZES = 0.5, 20.0  # of a link in a unit that is tried, over the extent of the places
DAMPED = 1e-6  # of the trace: motions that distances do not show stay small
LEAST = 1.0  # 1/m^2, 1/rad^2: the weak prior of the pose

Points = Float[np.ndarray, "n 3"]


@frozen_value
class Registration:
    """The pose of a surface in the frame of taxel places.

    Attributes:
        pose: T_places_surface.
        covariance: (6, 6) of (rotation vector [rad], translation [m]), perturbed on the left, in the frame of the
            places.
        distances: (k,) [m] of the places from the surface, NaN without a place.
        spread: [m] standard deviation (rms over the places) of where the surface lies at them.
        uncertain: small motions of the surface that move places by more than 3 mm within their standard deviation.
        others: other poses that fit as well, as (rms [m] of the distances, rms [m] by which they move the places).
        mirrored: rms [m] of the distances of the places' mirror image.
        validation: errors of parts of the places that a fit did not use.
    """

    pose: Pose
    covariance: Float[np.ndarray, "6 6"]
    distances: Float[np.ndarray, " k"]
    spread: float
    uncertain: tuple[str, ...]
    others: tuple[tuple[float, float], ...]
    mirrored: float
    validation: Validation

    @property
    def rms(self) -> float:
        """Return the root mean square [m] of the distances."""
        return float(np.sqrt(np.nanmean(self.distances**2)))


@takes_arrays
def register_places(places: TaxelPlaces, surface: Surface, *, initial: Pose | None = None) -> Registration:
    """Return the `Registration` of taxel places on a surface.

    Args:
        places: seven or more, not on one line; normals, where known, say which side is outside.
        surface: of the link, in any frame.
        initial: rough T_places_surface, which chooses among poses that fit as well; None: the best fit.

    Raises:
        InputError: the places fit in another unit or mirrored, but not as stated.
        NotIdentifiable: fewer than seven places, or all on one line.
    """
    middle = Pose.from_translation(np.nanmean(np.where(places.there[:, None], places.positions, np.nan), axis=0))
    points, normals = middle.inverse().apply(places.positions[places.there]), places.normals[places.there]
    _require(points)
    search, begun = _Search.of(surface.drawn()), None if initial is None else initial.inverse() @ middle
    poses, rms = search.found(points, normals, begun)
    best, mirror = float(rms.min()), np.array([-1.0, 1.0, 1.0])
    mirrored = float(search.found(mirror * points, mirror * normals)[1].min())
    _require_unit(points, normals, search, best)
    if mirrored < BETTER * best:
        raise InputError(
            f"the places lie {1e3 * best:.2f} mm (rms) from the surface at best, and their mirror image "
            f"{1e3 * mirrored:.2f} mm: places and surface differ in handedness.",
            where="places",
            hint="Change the sign of one coordinate of the places, or use the mesh of the other side's link.",
        )
    alike = list[int]()
    for k in np.argsort(rms).tolist():
        if rms[k] <= ALIKE * best + STILL and all(_apart(points, poses, k, j) > ELSEWHERE for j in alike):
            alike.append(k)
    if begun is not None:
        goal = begun.apply(points)
        alike.sort(key=lambda k: float(np.linalg.norm(_at(poses, k).apply(points) - goal)))
    others = tuple((float(rms[k]), _apart(points, poses, k, alike[0])) for k in alike[1:])
    pose, gaps, covariance, spread, uncertain, left = _judged(points, search, _at(poses, alike[0]))
    distances = np.full(len(places), np.nan)
    distances[places.there] = np.abs(gaps)
    shift = middle.wrench_matrix()
    return Registration(
        middle @ pose, shift @ covariance @ shift.T, distances, spread, uncertain, others, mirrored, left
    )


def _require(points: Points) -> None:
    """Raise NotIdentifiable for places from which no pose can be found."""
    if len(points) < FEWEST:
        raise NotIdentifiable(
            f"{len(points)} places cannot show where the surface lies: each gives one distance, and at least {FEWEST} "
            "are needed.",
            rank=len(points),
            missing=("pose of the surface",),
        )
    values = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if values[1] < LINE * values[0]:
        raise NotIdentifiable(
            "the places lie on one line, about which the surface can turn: give places beside it.",
            rank=4,
            missing=("rotation about the line",),
        )


def _require_unit(points: Points, normals: Points, search: _Search, best: float) -> None:
    """Raise an InputError if the places fit far better where the surface's numbers are in another unit."""
    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    if best < GOOD * extent:
        return
    factors = {a / b for a in UNITS.values() for b in UNITS.values() if a != b}
    sizes = {factor: factor * search.mesh.size / extent for factor in factors}
    tried = {
        factor: factor * float(search.found(points / factor, normals)[1].min())
        for factor, size in sizes.items()
        if SIZES[0] < size < SIZES[1]
    }
    factor = min(tried, key=lambda each: tried[each], default=1.0)
    if factor != 1.0 and tried[factor] < BETTER * best:
        pairs = [f"{a} for {b}" for a, x in UNITS.items() for b, y in UNITS.items() if np.isclose(x / y, factor)]
        raise InputError(
            f"the surface is {1e3 * search.mesh.size:.3g} mm large, and the places lie {1e3 * best:.3g} mm (rms) from "
            f"it at best; {factor:.4g} times as large it fits to {1e3 * tried[factor]:.3g} mm: a unit is wrong.",
            where="surface",
            hint=f"Write another unit in [surface] ({', '.join(pairs)}), or the reverse in the file of places.",
        )


def _judged(
    points: Points, search: _Search, pose: Pose
) -> tuple[Pose, Float[np.ndarray, " n"], Float[np.ndarray, "6 6"], float, tuple[str, ...], Validation]:
    """Return what a `Registration` says of a pose T_surface_places of places about their middle."""
    gaps, slopes = search.slopes(points, pose)
    alike = spread_in_time(gaps[:, None])  # taxels of a module err alike
    variance = alike * float(gaps @ gaps) / max(len(points) - 6, 1) + STILL**2

    def predict(left: Bool[np.ndarray, " n"]) -> tuple[np.ndarray, np.ndarray]:
        rest = search.closer(points[~left], pose, LAST)[0]
        known = _covariance(search.slopes(points[~left], rest)[1], variance)
        away, slope = search.slopes(points[left], rest)
        return away, variance / alike * np.eye(len(away)) + slope @ known @ slope.T

    left = cross_validate(len(points), predict) if len(points) >= 2 * FEWEST else Validation()
    covariance, back = _covariance(slopes, variance * left.widening), pose.inverse()
    moves = np.concatenate([-skew(points), np.tile(np.eye(3), (len(points), 1, 1))], axis=2)
    metric: Float[np.ndarray, "6 6"] = np.einsum("nki,nkj->ij", moves, moves) / len(points)
    root: Float[np.ndarray, "6 6"] = np.linalg.cholesky(metric)
    values, vectors = np.linalg.eigh(root.T @ covariance @ root)  # variances [m^2] of motions of the places
    free: Float[np.ndarray, "6 k"] = np.linalg.solve(root.T, vectors[:, values > ELSEWHERE**2])
    lever = float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean()))
    sizes = np.repeat([1.0 / lever, 1.0], 3)  # rad and m by which places move alike
    own_axes = np.kron(np.eye(2), pose.rotation)  # those of the surface
    turned: Float[np.ndarray, "6 k"] = own_axes @ free / sizes[:, None]
    uncertain = name_motions(np.linalg.qr(turned)[0], 1.0 / lever, 1.0, pose.translation)
    return back, gaps, covariance, float(np.sqrt(values.sum())), uncertain, left


def _covariance(slopes: Float[np.ndarray, "n 6"], variance: float) -> Float[np.ndarray, "6 6"]:
    return np.asarray(np.linalg.inv(slopes.T @ slopes / variance + LEAST * np.eye(6)))


def _at(poses: Pose, k: int) -> Pose:
    return Pose(poses.rotation[k], poses.translation[k])


def _apart(points: Points, poses: Pose, one: int, other: int) -> float:
    """Return the rms [m] of the distances between places in two poses."""
    away = _at(poses, one).apply(points) - _at(poses, other).apply(points)
    return float(np.sqrt((away**2).sum(axis=1).mean()))


@dataclass(frozen=True, eq=False)
class _Search:
    """A surface, with points on it to start from.

    Attributes:
        samples: (m, 3) [m], all over it; normals: (m, 3) there.
    """

    mesh: Mesh
    samples: Float[np.ndarray, "m 3"]
    normals: Float[np.ndarray, "m 3"]

    @classmethod
    def of(cls, mesh: Mesh) -> _Search:
        rng = np.random.default_rng(0)
        area = np.where(mesh.covered, 0.0, mesh.areas)
        facet = rng.choice(len(area), STARTS, p=area / area.sum())
        share = rng.dirichlet(np.ones(3), STARTS)
        samples = np.einsum("mc,mcx->mx", share, mesh.vertices[mesh.faces[facet]])
        return cls(mesh, samples, mesh.normals[facet])

    def found(self, points: Points, normals: Points, begun: Pose | None = None) -> tuple[Pose, Float[np.ndarray, " s"]]:
        """Return the best poses T_surface_places, from all starts and `begun`, and their rms distances [m]."""
        poses = self._starts(points, normals)
        for rounds, count, kept in STEPS:
            some = np.linspace(0, len(points) - 1, min(count, len(points))).astype(np.int64)
            poses, rms = self.closer(points[some], poses, rounds)
            order = np.argsort(rms)[:kept]
            poses = Pose(poses.rotation[order], poses.translation[order])
        if begun is not None:
            both = np.concatenate([poses.rotation, begun.rotation[None]])
            poses = Pose(both, np.concatenate([poses.translation, begun.translation[None]]))
        return self.closer(points, poses, LAST)

    def _starts(self, points: Points, normals: Points) -> Pose:
        """Return poses that bring a patch of places onto points all over the surface, in all turns."""
        middle = points[np.linalg.norm(points - points.mean(axis=0), axis=1).argmin()]
        patch = np.argsort(np.linalg.norm(points - middle, axis=1))[:PATCH]
        middle, known = points[patch].mean(axis=0), normals[patch][np.isfinite(normals[patch]).all(axis=1)]
        flat = np.linalg.svd(points[patch] - middle)[2][2]
        outward = known.sum(axis=0) if len(known) else flat
        sides = [outward] if np.linalg.norm(outward) > 0 and len(known) else [flat, -flat]
        first = np.array([[1.0, 0.0, 0.0]])
        own = np.concatenate([frame_about(side[None], first) for side in sides])
        angle = 2 * np.pi * np.arange(TURNS) / TURNS
        turned = Pose.from_rotation_vector(angle[:, None] * [0.0, 0.0, 1.0], np.zeros((TURNS, 3))).rotation
        there = frame_about(self.normals, np.tile(first, (STARTS, 1)))
        rotation = np.einsum("sij,tjk,mlk->stmil", there, turned, own).reshape(-1, 3, 3)
        onto = np.repeat(self.samples, TURNS * len(sides), axis=0)
        return Pose(rotation, onto - rotation @ middle)

    def closer(self, points: Points, poses: Pose, rounds: int) -> tuple[Pose, Float[np.ndarray, "*s"]]:
        """Return the best poses of so many Gauss-Newton steps, and the rms distances [m] of the places."""
        best, least = poses, np.full(poses.translation.shape[:-1], np.inf)
        for _ in range(rounds):
            gaps, slopes = self.slopes(points, poses)
            rms = np.sqrt((gaps**2).mean(axis=-1))
            better = rms < least
            rotation = np.where(better[..., None, None], poses.rotation, best.rotation)
            best = Pose(rotation, np.where(better[..., None], poses.translation, best.translation))
            if not (rms < least - STILL).any():
                break
            least = np.minimum(rms, least)
            square: np.ndarray = np.einsum("...ni,...nj->...ij", slopes, slopes)
            scale: np.ndarray = DAMPED * np.trace(square, axis1=-2, axis2=-1)[..., None, None]
            right: np.ndarray = np.einsum("...ni,...n->...i", slopes, gaps)
            raised: Float[np.ndarray, "*s 6 6"] = square + scale * np.eye(6)
            step = np.asarray(np.linalg.solve(raised, right[..., None])[..., 0], dtype=np.float64)
            poses = poses @ Pose.from_rotation_vector(step[..., :3], step[..., 3:])
        return best, np.asarray(least)

    def slopes(self, points: Points, poses: Pose) -> tuple[Float[np.ndarray, "*s n"], Float[np.ndarray, "*s n 6"]]:
        """Return signed distances [m] of places below the surface, and their derivatives.

        They are by the motion (rotation vector, translation) of the surface in the frame of the places.
        """
        at = poses.rotation @ points.T
        at = np.swapaxes(at, -1, -2) + poses.translation[..., None, :]
        onto, normals = (each.reshape(at.shape) for each in self.mesh.project(at.reshape(-1, 3))[:2])
        away = onto - at
        gap = np.linalg.norm(away, axis=-1)
        sign = np.where(np.einsum("...c,...c->...", away, normals) < 0, -1.0, 1.0) * gap
        along = np.where((gap > STILL)[..., None], away / np.where(sign == 0, 1.0, sign)[..., None], normals)
        along = np.einsum("...ji,...nj->...ni", poses.rotation, along)  # in the frame of the places
        return sign, np.concatenate([np.cross(np.broadcast_to(points, along.shape), along), along], axis=-1)
