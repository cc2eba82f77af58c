"""The `probe` paper's moving phantom, run again in the lab: tables I and II and figure 10, theirs beside ours.

It takes a quarter of an hour on two cores.
"""

import time
from collections.abc import Iterator, Mapping

import numpy as np

from claims.page import asked, fill, table
from claims.papers.moving_phantom.conditions import (
    BIAS,
    BOUNDED,
    DIRECTIONS,
    FULL,
    HARD,
    INERTIA,
    PERIODS,
    PROBES,
    STEP,
    Sizes,
    sections,
)
from claims.papers.moving_phantom.figures import FOLDER, figure_10
from claims.papers.moving_phantom.study import SKIPPED, Found, Trace, traces
from claims.row import Row, expected

FIRST = (0.0, SKIPPED)  # s
TABLE_1 = {  # mean [deg], in-plane and out-of-plane for T = 10, 5 and 2 s
    "human, eyes and touch": ("0.62", "0.83", "1.24", "1.78", "2.87", "3.96"),
    "human, touch": ("1.34", "1.98", "2.69", "3.86", "3.89", "4.62"),
    "the paper's robot": ("1.26", "1.55", "3.97", "4.65", "x", "x"),
}
TABLE_2 = {  # mean and deviation [deg] for T = 10 and 5 s; time [ms]
    "soft finger": ("1.53 +- 1.47", "1.87 +- 1.38", "3.34 +- 2.53", "3.74 +- 2.28", "0.439"),
    "iterative": ("3.35 +- 2.54", "2.73 +- 1.40", "5.37 +- 4.15", "5.15 +- 3.89", "4.191"),
    "wrench axis": ("2.27 +- 1.72", "2.68 +- 1.87", "4.43 +- 3.23", "x", "0.314"),
}
FORCES = {"vertical": "5.23-8.83", "in-plane": "6.04-8.26", "out-of-plane": "5.46-8.48"}
BOTH = [f"{way} {unit}" for unit in ("[deg]", "[N]") for way in DIRECTIONS]
Runs = Mapping[str, Found]


def figures_of(found: Runs) -> dict[str, float]:
    """Return what expected.toml may ask of a run: degrees, newtons, seconds, ratios."""
    got = {
        f"{method}_{way}_{period}": found[f"{method} {way} {period}"].mean
        for method in ("paper", "ours")
        for way in DIRECTIONS
        for period in PERIODS
    }
    got |= {"paper_vertical": found["paper vertical 10"].off(), "vertical": found["ours vertical"].off()}
    got["vertical_start"] = found["ours vertical"].off(*FIRST)
    got["vertical_stiff"] = found["ours vertical stiff"].off(*FIRST)
    for period in PERIODS:
        got[f"rotation_{period}"] = max(found[f"ours {way} {period}"].off() for way in DIRECTIONS)
    for way in DIRECTIONS:
        both = found[f"bias +1 {way}"].signed - found[f"bias -1 {way}"].signed
        got[f"bias_{way}"] = abs(both) / (2.0 * BIAS) * 0.010
    moved = [found[f"unplanned {way}"] for way in DIRECTIONS]
    got["unplanned_lost"] = float(sum(each.lost for each in moved))
    got["unplanned_force"] = max(each.off() for each in moved)
    for each, end in zip(moved, ("", "_out"), strict=True):
        got[f"unplanned_settled{end}"] = max(trace.settled(STEP) for trace in each.traces)
    got["robust"] = max(max(ratios) for ratios in _robust(found).values())
    stops = [_stop(found[f"drift stops {way}"].traces[0]) for way in DIRECTIONS]
    got["drift_stopped"] = float(sum(each is not None for each in stops))
    got["drift_true"] = max((each[1] for each in stops if each is not None), default=float("nan"))
    return got


def _robust(found: Runs) -> dict[str, list[float]]:
    """Return the mean angle in each trouble over that of the same seeds without, by direction."""
    made = dict[str, list[float]]()
    for name in HARD:
        made[name] = list[float]()
        for way in DIRECTIONS:
            hard = found[f"{name} {way}"]
            seeds = {trace.condition.settings.seed for trace in hard.traces}
            same = [each for each in found[f"ours {way} 5"].traces if each.condition.settings.seed in seeds]
            made[name].append(hard.mean / Found(same).mean)
    return made


