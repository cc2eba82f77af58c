"""Draw the tracked bias of each channel over time with matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from palpate.viewer._style import AXES, MUTED, panels, plotted
from palpate.viewer.plots import clock_of, named, strip
from palpate.viewer.timeline import downsampled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_GATE = ("#009e73", "#9aa5b0")  # where the bias was tracked, and where it was kept
_SURE = 1.96  # deviations: 95 %
MOST, FEWEST = 1_400, 60  # points of all lines, and of one


@plotted
def zeros(
    time: Float[np.ndarray, " n"],
    zero: Float[np.ndarray, "n m"],
    deviation: Float[np.ndarray, "n m"],
    uncertain: Bool[np.ndarray, " n"],
) -> Figure:
    """Draw as a `Figure` each channel's change of bias, its 95 % band, and a strip of when the bias was tracked.

    Args:
        time: (n,) [s].
        zero: (n, m) bias: of six channels the first three in N and the others in N m, else V.
        deviation: (n, m) standard deviations of the bias.
        uncertain: (n,) True where something may have touched, so that the bias was not tracked.

    Raises:
        InputError: matplotlib is not installed; or arrays of other shapes.
    """
    clock, label = clock_of(time)
    parts, most = _parts(zero.shape[1]), max(MOST // max(zero.shape[1], 1), FEWEST)
    ratios = [5.0] * len(parts) + [0.55]
    drawn, below = panels(1.9 * len(parts) + 0.8, len(ratios), sharex=True, height_ratios=ratios)
    for axes, (channels, names, scale, quantity) in zip(below, parts, strict=False):
        for k, channel in enumerate(channels):
            gone = scale * (zero[:, channel] - _first(zero[:, channel]))
            band = _SURE * scale * deviation[:, channel]
            few, rows = downsampled(clock, np.column_stack([gone, gone - band, gone + band]), most)
            axes.fill_between(few, rows[:, 1], rows[:, 2], color=AXES[k % 3], alpha=0.2, linewidth=0)
            axes.plot(few, rows[:, 0], color=AXES[k % 3], label=names[k] if names else None)
        axes.set(ylabel=quantity)
        if names:
            named(axes, 3)
    strip(below[-1], clock, uncertain.astype(np.int64), _GATE)
    below[-1].set(xlabel=label)
    below[-1].set_ylabel("gate", rotation=0, ha="right", va="center", color=MUTED)
    drawn.align_ylabels()
    return drawn


def _parts(channels: int) -> list[tuple[range, tuple[str, ...], float, str]]:
    """Return for each panel its channels, their names, the factor of the unit, and the label."""
    if channels != 6:
        return [(range(channels), (), 1e3, "voltage [mV]")]
    return [
        (range(3), ("x", "y", "z"), 1.0, "zero of the force [N]"),
        (range(3, 6), ("x", "y", "z"), 1e3, "of the torque [N mm]"),
    ]


def _first(values: Float[np.ndarray, " n"]) -> float:
    known = values[np.isfinite(values)]
    return float(known[0]) if len(known) else 0.0
