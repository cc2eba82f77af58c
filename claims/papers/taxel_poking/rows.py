"""The `taxel poking` paper: where 84 taxels of a forearm sit, from the wrenches of pokes."""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from claims.page import asked, fill, table
from claims.papers.taxel_poking.study import ALONE, FIRST, Found, Session, alone, mean_of
from claims.row import Row, expected
from palpate.viewer._style import AXES, INK, MUTED, RULE, figure, save, styled

FOLDER = Path(__file__).parent
AVERAGED, NOTHING, CAD = "averaged, surface", "modules", "modules, CAD"
WAYS = ("free", "surface")
SINGLES = {"free": (8.1e-3, 18.5e-3), "surface": (5.2e-3, 19.3e-3)}  # m, least and largest mean of a dataset
FINAL = {"free": (4.2e-3, 10.2e-3), "surface": (3.7e-3, 9.5e-3)}  # m, final mean -+ its deviation over taxels
SAID_4 = {"free": "8.1 +- 4.2 to 18.5 +- 8.3", "surface": "5.2 +- 3.1 to 19.3 +- 13.1"}
SAID_5 = {"free": "7.2 +- 3 after all seven", "surface": "6.6 +- 2.9 after all seven"}


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
Sessions = dict[str, list[Found]]  # method -> of each session


@dataclass(frozen=True)
class Measured:
    """Everything that the page shows.

    Attributes:
        singles, running: "free" or "surface" -> of each session, of each dataset alone and of datasets 1 to n.
        together: with all errors.
        alone: error -> with that one.
        slow: the same as `together`, of fewer pokes.
    """

    singles: dict[str, list[list[Found]]]
    running: dict[str, list[list[Found]]]
    together: Sessions
    alone: dict[str, Sessions]
    slow: Sessions

    def averaged(self) -> list[Found]:
        """The paper's best way, of the sessions that `together` has."""
        return [run[-1] for run in self.running["surface"][: len(self.together[CAD])]]


def measured(sizes: Sizes) -> Measured:
    singles, running = ({way: list[list[Found]]() for way in WAYS} for _ in range(2))
    for seed in range(FIRST, FIRST + sizes.paper):
        for way in WAYS:
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


def _of(sessions: Sequence[Session], methods: Sequence[str]) -> Sessions:
    found = [session.together(methods) for session in sessions]
    return {name: [one[name] for one in found] for name in methods}


def figures_of(made: Measured) -> dict[str, float]:
    """What expected.toml may ask of a run: [m] but for ratios."""
    got = {f"{way}_averaged": mean_of([run[-1] for run in runs]) for way, runs in made.running.items()}
    for way, runs in made.singles.items():
        got[f"{way}_singles"] = mean_of([one for run in runs for one in run])
    theirs = mean_of(made.averaged())
    got |= {"modules": mean_of(made.together[NOTHING]), "modules_cad": mean_of(made.together[CAD])}
    got |= {"ratio": theirs / got["modules"], "ratio_cad": theirs / got["modules_cad"]}
    got["modules_relative"] = float(np.mean([found.relative for found in made.together[NOTHING]]))
    return got


def checks(made: Measured) -> list[Row]:
    return expected(FOLDER, figures_of(made), scale=lambda figure: 1.0 if "ratio" in figure else 1e3)


def parts(made: Measured) -> dict[str, object]:
    header = ("", *(str(k + 1) for k in range(len(made.singles["free"][0]))), "the paper's")
    return {
        "singles": table(header, [_bars(way, runs, SAID_4) for way, runs in made.singles.items()]),
        "running": table(header, [_bars(way, runs, SAID_5) for way, runs in made.running.items()]),
        "together": _methods({AVERAGED: made.averaged()} | made.together),
        "alone": "\n\n".join(f"### {name}\n\n{_methods(found)}" for name, found in made.alone.items()),
        "slow": _methods(made.slow),
    }


def _bars(way: str, runs: Sequence[Sequence[Found]], said: Mapping[str, str]) -> list[str]:
    """A row: mean and deviation over taxels, both averaged over sessions; in brackets the range of the means."""
    cells = list[str]()
    for column in zip(*runs, strict=True):
        means, deviations = ([1e3 * getattr(one, name) for one in column] for name in ("mean", "deviation"))
        cells.append(f"{np.mean(means):.1f} +- {np.mean(deviations):.1f} ({min(means):.1f}-{max(means):.1f})")
    return [way, *cells, said[way]]


def _methods(found: Mapping[str, Sequence[Found]]) -> str:
    """A row a method, and how many times better it is than the first."""
    first, rows = mean_of(next(iter(found.values()), [])), list[list[str]]()
    for name, runs in found.items():
        means = [1e3 * one.mean for one in runs]
        known = [one.expected**2 for one in runs if one.expected is not None]
        worst = 1e3 * max(one.worst for one in runs)
        cells = [f"{np.mean(means):.2f}", f"{min(means):.2f}-{max(means):.2f}", f"{worst:.1f}"]
        cells += [f"{1e3 * np.sqrt(np.mean([one.rms**2 for one in runs])):.2f}"]
        cells += [f"{1e3 * np.sqrt(np.mean(known)):.2f}" if known else ""]
        cells += [f"{1e3 * np.mean([one.relative for one in runs]):.2f}"]
        cells += [f"{1e3 * max(one.relative_worst for one in runs):.1f}", f"{1e3 * first / np.mean(means):.2f}"]
        rows.append([name, *cells])
    heads = ("mean", "of sessions", "worst", "rms", "expected", "relative", "worst", "times better")
    return table(("method", *heads), rows)


def bars(
    found: Mapping[str, Sequence[Sequence[Found]]], ranges: Mapping[str, tuple[float, float]], path: Path, label: str
) -> None:
    """Draw a panel a way: means of each session and dataset, and the paper's least and largest mean [m]."""
    with styled():
        drawn = figure(2.4)
        axes: Any = drawn.subplots(1, len(found), sharey=True)
        for part, (way, runs) in zip(axes, found.items(), strict=True):
            means, deviations = (
                np.array([[getattr(one, name) for one in run] for run in runs]) for name in ("mean", "deviation")
            )
            at = np.arange(1, means.shape[1] + 1)
            part.axhspan(*(1e3 * value for value in ranges[way]), color=RULE, linewidth=0)
            middle, spread = (1e3 * values.mean(axis=0) for values in (means, deviations))
            part.bar(at, middle, yerr=spread, color=AXES[2], width=0.6, error_kw={"linewidth": 0.7, "ecolor": MUTED})
            part.plot(np.tile(at, (len(means), 1)).T, 1e3 * means.T, ".", color=INK, markersize=2)
            part.set_title(way, color=MUTED)
            part.set_xticks(at)
            part.set_xlabel(label)
        axes[0].set_ylabel("error [mm]")
        save(drawn, path, "png")


def rows(small: bool) -> Iterator[Row]:
    """Twenty sessions of 2,000 pokes; small, two of 300."""
    begin, sizes = time.perf_counter(), SMALL if small else FULL
    made = measured(sizes)
    found = checks(made)
    if not small:
        bars(made.singles, SINGLES, FOLDER / "figure_4.png", "dataset")
        bars(made.running, FINAL, FOLDER / "figure_5.png", "datasets averaged")
        took = time.perf_counter() - begin
        fill(FOLDER, asked=asked(found, "paper"), took=took, pokes=f"{sizes.pokes:,}", **parts(made))
    yield from found
