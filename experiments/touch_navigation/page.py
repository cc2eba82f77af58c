"""README.md of this folder: theirs beside ours, what was asked, what differs and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from evidence.machine import machine
from experiments.check import Check, table
from experiments.touch_navigation.conditions import ABLATIONS, BASELINES, BUILT, COUNTS, FAULTS, JUDGED, LIMIT, TRAPS
from experiments.touch_navigation.study import Found
from palpate.control.touch_navigator import DOUBT

__all__ = ["FIGURE_11", "differing", "page", "parts"]

FIGURE_11 = (130.0, 156.0, 169.0, 182.0)  # s, in which robots 2, 3, 4 and 1 of the paper arrived
_NONE = Found([])


def parts(found: Mapping[str, Found]) -> dict[str, str]:
    """Name in the page -> Markdown."""
    return {
        "eleven": _figure_11(found),
        "many": _many(found),
        "harder": _harder(found),
        "ablation": _ablation(found),
        "images": _images(found),
        "scale": _scale(found),
        "faults": _faults(found),
        "again": _again(found),
    }


_HEADS = ("robots that arrive [%]", "all of them [% of runs]", "median [s]", "way [m]", "force, 99 % [N]", "most [N]")
_LESS = ("pushes a run", "deadlocks a run")


def _cells(runs: Found) -> list[str]:
    if not len(runs):
        return ["not run"] + [""] * (len(_HEADS) + len(_LESS))
    first = f"{runs.robots:.1f}", f"{runs.whole:.0f}", _number(runs.median, 0), _number(runs.path, 1)
    forces = _number(runs.force(), 2), f"{runs.greatest:.1f}"
    return [f"{len(runs)}", *first, *forces, f"{runs.pushes:.1f}", f"{runs.deadlocks:.1f}"]


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else "-"


def _compared(first: str, rows: Mapping[str, Found]) -> str:
    return table((first, "runs", *_HEADS, *_LESS), [[name, *_cells(runs)] for name, runs in rows.items()])


def _of(found: Mapping[str, Found], name: str) -> Found:
    return found.get(name, _NONE)


def _baselines(found: Mapping[str, Found], before: str = "", after: str = "") -> dict[str, Found]:
    return {
        f"the paper's, retreat {retreat}": _of(found, f"{before}{method}{after}")
        for method, retreat in BASELINES.items()
    }


def _figure_11(found: Mapping[str, Found]) -> str:
    rows = [["the paper, one run", *[f"{time:.0f}" for time in FIGURE_11], "100", "1", "pushed"]]
    named = {"ours": _of(found, "figure 11 ours"), **_baselines(found, "figure 11 ")}
    for name, runs in named.items():
        if not len(runs):
            continue
        times = np.sort(np.array([each.arrived for each in runs.outcomes]), axis=1)  # NaN last
        cells = list[str]()
        for column in times.T:
            there = column[np.isfinite(column)]
            ranged = f"{np.median(there):.0f} ({there.min():.0f}-{there.max():.0f})" if len(there) else "-"
            cells.append(ranged if len(there) in (0, len(column)) else f"{ranged}, {len(there)} of {len(column)}")
        moved = [1e3 * each.blocks for each in runs.outcomes]
        pushed = f"by {np.median(moved):.0f} mm ({min(moved):.0f}-{max(moved):.0f})"
        rows.append([name, *cells, f"{runs.whole:.0f}", f"{len(runs)}", pushed])
    return table(("arrived [s]", "first", "second", "third", "fourth", "all four [% of runs]", "runs", "box"), rows)


def _many(found: Mapping[str, Found]) -> str:
    ours = _of(found, "ours")
    same = ours.of(_of(found, "paper"))
    rows = {"ours": ours, "ours, the arenas of the rows below": same, **_baselines(found)}
    rows |= {
        "the same, one robot alone (to the goal's side)": _of(found, "paper alone"),
        "the same, binary touch": _of(found, "paper binary touch"),
    }
    sparse = {"ours": _of(found, "ours sparse"), **_baselines(found, after=" sparse")}
    return _compared("the paper's density", rows) + "\n\n" + _compared("half of its blocks", sparse)


def _harder(found: Mapping[str, Found]) -> str:
    rows = {"1.6 times the blocks, ours": _of(found, "dense")}
    for trap, said in TRAPS.items():
        rows |= {f"{said}, ours": _of(found, f"trap {trap}"), f"{said}, the paper's": _of(found, f"trap {trap} paper")}
    return _compared("", rows)


def _ablation(found: Mapping[str, Found]) -> str:
    first = _of(found, next(iter(ABLATIONS)))
    rows = {"ours": _of(found, "ours").of(first), **{name: _of(found, name) for name in ABLATIONS}}
    return _compared("the same arenas", rows)


def _images(found: Mapping[str, Found]) -> str:
    images = _of(found, "images")
    rows = {"the skin's deformation": _of(found, "ours").of(images), "images": images}
    text = _compared("the same arenas", rows)
    speeds = ", ".join(f"{_number(each.speed, 1)} ({name})" for name, each in rows.items() if len(each))
    return f"{text}\n\nSimulated seconds in a second of a core, four robots: {speeds}."


def _scale(found: Mapping[str, Found]) -> str:
    rows = list[list[str]]()
    for count in COUNTS:
        runs = _of(found, f"{count} robots")
        if len(runs):
            speed = f"{runs.speed:.1f}", f"{runs.speed * count:.0f}"
            rows.append([f"{count}", f"{len(runs)}", f"{runs.robots:.1f}", _number(runs.median, 0), *speed])
    heads = ("robots", "runs", _HEADS[0], "median [s]", "simulated seconds in one of a core", "times robots")
    return table(heads, rows)


def _faults(found: Mapping[str, Found]) -> str:
    rows = list[list[str]]()
    for fault, said in FAULTS.items():
        runs = _of(found, f"fault {fault}")
        if not len(runs):
            continue
        without = _of(found, "ours").of(runs)
        words = [DOUBT if DOUBT in each.states[0] else each.states[0] for each in runs.outcomes]
        usual = max(dict.fromkeys(words), key=words.count)
        first = 100.0 * np.mean([each.there[0] for each in runs.outcomes])
        shares = f"{runs.healthy:.1f}", f"{without.healthy:.1f}", f"{first:.0f}"
        rows.append([said, f"{len(runs)}", *shares, f"{usual} ({words.count(usual)} of {len(words)})"])
    heads = (
        "one robot has",
        "runs",
        "the others arrive [%]",
        "without the fault [%]",
        "it arrives [%]",
        "it says, at the end",
    )
    return table(heads, rows)


def differing(found: Mapping[str, Found]) -> float:
    """How many of the runs that were run again came out otherwise; NaN where none was."""
    digests = [[each.digest for each in _of(found, name).outcomes] for name in ("again 1", "again 2")]
    pairs = list(zip(*digests, strict=True))
    return float(sum(one != other for one, other in pairs)) if pairs else float("nan")


def _again(found: Mapping[str, Found]) -> str:
    count = len(_of(found, "again 1"))
    return f"{count} seeds were run twice, in whatever process was free: {differing(found):.0f} came out otherwise."


def page(checks: Sequence[Check], tables: Mapping[str, str], found: Mapping[str, Found]) -> str:
    """The whole page.

    Args:
        checks: what was asked.
        tables: of `parts`.
        found: of all conditions.
    """
    asked = table(("figure", "paper", "got", "asked", ""), [check.cells() for check in checks])
    runs = [each for name in found.values() for each in name.outcomes]
    took, stamps = sum(each.took for each in runs), {each.stamp for each in runs}
    said = [*machine(), f"{len(runs)} runs, {took / 60.0:.0f} minutes of a core"]
    if len(stamps) > 1:
        said.append(f"the runs are of {len(stamps)} versions of the code (`--any-code`)")
    lines = "\n".join(f"- {line}" for line in said)
    return _PAGE.format(asked=asked, machine=lines, judged=JUDGED, built=BUILT.stop - 1, limit=LIMIT, **tables)


_PAGE = """# Robots that find their way by touch: figures 11 and 12 of `marker ring`

