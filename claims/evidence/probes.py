"""Real meshes: touches at the outside of three ultrasound probes, located on the meshes as they come.

Points are uniform in area on facets; *outer* are those whose ray along the normal hits nothing (embree, millimetres);
a few of them are seen through a gap where nothing can touch, and are missed on purpose (`Mesh.covered`).
Faceted, the truth is the facet's own point and normal, exactly. With the default crease the truth must not be the model
that is judged (linear positions, linear normals): each facet is curved into a PN triangle (Vlachos et al. 2001), a
cubic patch that takes the corners' positions and normals, and the touch is at a point of that. Its normal is taken
twice: as the quadratic one that belongs to a PN triangle (continuous from facet to facet), and as the cubic's own
geometric one, which is not continuous and swings by 30 degrees and more on slivers and coarse fillets: the severer of
the two. The mesh differs from the truth by its chord error; an answer within `NEAR` of the truth counts as it.
"""

from collections.abc import Iterator
from itertools import product
from math import radians

import numpy as np
import trimesh

import palpate
from claims.evidence.bodies import on_facets
from claims.row import Row, shared, skipped
from palpate.surfaces._normals import half_edge_twins
from palpate_lab.simulation import touch_wrenches

PROBES = ("UsProbe_SPL40", "UsProbe_Ultrasonix_C5-2_60", "UsProbe_Ultrasonix_L14-5_38")
QUADRATIC, GEOMETRIC = "crease 30, PN truth", "crease 30, PN truth with geometric normals"
KINDS = {"faceted": 0.0, QUADRATIC: 30.0, GEOMETRIC: 30.0}  # degrees of crease
PITCH = 2e-3  # m
EXACT, NEAR = 1e-6, 0.5e-3  # m: what counts as the truth, faceted and smooth
OFF = 1e-5  # m: where a ray starts, off the surface
SEAM = 0.2e-3  # m from an edge that has no single neighbour


def rows(small: bool) -> Iterator[Row]:
    folder = shared()
    if folder is None:
        yield from skipped("three ultrasound probes", "")
        return
    count = 1_000 if small else 10_000
    for probe, (kind, crease) in product(PROBES[:: 2 if small else 1], KINDS.items()):
        mesh = palpate.Mesh.load(folder / f"data/probes/{probe}.stl", unit="mm", crease=radians(crease))
        yield from _judge(probe.removeprefix("UsProbe_"), mesh, kind, count)


def _judge(probe: str, mesh: palpate.Mesh, kind: str, count: int) -> Iterator[Row]:
    rng = np.random.default_rng(37)
    outside = Outside(mesh)
    points, normals, facets = _touched(mesh, outside, kind, count, rng)
    wrenches = touch_wrenches(points, normals, rng, pitch=PITCH)
    limit = EXACT if mesh.crease == 0 else NEAR
    locator = palpate.Locator(mesh)
    found = locator.run(wrenches, sequential=False)
    error = np.where(found.answered, np.linalg.norm(found.point - points, axis=1), np.inf)
    first = error <= limit
    among = first.copy()
    for i in np.flatnonzero(~first):
        candidates = locator.candidates(wrenches[i])
        among[i] = np.any(np.linalg.norm(candidates.point - points[i], axis=1) <= limit)
    what = f"{probe}, {kind}, {len(mesh.faces):,} facets: true point among the candidates"
    got = f"{among.mean():.2%} (within {limit * 1e6:g} um)"
    if mesh.crease > 0:
        shift = np.linalg.norm(points - _flat(mesh, points, facets), axis=1)
        got += f"; median error {1e6 * np.median(error):.0f} um"
        got += f", truth off the mesh by {1e6 * np.percentile(shift, 99):.0f} um (99 %)"
    yield Row(what, ">= 99 %", got, among.mean() >= 0.99)
    got = f"{first.mean():.2%}"
    if not first.all():
        rest = _causes(mesh, outside, points, mesh.covered[facets], found, among, first)
        got += "; the rest: " + ", ".join(f"{cause} {share:.2%}" for cause, share in rest.items() if share)
    yield Row(f"{probe}, {kind}: true point is the first", ">= 90 %", got, first.mean() >= 0.9)


class Outside:
    """Which points can be touched from outside, in millimetres: at metre scale ray casters miss."""

    def __init__(self, mesh: palpate.Mesh) -> None:
        self.caster = trimesh.Trimesh(mesh.vertices * 1e3, mesh.faces, process=False).ray

    def __call__(self, points: np.ndarray, normals: np.ndarray, ways: np.ndarray | None = None) -> np.ndarray:
        """Whether rays along the normals, or other ways, meet nothing."""
        return ~self.caster.intersects_any((points + OFF * normals) * 1e3, normals if ways is None else ways)


