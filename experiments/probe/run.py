"""Everything that the page says, measured: `measure` runs it all, small in seconds."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace

import numpy as np

import palpate
from experiments.probe import assumed
from experiments.probe.draws import CAUSES, Draws
from experiments.probe.shapes import PROBES
from experiments.probe.study import ANGLES, Case, Errors, Meshes, Size, calibrated, case, errors, noise_over_bound
from palpate.contact.iterative import PatchParaboloid, fit_paraboloid, locate_iteratively

__all__ = [
    "ALL",
    "CALIBRATED",
    "FORCES",
    "MARK_3",
    "METHODS",
    "READINGS",
    "TIPS",
    "TWIST",
    "Method",
    "Results",
    "measure",
]

ALL = tuple(cause for cause in CAUSES if cause != "noise, single reading")
UNFILTERED = tuple(cause for cause in CAUSES if cause != "noise, filtered")
WITHOUT_ASSEMBLY = tuple(cause for cause in ALL if cause != "assembly")
FORCES = (1.0, 2.0, 5.0, 10.0, 15.0, 20.0)  # N
MARK_3, READINGS = 2, 50
TIPS = (1.5e-3, 3e-3, 6e-3)  # m
TWIST = 30.0  # degrees, about the normal, under the broad pad: not in the paper
REGION = 6e-3  # m, what the paraboloid is fitted to
CALIBRATED = "all errors, mounting calibrated"
METHODS = ("soft_finger", "soft_finger, flat facets", "iterative", "wrench_axis")
SEED = 20231
Answer = Callable[
    [np.ndarray, np.ndarray], np.ndarray
]  # wrench (6,), the mark pressed (3,) -> point (3,), NaN: refused


@dataclass(frozen=True)
class Method:
    """One method on the simplified mesh: errors [m] to the pressure's centre, times [us] by mark, answers refused.

    Attributes:
        errors: all errors on, the paper's three angles, simplified mesh.
        clean: nothing wrong, fine mesh; twisted: so too, under a broad soft pad that is twisted.
    """

    errors: np.ndarray
    clean: np.ndarray
    twisted: np.ndarray
    times: np.ndarray
    refused: int


@dataclass
class Results:
    """What was measured, by name; distances in metres."""

    cases: dict[tuple[str, str], Case] = field(default_factory=dict)
    causes: dict[str, dict[str, Errors]] = field(default_factory=dict)  # by cause, by angle, on the T
    probes: dict[str, Errors] = field(default_factory=dict)  # all causes, perpendicular
    bound: dict[float, float] = field(default_factory=dict)  # worst mark's ratio by force
    forces: dict[str, dict[float, list[Errors]]] = field(
        default_factory=dict
    )  # mark 3, by filter, by force, an angle each
    tips: dict[float, dict[str, float]] = field(default_factory=dict)  # mean error to the mark, nothing else wrong
    methods: dict[str, Method] = field(default_factory=dict)
    force_error: dict[str, np.ndarray] = field(default_factory=dict)  # [N], by angle, one each of figure 6's forces
    pitch: tuple[float, float] = (0.0, 0.0)  # mean |h| without and with twist
    took: float = 0.0

    def values(self) -> dict[str, float]:
        """The figures that `expected.toml` holds on to: millimetres, but for ratios and shares."""
        said: dict[str, float] = {}
        for name, angles in self.causes.items():
            for angle, found in angles.items():
                said[f"{name}, {angle}: mark"] = 1e3 * float(found.mark.mean())
                said[f"{name}, {angle}: centroid"] = 1e3 * float(found.centroid.mean())
        for name, found in self.probes.items():
            said[f"{name} probe, all errors: mark"] = 1e3 * float(found.mark.mean())
        said["all probes: mark"] = 1e3 * float(self.overall().mean())
        said["share of assembly"] = self.share("assembly")
        for force, ratio in self.bound.items():
            said[f"noise over bound, {force:g} N, worst mark"] = ratio
        for name, method in self.methods.items():
            said[f"{name}: centroid"] = 1e3 * float(np.nanmean(method.errors))
            said[f"{name}, nothing wrong: centroid"] = 1e3 * float(np.nanmean(method.clean))
            said[f"{name}, nothing wrong, twisted: centroid"] = 1e3 * float(np.nanmean(method.twisted))
        return said

    def overall(self) -> np.ndarray:
        """Every reading of the three probes, perpendicular, to the mark."""
        return np.concatenate([found.mark.reshape(len(found.mark), -1) for found in self.probes.values()], axis=1)

    def share(self, cause: str) -> float:
        """Of the mean square error to the mark, perpendicular on the T, that a cause makes alone."""
        squares = {name: float(np.mean(self.causes[name]["perpendicular"].mark ** 2)) for name in ("all errors", cause)}
        return squares[cause] / squares["all errors"]


def measure(small: bool, say: Callable[[str], None] = lambda text: None) -> Results:
    """All of it, said as it goes."""
    begin, size, results = time.perf_counter(), Size.of(small), Results()
    draws = Draws(size.builds, SEED)
    for name in PROBES:
        for angle in ANGLES if name == "T-shaped" else ["perpendicular"]:
            say(f"pressing {name}, {angle}")
            results.cases[name, angle] = case(name, angle, size.spacing)
    meshes = {name: Meshes(probe) for name, probe in PROBES.items()}
    tee, angles = meshes["T-shaped"], {angle: results.cases["T-shaped", angle] for angle in ANGLES}
    say("one error at a time")
    rows: dict[str, Collection[str]] = {"nothing wrong": ()} | {name: (name,) for name in CAUSES}
    rows |= {"all errors": ALL, "all but assembly": WITHOUT_ASSEMBLY}
    for name, causes in rows.items():
        results.causes[name] = {a: errors(c, _mesh(tee, causes), draws, causes) for a, c in angles.items()}
    results.causes["worse payload model"] = {
        a: errors(c, tee.locator("fine"), draws, (), worse_payload=True) for a, c in angles.items()
    }
    mounted = calibrated(angles["perpendicular"], tee.mesh("simple"), draws, ALL)
    results.causes[CALIBRATED] = {
        a: errors(c, tee.locator("simple"), draws, ALL, mounted=mounted) for a, c in angles.items()
    }
    for name, mesh in meshes.items():
        results.probes[name] = errors(results.cases[name, "perpendicular"], mesh.locator("simple"), draws, ALL)
    say("noise over its bound")
    for force in (1.0, 5.0, 9.0, 20.0):
        ratios = [
            noise_over_bound(c, meshes[p].locator("fine"), force, size.readings) for (p, _), c in results.cases.items()
        ]
        results.bound[force] = float(np.max(np.concatenate(ratios)))
    say("forces")
    for kind, causes in (("filtered", ALL), ("single readings", UNFILTERED)):
        results.forces[kind] = {
            force: [
                errors(_third(c), tee.locator("simple"), draws, causes, (force, force), READINGS, presses=1)
                for c in angles.values()
            ]
            for force in FORCES
        }
    results.force_error = {angle: _force_error(c, draws) for angle, c in angles.items()}
    say("tips")
    for radius in TIPS:
        pressed = (
            angles
            if radius == assumed.Pad().radius
            else {a: case("T-shaped", a, size.spacing, assumed.tip(radius)) for a in ("in-plane", "out-of-plane")}
        )
        results.tips[radius] = {
            a: float(errors(pressed[a], tee.locator("fine"), Draws(1, SEED), ()).mark.mean())
            for a in ("in-plane", "out-of-plane")
        }
    say("methods")
    twisted = case("T-shaped", "in-plane", size.spacing, assumed.BROAD, np.radians(TWIST), centred=True)
    results.methods = _methods(tee, angles, twisted, replace(draws, builds=1 if small else 10))
    results.pitch = (_pitch(angles["in-plane"]), _pitch(twisted))
    results.took = time.perf_counter() - begin
    return results


def _mesh(meshes: Meshes, causes: Collection[str]) -> palpate.Locator:
    return meshes.locator("simple" if "mesh" in causes else "fine")


def _third(some: Case) -> Case:
    """The same with mark 3 alone."""
    pick = slice(MARK_3, MARK_3 + 1)
    return replace(some, marks=some.marks[pick], tangents=some.tangents[pick], presses=some.presses[pick])


def _force_error(some: Case, draws: Draws) -> np.ndarray:
    """Mean | |F| - reference | [N] at 5, 10, 15 and 20 N of a ramp of 1 N/s, both from sensors of one kind."""
    lag = float(palpate.Kalman().delay(0.0, assumed.RATE))
    reference = Draws(draws.builds, draws.seed + 1)
    means = []
    for force in (5.0, 10.0, 15.0, 20.0):
        now, before = (some.at(np.full((draws.builds, len(some.marks), 1), f))[0] for f in (force, force - lag))
        ours = draws.sensed(before, ("sensor", "payload", "assembly", "noise, filtered"), some.number)
        theirs = reference.sensed(now, ("sensor", "noise, filtered"), some.number)
        sizes = [np.linalg.norm(w[..., :3], axis=-1) for w in (ours, theirs)]
        means.append(np.mean(np.abs(sizes[0] - sizes[1])))
    return np.array(means)


def _pitch(some: Case) -> float:
    """Mean |F . M|/|F|^2 about the pressure's centre, at 9 N [m]."""
    wrench, _ = some.at(np.full((1, len(some.marks), 1), 9.0))
    force, moment = wrench[..., :3], wrench[..., 3:]
    return float(np.mean(np.abs(np.sum(force * moment, axis=-1)) / np.sum(force**2, axis=-1)))


