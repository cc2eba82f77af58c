"""What is covered cannot be touched: real probes with inner shells, and made bodies inside each other.

Embree says what can be touched, not the code under test. On the probes it is a point whose ray along the normal leaves
the mesh, as in `probes`; on made bodies any point that one of `RAYS` rays over its hemisphere leaves, the deep inner
walls of a mug and of a gripper among them. Counted are touches at such points of whose plausible candidates, on all
facets, exactly one can be touched: which of several that can is another question.
"""

import time
from collections.abc import Iterator

import numpy as np
import trimesh

import palpate
from claims.evidence.probes import OFF, PROBES, Outside
from claims.row import Row, shared, skipped
from palpate_lab.simulation import BumpySphere, touch_wrenches

RAYS = 128
NOISE = np.array([2e-3, 2e-3, 2e-3, 2e-5, 2e-5, 2e-5])  # N, N m
NEAR = 0.5e-3  # m: an answer so near is the true point, with that noise
FINE = 3e-3  # m: sides of the made bodies' facets; a facet that is covered in part is kept whole
PITCH = 2e-3  # m


def rows(small: bool) -> Iterator[Row]:
    """The probes, made bodies, and what finding covered facets costs."""
    count = 300 if small else 3_000
    folder = shared()
    if folder is None:
        yield from skipped("three ultrasound probes", "")
    else:
        for probe in PROBES[:1] if small else PROBES:
            path = folder / f"data/probes/{probe}.stl"
            meshes = [palpate.Mesh.load(path, unit="mm", covered=covered) for covered in (False, True)]
            yield from _judge(probe.removeprefix("UsProbe_"), meshes, Outside(meshes[0]), count)
    for name, (vertices, faces) in list(made().items())[:: 2 if small else 1]:  # a shell within, and a deep wall
        meshes = [palpate.Mesh.from_arrays(vertices, faces, covered=covered) for covered in (False, True)]
        yield from _judge(name, meshes, _Seen(meshes[0]), count)
    yield _preparation(2_000 if small else 200_000, judged=not small)


def made() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Bodies [m] of several shells, or with walls deep inside that can be touched."""
    outer, inner = (trimesh.creation.icosphere(4, radius) for radius in (0.03, 0.025))
    boxes = [box((0.06, 0.03, 0.03)), box((0.03, 0.06, 0.02), (0.01, 0.0, 0.01)), box((0.02, 0.02, 0.02))]
    profile = np.array([(0, 0), (40, 0), (40, 90), (35, 90), (35, 6), (0, 6)]) * 1e-3
    gripper = [box((0.08, 0.02, 0.02)), *(box((0.015, 0.02, 0.06), (s * 0.0325, 0.0, 0.035)) for s in (-1, 1))]
    bodies = {
        "sphere in a sphere": [outer, inner],
        "boxes that overlap": boxes,
        "thick-walled mug": [trimesh.creation.revolve(profile, sections=64)],
        "U-shaped gripper of three boxes": gripper,
    }
    joined = {name: trimesh.util.concatenate(parts).subdivide_to_size(FINE) for name, parts in bodies.items()}
    return {name: (np.array(body.vertices), np.array(body.faces)) for name, body in joined.items()}


def box(sides: tuple[float, float, float], middle: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> trimesh.Trimesh:
    return trimesh.creation.box(sides, trimesh.transformations.translation_matrix(middle))


class _Seen(Outside):
    """Which points are seen from outside at all."""

    def __call__(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        seen = np.zeros(len(points), dtype=bool)
        for direction in np.random.default_rng(5).normal(size=(RAYS, 3)):
            unit = direction / np.linalg.norm(direction)
            side = np.einsum("nk,k->n", normals, unit)
            rays = np.where(side[:, None] < 0, -unit, unit)
            seen |= ~self.caster.intersects_any((points + OFF * normals) * 1e3, rays)
        return seen


def _judge(name: str, meshes: list[palpate.Mesh], outside: Outside, count: int) -> Iterator[Row]:
    mesh, whole = meshes
    rng = np.random.default_rng(41)
    facets = rng.choice(len(mesh.faces), 4 * count, p=mesh.areas / mesh.areas.sum())
    weights = rng.dirichlet(np.ones(3), 4 * count)
    points = np.einsum("ni,nik->nk", weights, mesh.vertices[mesh.faces[facets]])
    free = np.flatnonzero(outside(points, mesh.normals[facets]))[:count]
    points, facets, weights = points[free], facets[free], weights[free]
    normals = np.einsum("ni,nik->nk", weights, mesh.corner_normals[facets])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    wrenches = touch_wrenches(points, normals, rng, pitch=PITCH)
    alone = _alone(palpate.Locator(whole), wrenches, outside)
    noisy = wrenches + rng.normal(size=wrenches.shape) * NOISE
    shares = []
    for one in (mesh, whole):
        found = palpate.Locator(one, noise=NOISE).run(noisy[alone], sequential=False)
        shares.append(np.mean(found.status == palpate.Status.AMBIGUOUS))
        if one is mesh:
            right = np.mean(found.answered & (np.linalg.norm(found.point - points[alone], axis=1) <= NEAR))
    got = f"{shares[0]:.2%} ({shares[1]:.1%} with all facets); {mesh.coverage or 'no facet'} covered"
    what = f"{name}: ambiguous, of {alone.mean():.0%} of the touches that have one plausible candidate to be touched"
    yield Row(what, "<= 2 %", got, shares[0] <= 0.02)
    yield Row(f"{name}: true point first", ">= 99 %", f"{right:.2%}", right >= 0.99)


def _alone(locator: palpate.Locator, wrenches: np.ndarray, outside: Outside) -> np.ndarray:
    """Which wrenches have exactly one plausible candidate that can be touched."""
    each = [locator.candidates(wrench) for wrench in wrenches]
    number = np.repeat(np.arange(len(each)), [np.count_nonzero(one.plausible) for one in each])
    points, normals = (
        np.concatenate([getattr(one, name)[one.plausible] for one in each]) for name in ("point", "normal")
    )
    return np.bincount(number, outside(points, normals), len(each)) == 1


def _preparation(facets: int, judged: bool) -> Row:
    """Loading and the tree, with and without the search for covered facets, one after the other."""
    vertices, faces = BumpySphere(0.01).mesh(facets)
    seconds = []
    for covered in (True, False, True, False):  # the first two compile
        start = time.perf_counter()
        palpate.Mesh.from_arrays(vertices, faces, covered=covered).tree()
        seconds.append(time.perf_counter() - start)
    ratio = seconds[3] / seconds[2]
    got = f"{ratio:.2f} x ({seconds[3]:.2f} s, {seconds[2]:.2f} s without)"
    what = f"preparation of {len(faces):,} facets, by what it takes without"
    return Row(what, "<= 2 x", got, ratio <= 2.0 if judged else None)