def _stop(trace: Trace) -> tuple[float, float, float] | None:
    """Return the time [s] of a stop, and the true angle, mean of the last half second, and the predicted one [deg]."""
    at = [time for time, state, _ in trace.states if state == "stopped"]
    if not at:
        return None
    times = trace.column("time")
    before = (times < at[0]) & (times >= at[0] - 0.5)
    return at[0], abs(float(trace.error[before].mean())), float(np.degrees(trace.column("drifted")[before][-1]))


def _ranges(runs: list[Found], *spans: tuple[float, ...]) -> list[str]:
    """Return the least and largest force [N] of each, in each span [s]; in what is judged if none is given."""
    return [f"{low:.2f}-{high:.2f}" for each in runs for low, high in (each.force(*span) for span in spans or ((),))]


def _spread(runs: list[Found]) -> list[str]:
    return [f"{each.mean:.2f} +- {each.deviation:.2f}" for each in runs]


def _held(runs: list[Found]) -> list[str]:
    """Return the mean angles, the ranges of force, and how often the contact was lost."""
    return [*(f"{each.mean:.2f}" for each in runs), *_ranges(runs), f"{sum(each.lost for each in runs)}"]


def parts(found: Runs) -> dict[str, object]:
    """Return the tables of the page, by their place there."""
    ways = {name: [found[f"{name} {way}"] for way in DIRECTIONS] for name in HARD}
    one = [
        [name, *(f"{found[f'{method} {way} {period}'].mean:.2f}" for period in PERIODS for way in DIRECTIONS)]
        for name, method in (("its law on this lab", "paper"), ("ours", "ours"))
    ]
    inertia = [
        [name, *_held([found[f"inertia {name} {way}" if variant else f"ours {way} 2"] for way in DIRECTIONS])]
        for name, variant in {**INERTIA, BOUNDED: BOUNDED}.items()
    ]
    hard = list[list[str]]()
    for name, ratios in _robust(found).items():
        cells = [f"{each.mean:.2f} ({ratio:.2f})" for each, ratio in zip(ways[name], ratios, strict=True)]
        hard.append([name, *cells, *_held(ways[name])[2:]])
    times = [f"T = {period} s, {way}" for period in PERIODS for way in DIRECTIONS]
    cycles = list[list[str]]()
    for name in ("ours", "paper"):
        took = np.median([trace.cycle for trace in found[f"{name} in-plane 5"].traces], axis=0)
        cycles.append([name, *(f"{1e6 * value:.0f}" for value in took)])
    troubled = [f"{way} [deg] (times nominal)" for way in DIRECTIONS]
    return {
        "one": table(("mean [deg]", *times), [[name, *said] for name, said in TABLE_1.items()] + one),
        "two": _table_2(found),
        "forces": _forces(found),
        "seeds": _seeds(found),
        "inertia": table(("acceleration, T = 2 s", *BOTH, "left hold"), inertia),
        "bias": _bias(found),
        "unplanned": _unplanned(found),
        "hard": table(("ours, T = 5 s", *troubled, *BOTH[2:], "left hold"), hard),
        "drift": _drift(found),
        "probes": _probes(found),
        "cycles": table(("a call of `update` [us]", "p50", "p99"), cycles),
    }


def _table_2(found: Runs) -> str:
    rows = list[list[str]]()
    for name, said in TABLE_2.items():
        rows.append([f"{name}, the paper", *said, "", ""])
        law = "paper" if name == "soft finger" else name
        runs = [Found(found[f"{law} {way} {period}"].traces[:1]) for period in (10, 5) for way in DIRECTIONS]
        took = np.median([each.traces[0].estimate for each in runs])
        spun = [found[f"{name} {way} spun"] for way in DIRECTIONS]
        rows.append([f"{name}, here", *_spread(runs), f"{1e3 * took:.3f}", *_spread(spun)])
    heads = [f"T = {period} s, {way}" for period in (10, 5) for way in DIRECTIONS]
    return table(("method", *heads, "time [ms]", *(f"T = 10 s and a spin, {way}" for way in DIRECTIONS)), rows)


def _forces(found: Runs) -> str:
    rows = list[list[str]]()
    for way, period in (("vertical", 10), *((way, period) for period in PERIODS for way in DIRECTIONS)):
        runs = [found[f"paper {way} {period}"], found["ours vertical" if way == "vertical" else f"ours {way} {period}"]]
        said = FORCES[way] if period == 10 else ""
        rows.append([f"{way}, T = {period} s", said, *_ranges(runs, (SKIPPED,), FIRST)])
    stiff = _ranges([found["ours vertical stiff"]], (SKIPPED,), FIRST)
    rows.append(["vertical, three times the stiffness", "", "", "", *stiff])
    return table(("[N]", "paper", "its law here", "first second", "ours", "first second"), rows)


