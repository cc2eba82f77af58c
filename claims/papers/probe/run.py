"""Everything that the page says, measured: `measure` runs it all, small in seconds."""

from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np

import palpate
from claims.papers.probe import assumed
from claims.papers.probe.draws import CAUSES, Draws
from claims.papers.probe.methods import Method, methods
from claims.papers.probe.shapes import PROBES
from claims.papers.probe.study import ANGLES, Case, Errors, Meshes, Size, calibrated, case, errors, noise_over_bound

ALL = tuple(cause for cause in CAUSES if cause != "noise, single reading")
UNFILTERED = tuple(cause for cause in CAUSES if cause != "noise, filtered")
WITHOUT_ASSEMBLY = tuple(cause for cause in ALL if cause != "assembly")
FORCES = (1.0, 2.0, 5.0, 10.0, 15.0, 20.0)  # N
MARK_3, READINGS = 2, 50
TIPS = (1.5e-3, 3e-3, 6e-3)  # m
TWIST = 30.0  # degrees, about the normal, under the broad pad: not in the paper
CALIBRATED = "all errors, mounting calibrated"
SEED = 20231


@dataclass
class Results:
    """What was measured, by name; distances in metres."""

    cases: dict[tuple[str, str], Case] = field(default_factory=dict)
    causes: dict[str, dict[str, Errors]] = field(default_factory=dict)  # by cause, by angle, on the T
    probes: dict[str, Errors] = field(default_factory=dict)  # all causes, perpendicular
    bound: dict[float, float] = field(default_factory=dict)  # worst mark's ratio by force
    forces: dict[str, dict[float, list[Errors]]] = field(default_factory=dict)  # mark 3: filter, force, an angle each
    tips: dict[float, dict[str, float]] = field(default_factory=dict)  # mean error to the mark, nothing else wrong
    methods: dict[str, Method] = field(default_factory=dict)
    force_error: dict[str, np.ndarray] = field(default_factory=dict)  # [N], by angle, one each of figure 6's forces
    pitch: tuple[float, float] = (0.0, 0.0)  # mean |h| without and with twist

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


def measure(small: bool) -> Results:
    size, results = Size.of(small), Results()
    draws = Draws(size.builds, SEED)
    meshes = {name: Meshes(probe) for name, probe in PROBES.items()}
    for name in PROBES:
        for angle in ANGLES if name == "T-shaped" else ["perpendicular"]:
            results.cases[name, angle] = case(name, angle, size.spacing)
    tee, angles = meshes["T-shaped"], {angle: results.cases["T-shaped", angle] for angle in ANGLES}
    results.causes = _causes(tee, angles, draws)
    for name, mesh in meshes.items():
        results.probes[name] = errors(results.cases[name, "perpendicular"], mesh.locator("simple"), draws, ALL)
    for force in (1.0, 5.0, 9.0, 20.0):
        fine = [(some, meshes[name].locator("fine")) for (name, _), some in results.cases.items()]
        ratios = [noise_over_bound(some, locator, force, size.readings) for some, locator in fine]
        results.bound[force] = float(np.max(np.concatenate(ratios)))
    results.forces = {"filtered": _forces(tee, angles, draws, ALL)}
    results.forces["single readings"] = _forces(tee, angles, draws, UNFILTERED)
    results.force_error = {angle: _force_error(some, draws) for angle, some in angles.items()}
    results.tips = {radius: _tip(tee, radius, size.spacing) for radius in TIPS}
    twisted = case("T-shaped", "in-plane", size.spacing, assumed.BROAD, np.radians(TWIST), centred=True)
    results.methods = methods(tee, list(angles.values()), twisted, replace(draws, builds=1 if small else 10), ALL)
    results.pitch = (_pitch(angles["in-plane"]), _pitch(twisted))
    return results


def _causes(tee: Meshes, angles: dict[str, Case], draws: Draws) -> dict[str, dict[str, Errors]]:
    """The rows of the table: each cause alone, all of them, and all without the assembly or with it calibrated."""
    rows: dict[str, Collection[str]] = {"nothing wrong": ()} | {name: (name,) for name in CAUSES}
    rows |= {"all errors": ALL, "all but assembly": WITHOUT_ASSEMBLY}
    mounted = calibrated(angles["perpendicular"], tee.mesh("simple"), draws, ALL)
    fine, simple = tee.locator("fine"), tee.locator("simple")
    found = {
        name: {a: errors(c, simple if "mesh" in causes else fine, draws, causes) for a, c in angles.items()}
        for name, causes in rows.items()
    }
    found[CALIBRATED] = {a: errors(c, simple, draws, ALL, mounted=mounted) for a, c in angles.items()}
    found["worse payload model"] = {a: errors(c, fine, draws, (), worse_payload=True) for a, c in angles.items()}
    return found


def _forces(tee: Meshes, angles: dict[str, Case], draws: Draws, causes: Collection[str]) -> dict[float, list[Errors]]:
    """Readings of one press on mark 3 at each force and angle."""
    simple = tee.locator("simple")
    some, found = [_third(each) for each in angles.values()], dict[float, list[Errors]]()
    for force in FORCES:
        span = force, force
        found[force] = [errors(each, simple, draws, causes, span, READINGS, presses=1) for each in some]
    return found


def _tip(tee: Meshes, radius: float, spacing: float) -> dict[str, float]:
    """Mean error to the mark [m] under a tip of another radius, nothing else wrong."""
    fine, once = tee.locator("fine"), Draws(1, SEED)
    tilts = {angle: case("T-shaped", angle, spacing, assumed.tip(radius)) for angle in ("in-plane", "out-of-plane")}
    return {angle: float(errors(some, fine, once, ()).mark.mean()) for angle, some in tilts.items()}


def _third(some: Case) -> Case:
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
