"""A page about many runs in the arena: arrivals, times, forces, and the commands that show the failures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from palpate.viewer._style import AXES, INK, figure, plotted
from palpate.viewer.report import Report, ReportTable, Section, Tile, first_rows, percent, picture
from palpate.viewer.samples import median
from palpate_lab.simulation.arena.moment import ArenaResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN = 200  # runs in the table of all
GOOD, POOR = 0.95, 0.7  # shares of the robots


def figures(runs: Sequence[ArenaResult]) -> list[tuple[str, str, float]]:
    """Return a list of (name, text, number), one for each summary figure of many runs.

    Args:
        runs: at least one run.
    """
    times, total = _times(runs), sum(len(run.arrived) for run in runs)
    whole, there = float(np.mean([run.complete for run in runs])), len(times) / total
    last = median(np.array([max(run.arrived) if run.complete else np.nan for run in runs]))
    force = np.array([run.force for run in runs])
    greatest = max(max(run.greatest) for run in runs)
    pushes, deadlocks = sum(sum(run.pushes) for run in runs), sum(sum(run.deadlocks) for run in runs)
    return [
        ("all arrive", f"{percent(whole)} of {len(runs)} runs", whole),
        ("robots arrive", f"{percent(there)} of {total} robots", there),
        ("median time", f"{_number(median(times))} s, of those that arrive", median(times)),
        ("last robot", f"{_number(last)} s, median of the runs in which all arrive", last),
        ("force", f"{_number(median(force), 2)} N at 99 % of a run's contact time, median of the runs", median(force)),
        ("force, worst run", f"{_number(float(force.max()), 2)} N likewise", float(force.max())),
        ("greatest force", f"{_number(greatest, 2)} N", greatest),
        ("pushes", f"{pushes}", float(pushes)),
        ("deadlocks", f"{deadlocks}", float(deadlocks)),
    ]


def compose(
    runs: Sequence[ArenaResult], settings: tuple[tuple[str, str], ...], command: Callable[[int], str]
) -> Report:
    """Compose the page about many runs, a `Report`.

    Args:
        runs: at least one run.
        settings: settings that all runs share, as names and values.
        command: returns the command that shows the run of a seed.

    Raises:
        InputError: matplotlib is not installed.
    """
    found = {name: (text, value) for name, text, value in figures(runs)}
    seeds = f"seed {runs[0].seed}" if len(runs) == 1 else f"seeds {runs[0].seed} to {runs[-1].seed}"
    facts = tuple((name, text) for name, (text, _) in found.items())
    sections = (
        Section("In figures", settings=facts),
        _over_time(runs),
        _failures(runs, command),
        Section("All runs", tables=(_table(runs),)),
        Section("Settings", settings=settings),
    )
    return Report(
        title="Robots that find their way by touch",
        summary=f"{len(runs)} runs in the simulated arena, {seeds}, {len(runs[0].arrived)} robots each.",
        tiles=_tiles(found),
        sections=tuple(section for section in sections if section),
        footer="Times are of the simulated clock. Forces are what the physics engine says, not what robots felt.",
    )


def _tiles(found: dict[str, tuple[str, float]]) -> tuple[Tile, ...]:
    whole, there = found["all arrive"][1], found["robots arrive"][1]
    return (
        Tile("robots arrive", percent(there), found["robots arrive"][0].partition(" % ")[2], _tone(there)),
        Tile("all arrive", percent(whole), found["all arrive"][0].partition(" % ")[2], _tone(whole)),
        Tile("median time", f"{_number(found['median time'][1])} s", "of those that arrive"),
        Tile("force", f"{_number(found['force'][1], 2)} N", "at 99 % of the contact time"),
        Tile("pushes", found["pushes"][0]),
        Tile("deadlocks", found["deadlocks"][0]),
    )


def _tone(share: float) -> str:
    return "good" if share >= GOOD else "poor" if share < POOR else ""


def _times(runs: Sequence[ArenaResult]) -> Float[np.ndarray, " n"]:
    """Return the arrival times [s] of all robots that arrived."""
    times = np.array([time for run in runs for time in run.arrived], dtype=np.float64)
    return times[np.isfinite(times)]


def _number(value: float, digits: int = 0) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else "-"


def _over_time(runs: Sequence[ArenaResult]) -> Section:
    times = _times(runs)
    if not len(times):
        return Section("When they arrive", text=("No robot arrived.",))
    drawn = arrivals(times)
    return Section("When they arrive", pictures=(picture(drawn, "Robots that arrived, by the time they took."),))


@plotted
def arrivals(times: Float[np.ndarray, " n"]) -> Figure:
    """Draw a histogram of arrival times (n,) [s], at least one, as a `Figure` of matplotlib.

    Raises:
        InputError: matplotlib is not installed.
    """
    drawn = figure(2.6)
    axes: Any = drawn.subplots()
    step = 10.0 if times.max() <= 400.0 else 50.0
    axes.hist(times, np.arange(0.0, times.max() + 2 * step, step), color=AXES[2], alpha=0.8)
    middle = float(np.median(times))
    axes.axvline(middle, color=INK, linewidth=1.0)
    axes.annotate(f" median {middle:.0f} s", (middle, 1.0), xycoords=("data", "axes fraction"), va="top", fontsize=8.5)
    axes.set(xlabel="time until it arrives [s]", ylabel="robots", xlim=(0, None))
    axes.yaxis.get_major_locator().set_params(integer=True)
    return drawn


def _failures(runs: Sequence[ArenaResult], command: Callable[[int], str]) -> Section:
    """List each robot that did not arrive, its last state, and the command that shows it."""
    rows = [
        (f"{run.seed}", f"{robot + 1}", state, command(run.seed))
        for run in runs
        for robot, (time, state) in enumerate(zip(run.arrived, run.state, strict=True))
        if not np.isfinite(time)
    ]
    if not rows:
        return Section("Robots that do not arrive", text=("None.",))
    table = first_rows(("seed", "robot", "in the end", "to see it"), rows, SHOWN)
    return Section("Robots that do not arrive", tables=(table,))


def _table(runs: Sequence[ArenaResult]) -> ReportTable:
    header = ("seed", "arrive", "last [s]", "way [m]", "force 99 % [N]", "greatest [N]", "pushes", "deadlocks")
    rows = [
        (
            f"{run.seed}",
            f"{run.count} of {len(run.arrived)}",
            _number(max(run.arrived) if run.complete else np.nan, 1),
            f"{sum(run.path):.2f}",
            f"{run.force:.2f}",
            f"{max(run.greatest):.2f}",
            f"{sum(run.pushes)}",
            f"{sum(run.deadlocks)}",
        )
        for run in runs
    ]  # fmt: skip
    return first_rows(header, rows, SHOWN)