def _seeds(found: Runs) -> str:
    rows = list[list[str]]()
    for way in DIRECTIONS:
        for period in PERIODS:
            each = found[f"ours {way} {period}"]
            means = [float(np.abs(t.error[t.steady]).mean()) for t in each.traces]
            cells = [f"{each.mean:.2f}", f"{each.deviation:.2f}", f"{min(means):.2f}-{max(means):.2f}"]
            rows.append([f"{way}, T = {period} s", *cells, f"{each.whole:.2f}", f"{each.off():.2f}", f"{each.lost}"])
    heads = ("mean [deg]", "deviation", "means of seeds", "whole angle", "force off 7 N, most [N]", "left hold")
    return table(("ours", *heads), rows)


def _bias(found: Runs) -> str:
    rows = list[list[str]]()
    for sign in ("-1", "+1"):
        for way in DIRECTIONS:
            each = found[f"bias {sign} {way}"]
            cells = [f"{each.signed:+.2f}", f"{each.mean:.2f}", *_ranges([each]), each.traces[0].states[-1][1]]
            rows.append([f"{sign[0]}20 mN, {way}", *cells])
    return table(("ours, still", "mean with its sign [deg]", "mean [deg]", "force [N]", "state at the end"), rows)


def _unplanned(found: Runs) -> str:
    rows = list[list[str]]()
    kinds = {way: f"unplanned {way}" for way in DIRECTIONS}
    kinds |= {f"{way}, a quarter of the noise": f"unplanned, quiet, {way}" for way in DIRECTIONS}
    for way, name in kinds.items():
        each, cells = found[name], list[str]()
        for over in (0.0, 0.2):
            settled = [trace.settled(STEP, over) for trace in each.traces]
            cells.append(f"{np.median(settled):.2f} / {max(settled):.2f} / {sum(after <= 0.5 for after in settled)}")
        forces = _ranges([each], (SKIPPED, STEP), (STEP,))
        rows.append([way, f"{len(each.traces)}", f"{each.lost}", *forces, f"{each.mean:.2f}", *cells])
    heads = ("seeds", "left hold", "force before the step [N]", "from the step on [N]", "mean angle [deg]")
    settles = "settled: median [s] / slowest [s] / seeds within 0.5 s"
    return table(("", *heads, settles, "the same of the mean over 0.2 s"), rows)


def _drift(found: Runs) -> str:
    rows = list[list[str]]()
    for way in DIRECTIONS:
        free, stopped = found[f"drift goes on {way}"].traces[0], _stop(found[f"drift stops {way}"].traces[0])
        drifted, cells = np.degrees(free.column("drifted")), list[str]()
        for at in (6.0, 12.0):
            near = np.abs(free.column("time") - at) < 0.5
            cells.append(f"{np.abs(free.error[near].mean()):.1f} / {drifted[near].mean():.1f}")
        end = "never" if stopped is None else f"after {stopped[0]:.1f} s at {stopped[1]:.1f} / {stopped[2]:.1f}"
        rows.append([way, *cells, end])
    return table(("true / predicted [deg]", "after 6 s", "after 12 s", "with a bound of 3 deg it stops"), rows)


def _probes(found: Runs) -> str:
    rows = list[list[str]]()
    for probe in PROBES:
        for method, name in (("paper", "the paper's law"), ("ours", "ours")):
            runs = [found[f"{probe} {method} {way}"] for way in DIRECTIONS]
            ends = ", ".join(each.traces[0].states[-1][1] for each in runs)
            rows.append([f"{probe}, {name}", *_spread(runs), *_held(runs)[2:], ends])
    return table(("T = 10 s", *BOTH, "left hold", "states at the end"), rows)


def rows(small: bool) -> Iterator[Row]:
    begin = time.monotonic()
    found = traces(sections(Sizes(1, 1) if small else FULL))
    made = expected(FOLDER, figures_of(found), "paper", "human")
    if not small:
        figure_10(found)
        runs = sum(len(each.traces) for each in found.values())
        fill(FOLDER, asked=asked(made, "paper", "human"), took=time.monotonic() - begin, runs=runs, **parts(found))
    yield from made
