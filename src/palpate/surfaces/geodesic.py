"""Walk straight along a surface of any shape."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.spatial.arguments import takes_arrays
from palpate.surfaces.surface import Surface

STEPS = 4  # each errs by (length / 4)^3 / (24 R^2): 0.1 um for 10 mm on a radius of 30 mm

LONGER = 1.3  # of a step, at most

Vectors = Float[np.ndarray, "n 3"]


@takes_arrays
def walk(surface: Surface, starts: Vectors, ways: Vectors) -> tuple[Vectors, Vectors, Vectors]:
    """Return the ends of walks along geodesics.

    Args:
        surface: any.
        starts: (n, 3) [m] on it.
        ways: (n, 3) [m] direction, nearly in the tangent plane, and length of each walk.

    Returns:
        Points [m], outward unit normals, and the unit directions in which walks arrive (NaN for a walk of no length),
        (n, 3) each.

    Raises:
        InputError: starts and ways are not (n, 3) each.
    """
    length = np.linalg.norm(ways, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        heading = np.where(length > 0, ways / length, np.nan)
    points, normals, _ = surface.project(starts)
    for _ in range(STEPS):
        ahead = _along(heading, normals)
        onto, outward, _ = surface.project(points + np.nan_to_num(ahead) * length / STEPS)
        chord = np.linalg.norm(onto - points, axis=1, keepdims=True)  # a step in the tangent plane comes out too short
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.clip(np.where(chord > 0, length / STEPS / chord, 1.0), 1.0, LONGER)  # at a rim no step gets on
        onto, outward, _ = surface.project(points + np.nan_to_num(ahead) * length / STEPS * share)
        heading = _turned(ahead, normals, outward)
        points, normals = onto, outward
    return points, normals, _along(heading, normals)


def _along(vectors: Vectors, normals: Vectors) -> Vectors:
    flat = vectors - np.einsum("nc,nc->n", vectors, normals)[:, None] * normals
    with np.errstate(invalid="ignore", divide="ignore"):
        return flat / np.linalg.norm(flat, axis=1, keepdims=True)


def _turned(vectors: Vectors, before: Vectors, after: Vectors) -> Vectors:
    """Return vectors turned by the least rotation from one normal to the next."""
    axis = np.cross(before, after)
    cosine = np.einsum("nc,nc->n", before, after)[:, None]
    share = np.einsum("nc,nc->n", axis, vectors)[:, None] / (1.0 + np.maximum(cosine, -0.999))
    return cosine * vectors + np.cross(axis, vectors) + axis * share
