"""The elastic body of a barrel of silicone: its mesh, its stiffness and the compliance of its two surfaces.

Linear three-dimensional elasticity on quadratic bricks of 27 nodes, one through the thickness; mesh, mapping and shape
functions are scikit-fem's. Only the half above the equator is built: loads are symmetric about it, so no node of the
equator moves along the axis. The far end is clamped.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve

from palpate.errors import not_loaded

FULL_ROWS = (0.0, 0.004, 0.008, 0.012, 0.016, 0.022, 0.029, 0.037, 0.045)
COARSE_ROWS = (0.0, 0.006, 0.016, 0.029, 0.045)

Carried = tuple[np.ndarray, np.ndarray, np.ndarray]  # freedoms, their parts of the borders, which borders

SECTOR = 4  # bricks around the ring that are condensed together: 24 sectors of 96, the fewest operations in all


@dataclass(frozen=True)
class BarrelSettings:
    """Shape and material of a barrel.

    Attributes:
        radius, end_radius: outer radius [m] at the equator and at the ends; a parabola between.
        thickness: mean thickness of the wall [m].
        uneven: relative first harmonic and relative higher harmonics (2 to 5) of the thickness around the ring.
        modulus: Young's modulus [Pa].
        poisson: Poisson's ratio.
        around: number of bricks around the ring, a multiple of 4.
        rows: edges of the bricks [m] from the equator to the clamped end.
        band: height [m] above the equator up to which bodies can touch; one of `rows`.
        markers: number of markers in each ring, evenly spaced from angle 0.
        rings: heights [m] of the rings of markers above the equator, ring by ring; below `rows`' clamped end.
        marker_radius: radius of a marker [m].
        outline: number of points on a marker's outline.
        seed: seed of the uneven thickness.
    """

    radius: float = 0.055
    end_radius: float = 0.047
    thickness: float = 0.004
    uneven: tuple[float, float] = (0.04, 0.02)
    modulus: float = 0.3e6
    poisson: float = 0.45
    around: int = 96
    rows: tuple[float, ...] = FULL_ROWS
    band: float = 0.016
    markers: int = 24
    rings: tuple[float, ...] = (0.0,)
    marker_radius: float = 0.0015
    outline: int = 12
    seed: int = 0

    def outer(self, z: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Return the outer radius [m] at heights [m]."""
        return self.radius - (self.radius - self.end_radius) * (z / self.rows[-1]) ** 2

    def thickness_at(self, angle: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Return the thickness [m] at angles [rad]."""
        rng = np.random.default_rng(self.seed)
        phase = rng.uniform(0.0, 2.0 * np.pi, 5)
        share = rng.standard_normal(4)
        share /= np.linalg.norm(share)
        order = np.arange(2, 6)
        higher = np.cos(order * (np.asarray(angle)[..., None] - phase[1:])) @ share
        return self.thickness * (1.0 + self.uneven[0] * np.cos(angle - phase[0]) + self.uneven[1] * higher)


@dataclass(frozen=True, eq=False)
class Solid:
    """A meshed half barrel.

    Attributes:
        node: (around, rows, 3) number of each node: around the ring, along the axis, from the inner to the outer side.
        place: (nodes, 3) [m] positions of the nodes at rest.
        stiffness: (3 nodes, 3 nodes) [N/m], before any support; freedom 3 i + a is node i along axis a.
    """

    node: Int[np.ndarray, "around rows 3"]
    place: Float[np.ndarray, "nodes 3"]
    stiffness: sparse.csr_matrix


def _skfem() -> Any:
    try:
        return import_module("skfem")
    except ImportError as problem:
        raise not_loaded(
            problem, "the barrel's elasticity needs scikit-fem", "simulation", where="marker ring"
        ) from problem


def solid(settings: BarrelSettings) -> Solid:
    """Build the finite-element mesh of the half barrel, and its stiffness.

    Returns:
        a `Solid`: numbers of the nodes, their positions (nodes, 3) [m], and the sparse stiffness matrix (3 nodes, 3
        nodes) [N/m].

    Raises:
        InputError: scikit-fem is not installed.
    """
    fem = _skfem()
    around, edges = settings.around, np.asarray(settings.rows)
    angle = np.linspace(0.0, 2.0 * np.pi, around + 1)
    box = fem.MeshHex.init_tensor(np.array([1.0, 2.0]), angle, edges)
    side, turn, z = box.p
    turn = np.where(turn > 2.0 * np.pi - 1e-9, 0.0, turn)
    kept, merged = np.unique(np.round(np.stack([side, turn, z]), 9), axis=1, return_inverse=True)
    prism = fem.MeshHex(
        np.stack([kept[0] * np.cos(kept[1]), kept[0] * np.sin(kept[1]), kept[2]]), merged.ravel()[box.t]
    )
    flat = fem.MeshHex2.from_mesh(prism)
    x, y, z = flat.doflocs
    # the middles of edges lie on chords of the prism: told apart by their angle, and put back on the curves
    column = np.rint(np.arctan2(y, x) / (np.pi / around)).astype(int) % (2 * around)
    layer = np.rint(2.0 * (np.hypot(x, y) - 1.0)).astype(int)
    levels: Float[np.ndarray, " r"] = np.unique(np.round(np.asarray(z), 9))
    row = np.abs(z[:, None] - levels).argmin(axis=1)
    node = np.full((2 * around, len(levels), 3), -1)
    node[column, row, layer] = np.arange(len(x))
    theta = column * np.pi / around
    radius = settings.outer(z) - (1.0 - 0.5 * layer) * settings.thickness_at(theta)
    place = np.stack([radius * np.cos(theta), radius * np.sin(theta), z])
    mesh = replace(flat, doflocs=place)
    return Solid(node, place.T.copy(), stiffness_matrix(mesh, settings.modulus, settings.poisson))


def stiffness_matrix(mesh: Any, modulus: float, poisson: float) -> sparse.csr_matrix:
    """Assemble the stiffness of an isotropic body, sparse, (3 nodes, 3 nodes) [N/m], by 3 x 3 x 3 points a brick.

    K_iajb = integral of lambda g_ia g_jb + mu (g_ib g_ja + delta_ab g_ic g_jc), g the gradients of the shape functions.

    Args:
        mesh: scikit-fem's mesh of quadratic bricks.
        modulus: Young's modulus [Pa].
        poisson: Poisson's ratio, below 0.5.

    Raises:
        InputError: scikit-fem is not installed.
    """
    fem = _skfem()
    basis = fem.Basis(mesh, fem.ElementHex2(), intorder=5)
    lame = modulus * poisson / ((1 + poisson) * (1 - 2 * poisson))
    shear = modulus / (2 * (1 + poisson))
    gradient = np.stack([each[0].grad for each in basis.basis])  # 27, 3, bricks, points
    count, bricks = gradient.shape[0], gradient.shape[2]
    flat = gradient.transpose(2, 0, 1, 3).reshape(bricks, 3 * count, -1)
    outer = ((flat * basis.dx[:, None]) @ flat.transpose(0, 2, 1)).reshape(bricks, count, 3, count, 3)
    blocks = lame * outer + shear * outer.transpose(0, 1, 4, 3, 2)
    trace = shear * np.einsum("eiaja->eij", outer)
    for axis in range(3):
        blocks[:, :, axis, :, axis] += trace
    freedom = (3 * basis.element_dofs.T[:, :, None] + np.arange(3)).reshape(bricks, 3 * count)
    rows = np.repeat(freedom, 3 * count, axis=1).ravel()
    columns = np.tile(freedom, (1, 3 * count)).ravel()
    size = 3 * basis.N
    return sparse.csr_matrix((blocks.ravel(), (rows, columns)), shape=(size, size))


def _supported(body: Solid) -> Int[np.ndarray, " s"]:
    """Return the freedoms fixed at zero: all of the clamped end's, and the equator's along the axis."""
    end = (3 * body.node[:, -1].ravel()[:, None] + np.arange(3)).ravel()
    return np.concatenate([end, 3 * body.node[:, 0].ravel() + 2])


def compliance(body: Solid, answered: Int[np.ndarray, " a"], loaded: Int[np.ndarray, " l"]) -> Float[np.ndarray, "a l"]:
    """Compute the movements of some freedoms by unit forces on others, (answered, loaded) [m/N].

    Sectors of the ring are condensed onto the planes between them, so that all the work is in dense blocks: with
    T = -K_II^-1 K_IB and S = sum over sectors of K_BB + K_BI T, u = T S^-1 T' f + K_II^-1 f.

    Args:
        body: the mesh.
        answered: freedoms whose movement is wanted.
        loaded: freedoms on which forces act.
    """
    free = np.ones(body.stiffness.shape[0], dtype=bool)
    free[_supported(body)] = False
    starts = np.arange(0, len(body.node), 2 * SECTOR)
    plane = [_freedoms(body.node[[at]], free) for at in starts]
    borders = np.concatenate(plane)
    number = np.full(len(free), -1)
    number[borders] = np.arange(len(borders))
    schur = body.stiffness[borders][:, borders].toarray()
    answers: list[Carried] = []
    loads: list[Carried] = []
    local: list[np.ndarray] = []
    for at, start in enumerate(starts):
        inside = _freedoms(body.node[start + 1 : start + 2 * SECTOR], free)
        near = np.concatenate([plane[at], plane[(at + 1) % len(plane)]])
        coupling = body.stiffness[inside][:, near].toarray()
        factor = cho_factor(body.stiffness[inside][:, inside].toarray(), check_finite=False)
        carried: Float[np.ndarray, "i b"] = -cho_solve(factor, coupling, check_finite=False)
        where = number[near]
        schur[np.ix_(where, where)] += coupling.T @ carried
        owned = np.concatenate([inside, plane[at]])
        spread: Float[np.ndarray, "o b"] = np.concatenate([np.asarray(carried), np.eye(len(plane[at]), len(near))])
        index = np.full(len(free), -1)
        index[owned] = np.arange(len(owned))
        a, b = np.flatnonzero(index[answered] >= 0), np.flatnonzero(index[loaded] >= 0)
        answers.append((a, spread[index[answered[a]]], where))
        loads.append((b, spread[index[loaded[b]]], where))
        local.append(_inside(factor, len(inside), index[answered[a]], index[loaded[b]]))
    return _spread(schur, answers, loads, local, (len(answered), len(loaded)))


def _freedoms(nodes: Int[np.ndarray, "..."], free: np.ndarray) -> Int[np.ndarray, " f"]:
    """Return the freedoms of nodes that are not supported."""
    every = (3 * nodes.ravel()[:, None] + np.arange(3)).ravel()
    return every[free[every]]


def _inside(factor: Any, size: int, answered: np.ndarray, loaded: np.ndarray) -> np.ndarray:
    """Compute the movements inside one sector with fixed borders."""
    unit = np.zeros((size, len(loaded)))
    inner = np.flatnonzero(loaded < size)
    unit[loaded[inner], inner] = 1.0
    moved = np.zeros((size + 1, len(loaded)))
    moved[:size] = cho_solve(factor, unit, check_finite=False)
    return moved[np.minimum(answered, size)]


def _spread(
    schur: np.ndarray,
    answers: list[Carried],
    loads: list[Carried],
    local: list[np.ndarray],
    shape: tuple[int, int],
) -> np.ndarray:
    """Assemble the compliance of all freedoms from the borders' and each sector's own."""
    borders = cho_solve(cho_factor(schur, check_finite=False), np.eye(len(schur)), check_finite=False)
    total = np.zeros(shape)
    for column, (b, carry, near) in enumerate(loads):
        reached = borders[:, near] @ carry.T
        for row, (a, spread, where) in enumerate(answers):
            block = spread @ reached[where]
            total[np.ix_(a, b)] = block + local[row] if row == column else block
    return total
