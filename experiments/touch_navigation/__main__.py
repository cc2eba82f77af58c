"""`python -m experiments.touch_navigation [--seeds N] [--only NAME ...]`: figures 11 and 12, theirs beside ours.

Each run is kept in `.cache/touch_navigation.jsonl` as soon as it is done: whoever stops goes on there the next time,
until the code of navigation, arena or loop changes. README.md and its figures are written at the end, of what has been
run. All of it takes some eight hours of a core; --seeds 5 half an hour.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from fnmatch import fnmatch
from pathlib import Path

import numpy as np

from experiments.check import Check, checks_of
from experiments.touch_navigation.conditions import BASELINES, FAULTS, FULL, Condition, conditions
from experiments.touch_navigation.figures import arrivals, ways
from experiments.touch_navigation.page import differing, page, parts
from experiments.touch_navigation.study import Found, Outcome, frames_a_second
from experiments.touch_navigation.study import found as find
from palpate.errors import PalpateError
from palpate_lab.cli.arena_run import RATE

__all__ = ["checks", "figures_of", "main", "write"]

FOLDER = Path(__file__).parent
KEPT = FOLDER.parents[1] / ".cache/touch_navigation.jsonl"
PUSHED = 0.05  # m
_NONE = Found([])


def figures_of(found: Mapping[str, Found], sensed: float = float("nan")) -> dict[str, float]:
    """What expected.toml may ask of a run; NaN for what was not run. `sensed`: of `frames_a_second`."""
    eleven, ours, images = (found.get(name, _NONE) for name in ("figure 11 ours", "ours", "images"))
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
        **{method.replace("-", "_"): found.get(method, _NONE).robots for method in BASELINES},
        "dense": found.get("dense", _NONE).robots,
        "images": abs(images.robots - ours.of(images).robots),
        "images_speed": images.speed,
        "cameras": sensed / RATE,
        "again": differing(found),
        "fault": max((abs(each.healthy - ours.of(each).healthy) for each in faults), default=float("nan")),
    }


def checks(found: Mapping[str, Found], sensed: float = float("nan")) -> list[Check]:
    """All that expected.toml asks for, measured."""
    return checks_of(FOLDER / "expected.toml", figures_of(found, sensed))


def write(found: Mapping[str, Found], made: Sequence[Check], folder: Path = FOLDER) -> None:
    """The page and its figures."""
    shown = {
        "ours": _median_run(found.get("figure 11 ours", _NONE)),
        "the paper's state machine, retreat to the goal's side": _median_run(found.get("figure 11 paper", _NONE)),
    }
    ways({title: outcome for title, outcome in shown.items() if outcome is not None}, folder / "figure_11.png")
    named = {"ours": found.get("ours", _NONE)}
    named |= {f"the paper's, {retreat}": found.get(method, _NONE) for method, retreat in BASELINES.items()}
    arrivals({name: runs for name, runs in named.items() if len(runs)}, folder / "arrivals.png")
    (folder / "README.md").write_text(page(made, parts(found), found), encoding="utf-8")


def _median_run(runs: Found) -> Outcome | None:
    """That whose last robot arrives at the median of all; robots that do not count as late."""
    last = [np.nan_to_num(np.max(each.arrived), nan=np.inf) for each in runs.outcomes]
    return runs.outcomes[int(np.argsort(last)[len(last) // 2])] if last else None


def _wanted(seeds: int, only: Sequence[str]) -> list[Condition]:
    made = conditions(FULL.at_most(seeds))
    return [each for each in made if not only or any(fnmatch(each.name, pattern) for pattern in only)]


def main(arguments: Sequence[str] | None = None) -> int:
    """0 when everything that is asked for is met."""
    parser = argparse.ArgumentParser(prog="python -m experiments.touch_navigation", description=__doc__)
    parser.add_argument("--seeds", type=int, default=FULL.many, help="at most so many of each; default: %(default)s")
    parser.add_argument("--only", nargs="+", default=(), metavar="NAME", help="patterns of names, such as 'fault*'")
    parser.add_argument("--workers", type=int, default=2, help="processes, by joblib; 0: this one")
    parser.add_argument("--runs", type=Path, default=KEPT, help="where runs are kept")
    parser.add_argument("--any-code", action="store_true", help="take runs of other versions of the code, too")
    parser.add_argument("--kept", action="store_true", help="run nothing: the page of what was run before")
    parser.add_argument("--dry", action="store_true", help="print what is found, and write nothing")
    asked = parser.parse_args(arguments)
    try:
        wanted, code = _wanted(asked.seeds, asked.only), asked.any_code
        found = find(wanted, asked.runs, workers=asked.workers, any_code=code, only_kept=asked.kept)
    except KeyboardInterrupt:
        print("\nstopped; what was run is kept", file=sys.stderr)
        return 130
    except PalpateError as problem:
        print(f"touch navigation: {problem}", file=sys.stderr)
        return 1
    print(file=sys.stderr)
    made = checks(found, frames_a_second())
    for check in made:
        print(" | ".join(check.cells()))
    if asked.dry:
        print("\n\n".join(parts(found).values()))
    else:
        write(found, made)
    return 0 if all(check.met for check in made) else 1


if __name__ == "__main__":
    sys.exit(main())