Written by `python -m experiments.touch_navigation`; what it asks for stands in [expected.toml](expected.toml).

{machine}

The paper has four robots of 110 mm with the soft ring on Zumo tracks, a field with fixed and movable boxes, and an
optical tracker. Here they stand in a physics engine (`palpate_lab.simulation.arena`): tracks with limited grip, a skin
of 500 N/m with friction, boxes that slide; the engine's contacts deform the simulated skin, whose markers are seen with
the detector's noise (fast mode) or through its camera's frames and the real detector (images). Position is a
tracker's, for the direction of the goal and the speed. Every random arena can be crossed by a disc of the robot's
size (a planner that sees the map says so). A run ends when all have arrived, or after {limit:.0f} s.

**The paper's** is `palpate.PaperNavigator`: figure 10, tables I and II. What the paper leaves open is a named reading
of `PaperSettings`; the one that matters, which way V_A turns after a retreat, is shown in three readings. **Ours** is
`palpate.TouchNavigator` with its defaults. Seeds 0 to {built} were looked at while building; what is judged here begins
at {judged}, and nothing was chosen on it.

*Force* is the strongest contact of a robot, in 99 % of the time in which something touches it, all runs together. A
*push* is one on purpose, that moved something. A *deadlock*: less than 50 mm in half a minute on the way.

## What was asked

{asked}

## Figures 11 and 12

The paper shows one run in one arena and does not give its measures; this arena is like it, so its times stand beside
the paper's and are not to be matched. Runs differ in noise. Medians, and the range.

{eleven}

![ways](figure_11.png)

## Many arenas

{many}

![who arrived by when](arrivals.png)

## Harder

{harder}

## What each part is worth

{ablation}

## Through images

{images}

## How many robots

The field grows with their number.

{scale}

## Faults

The first robot has one, from 10 s on or from the start; the others know nothing of it.

{faults}

## The same again

{again}

## What differs, and why

- **The paper's state machine** has no memory: a retreat of one second and a second along what it touched do not lead
  round a box that is wider than that, nor out of a corner, and it comes back to the same place. One run in one arena,
  as the paper has, is no rate.
- **Its retreat.** "V_A is defined by rotating V_B by 90 deg" leaves open which way: three readings, side by side.
- **Times** of the paper are those of its own arena, speeds and boxes, of which it gives none.
"""
