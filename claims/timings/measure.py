"""Every variant on one mesh, in turns, so that a busy moment of the machine falls on all of them alike."""

import gc
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit

import palpate
from claims.clock import in_turns
from claims.evidence.bodies import touched
from claims.timings import rivals
from palpate.contact.locate import in_space
from palpate.surfaces import _bvh, _patches
from palpate.surfaces._patches import FLAT as FACET
from palpate.surfaces._patches import patch_rows
from palpate.surfaces._tree import Tree, build_tree
from palpate_lab.simulation import BumpySphere

R = 0.010  # m
NOISE = [0.02] * 3 + [0.001] * 3
ROUNDS = 5
FACETS = "flat kernel, facets only, h/R 0.05"
FLAT, FULL = "flat kernel, h/R 0.05", "full answer, h/R 0.3"
BEGINNER = "palpate.locate(list, mesh), h/R 0.3"


@njit(cache=True, nogil=True)
def _search_many(wrenches, soft, tan_limit, nodes, corners, found):
    total, room = 0, _bvh.room()
    for i in range(len(wrenches)):
        total += _bvh.search_in(wrenches[i], soft, tan_limit, nodes, corners, found, room)
    return total


def touches(count: int, ratio: float, seed: int = 1) -> np.ndarray:
    """Wrenches of touches on the analytic bumpy sphere, tan(theta) to 0.5."""
    body, rng = BumpySphere(R), np.random.default_rng(seed)
    return touched(body, count, rng, pitch=ratio * R)[1]


class Meshes:
    """The two meshes of a size, faceted and smooth, their locator, and wrenches in the units each takes."""

    def __init__(self, facets: int) -> None:
        vertices, faces = BumpySphere(R).mesh(facets)
        self.flat = palpate.Mesh.from_arrays(vertices, faces, smooth=False)
        self.smooth = palpate.Mesh.from_arrays(vertices, faces)
        self.tree = self.flat.tree()
        self.facets = _facets_only(self.flat)
        self.locator = palpate.Locator(self.smooth, noise=NOISE, on=0.5, off=0.3)

    def inside(self, wrenches: np.ndarray) -> np.ndarray:
        """About the tree's centre, in its unit size: what the flat kernel takes."""
        force, moment = wrenches[:, :3], wrenches[:, 3:]
        return np.concatenate([force, (moment - np.cross(self.tree.centre, force)) / self.tree.scale], axis=1)


def _facets_only(mesh: palpate.Mesh) -> Tree:
    """A tree without the vertices' fans: what the NumPy forms and embree see, a quarter of the patches."""
    corners = np.concatenate([mesh.vertices[mesh.faces], mesh.corner_normals], axis=2)
    return build_tree(patch_rows(corners, FACET, np.arange(len(corners))))


Variant = tuple[Callable[..., Any], np.ndarray, tuple[object, ...]]  # what is called, first arguments, the others


def singles(meshes: Meshes, queries: int, budget: float) -> dict[str, np.ndarray]:
    """Return the times [us] of the calls; `budget` [s] bounds a slow variant's share of a round."""
    facets = len(meshes.flat.faces)
    slight, steep = touches(queries, 0.05), touches(queries, 0.3, seed=2)
    unit, tree, out = meshes.inside(slight), meshes.tree, meshes.locator.empty()
    found = np.empty((_bvh.CAPACITY + 1, _bvh.CANDIDATE))
    bare = meshes.facets
    calls: dict[str, Variant] = {
        FLAT: (_bvh.search, unit, (1.0, 1.0, tree.nodes, tree.corners, found)),
        FACETS: (_bvh.search, unit, (1.0, 1.0, bare.nodes, bare.corners, found)),
        FULL: (meshes.locator, steep, (out,)),
        BEGINNER: (_as_list(meshes.smooth), steep, ()),
        "NumPy, three products a facet": (rivals.reciprocal_products(meshes.flat), slight, ()),
        "NumPy, closed form": (rivals.closed_form(meshes.flat), slight, ()),
    }
    if facets <= 25_000:
        calls["4 x 4 solves, batched"] = (rivals.batched_solve(meshes.flat), slight, ())
    if facets <= 2_500:
        calls["4 x 4 solves in a loop (the paper)"] = (rivals.loop_of_solves(meshes.flat), slight, ())
    _agree(calls, meshes, found)
    cast = rivals.embree_scene(meshes.flat, query="INTERSECT")
    if cast is not None:
        rays = np.stack(_rays(slight))  # (2, n, 3)
        rays = rays.transpose(1, 0, 2)[:, :, None].copy()
        calls["embreex, one ray, zero pitch"] = (lambda ray: cast(ray[0], ray[1]), rays, ())
    times = {name: list[float]() for name in calls}
    for turn in range(ROUNDS):
        for name, (call, arguments, rest) in calls.items():
            _time(call, np.roll(arguments, -turn * 7, axis=0), rest, budget, times[name])
    return {name: np.array(each) for name, each in times.items()}


