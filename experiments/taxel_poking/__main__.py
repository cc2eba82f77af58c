"""`python -m experiments.taxel_poking [--small]`: figures 4 and 5 beside ours, one error at a time, into README.md.

With --small few sessions of few pokes are made and printed, and nothing is written.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices are small: threads cost more than they save

import numpy as np

from experiments.check import Check, checks_of, table
from experiments.taxel_poking import figures
from experiments.taxel_poking.page import FINAL, SAID_4, SAID_5, SINGLES, page
from experiments.taxel_poking.study import ALONE, FIRST, Found, Session, alone, mean_of

__all__ = ["FULL", "SMALL", "Measured", "Sizes", "checks", "main", "measured"]

FOLDER = Path(__file__).parent
AVERAGED, NOTHING, CAD = "averaged, surface", "modules", "modules, CAD"


@dataclass(frozen=True)
class Sizes:
    """How much is done.

    Args:
        pokes: of a session.
        paper: sessions for the paper's ways, which are quick.
        modules: of these, for modules.
        alone: sessions with one error.
        taxels: sessions for the estimate taxel by taxel, which is slow; slow: their pokes.
    """

    pokes: int
    paper: int
    modules: int
    alone: int
    taxels: int
    slow: int


FULL, SMALL = Sizes(2000, 20, 20, 3, 2, 500), Sizes(300, 2, 1, 0, 0, 0)


@dataclass(frozen=True)
class Measured:
    """Everything that the page shows.

    Attributes:
        singles, running: "free" or "surface" -> of each session, of each dataset alone and of datasets 1 to n.
        together: method -> of each session, with all errors.
        alone: error -> method -> of each session.
        slow: the same as `together`, of fewer pokes.
    """

    singles: dict[str, list[list[Found]]]
    running: dict[str, list[list[Found]]]
    together: dict[str, list[Found]]
    alone: dict[str, dict[str, list[Found]]]
    slow: dict[str, list[Found]]


def measured(sizes: Sizes) -> Measured:
    """All sessions."""
    singles, running = ({"free": list[list[Found]](), "surface": list[list[Found]]()} for _ in range(2))
    for seed in range(FIRST, FIRST + sizes.paper):
        for way in singles:
            one, mean = Session(seed, sizes.pokes).averaged(surface=way == "surface")
            singles[way].append(one)
            running[way].append(mean)
    seeds = range(FIRST, FIRST + sizes.modules)
    together = _of([Session(seed, sizes.pokes) for seed in seeds], ("pooled, free", "pooled", NOTHING, CAD))
    single = {
        name: _of([Session(FIRST + k, sizes.pokes, alone(name)) for k in range(sizes.alone)], (AVERAGED, NOTHING, CAD))
        for name in (ALONE if sizes.alone else ())
    }
    few = [Session(FIRST + k, sizes.slow) for k in range(sizes.taxels)]
    return Measured(singles, running, together, single, _of(few, (AVERAGED, "taxels", "taxels, CAD") if few else ()))


def _of(sessions: Sequence[Session], methods: Sequence[str]) -> dict[str, list[Found]]:
    found = [session.together(methods) for session in sessions]
    return {name: [one[name] for one in found] for name in methods}


def figures_of(made: Measured) -> dict[str, float]:
    """What expected.toml may ask of a run: [m] but for ratios."""
    got = {f"{way}_averaged": mean_of([run[-1] for run in runs]) for way, runs in made.running.items()}
    for way, runs in made.singles.items():
        got[f"{way}_singles"] = mean_of([one for run in runs for one in run])
    theirs = mean_of([run[-1] for run in made.running["surface"][: len(made.together[CAD])]])
    got |= {"modules": mean_of(made.together[NOTHING]), "modules_cad": mean_of(made.together[CAD])}
    got |= {"ratio": theirs / got["modules"], "ratio_cad": theirs / got["modules_cad"]}
    got["modules_relative"] = float(np.mean([found.relative for found in made.together[NOTHING]]))
    return got


def checks(made: Measured) -> list[Check]:
    """All that expected.toml asks for, measured."""
    return checks_of(FOLDER / "expected.toml", figures_of(made), scale=lambda figure: 1.0 if "ratio" in figure else 1e3)


def main() -> int:
    """0 when everything that is asked for is met."""
    parser = argparse.ArgumentParser(prog="python -m experiments.taxel_poking", description=__doc__)
    parser.add_argument("--small", action="store_true", help="few sessions of few pokes; nothing is written")
    small = parser.parse_args().small
    sizes = SMALL if small else FULL
    begin = time.perf_counter()
    made = measured(sizes)
    found = checks(made)
    for check in found:
        print(" | ".join(check.cells()))
    if not small:
        _write(made, found, sizes, time.perf_counter() - begin)
    return 0 if all(check.met for check in found) else 1


def _write(made: Measured, found: Sequence[Check], sizes: Sizes, took: float) -> None:
    for name, runs, theirs, label in (
        ("figure_4", made.singles, SINGLES, "dataset"),
        ("figure_5", made.running, FINAL, "datasets averaged"),
    ):
        panels = [
            (
                way,
                np.array([[one.mean for one in run] for run in values]),
                np.array([[one.deviation for one in run] for run in values]),
                theirs[way],
            )
            for way, values in runs.items()
        ]
        figures.bars(panels, FOLDER / f"{name}.png", label=label)
    (FOLDER / "README.md").write_text(page(found, _tables(made, sizes), took, sizes.pokes), encoding="utf-8")


def _tables(made: Measured, sizes: Sizes) -> dict[str, str]:
    """Name in the page -> Markdown."""
    datasets = [str(k + 1) for k in range(len(made.singles["free"][0]))]
    return {
        "singles": table(
            ("", *datasets, "the paper's"), [_bars(way, runs, SAID_4) for way, runs in made.singles.items()]
        ),
        "running": table(
            ("", *datasets, "the paper's"), [_bars(way, runs, SAID_5) for way, runs in made.running.items()]
        ),
        "together": _methods({AVERAGED: _last(made, sizes.modules)} | made.together),
        "alone": "\n\n".join(f"### {name}\n\n{_methods(found)}" for name, found in made.alone.items()),
        "slow": _methods(made.slow),
    }


def _last(made: Measured, count: int) -> list[Found]:
    return [run[-1] for run in made.running["surface"][:count]]


def _bars(way: str, runs: Sequence[Sequence[Found]], said: Mapping[str, str]) -> list[str]:
    """A row: mean and deviation over taxels, both averaged over sessions; in brackets the range of the means."""
    cells = list[str]()
    for column in zip(*runs, strict=True):
        means, deviations = ([1e3 * getattr(one, name) for one in column] for name in ("mean", "deviation"))
        cells.append(f"{np.mean(means):.1f} +- {np.mean(deviations):.1f} ({min(means):.1f}-{max(means):.1f})")
    return [way, *cells, said[way]]


def _methods(found: Mapping[str, Sequence[Found]]) -> str:
    """A row a method, and how many times better it is than the first."""
    first = mean_of(next(iter(found.values()), []))
    rows = list[list[str]]()
    for name, runs in found.items():
        means = [1e3 * one.mean for one in runs]
        worst, relative, left = (
            1e3 * max(one.worst for one in runs),
            1e3 * np.mean([one.relative for one in runs]),
            1e3 * max(one.relative_worst for one in runs),
        )
        rms = 1e3 * np.sqrt(np.mean([one.rms**2 for one in runs]))
        known = [one.expected**2 for one in runs if one.expected is not None]
        expected = f"{1e3 * np.sqrt(np.mean(known)):.2f}" if known else ""
        cells = [f"{np.mean(means):.2f}", f"{min(means):.2f}-{max(means):.2f}", f"{worst:.1f}"]
        cells += [f"{rms:.2f}", expected]
        rows.append([name, *cells, f"{relative:.2f}", f"{left:.1f}", f"{1e3 * first / np.mean(means):.2f}"])
    return table(
        ("method", "mean", "of sessions", "worst", "rms", "expected", "relative", "worst", "times better"), rows
    )


if __name__ == "__main__":
    sys.exit(main())