def _methods(meshes: Meshes, angles: dict[str, Case], twisted: Case, draws: Draws) -> dict[str, Method]:
    """Distance to the pressure's centre on the simplified mesh with all errors, and the time of one call."""
    found = {}
    alone = Draws(1, draws.seed)
    for name in METHODS:
        answer, exact = _answer(meshes, "simple", name), _answer(meshes, "fine", name)
        parts = [_asked(answer, some, draws, ALL) for some in angles.values()]
        clean = [_asked(exact, some, alone, ())[0] for some in angles.values()]
        turned = _asked(exact, twisted, alone, ())[0]
        off, times = np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
        refused = int(np.sum(np.isnan(off)))
        found[name] = Method(off, np.concatenate(clean), turned, times, refused)
    return found


def _answer(meshes: Meshes, mesh: str, method: str) -> Answer:
    if method == "iterative":
        return _iterated(meshes.mesh(mesh))
    flat = ", flat" if "flat" in method else ""
    return _located(meshes.locator(mesh + flat, method.partition(",")[0]))


def _located(locator: palpate.Locator) -> Answer:
    out = locator.empty()

    def answer(wrench: np.ndarray, _mark: np.ndarray) -> np.ndarray:
        locator(wrench, out)
        return out[:3]

    return answer


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
