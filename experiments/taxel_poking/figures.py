"""Figures 4 and 5, ours: bars of the mean error a dataset, and after averaging; the paper's range in grey."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.viewer._style import AXES, INK, MUTED, RULE, figure, save, styled

__all__ = ["bars"]


def bars(panels: Sequence[tuple[str, np.ndarray, np.ndarray, tuple[float, float]]], path: Path, *, label: str) -> None:
    """A panel a method.

    Args:
        panels: title, means (seeds, datasets) [m], deviations over taxels (seeds, datasets) [m], and the paper's least
            and largest mean [m].
        path: of the png.
        label: of the axis of datasets.
    """
    with styled():
        drawn = figure(2.4)
        axes: Any = drawn.subplots(1, len(panels), sharey=True)
        for part, (title, means, deviations, theirs) in zip(axes, panels, strict=True):
            at = np.arange(1, means.shape[1] + 1)
            part.axhspan(*(1e3 * value for value in theirs), color=RULE, linewidth=0)
            middle, spread = (1e3 * values.mean(axis=0) for values in (means, deviations))
            part.bar(at, middle, yerr=spread, color=AXES[2], width=0.6, error_kw={"linewidth": 0.7, "ecolor": MUTED})
            part.plot(np.tile(at, (len(means), 1)).T, 1e3 * means.T, ".", color=INK, markersize=2)
            part.set_title(title, color=MUTED)
            part.set_xticks(at)
            part.set_xlabel(label)
        axes[0].set_ylabel("error [mm]")
        save(drawn, path, "png")