def _touched(
    mesh: palpate.Mesh, outside: Outside, kind: str, count: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Outer points, normals and facets, uniform in the outside's area."""
    kept: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    while sum(len(part[0]) for part in kept) < count:
        facets, weights = on_facets(mesh, 2 * count, rng)
        flat = np.einsum("ni,nik->nk", weights, mesh.vertices[mesh.faces[facets]])
        free = outside(flat, mesh.normals[facets])
        facets, weights = facets[free], weights[free]
        if mesh.crease == 0:
            points, normals = flat[free], mesh.normals[facets]
        else:
            points, normals = _curved(mesh, facets, weights, geometric=kind == GEOMETRIC)
        kept.append((points, normals, facets))
    points, normals, facets = (np.concatenate(part)[:count] for part in zip(*kept, strict=True))
    return points, normals, facets


def _curved(
    mesh: palpate.Mesh, facets: np.ndarray, weights: np.ndarray, geometric: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals of the PN triangles over the corners' positions and normals."""
    corner, normal = mesh.vertices[mesh.faces[facets]], mesh.corner_normals[facets]
    points = _pn(corner, normal, weights)
    if not geometric:
        return points, _pn_normals(corner, normal, weights)
    sides = []
    for turn in (np.array([-1, 1, 0]), np.array([-1, 0, 1])):
        ahead, behind = (_pn(corner, normal, weights + sign * 1e-5 * turn) for sign in (1, -1))
        sides.append(ahead - behind)
    across = np.cross(*sides)
    return points, across / np.linalg.norm(across, axis=1, keepdims=True)


def _pn_normals(p: np.ndarray, n: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The quadratic of Vlachos et al. 2001: midway along an edge, the mean normal mirrored in its middle plane."""
    out = sum(b[:, i, None] ** 2 * n[:, i] for i in range(3))
    for i, j in ((0, 1), (1, 2), (2, 0)):
        edge, both = p[:, j] - p[:, i], n[:, i] + n[:, j]
        share = 2 * np.einsum("nk,nk->n", edge, both) / np.einsum("nk,nk->n", edge, edge)
        middle = both - share[:, None] * edge
        out = out + (b[:, i] * b[:, j])[:, None] * middle / np.linalg.norm(middle, axis=1, keepdims=True)
    return out / np.linalg.norm(out, axis=1, keepdims=True)


def _pn(p: np.ndarray, n: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The cubic of Vlachos et al. 2001: control points on each edge lie in the tangent planes of its ends."""
    out = sum(b[:, i, None] ** 3 * p[:, i] for i in range(3))
    edges = []
    for i, j in ((0, 1), (1, 0), (1, 2), (2, 1), (2, 0), (0, 2)):
        height = np.einsum("nk,nk->n", p[:, j] - p[:, i], n[:, i])[:, None]
        control = (2 * p[:, i] + p[:, j] - height * n[:, i]) / 3
        edges.append(control)
        out = out + 3 * b[:, i, None] ** 2 * b[:, j, None] * control
    middle = sum(edges) / 6
    middle = middle + (middle - p.mean(axis=1)) / 2
    return out + 6 * np.prod(b, axis=1)[:, None] * middle


def _flat(mesh: palpate.Mesh, points: np.ndarray, facets: np.ndarray) -> np.ndarray:
    normal = mesh.normals[facets]
    height = np.einsum("nk,nk->n", points - mesh.vertices[mesh.faces[facets, 0]], normal)
    return points - height[:, None] * normal


def _causes(
    mesh: palpate.Mesh,
    outside: Outside,
    points: np.ndarray,
    covered: np.ndarray,
    found: palpate.ContactEstimate,
    among: np.ndarray,
    first: np.ndarray,
) -> dict[str, float]:
    """Why the first was not the truth, as shares of all touches; each touch has one cause, the first that fits."""
    exposed, by_seam, there = (
        np.zeros(len(points), dtype=bool),
        np.zeros(len(points), dtype=bool),
        ~first & found.answered,
    )
    exposed[there] = outside(found.point[there], found.normal[there])
    by_seam[~first] = _near_open_edges(mesh, points[~first])
    left, shares = ~first, dict[str, float]()
    for cause, fits in {
        "covered facet (a ray leaves through a gap, no ball comes in)": covered & ~among,
        "inner shell (what came first is covered)": found.answered & among & ~exposed,
        "seam (truth by an open edge)": found.answered & ~among & by_seam,
        "not answered": ~found.answered,
        "lost (truth is no candidate)": ~among,
        "concave place (another exposed point came first)": exposed,
    }.items():
        shares[cause] = float(np.mean(left & fits))
        left &= ~fits
    return shares


def _near_open_edges(mesh: palpate.Mesh, points: np.ndarray) -> np.ndarray:
    """Does a point lie within `SEAM` of an edge without a single neighbour?"""
    loose = np.flatnonzero(half_edge_twins(mesh.faces) < 0)
    if not len(loose):
        return np.zeros(len(points), dtype=bool)
    start = mesh.vertices[mesh.faces.reshape(-1)[loose]]
    along = mesh.vertices[np.roll(mesh.faces, -1, axis=1).reshape(-1)[loose]] - start
    length = np.einsum("ek,ek->e", along, along)
    near = np.empty(len(points), dtype=bool)
    for k, point in enumerate(points):
        share = np.clip(np.einsum("ek,ek->e", point - start, along) / length, 0, 1)[:, None]
        near[k] = np.linalg.norm(start + share * along - point, axis=1).min() <= SEAM
    return near
