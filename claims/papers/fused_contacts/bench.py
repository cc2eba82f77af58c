"""Touches that are known exactly: places drawn on bodies, forces drawn within friction, readings made from both.

Nothing here uses the estimator: a wrench is the sum of forces and of places x forces, and a reading is the truth and a
normal number.
"""

from dataclasses import dataclass

import numpy as np

from palpate.surfaces import Mesh

APART = 0.025  # [m] least distance of two contacts


@dataclass(frozen=True)
class Conditions:
    """What readings and forces are like.

    Attributes:
        gain: deviation of the skin's force, as a share.
        place: [m] deviation of the skin's place along each of two tangents.
        friction: tangential forces are uniform in a disc of this share of the normal force.
        normal: [N] least and largest normal force.
        noise: [N], [N m] deviations of the wrench.
    """

    gain: float = 0.10
    place: float = 2e-3 / 2**0.5
    friction: float = 0.5
    normal: tuple[float, float] = (2.0, 12.0)
    noise: tuple[float, float] = (0.04, 0.0015)


@dataclass(frozen=True)
class Body:
    """Corners (v, 3) [m] and outward triangles (f, 3) of a body; a smooth one has its exact outside in `radii`.

    Attributes:
        radii: lower and upper radius [m] of a cone about z, between the heights `ends` [m]; None: facets are exact.
    """

    vertices: np.ndarray
    faces: np.ndarray
    radii: tuple[float, float] | None = None
    ends: tuple[float, float] = (0.0, 0.0)

    def mesh(self) -> Mesh:
        return Mesh.from_arrays(self.vertices, self.faces)

    def draw(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Points [m] on it, uniform over its area but for the cone's slope, and outward normals."""
        if self.radii is not None:
            (low, high), (begin, end) = self.radii, self.ends
            slope = (high - low) / (end - begin)
            share, angle = rng.uniform(size=count), rng.uniform(-np.pi, np.pi, count)
            radius = low + (high - low) * share
            out = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
            points = radius[:, None] * out
            points[:, 2] = begin + (end - begin) * share
            return points, (out - [0.0, 0.0, slope]) / np.hypot(1.0, slope)
        corners = self.vertices[self.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(normals, axis=1)
        facet = rng.choice(len(areas), count, p=areas / areas.sum())
        weights = rng.dirichlet(np.ones(3), count)
        return np.einsum("nk,nki->ni", weights, corners[facet]), normals[facet] / areas[facet, None]


def forearm(rng: np.random.Generator) -> Body:
    """A cone of 32 to 40 mm radius and 160 to 220 mm length, its middle 100 to 200 mm from the sensor at the origin."""
    low, high = rng.uniform(0.032, 0.040, 2)
    length, middle = rng.uniform(0.16, 0.22), rng.uniform(0.1, 0.2)
    height = np.linspace(0.0, 1.0, 41)
    angle = np.arange(48) * 2.0 * np.pi / 48
    radius = (low + (high - low) * height)[:, None]
    around = [radius * np.cos(angle), radius * np.sin(angle)]
    along = np.broadcast_to((middle + length * (height - 0.5))[:, None], around[0].shape)
    i, j = (each.ravel() for each in np.meshgrid(np.arange(40), np.arange(48), indexing="ij"))
    a, b, c, d = i * 48 + j, i * 48 + (j + 1) % 48, (i + 1) * 48 + (j + 1) % 48, (i + 1) * 48 + j
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    ends = (middle - 0.5 * length, middle + 0.5 * length)
    return Body(np.stack([*around, along], axis=-1).reshape(-1, 3), faces, (float(low), float(high)), ends)


def box(rng: np.random.Generator) -> Body:
    """A link of 60 to 90 x 50 to 70 x 160 to 240 mm with flat sides, its middle 100 to 200 mm from the sensor."""
    size = rng.uniform([0.06, 0.05, 0.16], [0.09, 0.07, 0.24])
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.array([[a, b, c] for a, b, c, _ in sides] + [[a, c, d] for a, _, c, d in sides])
    return Body(corners * size + [0.0, 0.0, rng.uniform(0.1, 0.2)], faces)


@dataclass(frozen=True)
class Touch:
    """Contacts, and what is read of them.

    Attributes:
        places, normals, forces: (n, 3) the truth.
        points: (n, 3) [m] where the skin says they are.
        felt: (n,) [N] normal forces that it says.
        spread: (n, 3, 3) [m^2] covariance of its places.
        wrench, covariance: (6,), (6, 6) of the sensor.
    """

    places: np.ndarray
    normals: np.ndarray
    forces: np.ndarray
    points: np.ndarray
    felt: np.ndarray
    spread: np.ndarray
    wrench: np.ndarray
    covariance: np.ndarray

    def seen(self, count: int) -> tuple[np.ndarray, ...]:
        """What `FusedLocator.fuse` takes, of the first `count` contacts only."""
        skin = (self.points, self.normals, self.felt, np.zeros(len(self.felt)), self.spread)
        return *(each[:count] for each in skin), self.wrench[None], self.covariance[None]


def touch(body: Body, count: int, rng: np.random.Generator, now: Conditions, unseen: float | None = None) -> Touch:
    """`count` contacts, and one more of `unseen` newtons that is the last."""
    total = count + (unseen is not None)
    places, normals = body.draw(total, rng)
    while total > 1 and _closest(places) < APART:
        places, normals = body.draw(total, rng)
    pressing = rng.uniform(*now.normal, total)
    if unseen is not None:
        pressing[-1] = unseen
    across = np.cross(normals, rng.standard_normal((total, 3)))
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    reach = now.friction * np.sqrt(rng.uniform(size=total))
    forces = pressing[:, None] * (reach[:, None] * across - normals)
    clean = np.concatenate([forces.sum(axis=0), np.cross(places, forces).sum(axis=0)])
    deviations = np.repeat(now.noise, 3)
    flat = np.eye(3) - normals[:, :, None] * normals[:, None, :]
    moved = np.einsum("nij,nj->ni", flat, now.place * rng.standard_normal((total, 3)))
    felt = np.maximum(pressing * (1.0 + now.gain * rng.standard_normal(total)), 0.0)
    wrench = clean + deviations * rng.standard_normal(6)
    return Touch(places, normals, forces, places + moved, felt, now.place**2 * flat, wrench, np.diag(deviations**2))


def _closest(points: np.ndarray) -> float:
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    return float(apart[np.triu_indices(len(points), 1)].min())
