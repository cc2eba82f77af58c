"""Find taxels by the paper's methods: the point nearest to all lines of force, free or on the surface."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.sensors.taxels.poking.pokes import Pokes
from palpate.sensors.taxels.poking.rigid_groups import across
from palpate.spatial._arrays import Value
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.surfaces.mesh import Mesh
from palpate.surfaces.surface import Surface

FLAT = 1e-9  # of the eigenvalues of a taxel's matrix: below it its lines of force are parallel
LEAST = 1e-6  # share of the largest eigenvalue that each direction has at least: parallel lines leave one without any
ROUNDS = 20  # of Newton's steps on a surface that is no mesh
REACHED = 1e-12  # m

Places = Float[np.ndarray, "k 3"]


@frozen_value
class NormalEquations(Value):
    """Normal equations A p = b of each taxel's place p.

    Attributes:
        matrix: (k, 3, 3) A, the sum of the weights times I - u u', u the direction of a force.
        vector: (k, 3) b [m].
        pressing: (k, 3) sum of the weights times u.
        weight: (k,) sum of the weights; 0: the taxel never answered.
    """

    matrix: Float[np.ndarray, "k 3 3"]
    vector: Float[np.ndarray, "k 3"]
    pressing: Float[np.ndarray, "k 3"]
    weight: Float[np.ndarray, " k"]


def in_link(pokes: Pokes) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Return forces (n, 3) [N], and torques (n, 3) [N m] about the link's origin, in its frame [taxel poking, (6)]."""
    force, torque = pokes.wrench[:, :3], pokes.wrench[:, 3:]
    moved = torque - np.cross(pokes.origin, force)
    turn = pokes.rotation
    return np.einsum("nij,ni->nj", turn, force), np.einsum("nij,ni->nj", turn, moved)


def normal_equations(pokes: Pokes, *, weighted: bool = False) -> NormalEquations:
    """Return the `NormalEquations` of pokes in the link's frame, times their weights [taxel poking, (5)].

    Args:
        pokes: of any configurations.
        weighted: also by the square of each response over the strongest one of its poke.
    """
    from palpate.sensors.taxels.poking._accumulate import accumulate  # compiled: loaded when first needed

    force, torque = in_link(pokes)
    weights = pokes.weight[pokes.poke]
    if weighted:
        strongest = np.zeros(len(pokes))
        np.maximum.at(strongest, pokes.poke, pokes.response)
        weights = weights * (pokes.response / strongest[pokes.poke]) ** 2
    sound = np.asarray(np.isfinite(pokes.wrench).all(axis=1), dtype=bool)
    weights = np.where(sound[pokes.poke], weights, 0.0)
    sums = np.zeros((pokes.taxels, 12))
    accumulate(np.nan_to_num(force), np.nan_to_num(torque), pokes.starts, pokes.taxel, weights, sums)
    matrix = sums[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    weight = np.bincount(pokes.taxel, weights, pokes.taxels)
    return NormalEquations(matrix, sums[:, 6:9].copy(), sums[:, 9:].copy(), weight)


def free(equations: NormalEquations) -> Places:
    """Return the point nearest to each taxel's lines of force, (k, 3) [m]; NaN if parallel or it never answered."""
    values = np.linalg.eigvalsh(equations.matrix)
    sound = values[:, 0] > FLAT * np.maximum(values[:, 2], 1e-300)
    found = np.full(equations.vector.shape, np.nan)
    found[sound] = np.linalg.solve(equations.matrix[sound], equations.vector[sound][..., None])[..., 0]
    return found


def on_surface(equations: NormalEquations, surface: Surface) -> Places:
    """Return the surface's points of least residual [taxel poking, II-B], (k, 3) [m]; NaN if a taxel never answered.

    The residual is (p - p*)' A (p - p*), p* the free points. Facets at which forces would pull are excluded, as lines
    of force also meet the far side of a link.
    """
    found = np.full(equations.vector.shape, np.nan)
    answered = np.flatnonzero(equations.weight > 0)
    if len(answered):
        found[answered] = nearest_in_metric(
            equations.matrix[answered], equations.vector[answered], equations.pressing[answered], surface
        )
    return found


@takes_arrays
def nearest_in_metric(
    matrix: Float[np.ndarray, "k 3 3"],
    vector: Float[np.ndarray, "k 3"],
    pressing: Float[np.ndarray, "k 3"],
    surface: Surface,
) -> Float[np.ndarray, "k 3"]:
    """Return the points of the surface with the least p' A p / 2 - b' p, (k, 3) [m]; NaN where forces press no facet.

    Args:
        matrix: (k, 3, 3) A, positive semidefinite.
        vector: (k, 3) b.
        pressing: (k, 3) mean direction of the forces; facets at which they would pull are ignored.
        surface: a mesh, for an exact answer, or another, on which it is refined from its drawing.

    Raises:
        InputError: arrays of other shapes.
        GeometryError: an implicit surface cannot be drawn.
    """
    from palpate.sensors.taxels.poking._closest_point import nearest

    values, axes = np.linalg.eigh(matrix)
    values = np.maximum(values, LEAST * values[:, -1:])
    raised: Float[np.ndarray, "k 3 3"] = np.einsum("kia,ka,kja->kij", axes, values, axes)
    centre = np.einsum("kij,kj->ki", np.linalg.inv(raised), vector)
    drawn = surface.drawn()
    facets = ~drawn.covered
    corners = np.ascontiguousarray(drawn.vertices[drawn.faces[facets]])
    middles = corners.mean(axis=1)
    radii = np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1)
    root = np.sqrt(values)[:, :, None] * np.swapaxes(axes, 1, 2)  # A = root' root
    found = np.full(centre.shape, np.nan)
    balls = np.column_stack([middles, radii, drawn.normals[facets]])
    nearest(centre, np.ascontiguousarray(root), np.sqrt(values[:, 0]), pressing, corners, balls, found)
    return found if isinstance(surface, Mesh) else _refined(raised, vector, surface, found)


def _refined(
    matrix: Float[np.ndarray, "k 3 3"],
    vector: Float[np.ndarray, "k 3"],
    surface: Surface,
    points: Float[np.ndarray, "k 3"],
) -> Float[np.ndarray, "k 3"]:
    for _ in range(ROUNDS):
        points, normals, _ = surface.project(points)
        tangents = across(normals)
        downhill = vector - np.einsum("kij,kj->ki", matrix, points)
        small: Float[np.ndarray, "k 2 2"] = np.einsum("kia,kij,kjb->kab", tangents, matrix, tangents)
        moved = np.einsum("kia,kab,kjb,kj->ki", tangents, np.linalg.inv(small), tangents, downhill)
        points = points + moved
        if np.abs(moved).max(initial=0.0) < REACHED:
            break
    return surface.project(points)[0]
