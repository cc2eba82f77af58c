"""The bodies of the claims, their curvature, and smooth paths over them: all from the analytic surface."""

from typing import Any

import numpy as np

import palpate
from palpate_lab.simulation import Body, BumpySphere, EllipsoidBody, Superquadric, contact_wrenches, touch_wrenches

R = 0.010  # m
BODIES: dict[str, Body] = {
    "ellipsoid 1 : 0.7 : 0.5": EllipsoidBody((R, 0.7 * R, 0.5 * R)),
    "superquadric 1 : 0.7 : 0.5, exponents 0.7": Superquadric((R, 0.7 * R, 0.5 * R), (0.7, 0.7)),
    "bumpy sphere": BumpySphere(R),
}
CONVEX = tuple(BODIES)[:2]
BUMPIER = BumpySphere(R, amplitude=0.4)  # the bumpy sphere turns out to be convex; this one is not
SIZES = (2_000, 20_000, 200_000)


def mesh_of(body: Body, facets: int, smooth: bool = True) -> palpate.Mesh:
    return palpate.Mesh.from_arrays(*body.mesh(facets), smooth=smooth)


def touched(body: Body, count: int, rng: np.random.Generator, **options: Any) -> tuple[np.ndarray, np.ndarray]:
    """Points that are drawn on a body, and wrenches of touches there; options as of `touch_wrenches`."""
    points = body.sample(count, rng)
    return points, touch_wrenches(points, body.normals(points), rng, **options)


def on_facets(mesh: palpate.Mesh, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Facets (n,) and weights of their corners (n, 3) of points that are uniform in area."""
    facets = rng.choice(len(mesh.areas), count, p=mesh.areas / mesh.areas.sum())
    root, along = np.sqrt(rng.uniform(size=count)), rng.uniform(size=count)
    return facets, np.stack([1 - root, root * (1 - along), root * along], axis=1)


def curvature(body: Body, points: np.ndarray) -> np.ndarray:
    """Gaussian curvature [1/m^2]: determinant of how the normal turns along two tangents, by differences."""
    normals = body.normals(points)
    first = np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    tangents = (first, np.cross(normals, first))
    step = 1e-4 * body.radius
    turns = [(body.normals(points + step * t) - body.normals(points - step * t)) / (2 * step) for t in tangents]
    (a, b), (c, d) = [[np.einsum("ij,ij->i", t, turn) for turn in turns] for t in tangents]
    return a * d - b * c


def path(body: Body, count: int, step: float, pitch: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A finger that slides over a body: points (n, 3) and wrenches (n, 6), all smooth in time.

    Direction, force, friction angle, azimuth and pitch are slow sums of sines; `step` [m] is about what a sample moves.
    """
    rng = np.random.default_rng(seed)
    course = np.arange(count) * step / body.radius

    def wander(rates: np.ndarray) -> np.ndarray:
        return np.sin(course[:, None] * rates + rng.uniform(0, 2 * np.pi, len(rates)))

    # A direction that winds around a slowly turning axis never stands still and never passes the middle.
    turn, tilt = course + 0.3 * wander(np.array([0.13]))[:, 0], 1.4 * wander(np.array([0.071]))[:, 0]
    directions = np.stack([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.sin(tilt)], axis=1)
    points = body.on_ray(directions)
    normals = body.normals(points)
    size = 5.0 + 3.0 * wander(np.array([0.31]))[:, 0]
    slope = 0.25 + 0.25 * wander(np.array([0.23]))[:, 0]
    # Forces in a frame that moves smoothly with the path: sideways along and across the motion, seen from the axis z.
    along = np.stack([-np.sin(turn), np.cos(turn), np.zeros(count)], axis=1)
    along -= normals * np.einsum("ij,ij->i", along, normals)[:, None]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(normals, along)
    azimuth = 0.37 * course
    sideways = np.cos(azimuth)[:, None] * along + np.sin(azimuth)[:, None] * across
    forces = size[:, None] * (slope[:, None] * sideways - normals) / np.sqrt(1 + slope[:, None] ** 2)
    pitches = pitch * wander(np.array([0.41]))[:, 0]
    torsion = pitches * size**2 / np.einsum("ij,ij->i", forces, normals)
    return points, contact_wrenches(points, normals, forces, torsion)


def prism(outline: np.ndarray, height: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces over a polygon, counter-clockwise and star-shaped about its first corner; z in +-height/2."""
    count = len(outline)
    vertices = np.concatenate([np.c_[outline, np.full(count, s * height / 2)] for s in (-1, 1)])
    i, j = np.arange(count), np.roll(np.arange(count), -1)
    sides = np.concatenate([np.c_[i, j, j + count], np.c_[i, j + count, i + count]])
    fan = np.c_[np.zeros(count - 2, dtype=int), np.arange(1, count - 1), np.arange(2, count)]
    return vertices, np.concatenate([sides, fan[:, ::-1], fan + count])
