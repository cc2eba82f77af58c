"""Figures of a taxel sheet, unrolled: rows upward, columns to the right, a square a cell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from palpate.viewer._style import MUTED, figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["skin_errors"]


@styled()
def skin_errors(
    cells: Float[np.ndarray, "n 2"], errors: Float[np.ndarray, " n"], shape: tuple[int, int] | None = None
) -> Figure:
    """Where touches were, coloured by how far off [m]; crosses where nothing could be compared.

    Args:
        cells: (n, 2) row and column.
        errors: (n,) [m], NaN where there is none.
        shape: rows and columns of the sheet; None: as far as there are touches.
    """
    drawn = figure(2.6)
    axes: Any = drawn.subplots()
    known = np.isfinite(errors) & np.isfinite(cells).all(axis=1)
    axes.scatter(cells[~known, 1], cells[~known, 0], marker="x", s=16, color=MUTED, linewidths=0.8)
    if known.any():
        dots = axes.scatter(cells[known, 1], cells[known, 0], c=1e3 * errors[known], s=26, cmap="viridis_r", vmin=0.0)
        drawn.colorbar(dots, ax=axes, label="position error [mm]", shrink=0.8)
    rows, columns = shape or (int(np.nanmax(cells[:, 0])) + 2, int(np.nanmax(cells[:, 1])) + 2)
    axes.set(xlim=(-0.5, columns - 0.5), ylim=(-0.5, rows - 0.5), xlabel="column", ylabel="row", aspect="equal")
    return drawn
