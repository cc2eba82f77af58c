"""Bodies of the benchmark's single wrenches: meshes, and points of the exact surface with their normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from palpate_lab.simulation.phantom.probes import probe
from palpate_lab.simulation.shapes import EllipsoidBody

HALVES = (0.030, 0.020, 0.012)  # m: of the ellipsoid and of the box
RING, TUBE = 0.030, 0.010  # m: of the torus, round its axis and of its tube
AROUND, ACROSS = 96, 32
FACETS, CELLS = 5000, 20  # of the ellipsoid; along each edge of a face of the box


@dataclass(frozen=True, eq=False)
class TouchedBody:
    """A closed mesh [m], and n points on the exact surface that it approximates, with outward unit normals."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]


def ellipsoid(count: int, rng: np.random.Generator) -> TouchedBody:
    """Make a convex, smooth `TouchedBody`, with `count` points uniform in direction from its middle."""
    body = EllipsoidBody(HALVES)
    points = body.sample(count, rng)
    return TouchedBody(*body.mesh(FACETS), points, body.normals(points))


def torus(count: int, rng: np.random.Generator) -> TouchedBody:
    """Make a `TouchedBody`: a torus about z, which a line crosses at up to four places.

    The `count` points are uniform in both angles.
    """
    turn, roll = np.meshgrid(
        2 * np.pi * np.arange(AROUND) / AROUND, 2 * np.pi * np.arange(ACROSS) / ACROSS, indexing="ij"
    )
    vertices, _ = _torus(turn.ravel(), roll.ravel())
    grid = np.arange(AROUND * ACROSS).reshape(AROUND, ACROSS)
    faces = _quads(grid, np.roll(grid, -1, 0), np.roll(grid, -1, (0, 1)), np.roll(grid, -1, 1))
    return TouchedBody(vertices, faces, *_torus(*rng.uniform(0.0, 2 * np.pi, (2, count))))


def box(count: int, rng: np.random.Generator) -> TouchedBody:
    """Make a `TouchedBody`: a box with sharp edges and corners, with `count` points on its faces, uniform in area."""
    halves = np.array(HALVES)
    sides = [_side(axis, sign, halves) for axis in range(3) for sign in (-1.0, 1.0)]
    offsets = np.cumsum([0, *(len(vertices) for vertices, _ in sides)])
    area = np.repeat(np.prod(halves) / halves, 2)
    side = rng.choice(6, count, p=area / area.sum())
    axis, normals, points = side // 2, np.zeros((count, 3)), rng.uniform(-1.0, 1.0, (count, 3)) * halves
    normals[np.arange(count), axis] = np.where(side % 2 == 1, 1.0, -1.0)
    points[np.arange(count), axis] = halves[axis] * normals[np.arange(count), axis]
    faces = np.concatenate([faces + offset for (_, faces), offset in zip(sides, offsets, strict=False)])
    return TouchedBody(np.concatenate([vertices for vertices, _ in sides]), faces, points, normals)


def ultrasound_probe(count: int, rng: np.random.Generator) -> TouchedBody:
    """Make a `TouchedBody`: the T-shaped ultrasound probe in its sensor's frame, its face 150 mm away.

    The `count` points are uniform in area.
    """
    made = probe("t-shaped")
    cell = rng.choice(len(made.points), count, p=made.areas / made.areas.sum())
    return TouchedBody(made.vertices, made.faces, made.points[cell], made.normals[cell])


def _torus(turn: np.ndarray, roll: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points and normals at angles about the axis and about the tube [rad]."""
    outward = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=-1)
    normals = np.cos(roll)[:, None] * outward + np.sin(roll)[:, None] * [0.0, 0.0, 1.0]
    return RING * outward + TUBE * normals, normals


def _side(axis: int, sign: float, halves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a face of the box, cut into equal triangles."""
    steps = np.linspace(-1.0, 1.0, CELLS + 1)
    points = np.empty((CELLS + 1, CELLS + 1, 3))
    points[..., axis] = sign
    points[..., (axis + 1) % 3], points[..., (axis + 2) % 3] = np.meshgrid(steps, steps, indexing="ij")
    grid = np.arange((CELLS + 1) ** 2).reshape(CELLS + 1, CELLS + 1)
    faces = _quads(grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:])
    return points.reshape(-1, 3) * halves, faces if sign > 0 else faces[:, ::-1]


def _quads(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Split quadrilaterals into two triangles each, in the order in which their corners are seen from outside."""
    corners = [each.ravel() for each in (a, b, c, d)]
    return np.concatenate([np.stack([corners[k] for k in which], axis=1) for which in ((0, 1, 2), (0, 2, 3))])
