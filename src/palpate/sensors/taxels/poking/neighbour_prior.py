"""Add priors on single taxels without a surface: they lie on a smooth surface, at known distances."""

from __future__ import annotations

from math import isfinite

import numpy as np
from jaxtyping import Float, Int

from palpate.sensors.taxels.poking.priors import Priors
from palpate.sensors.taxels.poking.rigid_groups import Units

__all__ = ["tied"]

AROUND = 6  # neighbours that say where the surface is at a taxel
NEXT = 2  # neighbours whose distance is known

Vectors = Float[np.ndarray, "u 3"]


def tied(units: Units, priors: Priors) -> tuple[Float[np.ndarray, "p p"], Float[np.ndarray, " p"]]:
    """Return the priors' terms of J' W J (p, p) and J' W r (p,) for the units' p unknowns; 0 with a surface.

    A taxel's offset from the mean of its neighbours, along the normal of the plane that fits them best, has the
    standard deviation `Priors.smooth`; the distances to its next neighbours are `Priors.neighbours`, within
    `Priors.spacing`.
    """
    size = len(units) * units.freedom
    square, right = np.zeros((size, size)), np.zeros(size)
    if not units.alone or units.surface is not None or len(units) <= AROUND:
        return square, right
    places = units.centre
    about = _about(places)
    if isfinite(priors.smooth):
        _add_smooth(places, about, priors.smooth, square, right)
    if isfinite(priors.spacing) and isfinite(priors.neighbours):
        _add_distances(places, about[:, :NEXT], priors, square, right)
    return square, right


def _about(places: Vectors) -> Int[np.ndarray, "u a"]:
    from scipy.spatial import cKDTree  # here: scipy is slow to import

    return np.asarray(cKDTree(places).query(places, k=AROUND + 1)[1])[:, 1:]


def _add_smooth(
    places: Vectors, about: Int[np.ndarray, "u a"], smooth: float, square: np.ndarray, right: np.ndarray
) -> None:
    middle = places[about].mean(axis=1)
    axes = np.linalg.svd(places[about] - middle[:, None], full_matrices=False)[2]
    normal = axes[:, 2]  # of the plane that is nearest to the neighbours
    gap = np.einsum("uc,uc->u", normal, places - middle)
    rows = np.zeros((len(places), len(right)))
    _put(rows, np.arange(len(places))[:, None], normal[:, None])
    _put(rows, about, -np.repeat(normal[:, None], about.shape[1], axis=1) / about.shape[1])
    square += rows.T @ rows / smooth**2
    right -= rows.T @ gap / smooth**2


def _add_distances(
    places: Vectors, about: Int[np.ndarray, "u a"], priors: Priors, square: np.ndarray, right: np.ndarray
) -> None:
    pairs = np.unique(
        np.sort(np.stack([np.repeat(np.arange(len(places)), about.shape[1]), about.ravel()]), axis=0), axis=1
    )
    away = places[pairs[0]] - places[pairs[1]]
    length = np.linalg.norm(away, axis=1)
    way = away / np.maximum(length, 1e-6)[:, None]
    rows = np.zeros((pairs.shape[1], len(right)))
    _put(rows, pairs[:1].T, way[:, None])
    _put(rows, pairs[1:].T, -way[:, None])
    square += rows.T @ rows / priors.spacing**2
    right -= rows.T @ (length - priors.neighbours) / priors.spacing**2


def _put(rows: Float[np.ndarray, "n p"], unit: Int[np.ndarray, "n a"], value: Float[np.ndarray, "n a 3"]) -> None:
    """Add values to the columns of units."""
    each = np.arange(len(rows))[:, None]
    for axis in range(3):
        np.add.at(rows, (each, 3 * unit + axis), value[..., axis])
