"""Rank places of a contact that the skin does not feel by how well they explain a wrench."""

from __future__ import annotations

from math import log

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.sensors.fused import _kernels
from palpate.spatial._arrays import Value
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.surfaces.surface import Surface

__all__ = ["PUSHES", "LockedValue", "Unseen", "candidates"]

PUSHES = np.geomspace(0.5, 20.0, 11)  # [N] normal forces of an unseen contact, equally likely; sd a quarter of each
_PLACES = 1200
_FINER = 8  # points of the surface behind each place
_HELD = 0.95


class LockedValue(Value):
    """A frozen dataclass that makes the arrays given to it read-only, without a copy."""

    def __post_init__(self) -> None:
        for each in vars(self).values():
            if isinstance(each, np.ndarray):
                each.flags.writeable = False


@frozen_value
class Unseen(LockedValue):
    """Places of one more contact that the skin does not feel, the likeliest first.

    Attributes:
        points: (c, 3) [m] on the surface.
        normals: (c, 3) outward, unit.
        forces: (c, 3) [N] of the contact if it is there.
        belief: (c,) probability of each place, given that there is one more contact.
        region: (c,) whether a place is in the smallest set with a probability of 95 %.
        cluster: (c,) number of the group of neighbouring places in the region, 0 for the likeliest place's; -1 outside.
    """

    points: Float[np.ndarray, "c 3"]
    normals: Float[np.ndarray, "c 3"]
    forces: Float[np.ndarray, "c 3"]
    belief: Float[np.ndarray, " c"]
    region: Bool[np.ndarray, " c"]
    cluster: Int[np.ndarray, " c"]


def candidates(surface: Surface) -> Float[np.ndarray, "c 8"]:
    """Return places spread evenly over the parts of a surface that can be touched, the same in each call.

    Returns:
        (c, 8), c <= 1200: point [m], outward unit normal, log of the share of the area that the place stands for, and
        the standard deviation [m] of that area in each direction.

    Raises:
        GeometryError: an implicit surface cannot be drawn.
    """
    rng, mesh, count = np.random.default_rng([0, 2]), surface.drawn(), _PLACES * _FINER
    facets = np.flatnonzero(~mesh.covered)
    areas = mesh.areas[facets]
    steps = (np.arange(count) + rng.uniform(size=count)) / count
    chosen = facets[np.minimum(np.searchsorted(np.cumsum(areas) / areas.sum(), steps), len(facets) - 1)]
    root, along = np.sqrt(rng.uniform(size=len(chosen))), rng.uniform(size=len(chosen))
    weights = np.stack([1.0 - root, root * (1.0 - along), root * along], axis=1)
    fine = np.einsum("nk,nki->ni", weights, mesh.vertices[mesh.faces[chosen]])
    kept, nearest = np.zeros(_PLACES, np.int64), np.zeros(len(fine), np.int64)
    _kernels.spaced(fine, kept, nearest)
    points, normals, _ = surface.project(fine[kept])
    shares = np.bincount(nearest, minlength=len(kept)) / len(fine)
    width = np.sqrt(shares * areas.sum() / 12.0)
    found = np.concatenate([points, normals, np.log(shares)[:, None], width[:, None]], axis=1)
    return np.ascontiguousarray(found[np.isfinite(found).all(axis=1)])


@takes_arrays
def ranked(places: Float[np.ndarray, "c 8"], explained: Float[np.ndarray, "c 4"], width: float) -> Unseen:
    """Return places by falling belief as `Unseen`.

    Args:
        places: (c, 8) from `candidates`.
        explained: (c, 4) log evidence of each place, with its share of the area, and force [N] there.
        width: [m] median of the places' standard deviations.

    Raises:
        InputError: arrays of other shapes.
    """
    evidence = explained[:, 0]
    top = evidence.max()
    belief = np.exp(evidence - top - log(np.exp(evidence - top).sum()))
    order = np.argsort(-evidence, kind="stable")
    places, belief = places[order], belief[order]
    region = np.cumsum(belief) - belief < _HELD
    cluster = np.full(len(places), -1, np.int64)
    near = 2.0 * float(np.sqrt(12.0)) * width  # two steps from place to place
    _kernels.clusters(places[region, :3], near, inside := cluster[region])
    cluster[region] = inside
    return Unseen(
        places[:, :3].copy(),
        places[:, 3:6].copy(),
        explained[order, 1:].copy(),
        belief,
        region,
        cluster,
    )
