"""Ways of four robots through the arena of figure 11, and who arrived by when in many arenas."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from claims.papers.touch_navigation.conditions import LIMIT, arena_settings
from claims.papers.touch_navigation.study import Found, Outcome
from palpate.viewer._style import AXES, INK, MUTED, RULE, figure, save, styled
from palpate_lab.simulation.arena.layout import ArenaLayout, Block

COLOURS = (*AXES, "#cc79a7")


def ways(panels: Mapping[str, Outcome], path: Path) -> None:
    """The arena from above, a panel a run: ways of the robots, fixed blocks, movable ones before and after.

    Args:
        panels: title -> a traced run.
        path: of the png.
    """
    if not panels:  # it was not run
        return
    with styled():
        drawn = figure(3.2 * len(panels))
        axes: Any = np.atleast_1d(drawn.subplots(len(panels), 1, sharex=True))
        for axis, (title, outcome) in zip(axes, panels.items(), strict=True):
            layout = arena_settings(outcome.condition).layout
            _arena(axis, layout, outcome)
            for k, flat in enumerate(outcome.ways):
                way, colour = np.reshape(flat, (-1, 3)), COLOURS[k % len(COLOURS)]
                when = outcome.arrived[k]
                said = f"robot {k + 1}: {when:.0f} s" if np.isfinite(when) else f"robot {k + 1}: not"
                axis.plot(way[:, 0], way[:, 1], color=colour, linewidth=0.8, label=said)
                axis.plot(way[0, 0], way[0, 1], "o", color=colour, markersize=4)
                axis.plot(*layout.goals[k], "x", color=colour, markersize=6)
            axis.set_title(title, color=MUTED)
            axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
        axes[-1].set_xlabel("[m]")
        save(drawn, path, "png")


def _arena(axis: Any, layout: ArenaLayout, outcome: Outcome) -> None:
    width, height = layout.size
    axis.set_aspect("equal")
    axis.set_xlim(0.0, width)
    axis.set_ylim(0.0, height)
    axis.grid(visible=False)
    for block in layout.blocks:
        if block.mass is None:
            axis.add_patch(_patch(block.corners(), facecolor=RULE, edgecolor=MUTED))
    if not outcome.boxes:
        return
    before, after = (np.reshape(flat, (-1, 3)) for flat in outcome.boxes)
    for block, was, now in zip(layout.movable, before, after, strict=True):
        axis.add_patch(_patch(_corners(block, was), fill=False, edgecolor=MUTED, linestyle=":"))
        axis.add_patch(_patch(_corners(block, now), facecolor="#e8d9b5", edgecolor=INK))


def _corners(block: Block, place: np.ndarray) -> Float[np.ndarray, "4 2"]:
    x, y, turn = place.tolist()
    return Block(x, y, turn, block.half).corners()


def _patch(corners: np.ndarray, **looks: Any) -> Any:
    from matplotlib.patches import Polygon

    return Polygon(corners, linewidth=0.7, **looks)


def arrivals(found: Mapping[str, Found], path: Path) -> None:
    """The share of robots that had arrived by a time, a line a name.

    Args:
        found: label -> runs.
        path: of the png.
    """
    with styled():
        drawn = figure(2.8)
        axis: Any = drawn.subplots()
        for k, (name, runs) in enumerate(found.items()):
            count = sum(len(each.arrived) for each in runs.outcomes)
            times = np.concatenate([[0.0], runs.times, [LIMIT]])
            share = 100.0 * np.concatenate([np.arange(len(runs.times) + 1), [len(runs.times)]]) / max(count, 1)
            colours = (AXES[2], AXES[0], "#e69f00", "#cc79a7", AXES[1])
            axis.step(times, share, where="post", color=colours[k % 5], linewidth=1.0, label=name)
        axis.set_xlabel("time [s]")
        axis.set_ylabel("robots that have arrived [%]")
        axis.set_xlim(0.0, LIMIT)
        axis.set_ylim(0.0, 102.0)
        axis.legend(loc="center right")
        save(drawn, path, "png")
