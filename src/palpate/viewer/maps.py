"""Draw maps of a quantity over a surface or an unrolled sheet, and the position error over the force."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Int

from palpate.viewer._style import AXES, INK, MUTED, panels, plotted
from palpate.viewer.plots import named, plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEVELS = 9  # colours of a map: as many as an eye tells apart
_NAMES = "xyz"


@plotted
def surface_map(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    values: Float[np.ndarray, " v"],
    label: str,
    *,
    cells: Float[np.ndarray, "k 3"] | None = None,
    view: tuple[int, float] = (2, 1.0),
) -> Figure:
    """Draw lines of equal values over the surface as a `Figure`, with the cells below it as numbered squares.

    Args:
        vertices: places of the values [m].
        faces: triangles between them.
        values: one per vertex; facets with one that is not finite are not drawn.
        label: name of the quantity, with its unit.
        cells: [m]; NaN where not known.
        view: the axis along which it is seen, and from which side: 1 or -1.

    Raises:
        InputError: matplotlib is not installed; or arrays of other shapes.
    """
    across, up = ((1, 2), (2, 0), (0, 1))[view[0]]
    places = 1e3 * vertices
    drawn, axes = panels(_height(places[:, across], places[:, up]))
    shown = faces[np.isfinite(values[faces]).all(axis=1)]
    if len(shown):
        filled = axes.tricontourf(
            places[:, across], places[:, up], shown, values, levels=_levels(values), cmap="viridis_r"
        )
        drawn.colorbar(filled, ax=axes, label=label).outline.set_visible(False)
    dark = "#1b2531"  # and not INK, which the page turns light in the dark: the box stays white
    for number, place in enumerate(np.zeros((0, 3)) if cells is None else 1e3 * cells, start=1):
        if np.isfinite(place).all():
            look: Any = {"boxstyle": "square,pad=0.25", "facecolor": "#ffffffcc", "edgecolor": MUTED, "linewidth": 0.6}
            axes.text(place[across], place[up], str(number), color=dark, ha="center", va="center", bbox=look)
    axes.set(aspect="equal", xlabel=f"{_NAMES[across]} [mm]", ylabel=f"{_NAMES[up]} [mm]")
    if view[1] < 0:
        axes.invert_xaxis()
    axes.grid(visible=False)
    return drawn


@plotted
def sheet_map(
    cells: Float[np.ndarray, "n 2"],
    values: Float[np.ndarray, " n"],
    label: str,
    shape: tuple[int, int] | None = None,
) -> Figure:
    """Draw values at places of an unrolled sheet of taxels as a `Figure`, rows upward; crosses where not known.

    Args:
        cells: (n, 2) row and column.
        values: (n,) NaN where there is none.
        label: name of the quantity, with its unit.
        shape: rows and columns of the sheet; None: just large enough for the places.

    Raises:
        InputError: matplotlib is not installed; or arrays of other shapes.
    """
    drawn, axes = panels(2.6)
    known = np.isfinite(values) & np.isfinite(cells).all(axis=1)
    axes.scatter(cells[~known, 1], cells[~known, 0], marker="x", s=16, color=MUTED, linewidths=0.8)
    if known.any():
        dots = axes.scatter(
            cells[known, 1], cells[known, 0], c=values[known], s=26, cmap="viridis_r", vmin=0.0, rasterized=True
        )
        drawn.colorbar(dots, ax=axes, label=label, shrink=0.8)
    rows, columns = shape or (int(np.nanmax(cells[:, 0])) + 2, int(np.nanmax(cells[:, 1])) + 2)
    axes.set(xlim=(-0.5, columns - 0.5), ylim=(-0.5, rows - 0.5), aspect="equal")
    axes.set(xlabel="column [cells]", ylabel="row [cells]")
    return drawn


@plotted
def error_over_force(
    force: Float[np.ndarray, " n"], curves: Mapping[str, Float[np.ndarray, " n"]], wanted: float
) -> Figure:
    """Draw named curves of the position error [m] over the force [N], and the wanted accuracy [m], as a `Figure`.

    Raises:
        InputError: matplotlib is not installed; or arrays of other shapes.
    """
    drawn, axes = panels(2.8)
    for colour, (name, error) in zip(AXES, curves.items(), strict=False):
        axes.plot(force, 1e3 * error, color=colour, label=name)
    axes.axhline(1e3 * wanted, color=INK, linewidth=0.8, linestyle="--")
    axes.annotate("wanted", (force[-1], 1e3 * wanted), ha="right", va="bottom", fontsize=8.5)
    axes.set(xscale="log", yscale="log", xlim=(force[0], force[-1]))
    axes.set(xlabel="force [N]", ylabel="position error, rms [mm]")
    plain(axes.xaxis)
    plain(axes.yaxis)
    named(axes, len(curves))
    return drawn


def _height(across: np.ndarray, up: np.ndarray) -> float:
    return float(np.clip(0.7 + 3.1 * np.ptp(up) / max(float(np.ptp(across)), 1e-9), 1.8, 4.6))


def _levels(values: np.ndarray) -> np.ndarray:
    from matplotlib.ticker import MaxNLocator

    known = values[np.isfinite(values)]
    low, high = float(known.min()), float(known.max())
    if high - low < 1e-3 * max(abs(high), abs(low), 1e-300):
        low, high = 0.99 * low, 1.01 * high if high else 1.0
    return np.asarray(MaxNLocator(LEVELS).tick_values(low, high))
