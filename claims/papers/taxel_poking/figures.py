"""Figures 4 and 5, ours: bars of the mean error a dataset, and after averaging; the paper's range in grey."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from claims.papers.taxel_poking.study import Found
from palpate.viewer._style import AXES, INK, MUTED, RULE, figure, save, styled


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
