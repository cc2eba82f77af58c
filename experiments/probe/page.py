"""The README of the experiment, theirs beside ours: `page.template` filled with what was measured."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from evidence.machine import machine
from experiments.probe.assumed import ASSUMED
from experiments.probe.methods import METHODS
from experiments.probe.run import CALIBRATED, FORCES, READINGS, TWIST, Results
from experiments.probe.study import ANGLES, Errors

__all__ = ["page"]

TEMPLATE = Path(__file__).parent / "page.template"


def page(results: Results, took: float) -> str:
    """The template with every number in its place; lengths there are in millimetres."""
    mean = {name: {a: 1e3 * float(e.mark.mean()) for a, e in found.items()} for name, found in results.causes.items()}
    builds = results.overall().mean(axis=1)
    pitch, turned = (1e3 * value for value in results.pitch)
    at_one_newton = results.forces["filtered"][1.0]
    return TEMPLATE.read_text(encoding="utf-8").format(
        machine="\n".join(f"- {line}" for line in machine()),
        took=took,
        builds=len(builds),
        headline=_headline(results),
        span=_span(builds),
        below=float(np.mean(builds <= 1.04e-3)),
        readings=READINGS,
        many=READINGS * len(ANGLES),
        alone=mean["assembly"]["perpendicular"],
        share=results.share("assembly"),
        theirs=float(np.mean(results.causes["assembly"]["perpendicular"].mark ** 2)) / (1.04e-3**2 + 0.43e-3**2),
        mounted=mean[CALIBRATED]["perpendicular"],
        all_centre=1e3 * float(results.causes["all errors"]["perpendicular"].centroid.mean()),
        mounted_centre=1e3 * float(results.causes[CALIBRATED]["perpendicular"].centroid.mean()),
        without=mean["all but assembly"]["perpendicular"],
        all=mean["all errors"]["perpendicular"],
        clean=1e6 * np.mean([e.centroid.mean() for e in results.causes["nothing wrong"].values()]),
        inplane=mean["nothing wrong"]["in-plane"],
        outplane=mean["nothing wrong"]["out-of-plane"],
        bound=results.bound[9.0],
        worst=1e3 * _worst(results, "filtered", 1.0),
        upright=1e3 * float(np.median(at_one_newton[0].mark.max(axis=(1, 2)))),
        causes=_causes(results),
        forces=_forces(results),
        bounds=_table(["force [N]", "worst mark"], [[f"{f:g}", f"{ratio:.3f}"] for f, ratio in results.bound.items()]),
        pitch=pitch,
        turned=turned,
        twist=TWIST,
        methods=_methods(results),
        tips=_tips(results),
        assumed=_table(["what", "taken", "source"], [list(row) for row in ASSUMED]),
    )


def _headline(results: Results) -> str:
    every, probes = results.causes["all errors"], results.probes
    worst = np.max([found.mark.max(axis=(1, 2)) for found in every.values()], axis=0)
    soft, iterative, axis = (1e-3 * results.methods[name].times for name in ("soft_finger", "iterative", "wrench_axis"))
    rows = [
        ["three probes, perpendicular, all marks [mm] (1)", "1.04 +- 0.43", _pm(results.overall())],
        ["T-shaped, perpendicular [mm]", "0.9 +- 0.5", _pm(every["perpendicular"].mark)],
        ["T-shaped, 30 degrees in-plane [mm]", "1.6 +- 0.6", _pm(every["in-plane"].mark)],
        ["T-shaped, 30 degrees out-of-plane [mm]", "2.0 +- 0.5", _pm(every["out-of-plane"].mark)],
        [
            "T-shaped, worst of 153 readings [mm] (2)",
            "3.10",
            f"{1e3 * np.median(worst):.2f} (5 to 95 %: {_span(worst)})",
        ],
        ["T-shaped probe [mm]", "0.94 +- 0.49", _pm(probes["T-shaped"].mark)],
        ["linear probe [mm]", "1.28 +- 0.44", _pm(probes["linear"].mark)],
        ["convex probe [mm]", "0.91 +- 0.24", _pm(probes["convex"].mark)],
        ["mark 3, 1 N, worst [mm] (2, 3)", "3.5", _both(results, _worst, 1.0)],
        ["mark 3, 1 N, SD [mm] (3)", "1.4", _both(results, _spread, 1.0)],
        ["mark 3, 20 N, SD [mm] (3)", "0.08", _both(results, _spread, 20.0)],
        ["time of one estimate [ms] (4)", "0.57 +- 0.31", f"{soft.mean():.4f} +- {soft.std():.4f}"],
        ["the slowest marker [ms] (4)", "0.89", f"{np.median(soft, axis=0).max():.4f}"],
        ["table II: soft finger [ms] (4)", "0.439", f"{np.median(soft):.4f}"],
        ["table II: iterative [ms] (4)", "4.191", f"{np.median(iterative):.3f}"],
        ["table II: wrench axis [ms] (4)", "0.314", f"{np.median(axis):.4f}"],
    ]
    return _table(["what", "theirs", "ours"], rows)


def _causes(results: Results) -> str:
    rows = [
        [
            name,
            *(f"{_pm(found[a].mark)} ({1e3 * found[a].mark.max():.2f})" for a in ANGLES),
            *(_fine(found[a]) for a in ANGLES),
        ]
        for name, found in results.causes.items()
    ]
    return _table(["error", *(f"{a}: mark" for a in ANGLES), *(f"{a}: centre" for a in ANGLES)], rows)


def _fine(found: Errors) -> str:
    mean = 1e3 * float(found.centroid.mean())
    return f"{mean:.3f}" if mean < 0.1 else _pm(found.centroid)


def _forces(results: Results) -> str:
    rows = []
    for force in FORCES:
        row = [f"{force:g}"]
        for kind in ("filtered", "single readings"):
            mean = float(np.mean([e.mark.mean() for e in results.forces[kind][force]]))
            row += [f"{1e3 * x:.2f}" for x in (mean, _spread(results, kind, force), _worst(results, kind, force))]
        rows.append(row)
    kinds = [f"{kind}: {what}" for kind in ("filtered", "single") for what in ("mean", "SD", "worst")]
    return _table(["force [N]", *kinds], rows)


def _methods(results: Results) -> str:
    rows = []
    for name in METHODS:
        found = results.methods[name]
        times = f"{np.median(found.times):.1f} ({np.percentile(found.times, 99):.1f})"
        means = [f"{1e3 * np.nanmean(values):.3f}" for values in (found.errors, found.clean, found.twisted)]
        rows.append([name, *means, times, f"{found.refused} of {found.errors.size}"])
    what = ["all errors", "nothing wrong", "nothing wrong, broad pad, twisted"]
    return _table(["method", *what, "time [us], median (99 %)", "no answer"], rows)


def _tips(results: Results) -> str:
    rows = [
        [f"{1e3 * radius:g} mm", *(f"{1e3 * found[a]:.2f}" for a in ("in-plane", "out-of-plane"))]
        for radius, found in results.tips.items()
    ]
    return _table(["tip's radius", "in-plane [mm]", "out-of-plane [mm]"], rows)


def _worst(results: Results, kind: str, force: float) -> float:
    """Of a build's readings at three angles, in the median build [m]."""
    return float(np.median(np.max([e.mark.max(axis=(1, 2)) for e in results.forces[kind][force]], axis=0)))


def _spread(results: Results, kind: str, force: float) -> float:
    """Standard deviation within a press, in the median press [m]."""
    return float(np.median([e.mark.std(axis=(1, 2)) for e in results.forces[kind][force]]))


def _both(results: Results, of: Callable[[Results, str, float], float], force: float) -> str:
    filtered, single = (1e3 * of(results, kind, force) for kind in ("filtered", "single readings"))
    return f"{filtered:.2f}, single readings {single:.2f}"


def _pm(values: np.ndarray) -> str:
    return f"{1e3 * values.mean():.2f} +- {1e3 * values.std():.2f}"


def _span(values: np.ndarray) -> str:
    low, high = np.percentile(1e3 * values, [5, 95])
    return f"{low:.2f} to {high:.2f}"


def _table(head: list[str], rows: list[list[str]]) -> str:
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *rows))
