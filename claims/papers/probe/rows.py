"""The `probe` paper's static tests, run again: press, locate, compare; theirs beside ours, one error at a time."""

import time
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from claims.page import fill, table
from claims.papers.probe.methods import METHODS
from claims.papers.probe.run import CALIBRATED, FORCES, READINGS, TWIST, Results, measure
from claims.papers.probe.study import ANGLES, Errors
from claims.row import Row

FOLDER = Path(__file__).parent


def rows(small: bool) -> Iterator[Row]:
    begin = time.perf_counter()
    results = measure(small)
    if not small:
        from claims.papers.probe.figures import draw

        draw(results, FOLDER)
        fill(FOLDER, took=time.perf_counter() - begin, **parts(results))
    yield from headline(results)
    wrong = differences(results, small)
    what = f"figures of {len(results.values())} that are not as expected.toml has them"
    yield Row(what, "0", "; ".join([f"{len(wrong)}", *wrong]), not wrong)


def differences(results: Results, small: bool) -> list[str]:
    """Return a sentence for each figure that is not as `expected.toml` has it."""
    expected = tomllib.loads((FOLDER / "expected.toml").read_text(encoding="utf-8"))
    found, said = results.values(), []
    for kind, part in expected.items():
        slack = part["small" if small else "full"]
        for name, value in part["figures"].items():
            if name not in found:
                said.append(f"{name}: not measured any more")
            elif abs(found[name] - value) > slack:
                said.append(f"{name}: {found[name]:.4g}, expected {value:g} +- {slack:g} ({kind})")
    known = {name for part in expected.values() for name in part["figures"]}
    return said + [f"{name}: {value:.4g}, not in expected.toml" for name, value in found.items() if name not in known]


def headline(results: Results) -> list[Row]:
    every, probes = results.causes["all errors"], results.probes
    worst = np.max([found.mark.max(axis=(1, 2)) for found in every.values()], axis=0)
    soft, iterative, axis = (1e-3 * results.methods[name].times for name in ("soft_finger", "iterative", "wrench_axis"))
    lines = (
        ("three probes, perpendicular, all marks [mm] (1)", "1.04 +- 0.43", _pm(results.overall())),
        ("T-shaped, perpendicular [mm]", "0.9 +- 0.5", _pm(every["perpendicular"].mark)),
        ("T-shaped, 30 degrees in-plane [mm]", "1.6 +- 0.6", _pm(every["in-plane"].mark)),
        ("T-shaped, 30 degrees out-of-plane [mm]", "2.0 +- 0.5", _pm(every["out-of-plane"].mark)),
        (
            "T-shaped, worst of 153 readings [mm] (2)",
            "3.10",
            f"{1e3 * np.median(worst):.2f} (5 to 95 %: {_span(worst)})",
        ),
        ("T-shaped probe [mm]", "0.94 +- 0.49", _pm(probes["T-shaped"].mark)),
        ("linear probe [mm]", "1.28 +- 0.44", _pm(probes["linear"].mark)),
        ("convex probe [mm]", "0.91 +- 0.24", _pm(probes["convex"].mark)),
        ("mark 3, 1 N, worst [mm] (2, 3)", "3.5", _both(results, _worst, 1.0)),
        ("mark 3, 1 N, SD [mm] (3)", "1.4", _both(results, _spread, 1.0)),
        ("mark 3, 20 N, SD [mm] (3)", "0.08", _both(results, _spread, 20.0)),
        ("time of one estimate [ms] (4)", "0.57 +- 0.31", f"{soft.mean():.4f} +- {soft.std():.4f}"),
        ("the slowest marker [ms] (4)", "0.89", f"{np.median(soft, axis=0).max():.4f}"),
        ("table II: soft finger [ms] (4)", "0.439", f"{np.median(soft):.4f}"),
        ("table II: iterative [ms] (4)", "4.191", f"{np.median(iterative):.3f}"),
        ("table II: wrench axis [ms] (4)", "0.314", f"{np.median(axis):.4f}"),
    )
    return [Row(what, "", ours, None, (theirs,)) for what, theirs, ours in lines]


