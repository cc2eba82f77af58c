"""The `marker ring` paper's showcases, run again in the lab: figures 11 and 12, theirs beside ours.

Each run is kept in `.cache/touch_navigation.jsonl` as soon as it is done: whoever stops goes on there the next time,
until the code of navigation, arena or loop changes. All of it takes some eight hours of a core.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from claims.page import asked, fill, table
from claims.papers.touch_navigation.conditions import (
    ABLATIONS,
    BASELINES,
    BUILT,
    COUNTS,
    FAULTS,
    FULL,
    JUDGED,
    LIMIT,
    TRAPS,
    conditions,
)
from claims.papers.touch_navigation.figures import arrivals, ways
from claims.papers.touch_navigation.study import Found, Outcome, Runs, frames_a_second
from claims.papers.touch_navigation.study import found as find
from claims.row import ROOT, Row, expected
from palpate.control.touch_navigator import DOUBT
from palpate_lab.cli.arena_run import RATE

FOLDER = Path(__file__).parent
KEPT = ROOT / ".cache/touch_navigation.jsonl"
PUSHED = 0.05  # m
FIGURE_11 = (130.0, 156.0, 169.0, 182.0)  # s, in which robots 2, 3, 4 and 1 of the paper arrived
HEADS = ("robots that arrive [%]", "all of them [% of runs]", "median [s]", "way [m]", "force, 99 % [N]", "most [N]")
LESS = ("pushes a run", "deadlocks a run")


def figures_of(found: Runs, sensed: float = float("nan")) -> dict[str, float]:
    """Return what expected.toml may ask of a run; NaN for what was not run. `sensed`: of `frames_a_second`."""
    eleven, ours, images = (found[name] for name in ("figure 11 ours", "ours", "images"))
    times = np.array([each.arrived for each in eleven.outcomes]) if len(eleven) else np.full((1, 1), np.nan)
    moved = [100.0 * (each.blocks >= PUSHED) for each in eleven.outcomes]
    faults = [found[f"fault {fault}"] for fault in FAULTS if f"fault {fault}" in found]
    return {
        "figure_11": eleven.whole,
        "figure_11_first": float(np.median(times.min(axis=1))),
        "figure_11_last": float(np.median(times.max(axis=1))),
        "figure_12": float(np.mean(moved)) if moved else float("nan"),
        "robots": ours.robots,
        "whole": ours.whole,
        "median": ours.median,
        "force": ours.force(),
        **{method.replace("-", "_"): found[method].robots for method in BASELINES},
        "dense": found["dense"].robots,
        "images": abs(images.robots - ours.of(images).robots),
        "images_speed": images.speed,
        "cameras": sensed / RATE,
        "again": differing(found),
        "fault": max((abs(each.healthy - ours.of(each).healthy) for each in faults), default=float("nan")),
    }


def differing(found: Runs) -> float:
    """Return how many of the runs that were run again came out otherwise; NaN where none was."""
    digests = [[each.digest for each in found[name].outcomes] for name in ("again 1", "again 2")]
    pairs = list(zip(*digests, strict=True))
    return float(sum(one != other for one, other in pairs)) if pairs else float("nan")


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else "-"


def _cells(runs: Found) -> list[str]:
    if not len(runs):
        return ["not run"] + [""] * len(HEADS + LESS)
    shares = f"{runs.robots:.1f}", f"{runs.whole:.0f}", _number(runs.median, 0), _number(runs.path, 1)
    forces = _number(runs.force(), 2), f"{runs.greatest:.1f}"
    return [f"{len(runs)}", *shares, *forces, f"{runs.pushes:.1f}", f"{runs.deadlocks:.1f}"]


def _compared(first: str, rows: Mapping[str, Found]) -> str:
    return table((first, "runs", *HEADS, *LESS), [[name, *_cells(runs)] for name, runs in rows.items()])


def parts(found: Runs) -> dict[str, object]:
    """Return what stands in the page, by its place there."""
    ours, images, first = found["ours"], found["images"], found[next(iter(ABLATIONS))]
    many = {"ours": ours, "ours, the arenas of the rows below": ours.of(found["paper"])}
    sparse = {"ours": found["ours sparse"]}
    for method, retreat in BASELINES.items():
        many[f"the paper's, retreat {retreat}"] = found[method]
        sparse[f"the paper's, retreat {retreat}"] = found[f"{method} sparse"]
    many["the same, one robot alone (to the goal's side)"] = found["paper alone"]
    many["the same, binary touch"] = found["paper binary touch"]
    harder = {"1.6 times the blocks, ours": found["dense"]}
    for trap, said in TRAPS.items():
        harder |= {f"{said}, ours": found[f"trap {trap}"], f"{said}, the paper's": found[f"trap {trap} paper"]}
    runs = [each for name in found.values() for each in name.outcomes]
    return {
        "judged": JUDGED,
        "built": BUILT.stop - 1,
        "limit": LIMIT,
        "runs": len(runs),
        "minutes": sum(each.took for each in runs) / 60.0,
        "versions": len({each.stamp for each in runs}),
        "eleven": _figure_11(found),
        "many": _compared("the paper's density", many),
        "sparse": _compared("half of its blocks", sparse),
        "harder": _compared("", harder),
        "ablation": _compared("the same arenas", {"ours": ours.of(first)} | {name: found[name] for name in ABLATIONS}),
        "images": _compared("the same arenas", {"the skin's deformation": ours.of(images), "images": images}),
        "speed_skin": ours.of(images).speed,
        "speed_images": images.speed,
        "scale": _scale(found),
        "faults": _faults(found),
        "again": len(found["again 1"]),
        "differing": differing(found),
    }


def _figure_11(found: Runs) -> str:
    rows = [["the paper, one run", *[f"{time:.0f}" for time in FIGURE_11], "100", "1", "pushed"]]
    theirs = {f"the paper's, retreat {retreat}": f"figure 11 {method}" for method, retreat in BASELINES.items()}
    for name, each in ({"ours": "figure 11 ours"} | theirs).items():
        runs = found[each]
        if not len(runs):
            continue
        times, cells = np.sort(np.array([each.arrived for each in runs.outcomes]), axis=1), list[str]()  # NaN last
        for column in times.T:
            there = column[np.isfinite(column)]
            ranged = f"{np.median(there):.0f} ({there.min():.0f}-{there.max():.0f})" if len(there) else "-"
            cells.append(ranged if len(there) in (0, len(column)) else f"{ranged}, {len(there)} of {len(column)}")
        moved = [1e3 * each.blocks for each in runs.outcomes]
        pushed = f"by {np.median(moved):.0f} mm ({min(moved):.0f}-{max(moved):.0f})"
        rows.append([name, *cells, f"{runs.whole:.0f}", f"{len(runs)}", pushed])
    return table(("arrived [s]", "first", "second", "third", "fourth", "all four [% of runs]", "runs", "box"), rows)


def _scale(found: Runs) -> str:
    rows = list[list[str]]()
    for count in COUNTS:
        if len(runs := found[f"{count} robots"]):
            speeds = f"{runs.speed:.1f}", f"{runs.speed * count:.0f}"
            rows.append([f"{count}", f"{len(runs)}", f"{runs.robots:.1f}", _number(runs.median, 0), *speeds])
    return table(("robots", "runs", HEADS[0], "median [s]", "simulated seconds in one of a core", "times robots"), rows)


def _faults(found: Runs) -> str:
    rows = list[list[str]]()
    for fault, said in FAULTS.items():
        runs = found[f"fault {fault}"]
        if len(runs):
            words = [DOUBT if DOUBT in each.states[0] else each.states[0] for each in runs.outcomes]
            usual = max(dict.fromkeys(words), key=words.count)
            first, without = 100.0 * np.mean([each.there[0] for each in runs.outcomes]), found["ours"].of(runs)
            shares = f"{runs.healthy:.1f}", f"{without.healthy:.1f}", f"{first:.0f}"
            rows.append([said, f"{len(runs)}", *shares, f"{usual} ({words.count(usual)} of {len(words)})"])
    heads = ("runs", "the others arrive [%]", "without the fault [%]", "it arrives [%]", "it says, at the end")
    return table(("one robot has", *heads), rows)


def draw(found: Runs, folder: Path = FOLDER) -> None:
    shown = {
        "ours": _median_run(found["figure 11 ours"]),
        "the paper's state machine, retreat to the goal's side": _median_run(found["figure 11 paper"]),
    }
    ways({title: outcome for title, outcome in shown.items() if outcome is not None}, folder / "figure_11.png")
    named = {"ours": "ours"} | {f"the paper's, {retreat}": method for method, retreat in BASELINES.items()}
    arrivals({name: found[each] for name, each in named.items() if each in found}, folder / "arrivals.png")


def _median_run(runs: Found) -> Outcome | None:
    """Return that whose last robot arrives at the median of all; robots that do not count as late."""
    last = [np.nan_to_num(np.max(each.arrived), nan=np.inf) for each in runs.outcomes]
    return runs.outcomes[int(np.argsort(last)[len(last) // 2])] if last else None


def rows(small: bool) -> Iterator[Row]:
    found = find(conditions(FULL.at_most(1) if small else FULL), KEPT, workers=2)
    made = expected(FOLDER, figures_of(found, frames_a_second()))
    if not small:
        draw(found)
        fill(FOLDER, asked=asked(made, "paper"), **parts(found))
    yield from made
