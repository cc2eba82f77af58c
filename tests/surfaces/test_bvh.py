"""The compiled search against its NumPy twin, which looks at every patch and asks numpy for the roots."""

import functools

import numpy as np
import pytest
from numba import njit

from palpate.contact import Locator
from palpate.surfaces import Mesh, _bvh, _patch
from palpate_lab.simulation.shapes import BumpySphere, EllipsoidBody
from tests.support.bodies import R, box, cylinder

MESHES = {
    "smooth ellipsoid": lambda: Mesh.from_arrays(*EllipsoidBody((R, 0.7 * R, 0.5 * R)).mesh(320)),
    "faceted ellipsoid": lambda: Mesh.from_arrays(*EllipsoidBody((R, 0.7 * R, 0.5 * R)).mesh(80), smooth=False),
    "smooth bumpy sphere": lambda: Mesh.from_arrays(*BumpySphere(R).mesh(320)),
    "faceted bumpy sphere": lambda: Mesh.from_arrays(*BumpySphere(R).mesh(80), smooth=False),
    "box": lambda: Mesh.from_arrays(*box()),
    "cylinder": lambda: Mesh.from_arrays(*cylinder()),
}


@pytest.fixture(scope="module", params=MESHES)
def mesh(request: pytest.FixtureRequest) -> Mesh:
    return MESHES[request.param]()


def random_wrench(rng: np.random.Generator, pitch: float) -> np.ndarray:
    """In the tree's unit size, through a random point of the body."""
    force, through = rng.normal(size=3), rng.uniform(-0.5, 0.5, 3)
    return np.concatenate([force, np.cross(through, force) + pitch * force])


def searched(wrench: np.ndarray, mesh: Mesh, soft: float = 1.0, limit: float = np.inf) -> np.ndarray:
    tree = mesh.tree()
    found = np.zeros((_bvh.CAPACITY + 1, _bvh.CANDIDATE))
    count = _bvh.search(wrench, soft, limit, tree.nodes, tree.corners, found)
    return found[:count, 8:14]


def search_reference(wrench: np.ndarray, pitch_used: float, tan_limit: float, corners: np.ndarray) -> np.ndarray:
    """The twin of `search`, over all patches and with numpy's polynomial roots.

    Returns:
        (k, 6) rows: patch, b0, b1, b2, tan(theta), height along f.
    """
    force, moment = wrench[:3], wrench[3:]
    size = np.linalg.norm(force)
    f, axis = force / size, np.cross(force, moment) / size**2
    pitch = pitch_used * (force @ moment) / size**2
    e1 = np.linalg.svd(f[None])[2][1]
    e2 = np.cross(f, e1)
    points, normals = np.split(corners[:, :18].reshape(-1, 3, 6), 2, axis=2)  # (patches, corners, 3)
    c = normals @ f
    across = np.cross(f, normals)
    u, v = (points - axis) @ e1, (points - axis) @ e2
    x, y = pitch * across @ e1, pitch * across @ e2
    d0, d1, d2 = np.cross(u, v), np.cross(u, y) + np.cross(x, v), np.cross(x, y)
    dot = functools.partial(np.einsum, "nk,nk->n")
    cubics = np.stack([-d0.sum(1), dot(c, d0) - d1.sum(1), dot(c, d1) - d2.sum(1), dot(c, d2)], axis=1)
    rows = []
    for patch in np.flatnonzero((c < 0).any(axis=1)):
        cubic = cubics[patch]
        scale = np.abs(cubic).max()
        if scale == 0:
            continue
        for w in np.roots(np.where(np.abs(cubic) < 1e-15 * scale, 0.0, cubic)):
            if abs(w.imag) > 1e-9 or w.real > -1e-12:
                continue
            weights = d2[patch] + w.real * (d1[patch] + w.real * d0[patch])
            if weights.sum() == 0:
                continue
            b = weights / weights.sum()
            normal = b @ normals[patch]
            cosine = -(f @ normal) / np.linalg.norm(normal)
            if b.min() < -1e-9 or cosine <= 0 or abs(b @ c[patch] - w.real) > 1e-6:
                continue
            tangent = np.sqrt(max(0.0, 1 - cosine**2)) / cosine
            if tangent <= tan_limit:
                rows.append([patch, *b, tangent, f @ (b @ points[patch])])
    return np.array(rows).reshape(-1, 6)