def _as_list(mesh: palpate.Mesh) -> Callable[[np.ndarray], palpate.ContactEstimate]:
    """The call that a beginner writes; making the list of six numbers is timed with it."""
    return lambda wrench: palpate.locate(wrench.tolist(), mesh)


def _time(
    call: Callable[..., object], arguments: np.ndarray, rest: tuple[object, ...], budget: float, times: list[float]
) -> None:
    """Each call by the clock; the clock itself takes about 0.05 us, which stays in."""
    ready = list(arguments)
    call(ready[0], *rest)
    gc.disable()
    end = time.perf_counter() + budget
    for argument in ready:
        begin = time.perf_counter_ns()
        call(argument, *rest)
        after = time.perf_counter_ns()
        times.append((after - begin) * 1e-3)
        if after * 1e-9 > end:
            break
    gc.enable()


def _agree(calls: dict[str, Variant], meshes: Meshes, found: np.ndarray) -> None:
    """All forms must name the same facets, or the comparison is of different things."""
    search, unit, rest = calls[FLAT]
    for i in range(20):
        count = int(search(unit[i], *rest))
        rows = found[:count]
        patches = rows[rows[:, 6] == 0, 0].astype(int)
        ours = set(meshes.tree.corners[patches, _patches.FACET].astype(int).tolist())
        for name, (call, wrenches, _) in calls.items():
            if name not in (FLAT, FACETS, FULL, BEGINNER) and not ours <= set(call(wrenches[i]).tolist()):
                raise RuntimeError(f"{name} and the kernel disagree on wrench {i}")


def _rays(wrenches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The wrench axes as rays from outside, in millimetres; their pitch is left out."""
    force, moment = wrenches[:, :3], wrenches[:, 3:]
    along = force / np.linalg.norm(force, axis=1, keepdims=True)
    origin = np.cross(force, moment) / np.einsum("nk,nk->n", force, force)[:, None] - 3 * R * along
    return np.ascontiguousarray(origin * 1e3, np.float32), np.ascontiguousarray(along, np.float32)


def batches(meshes: Meshes, count: int) -> dict[str, float]:
    """Return the rates [1/s] of many queries in one compiled call, one thread: the median of the rounds."""
    level, slight, steep = touches(count, 0.0), touches(count, 0.05), touches(count, 0.3, seed=2)
    tree, found = meshes.tree, np.empty((_bvh.CAPACITY + 1, _bvh.CANDIDATE))
    parts = (tree.nodes, tree.corners, found)
    bare = (meshes.facets.nodes, meshes.facets.corners, found)
    unit_level, unit_slight = meshes.inside(level), meshes.inside(slight)
    calls: dict[str, Callable[[], object]] = {
        "flat, h = 0": lambda: _search_many(unit_level, 1.0, 1.0, *parts),
        "flat, h/R 0.05": lambda: _search_many(unit_slight, 1.0, 1.0, *parts),
        "flat, facets only, h = 0": lambda: _search_many(unit_level, 1.0, 1.0, *bare),
        "flat, facets only, h = 0, sorted": lambda: _search_many(
            unit_level[in_space(level, meshes.tree.centre, meshes.tree.scale)], 1.0, 1.0, *bare
        ),
        "full, h/R 0.3": lambda: meshes.locator.run(steep, sequential=False),
    }
    cast = rivals.embree_scene(meshes.flat, query="INTERSECT")
    if cast is not None:
        rays = _rays(level)
        calls["embreex, h = 0"] = lambda: cast(*rays)
    return {name: count / float(np.median(took)) for name, took in in_turns(calls, ROUNDS).items()}


def short(value: float) -> str:
    steps = ((100.0, ",.0f"), (10.0, ".1f"), (0.1, ".2f"), (0.0, ".1e"))
    return format(value, next((form for least, form in steps if value >= least), ".2f"))
