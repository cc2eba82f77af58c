"""Modules of taxels from pokes against their own covariance (the bound, at the estimate), and planned pokes."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from claims.row import Row
from palpate.sensors.taxels.poking import Priors, calibrate_taxels
from palpate.sensors.taxels.poking.evaluate import compare_places
from palpate.sensors.taxels.poking.plan import candidates, known_after, plan_pokes
from palpate.sensors.taxels.poking.rigid_groups import Units, fitted, single
from palpate.surfaces.mesh import Mesh
from palpate_lab.simulation.forearm import Forearm
from palpate_lab.simulation.poke_bench import HAND, MIX, Elbow, PokeBench, PokeErrors

SEED = 500
HELD = 5.991  # of chi-square with two degrees of freedom: a place on a surface has no more


def rows(small: bool) -> Iterator[Row]:
    skin = Forearm.of()
    link = Mesh.from_arrays(*skin.cone.mesh())
    for start in (False, True):
        trials = (
            60 if start else 200
        )  # from nothing all taxels of a session share one slide, which is most of the error
        yield from _limit(skin, link, 1 if small else trials, 200 if small else 1000, start)
    yield from _untouched(skin, link, 1 if small else 60, 200 if small else 1000)
    yield from _planning(skin, link, small)


def priors_of(errors: PokeErrors) -> Priors:
    """As the errors were drawn; what is without error is not estimated."""
    shared = ("bias_force", "bias_torque", "frame", "frame_angle", "common", "common_angle", "cross_talk", "lever")
    return Priors(**{name: getattr(errors, name) for name in shared})


# --- errors over bounds


@dataclass(frozen=True)
class _Trial:
    """[m^2] squared errors of the taxels and what their covariance says; the same once a rigid motion is taken off."""

    error: Float[np.ndarray, " k"]
    said: Float[np.ndarray, " k"]
    relative: Float[np.ndarray, " k"]
    said_relative: Float[np.ndarray, " k"]
    held: Bool[np.ndarray, " k"]


def _limit(skin: Forearm, link: Mesh, trials: int, pokes: int, start: bool) -> Iterator[Row]:
    from_where = "from CAD" if start else "from nothing"
    found = [_trial(skin, link, SEED + seed, pokes, start) for seed in range(trials)]
    error, said, relative, said_relative, held = (
        np.concatenate([getattr(one, name) for one in found])
        for name in ("error", "said", "relative", "said_relative", "held")
    )
    ratio = float(np.sqrt(error.mean() / said.mean()))
    judged = trials >= 50
    what = f"modules {from_where}, {trials} sessions of {pokes} pokes: rms error over what its covariance says"
    yield Row(what, "<= 1.2", f"{ratio:.2f} ({1e3 * np.sqrt(error.mean()):.2f} mm)", ratio <= 1.2 if judged else None)
    ratio = float(np.sqrt(relative.mean() / said_relative.mean()))
    got = f"{ratio:.2f} ({1e3 * np.sqrt(relative.mean()):.2f} mm, worst {1e3 * np.sqrt(relative.max()):.2f} mm)"
    yield Row(f"modules {from_where}: the same once one rigid motion is taken off", "", got)
    worst = float(np.sqrt(error.max()))
    mean = float(np.sqrt(error).mean())
    met = None if not (judged and start) else mean <= 1.5e-3 and worst <= 4e-3
    got = f"{1e3 * mean:.2f} / {1e3 * worst:.2f} mm"
    yield Row(f"modules {from_where}: mean / worst error", "<= 1.5 / 4 mm" * start, got, met)
    what = f"modules {from_where}: 95 % ellipsoids hold the truth, taxel by taxel, {trials} sessions"
    share = float(held.mean())
    yield Row(what, "93-97 %", _by_session([one.held for one in found]), 0.93 <= share <= 0.97 if judged else None)


def _by_session(held: list[Bool[np.ndarray, " k"]]) -> str:
    """The share that is held, and its deviation as sessions differ: the taxels of one are not so many trials."""
    each = np.array([one.mean() for one in held])
    spread = f" +- {each.std(ddof=1) / len(each) ** 0.5:.1%} (as sessions differ)" if len(each) > 1 else ""
    return f"{each.mean():.1%}{spread}"


def _trial(skin: Forearm, link: Mesh, seed: int, pokes: int, start: bool) -> _Trial:
    rng = np.random.default_rng(seed)
    made = PokeBench.drawn(rng, skin=skin, errors=MIX, tip=HAND).session(rng, pokes).pokes
    cad = skin.cad(rng) if start else None
    places = calibrate_taxels(made, surface=link, start=cad, layout=skin.layout, priors=priors_of(MIX)).places
    held = inside_ellipse(places.positions - skin.places.positions, places.covariance)
    off = compare_places(places, skin.places)
    return _Trial(off.absolute**2, places.deviations() ** 2, off.relative**2, places.relative**2, held)


# --- taxels that were never touched


def _untouched(skin: Forearm, link: Mesh, sessions: int, pokes: int) -> Iterator[Row]:
    """Pokes that reach one half of every module alone, from CAD: the others hang on their modules."""
    touched = np.flatnonzero(np.arange(len(skin.places)) % len(skin.shape) < len(skin.shape) // 2)
    off, held = list[np.ndarray](), list[np.ndarray]()
    for seed in range(SEED + 200, SEED + 200 + sessions):
        rng = np.random.default_rng(seed)
        bench = PokeBench.drawn(rng, skin=skin, errors=MIX, tip=HAND)
        made = bench.session(rng, pokes, among=touched).pokes
        places = calibrate_taxels(made, surface=link, start=skin.cad(rng), priors=priors_of(MIX)).places
        never = places.pokes == 0
        away = places.positions[never] - skin.places.positions[never]
        off.append(np.linalg.norm(away, axis=1))
        held.append(inside_ellipse(away, places.covariance[never]))
    every = np.concatenate(off)
    means = np.array([each.mean() for each in off])
    got = (
        f"{1e3 * every.mean():.2f} mm mean ({1e3 * means.min():.2f} to {1e3 * means.max():.2f} by session), "
        f"{np.mean(every <= 2.5e-3):.0%} of them within 2.5 mm, worst {1e3 * every.max():.2f} mm; ellipsoids hold "
        f"{_by_session(held)}"
    )
    met = bool(every.mean() <= 2.5e-3) if sessions >= 20 else None
    what = f"half of each module never touched, from CAD, {sessions} sessions of {pokes} pokes: error of those taxels"
    yield Row(what, "<= 2.5 mm mean", got, met)


def inside_ellipse(away: Float[np.ndarray, "k 3"], covariance: Float[np.ndarray, "k 3 3"]) -> Bool[np.ndarray, " k"]:
    """Whether 95 % ellipses in the surface hold the truth."""
    values, axes = np.linalg.eigh(covariance)
    standing = np.einsum("kia,ki->ka", axes[:, :, 1:], away) ** 2 / values[:, 1:]
    return np.asarray(standing.sum(axis=1) < HELD, dtype=bool)


# --- planning


def _planning(skin: Forearm, link: Mesh, small: bool) -> Iterator[Row]:
    """Pokes until the worst deviation is 1.15 times that of 1,000 random ones, by the covariance."""
    places = skin.places.positions
    kinds: list[tuple[str, Units, bool, float]] = [("modules from CAD", fitted(skin.layout, places, link), True, 0.5)]
    if not small:
        kinds += [
            ("modules from nothing", kinds[0][1], False, 0.5),
            ("taxel by taxel, from nothing", single(places, link), False, 0.35),
            ("taxel by taxel, from CAD", single(places, link), True, 0.35),
        ]
    for name, units, start, asked in kinds:
        random, planned, goal = _counted(units, start, 60 if small else 1000)
        got = f"{planned / random:.2f} ({planned} planned, {random} random; to {1e3 * goal:.2f} mm)"
        met = None if small else planned <= asked * random
        yield Row(f"planned over random pokes, {name}", f"<= {asked:g}", got, met)


def _counted(units: Units, start: bool, pokes: int) -> tuple[int, int, float]:
    """Pokes that are needed at random (mean of some orders) and planned, and the deviation [m] that both reach."""
    arm, priors = Elbow(), priors_of(MIX)
    options = candidates(units, arm.pose(*arm.joints.T), MIX.noise)
    deviations = units.each(priors.start, priors.start_angle) if start else None

    def known(made: np.ndarray) -> np.ndarray:
        count = np.bincount(made, minlength=len(options.taxel)).astype(np.float64)
        return known_after(units, options, count, priors, len(arm.table), deviations)

    def worst(made: np.ndarray) -> float:
        return float(plan_pokes(units, known(made), options, pokes=0).worst[0])

    needed, goals = list[int](), list[float]()
    for seed in range(3):
        order = np.random.default_rng(seed).integers(0, len(options.taxel), pokes)
        goals.append(1.15 * worst(order))
        low, high = 1, pokes
        while high - low > max(pokes // 200, 1):  # more pokes never know less
            middle = (low + high) // 2
            low, high = (low, middle) if worst(order[:middle]) <= goals[-1] else (middle, high)
        needed.append(high)
    goal = float(np.mean(goals))
    plan = plan_pokes(units, known(np.zeros(0, dtype=np.int64)), options, wanted=goal, pokes=pokes)
    return int(np.mean(needed)), len(plan.chosen), goal
