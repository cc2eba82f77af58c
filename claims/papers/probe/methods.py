"""The methods side by side on the same presses: how far from the pressure's centre, and how long one call takes."""

import time
from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np

import palpate
from claims.papers.probe import assumed
from claims.papers.probe.draws import Draws
from claims.papers.probe.study import Case, Meshes
from claims.timings.peers import located
from palpate_lab.papers.iterative import PatchParaboloid, fit_paraboloid, locate_iteratively

METHODS = ("soft_finger", "soft_finger, flat facets", "iterative", "wrench_axis")
REGION = 6e-3  # m, what the paraboloid is fitted to
Answer = Callable[[np.ndarray, np.ndarray], np.ndarray]  # a wrench (6,) and the mark pressed (3,) to a point (3,)


@dataclass(frozen=True)
class Method:
    """What one method made of the same wrenches.

    Attributes:
        errors: (n,) [m] to the pressure's centre, all causes on, simplified mesh; NaN without an answer.
        clean: (n,) nothing wrong, fine mesh.
        twisted: (n,) nothing wrong, fine mesh, under a broad, soft pad that is twisted.
        times: (m, marks) [us] of single calls.
        refused: how many had no answer.
    """

    errors: np.ndarray
    clean: np.ndarray
    twisted: np.ndarray
    times: np.ndarray
    refused: int


def methods(
    meshes: Meshes, cases: list[Case], twisted: Case, draws: Draws, causes: Collection[str]
) -> dict[str, Method]:
    """Distance to the pressure's centre on the simplified mesh with all errors, and the time of one call."""
    found = {}
    alone = Draws(1, draws.seed)
    for name in METHODS:
        answer, exact = _answer(meshes, "simple", name), _answer(meshes, "fine", name)
        parts = [_asked(answer, some, draws, causes) for some in cases]
        clean = [_asked(exact, some, alone, ())[0] for some in cases]
        turned = _asked(exact, twisted, alone, ())[0]
        off, times = np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
        found[name] = Method(off, np.concatenate(clean), turned, times, int(np.sum(np.isnan(off))))
    return found


def _answer(meshes: Meshes, mesh: str, method: str) -> Answer:
    if method == "iterative":
        return _iterated(meshes.mesh(mesh))
    flat = ", flat" if "flat" in method else ""
    answer = located(meshes.locator(mesh + flat, method.partition(",")[0]))
    return lambda wrench, _mark: answer(wrench)


def _iterated(mesh: palpate.Mesh) -> Answer:
    """The paraboloid of a mark's region is fitted once, as the paper's equation of the contact region was."""
    fitted: dict[bytes, PatchParaboloid | None] = {}

    def answer(wrench: np.ndarray, mark: np.ndarray) -> np.ndarray:
        patch = fitted.get(mark.tobytes())
        if patch is None:
            patch = fitted[mark.tobytes()] = fit_paraboloid(mesh, mark, REGION)
        found = locate_iteratively(wrench, patch, mark)
        return found.point if found.converged and found.within else np.full(3, np.nan)

    return answer


def _asked(answer: Answer, some: Case, draws: Draws, causes: Collection[str]) -> tuple[np.ndarray, np.ndarray]:
    """Errors (n,) [m], NaN without an answer, and times [us] (repeats, marks), wrench by wrench."""
    size = np.random.default_rng([draws.seed, some.number]).uniform(
        *assumed.FORCE_SPAN, (draws.builds, len(some.marks), 3)
    )
    wrenches, centroids = some.at(size)
    sensed = draws.sensed(wrenches, causes, some.number)
    points, times = np.empty_like(centroids), np.empty(sensed.shape[:3])
    for index in np.ndindex(*sensed.shape[:3]):
        wrench, mark = sensed[index], some.marks[index[1]]
        if index[0] == index[2] == 0:
            answer(wrench, mark)  # caches warm, and the paraboloid fitted
        begin = time.perf_counter_ns()
        points[index] = answer(wrench, mark)
        times[index] = 1e-3 * (time.perf_counter_ns() - begin)
    off = np.linalg.norm(points - centroids, axis=-1).ravel()
    return off, np.moveaxis(times, 1, 2).reshape(-1, len(some.marks))
