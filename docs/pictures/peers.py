"""The benchmark as a picture: how far from the truth Palpate and its peers answer, by task."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from drawing import DEEP, WARM, figure, run, save

LOW, HIGH = 0.006, 200.0  # mm
OTHERS = "#9aa3af"


def benchmark(folder: Path) -> None:
    """Each task of `palpate benchmark` in a row: distances within which half and 95 % of its contacts are found."""
    tasks, table = folder / "tasks", folder / "benchmark.md"
    if not tasks.exists():
        run("benchmark", "make", "-o", tasks)
    if not table.exists():
        run("benchmark", "score", tasks, "-o", table)
    made, *parts = re.split(r"^## ", table.read_text(encoding="utf-8"), flags=re.MULTILINE)
    drawn = figure(9.0, 6.2)
    axes = drawn.subplots()
    for place, part in enumerate(parts):
        task(axes, -float(place), rows(part))
    axes.set_yticks([-place for place in range(len(parts))], [part.split("\n", 1)[0] for part in parts])
    axes.set(xscale="log", xlim=(LOW, HIGH), xlabel="distance from the true contact [mm]")
    axes.grid(axis="x", color="0.9", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0)
    axes.plot([], [], "o-", color=DEEP, label="Palpate: half of all contacts (dot), 95 % (end)")
    axes.plot([], [], "o-", color=WARM, label="the peer with the least median, named")
    axes.plot([], [], "|", color=OTHERS, markersize=9, label="medians of the other peers")
    axes.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.45, 1.0), ncols=3, fontsize=8, columnspacing=1.2)
    drawn.supxlabel(re.sub(r"^.*?, full size; |`", "", made.strip()), fontsize=8, color="0.4")
    save(drawn, "benchmark")


def rows(part: str) -> list[tuple[str, float, float]]:
    """Name, median and 95 % [mm] of each entrant of a task; a miss is infinitely far."""
    _, _, *table = [line for line in part.splitlines() if line.startswith("|")]  # without its head
    cells = [[cell.strip().replace("miss", "inf") for cell in line.split("|")] for line in table]
    return [(row[1], float(row[3]), float(row[4])) for row in cells]


def task(axes: Any, place: float, entrants: list[tuple[str, float, float]]) -> None:
    """One row."""
    ours, *peers = entrants
    best = min(peers, key=lambda row: row[1:])
    for (name, median, most), shift, colour in ((ours, 0.26, DEEP), (best, 0.0, WARM)):
        y = place + shift
        axes.plot([min(median, HIGH), min(most, HIGH)], [y, y], "-", color=colour, linewidth=2.5, clip_on=False)
        beyond = median > HIGH  # an arrow at the edge
        axes.plot(min(median, HIGH), y, ">" if beyond else "o", color=colour, markersize=6, clip_on=False)
        if colour == WARM:
            text = re.sub(r", .*| \(.*", "", name) + (": most are missed" if median > HIGH else "")
            anchor, side = (min(most, HIGH) * 1.25, "left") if most < 10.0 else (min(median, HIGH) * 0.8, "right")
            axes.text(anchor, y, text, fontsize=8, color=colour, va="center", ha=side)
    medians = [row[1] for row in peers if row is not best and row[1] <= HIGH]
    axes.plot(medians, [place - 0.26] * len(medians), "|", color=OTHERS, markersize=8)
