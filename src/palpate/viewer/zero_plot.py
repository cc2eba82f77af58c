"""Draw the tracked bias of each channel over time with matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float

from palpate.spatial.arguments import takes_arrays
from palpate.viewer._style import AXES, MUTED, figure, styled
from palpate.viewer.plots import COLUMNS, named
from palpate.viewer.timeline import downsampled, since

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["zeros"]

_FREE, _HELD = "#009e73", "#9aa5b0"
_SURE = 1.96  # deviations: 95 %
MOST, FEWEST = 1_400, 60  # points of all lines, and of one


@takes_arrays
@styled()
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
        uncertain: (n,) True where something touched, or may have, so that the bias was not tracked.

    Raises:
        InputError: matplotlib is not installed.
    """
    start, after = since(time)
    parts, most = _parts(zero.shape[1]), max(MOST // max(zero.shape[1], 1), FEWEST)
    drawn = figure(1.9 * len(parts) + 0.8)
    below: Any = drawn.subplots(len(parts) + 1, 1, sharex=True, height_ratios=[5.0] * len(parts) + [0.55])
    for axes, (channels, names, scale, label) in zip(below, parts, strict=False):
        for k, channel in enumerate(channels):
            gone = scale * (zero[:, channel] - _first(zero[:, channel]))
            band = _SURE * scale * deviation[:, channel]
            clock, rows = downsampled(time - start, np.column_stack([gone, gone - band, gone + band]), most)
            axes.fill_between(clock, rows[:, 1], rows[:, 2], color=AXES[k % 3], alpha=0.2, linewidth=0)
            axes.plot(clock, rows[:, 0], color=AXES[k % 3], label=names[k] if names else None)
        axes.set(ylabel=label)
        if names:
            named(axes, 3)
    _gate(below[-1], time - start, uncertain)
    below[-1].set(xlabel=f"time [s] {after}".strip())
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


def _gate(axes: Any, clock: Float[np.ndarray, " n"], held: Bool[np.ndarray, " n"]) -> None:
    """Draw a strip that shows when the bias was tracked and when it was kept constant."""
    axes.set_yticks([])
    axes.grid(visible=False)
    axes.spines[["left", "bottom"]].set_visible(False)
    axes.set_ylabel("gate", rotation=0, ha="right", va="center", color=MUTED)
    known = np.flatnonzero(np.isfinite(clock))
    if len(known) < 2 or not np.ptp(clock[known]) > 0:
        return
    ends = float(clock[known].min()), float(clock[known].max())
    edges: Float[np.ndarray, " e"] = np.linspace(*ends, COLUMNS + 1)
    counts, _ = np.histogram(clock[known], edges)
    touched, _ = np.histogram(clock[known][held[known]], edges)
    for there, colour in ((counts > 0, _FREE), (2 * touched > counts, _HELD)):
        rows = np.ma.masked_where(~there, np.ones(COLUMNS))
        axes.imshow(rows[None], extent=(edges[0], edges[-1], 0, 1), aspect="auto", cmap=_plain(colour), vmin=0, vmax=1)


def _plain(colour: str) -> Any:
    from matplotlib.colors import ListedColormap

    return ListedColormap([colour])
