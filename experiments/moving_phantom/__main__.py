"""`python -m experiments.moving_phantom [--small]`: tables I and II and figure 10, theirs beside ours, into README.md.

With --small one seed is run, what is found is printed, and nothing is written. Takes a quarter of an hour on two cores.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from experiments.check import Check, checks_of
from experiments.moving_phantom.conditions import BIAS, DIRECTIONS, FULL, PERIODS, STEP, Sizes, sections
from experiments.moving_phantom.figures import figure_10
from experiments.moving_phantom.page import page, parts, robust, stop
from experiments.moving_phantom.study import SKIPPED, Found, traces

__all__ = ["checks", "figures_of", "main", "write"]

FOLDER = Path(__file__).parent


def figures_of(found: Mapping[str, Found]) -> dict[str, float]:
    """What expected.toml may ask of a run: degrees, newtons, seconds, ratios."""
    got = {
        f"{method}_{way}_{period}": found[f"{method} {way} {period}"].mean
        for method in ("paper", "ours")
        for way in DIRECTIONS
        for period in PERIODS
    }
    got |= {"paper_vertical": found["paper vertical 10"].off(), "vertical": found["ours vertical"].off()}
    got["vertical_start"] = found["ours vertical"].off(0.0, SKIPPED)
    got["vertical_stiff"] = found["ours vertical stiff"].off(0.0, SKIPPED)
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
    got["robust"] = max(max(ratios) for ratios in robust(found).values())
    stops = [stop(found[f"drift stops {way}"].traces[0]) for way in DIRECTIONS]
    got["drift_stopped"] = float(sum(each is not None for each in stops))
    got["drift_true"] = max((each[1] for each in stops if each is not None), default=float("nan"))
    return got


def checks(found: Mapping[str, Found]) -> list[Check]:
    """All that expected.toml asks for, measured."""
    return checks_of(FOLDER / "expected.toml", figures_of(found), theirs=("paper", "human"))


def write(found: Mapping[str, Found], took: float) -> None:
    """The page and its figure."""
    panels = {
        title: [found[name].traces[0] for name in names]
        for title, names in {
            "vertical": ("paper vertical 10", "ours vertical"),
            "in-plane": ("paper in-plane 10", "ours in-plane 10"),
            "out-of-plane": ("paper out-of-plane 10", "ours out-of-plane 10"),
        }.items()
    }
    figure_10(panels, FOLDER / "figure_10.png")
    runs = int(np.sum([len(each.traces) for each in found.values()]))
    text = page(checks(found), parts(found), took, runs)
    (FOLDER / "README.md").write_text(text, encoding="utf-8")


def main() -> int:
    """0 when everything that is asked for is met."""
    parser = argparse.ArgumentParser(prog="python -m experiments.moving_phantom", description=__doc__)
    parser.add_argument("--small", action="store_true", help="one seed; nothing is written")
    small = parser.parse_args().small
    begin = time.monotonic()
    try:
        found = traces(sections(Sizes(1, 1) if small else FULL))
    except KeyboardInterrupt:
        print("\nstopped; nothing is written", file=sys.stderr)
        return 130
    made = checks(found)
    for check in made:
        print(" | ".join(check.cells()))
    if small:
        print("\n\n".join(parts(found).values()))
    else:
        write(found, time.monotonic() - begin)
    return 0 if all(check.met for check in made) else 1


if __name__ == "__main__":
    sys.exit(main())
