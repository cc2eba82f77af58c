"""Define the priors on errors of sensor and robot, and on single taxels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, isfinite, radians

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError
from palpate.sensors.taxels.poking.rigid_groups import Units

AROUND = 6  # neighbours that say where the surface is at a taxel
NEXT = 2  # neighbours whose distance is known

Vectors = Float[np.ndarray, "u 3"]


@dataclass(frozen=True)
class Priors:
    """Prior standard deviations, along each axis, of the errors that are estimated with the taxels; 0: not estimated.

    Args:
        bias_force, bias_torque: [N], [N m] of the wrench in each configuration.
        frame, frame_angle: [m], [rad] of the link in the sensor's frame, in each configuration.
        common, common_angle: the same, common to all configurations.
        cross_talk: share of each force and torque that reads as another one, or as more of itself.
        lever: [m] by which cross-talk between forces and torques is scaled.
        start, start_angle: [m], [rad] of each module from the start (CAD); inf: any.
        smooth: [m] of each single taxel from the mean of its neighbours, without a surface; inf: any.
        neighbours, spacing: [m] distance of next neighbours, and its standard deviation; inf: any.

    Raises:
        InputError: a negative value.
    """

    bias_force: float = 0.3
    bias_torque: float = 0.03
    frame: float = 3e-3
    frame_angle: float = radians(1.0)
    common: float = 3e-3
    common_angle: float = radians(1.0)
    cross_talk: float = 0.02
    lever: float = 0.1
    start: float = 3e-3
    start_angle: float = radians(5.0)
    smooth: float = 1e-3
    neighbours: float = 5e-3
    spacing: float = inf

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value >= 0:
                raise InputError(f"{name} must not be negative, but is {value}.", where="priors")

    def of_single_taxels(self) -> Priors:
        """Return `Priors` without cross-talk, as centroids of answers shrink, which would look like a sensor gain."""
        return replace(self, cross_talk=0.0)


def tied(units: Units, priors: Priors) -> tuple[Float[np.ndarray, "p p"], Float[np.ndarray, " p"]]:
    """Return the priors' terms of J' W J (p, p) and J' W r (p,) for the units' p unknowns.

    A taxel's offset from the mean of its six neighbours, along their plane's normal, has the standard deviation
    `Priors.smooth`; its distances to the next two are `Priors.neighbours`, within `Priors.spacing`. Terms are 0 for
    modules, on a surface, and for fewer than seven taxels.
    """
    size = len(units) * units.freedom
    square, right = np.zeros((size, size)), np.zeros(size)
    if not units.alone or units.surface is not None or len(units) <= AROUND:
        return square, right
    from scipy.spatial import cKDTree  # here: scipy is slow to import

    places = units.centre
    about = np.asarray(cKDTree(places).query(places, k=AROUND + 1)[1])[:, 1:]
    if isfinite(priors.smooth):
        _add_smooth(places, about, priors.smooth, square, right)
    if isfinite(priors.spacing) and isfinite(priors.neighbours):
        _add_distances(places, about[:, :NEXT], priors, square, right)
    return square, right


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
    ends = np.stack([np.repeat(np.arange(len(places)), about.shape[1]), about.ravel()])
    pairs = np.unique(np.sort(ends, axis=0), axis=1)
    away = places[pairs[0]] - places[pairs[1]]
    length = np.linalg.norm(away, axis=1)
    way = away / np.maximum(length, 1e-6)[:, None]
    rows = np.zeros((pairs.shape[1], len(right)))
    _put(rows, pairs[:1].T, way[:, None])
    _put(rows, pairs[1:].T, -way[:, None])
    square += rows.T @ rows / priors.spacing**2
    right -= rows.T @ (length - priors.neighbours) / priors.spacing**2


def _put(rows: Float[np.ndarray, "n p"], unit: Int[np.ndarray, "n a"], value: Float[np.ndarray, "n a 3"]) -> None:
    each = np.arange(len(rows))[:, None]
    for axis in range(3):
        np.add.at(rows, (each, 3 * unit + axis), value[..., axis])