def placed(rows: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Position and unit normal of the oracle's rows."""
    both = np.einsum("ni,nik->nk", rows[:, 1:4], corners[rows[:, 0].astype(int), :18].reshape(-1, 3, 6))
    both[:, 3:] /= np.linalg.norm(both[:, 3:], axis=1, keepdims=True)
    return both


def unmatched(one: np.ndarray, two: np.ndarray, tolerance: float) -> int:
    """How many of `one` are not among `two`."""
    if not len(one):
        return 0
    if not len(two):
        return len(one)
    return int(np.sum(np.abs(one[:, None] - two[None]).max(axis=2).min(axis=1) > tolerance))


@pytest.mark.parametrize("pitch", [0.0, 0.05, 0.3, 1.0, 3.0])
def test_search_finds_what_the_oracle_finds(mesh: Mesh, pitch: float) -> None:
    """As sets, to 1e-6: numpy's roots of a cubic are good to 1e-8 where two are near each other.

    What grazes (tan(theta) > 100) is left out: there both are rounding.
    """
    rng, corners, limit, seen = np.random.default_rng(int(pitch * 100)), mesh.tree().corners, 100.0, 0
    for _ in range(6):
        wrench = random_wrench(rng, pitch)
        oracle = placed(search_reference(wrench, float(pitch > 0), limit, corners), corners)
        found = searched(wrench, mesh, limit=limit)
        assert unmatched(found, oracle, 1e-6) == 0
        if len(found) < _bvh.CAPACITY:
            assert unmatched(oracle, found, 1e-6) == 0
        seen += len(oracle)
    assert seen > 0


def test_the_wrench_axis_is_the_soft_finger_without_pitch(mesh: Mesh) -> None:
    rng = np.random.default_rng(9)
    for _ in range(50):
        wrench = random_wrench(rng, 0.0)
        twisted = wrench + np.concatenate([np.zeros(3), 0.7 * wrench[:3]])
        one, two = searched(twisted, mesh, soft=0.0), searched(wrench, mesh, soft=1.0)
        assert len(one) == len(two)
        assert unmatched(one, two, 1e-9) == 0


@pytest.mark.parametrize("limit", [0.3, 1.0, 3.0])
def test_a_limit_on_friction_leaves_out_what_is_beyond_and_nothing_else(mesh: Mesh, limit: float) -> None:
    rng = np.random.default_rng(10)
    for pitch in (0.05, 0.3, 1.0):
        for _ in range(50):
            wrench = random_wrench(rng, pitch)
            everything, some = searched(wrench, mesh), searched(wrench, mesh, limit=limit)
            if len(everything) == _bvh.CAPACITY:
                continue
            cosine = -everything[:, 3:] @ wrench[:3] / np.linalg.norm(wrench[:3])
            near = cosine > 1 / np.sqrt(1 + limit**2)
            assert len(some) == near.sum()
            assert unmatched(some, everything[near], 1e-9) == 0


@njit
def _roots(k0, k1, k2, k3):
    out = np.empty(3)
    return out[: _patch._roots(k0, k1, k2, k3, 0.0, 1.0, out)]


@pytest.mark.parametrize("roots", [(0.2, 0.5, 0.9), (0.1, 0.4, 2.0), (-1.0, 0.3, 3.0), (-1.0, 0.25, 0.75)])
def test_every_root_of_a_cubic_in_the_interval_is_found(roots: tuple[float, float, float]) -> None:
    k3, k2, k1, k0 = 3.0 * np.poly(roots)
    np.testing.assert_allclose(_roots(k0, k1, k2, k3), [root for root in roots if 0.0 < root < 1.0], atol=1e-9)


@pytest.mark.parametrize("share", [-0.3, 0.0, 0.2])
def test_a_contact_on_the_side_that_two_facets_share_is_one(share: float) -> None:
    """On the diagonal of a face of a box, with and without a shift."""
    mesh = Mesh.from_arrays(*box())
    x, y = 2 * R * share, 1.4 * R * share
    for diagonal in (y, -y):
        point, force = np.array([x, diagonal, R / 2]), np.array([0.2, 0.1, -1.0])
        for torque in (0.0, 1e-3):
            moment = np.cross(point, force) + torque * np.array([0.0, 0.0, 1.0])
            found = Locator(mesh).candidates(np.concatenate([force, moment]))
            at_point = np.linalg.norm(found.point - point, axis=1) < 1e-9
            assert np.count_nonzero(at_point) == 1