def parts(results: Results) -> dict[str, object]:
    """Return what stands in the page, by its place there; lengths in millimetres."""
    causes = results.causes
    mean = {name: {a: 1e3 * float(e.mark.mean()) for a, e in found.items()} for name, found in causes.items()}
    centre = {name: 1e3 * float(found["perpendicular"].centroid.mean()) for name, found in causes.items()}
    builds = results.overall().mean(axis=1)
    pitch, turned = (1e3 * value for value in results.pitch)
    upright = results.forces["filtered"][1.0][0].mark
    angled = ("in-plane", "out-of-plane")
    kinds = [f"{kind}: {what}" for kind in ("filtered", "single") for what in ("mean", "SD", "worst")]
    what = ["all errors", "nothing wrong", "nothing wrong, broad pad, twisted", "time [us], median (99 %)", "no answer"]
    heads = ["error", *(f"{angle}: {to}" for to in ("mark", "centre") for angle in ANGLES)]
    tips = [[f"{1e3 * r:g} mm", *(f"{1e3 * found[a]:.2f}" for a in angled)] for r, found in results.tips.items()]
    bounds = [[f"{force:g}", f"{ratio:.3f}"] for force, ratio in results.bound.items()]
    return {
        "builds": len(builds),
        "headline": table(("what", "theirs", "ours"), [[r.what, *r.theirs, r.got] for r in headline(results)]),
        "span": _span(builds),
        "below": float(np.mean(builds <= 1.04e-3)),
        "readings": READINGS,
        "many": READINGS * len(ANGLES),
        "alone": mean["assembly"]["perpendicular"],
        "share": results.share("assembly"),
        "theirs": float(np.mean(causes["assembly"]["perpendicular"].mark ** 2)) / (1.04e-3**2 + 0.43e-3**2),
        "mounted": mean[CALIBRATED]["perpendicular"],
        "all_centre": centre["all errors"],
        "mounted_centre": centre[CALIBRATED],
        "without": mean["all but assembly"]["perpendicular"],
        "all": mean["all errors"]["perpendicular"],
        "clean": 1e6 * np.mean([e.centroid.mean() for e in causes["nothing wrong"].values()]),
        "inplane": mean["nothing wrong"]["in-plane"],
        "outplane": mean["nothing wrong"]["out-of-plane"],
        "bound": results.bound[9.0],
        "worst": 1e3 * _worst(results, "filtered", 1.0),
        "upright": 1e3 * float(np.median(upright.max(axis=(1, 2)))),
        "causes": table(heads, [[name, *_cause(found)] for name, found in causes.items()]),
        "forces": table(("force [N]", *kinds), [[f"{force:g}", *_force(results, force)] for force in FORCES]),
        "bounds": table(("force [N]", "worst mark"), bounds),
        "pitch": pitch,
        "turned": turned,
        "twist": TWIST,
        "methods": table(("method", *what), [[name, *_method(results, name)] for name in METHODS]),
        "tips": table(("tip's radius", *(f"{angle} [mm]" for angle in angled)), tips),
    }


def _cause(found: dict[str, Errors]) -> list[str]:
    marks = [f"{_pm(found[a].mark)} ({1e3 * found[a].mark.max():.2f})" for a in ANGLES]
    means = {a: 1e3 * float(found[a].centroid.mean()) for a in ANGLES}
    return marks + [f"{mean:.3f}" if mean < 0.1 else _pm(found[a].centroid) for a, mean in means.items()]


def _force(results: Results, force: float) -> list[str]:
    row = list[str]()
    for kind in ("filtered", "single readings"):
        mean = float(np.mean([e.mark.mean() for e in results.forces[kind][force]]))
        row += [f"{1e3 * x:.2f}" for x in (mean, _spread(results, kind, force), _worst(results, kind, force))]
    return row


def _method(results: Results, name: str) -> list[str]:
    found = results.methods[name]
    means = [f"{1e3 * np.nanmean(values):.3f}" for values in (found.errors, found.clean, found.twisted)]
    times = f"{np.median(found.times):.1f} ({np.percentile(found.times, 99):.1f})"
    return [*means, times, f"{found.refused} of {found.errors.size}"]


def _worst(results: Results, kind: str, force: float) -> float:
    """Return the worst of a build's readings at three angles, in the median build [m]."""
    return float(np.median(np.max([e.mark.max(axis=(1, 2)) for e in results.forces[kind][force]], axis=0)))


def _spread(results: Results, kind: str, force: float) -> float:
    """Return the standard deviation within a press, in the median press [m]."""
    return float(np.median([e.mark.std(axis=(1, 2)) for e in results.forces[kind][force]]))


def _both(results: Results, of: Callable[[Results, str, float], float], force: float) -> str:
    filtered, single = (1e3 * of(results, kind, force) for kind in ("filtered", "single readings"))
    return f"{filtered:.2f}, single readings {single:.2f}"


def _pm(values: np.ndarray) -> str:
    return f"{1e3 * values.mean():.2f} +- {1e3 * values.std():.2f}"


def _span(values: np.ndarray) -> str:
    low, high = np.percentile(1e3 * values, [5, 95])
    return f"{low:.2f} to {high:.2f}"
