"""Draw the figures of a report with matplotlib: units on every axis, few points in every line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.contact.estimate import Status
from palpate.spatial.arguments import frozen_value
from palpate.viewer._style import AXES, INK, MUTED, RULE, STATUS, panels, plotted, styled
from palpate.viewer.drawing import Mark
from palpate.viewer.report import HOVER
from palpate.viewer.samples import thinned
from palpate.viewer.timeline import downsampled, since

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = 450  # of a line over time: as many as a phone has pixels
DOTS = 1_500
_DISCS = 26  # numbers that stand side by side in the views of a body
_GOLDEN, _TRIED = 2.4, 200  # rad from a place of the spiral to the next; places that are tried
_NAMES = ("x", "y", "z")


@frozen_value
class SpectrumPanel:
    """The spectrum of a vector: frequency [Hz], density and its noise floor [unit^2/Hz], cut-off [Hz] or None."""

    frequency: Float[np.ndarray, " k"]
    density: Float[np.ndarray, "k 3"]
    title: str
    unit: str
    floor: Float[np.ndarray, "3"]
    cutoff: float | None


@plotted
def forces(time: Float[np.ndarray, " n"], force: Float[np.ndarray, "n 3"], status: Int[np.ndarray, " n"]) -> Figure:
    """Draw components [N], magnitude [N] and the status of each sample over time [s] as a `Figure`.

    Raises:
        InputError: matplotlib is not installed; or arrays of other shapes.
    """
    time, label = clock_of(time)
    drawn, parts = panels(3.6, 3, sharex=True, height_ratios=(5, 5, 0.55))
    for k, name in enumerate(_NAMES):
        parts[0].plot(*_curve(time, force[:, k]), color=AXES[k], label=f"F{name}")
    parts[0].set(ylabel="force [N]")
    named(parts[0], 3)
    parts[1].plot(*_curve(time, np.linalg.norm(force, axis=1)), color=INK)
    parts[1].set(ylabel="magnitude [N]", ylim=(0, None), xlim=_span(time))
    strip(parts[2], time, status, STATUS)
    parts[2].set(xlabel=label)
    parts[2].set_ylabel("status", rotation=0, ha="right", va="center")
    return drawn


@styled()
def sensor_forces(forces: Mapping[str, tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]]) -> Figure:
    """Draw the contact force [N] of each sensor over time [s], one below the other, as a `Figure`.

    Args:
        forces: sensor -> times (n,) [s] and magnitudes (n,) [N], at least one sensor.

    Raises:
        InputError: matplotlib is not installed.
    """
    start, after = since(np.concatenate([time for time, _ in forces.values()]))
    drawn, rows = panels(0.6 + 0.42 * len(forces), len(forces), sharex=True, sharey=True, squeeze=False)
    for axes, (name, (time, force)) in zip(rows[:, 0], forces.items(), strict=True):
        axes.plot(*_curve(time - start, force), color=INK)
        axes.set_ylabel(name, rotation=0, ha="right", va="center")
    rows[-1, 0].set(xlabel=f"time [s] {after}".strip(), ylim=(0, None))
    rows[0, 0].set_title("force [N]", color=MUTED)
    return drawn


@plotted
def locations(
    time: Float[np.ndarray, " n"],
    point: Float[np.ndarray, "n 3"],
    deviation: Float[np.ndarray, "n 3"],
    *,
    several: bool = False,
) -> Figure:
    """Draw x, y and z [m] of the answered samples with 95 % bands over time [s] as a `Figure`; NaN where not answered.

    Where there may be several contacts at once, they are dots with bars.

    Raises:
        InputError: matplotlib is not installed; or arrays of other shapes.
    """
    time, label = clock_of(time)
    drawn, parts = panels(4.0, 3, sharex=True)
    for k, (axes, name) in enumerate(zip(parts, _NAMES, strict=True)):
        place, band = 1e3 * point[:, k], 1.96e3 * np.nan_to_num(deviation[:, k])
        if several:
            some = thinned(np.flatnonzero(np.isfinite(place)), DOTS)
            axes.vlines(time[some], (place - band)[some], (place + band)[some], color=AXES[k], alpha=0.3)
            axes.plot(time[some], place[some], ".", color=AXES[k], markersize=2.5)
        else:
            clock, ends = downsampled(time, np.column_stack([place - band, place + band]), 2 * COLUMNS)
            axes.fill_between(clock, *ends.T, color=AXES[k], alpha=0.3, linewidth=0)
            axes.plot(*_curve(time, place), color=AXES[k])
        axes.set(ylabel=f"{name} [mm]", xlim=_span(time))
        if np.isfinite(place).any():  # a band is wide where a touch begins and ends, and would flatten all the rest
            margin = 3.0 * float(np.median(band[np.isfinite(place)])) + 1.0
            axes.set_ylim(np.nanmin(place) - margin, np.nanmax(place) + margin)
    drawn.align_ylabels()
    parts[-1].set_xlabel(label)
    return drawn


@plotted
def silhouettes(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    point: Float[np.ndarray, "n 3"],
    normal: Float[np.ndarray, "n 3"],
    force: Float[np.ndarray, " n"],
    touches: Sequence[Mark] = (),
) -> Figure:
    """Draw the body [m] from three sides and its contact points, coloured by force [N], as a `Figure`.

    Rings are on the far side. Touches have their numbers, with tooltips, on the views that show them.

    Raises:
        InputError: matplotlib is not installed; or arrays of other shapes.
    """
    dx, dy, dz = np.ptp(vertices[faces.reshape(-1)], axis=0)
    least = 0.3 * max(dx, dy, dz)  # a flat body has views that are lines, and these have axes too
    widths, heights = (max(dx, least), max(dy, least)), (max(dy, least), max(dz, least))
    high = min(5.5, 0.9 + 3.6 * sum(heights) / sum(widths))
    drawn, grid = panels(high, 2, ncols=2, width_ratios=widths, height_ratios=heights)
    shown, wide = None, 1e3 * sum(widths) / _DISCS
    for across, up, depth, axes in ((0, 1, 2, grid[0, 0]), (0, 2, 1, grid[1, 0]), (1, 2, 0, grid[1, 1])):
        toward = -1.0 if (across, up) == (0, 2) else 1.0  # so that what is seen is right-handed
        _body(axes, vertices, faces, (across, up, depth), toward)
        far = toward * normal[:, depth] < 0
        shown = _touched(axes, 1e3 * point[:, (across, up)], force, far) or shown
        _number(axes, [mark for mark in touches if toward * mark.normal[depth] > 0], (across, up), wide)
        axes.set(xlabel=f"{_NAMES[across]} [mm]", ylabel=f"{_NAMES[up]} [mm]")
        axes.set_title(f"from {'+' if toward > 0 else '-'}{_NAMES[depth]}", color=MUTED)
    grid[0, 1].axis("off")
    if shown is not None:
        bar: Any = {"cax": grid[0, 1].inset_axes((0.05, 0.5, 0.9, 0.1)), "orientation": "horizontal"}
        drawn.colorbar(shown, label="force [N]", **bar).outline.set_visible(False)
    return drawn


@plotted
def histogram(values: Float[np.ndarray, " n"], label: str, unit: str) -> Figure:
    """Draw the shares [%] of the positive values by size as a `Figure`, logarithmic over more than a decade.

    Raises:
        InputError: matplotlib is not installed; or arrays of other shapes.
    """
    drawn, axes = panels(2.4)
    known = values[np.isfinite(values) & (values > 0)]
    if len(known):
        low, high = (float(end) for end in np.percentile(known, (0.5, 99.5)))
        wide = high > 10 * low
        edges = np.geomspace(low, high * 1.001, 40) if wide else np.linspace(low, high * 1.001, 40)
        share = np.full(len(known), 100 / len(known))
        axes.hist(np.clip(known, low, high), edges, weights=share, color=AXES[2], alpha=0.8)
        if wide:
            axes.set_xscale("log")
            plain(axes.xaxis, (1, 2, 5))
        middle = float(np.median(known))
        _mark(axes, middle, f"median {middle:.3g} {unit}")
    axes.set(xlabel=f"{label} [{unit}]", ylabel="share [%]")
    return drawn


@plotted
def statuses(counts: Int[np.ndarray, " s"]) -> Figure:
    """Draw a bar for each status that occurred, with its share [%], as a `Figure`; `counts` (9,) are by `Status`.

    Raises:
        InputError: matplotlib is not installed.
    """
    kinds = [kind for kind in Status if counts[kind]]
    drawn, axes = panels(0.45 + 0.27 * max(len(kinds), 2))
    shares = [100 * counts[kind] / max(counts.sum(), 1) for kind in kinds]
    axes.barh([kind.words for kind in kinds], shares, color=[STATUS[kind] for kind in kinds], height=0.7)
    for row, share in enumerate(shares):
        axes.annotate(f" {share:.1f} %", (share, row), va="center", fontsize=8.5)
    axes.invert_yaxis()
    axes.set(xlim=(0, 118), xticks=range(0, 101, 25), xlabel="share of the samples [%]")
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0, labelcolor=INK)
    return drawn


@plotted
def errors(time: Float[np.ndarray, " n"], error: Float[np.ndarray, " n"], radius: Float[np.ndarray, " n"]) -> Figure:
    """Draw the distance from the ground truth [m] and the predicted 95 % radius [m] over time [s] as a `Figure`.

    Raises:
        InputError: matplotlib is not installed; or arrays of other shapes.
    """
    time, label = clock_of(time)
    drawn, axes = panels(2.6)
    some = thinned(np.flatnonzero(np.isfinite(error)), DOTS)
    axes.plot(time[some], 1e3 * error[some], ".", color=AXES[0], markersize=2.5, label="error")
    if np.isfinite(radius).any():
        axes.plot(*_curve(time, 1e3 * radius), color=AXES[2], label="95 % radius", zorder=1)
    # logarithmic: at the start and the end of a touch the force is small, and the radius large
    axes.set(yscale="log", xlabel=label, ylabel="location [mm]")
    plain(axes.yaxis)
    named(axes, 2)
    return drawn


@plotted
def touch_errors(labels: Sequence[str], error: Float[np.ndarray, " n"], radius: Float[np.ndarray, " n"]) -> Figure:
    """Draw the error of each touch's median point and a sample's 95 % radius [m] as a `Figure`.

    Raises:
        InputError: matplotlib is not installed; or arrays of other shapes.
    """
    drawn, axes = panels(min(0.9 + 0.21 * len(labels), 9.0))
    rows = np.arange(len(labels))
    axes.barh(rows, 1e3 * np.nan_to_num(radius), color=AXES[2], alpha=0.3, height=0.75, label="95 % radius")
    axes.plot(1e3 * error, rows, "o", color=AXES[0], markersize=4, label="error")
    every = 1 + len(labels) // 40
    axes.set_yticks(rows[::every], [label if len(label) < 18 else f"{label[:16]}.." for label in labels[::every]])
    axes.invert_yaxis()
    axes.set(xlim=(0, None), xlabel="location [mm]")
    axes.grid(visible=False, axis="y")
    named(axes, 2)
    return drawn


@styled()
def spectra(shown: Sequence[SpectrumPanel]) -> Figure:
    """Draw spectra over frequency [Hz] as a `Figure`, one below the other, with noise floors and cut-offs.

    Raises:
        InputError: matplotlib is not installed.
    """
    drawn, below = panels(2.9 * len(shown), len(shown), sharex=True, squeeze=False)
    for axes, panel in zip(below[:, 0], shown, strict=True):
        frequency, density = _banded(panel.frequency, panel.density)
        for k, name in enumerate(_NAMES):
            axes.loglog(frequency, np.sqrt(density[:, k]), color=AXES[k], label=name)
            if panel.floor[k] > 0:
                axes.axhline(panel.floor[k] ** 0.5, color=AXES[k], linewidth=0.8, linestyle=(0, (4, 3)))
        if panel.cutoff is not None:
            _mark(axes, panel.cutoff, f"{panel.cutoff:.3g} Hz")
        axes.set(ylabel=f"{panel.title} [{panel.unit}/√Hz]")
        plain(axes.xaxis)
        plain(axes.yaxis, (1, 3))
        named(axes, 3)
    below[-1, 0].set(xlabel="frequency [Hz]")
    return drawn


def _curve(
    time: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    clock, rows = downsampled(time, values[:, None], 2 * COLUMNS)
    return clock, rows[:, 0]


def clock_of(time: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " n"], str]:
    """Return times [s] for an axis, (n,), and its label: from 0, or from the start that the label states."""
    start, after = since(time)
    return time - start, f"time [s] {after}".strip()


def _span(time: Float[np.ndarray, " n"]) -> tuple[float | None, float | None]:
    """Return the first and last known time; None without a span."""
    known = time[np.isfinite(time)]
    return (float(known.min()), float(known.max())) if len(known) and np.ptp(known) > 0 else (None, None)


def _banded(
    frequency: Float[np.ndarray, " k"], density: Float[np.ndarray, "k 3"]
) -> tuple[Float[np.ndarray, " b"], Float[np.ndarray, "b 3"]]:
    """Return means over equal bands of a logarithmic axis."""
    band = np.floor(20 * np.log2(frequency / frequency[0]))
    starts = np.flatnonzero(np.diff(band, prepend=-1.0))
    sizes = np.diff(starts, append=len(band))
    middle = np.exp(np.add.reduceat(np.log(frequency), starts) / sizes)
    return middle, np.add.reduceat(density, starts, axis=0) / sizes[:, None]


def strip(axes: Any, time: Float[np.ndarray, " n"], kinds: Int[np.ndarray, " n"], inks: Sequence[str]) -> None:
    """Draw a strip of colours over time [s] on matplotlib's `axes`, each column in its most frequent kind's ink."""
    from matplotlib.colors import BoundaryNorm, ListedColormap

    axes.set_yticks([])
    axes.grid(visible=False)
    axes.spines[["left", "bottom"]].set_visible(False)
    known = np.isfinite(time)
    if known.any() and np.ptp(time[known]) > 0:
        edges: Float[np.ndarray, " e"] = np.linspace(float(time[known].min()), float(time[known].max()), COLUMNS + 1)
        ends = np.arange(len(inks) + 1) - 0.5
        counts, _, _ = np.histogram2d(time[known], kinds[known].astype(np.float64), bins=[edges, ends])
        most = np.ma.masked_where(~counts.any(axis=1), counts.argmax(axis=1))  # a gap in the log stays empty
        look: Any = {"cmap": ListedColormap(inks), "norm": BoundaryNorm(ends, len(inks)), "interpolation": "nearest"}
        axes.imshow(most[None], extent=(edges[0], edges[-1], 0, 1), aspect="auto", **look)


def _body(axes: Any, vertices: np.ndarray, faces: np.ndarray, order: tuple[int, int, int], toward: float) -> None:
    """Draw the facets that face the viewer as pixels, the furthest first."""
    from matplotlib.collections import PolyCollection

    corners = 1e3 * vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    facing = toward * normals[:, order[2]] / np.where(length > 0, length, 1.0)
    front = np.flatnonzero(facing > -1e-9)
    front = front[np.argsort(toward * corners[front, :, order[2]].mean(axis=1))]
    shade = 0.62 + 0.26 * np.clip(facing[front], 0, 1)
    colours = np.column_stack([shade, shade, shade + 0.02, np.ones(len(shade))])
    shapes = corners[front][:, :, list(order[:2])]
    axes.add_collection(
        PolyCollection(list(shapes), facecolors=colours, edgecolors=colours, linewidths=0.3, rasterized=True)
    )
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.03)
    axes.autoscale_view()
    axes.grid(visible=False)


def _touched(
    axes: Any, point: Float[np.ndarray, "n 2"], force: Float[np.ndarray, " n"], far: Bool[np.ndarray, " n"]
) -> Any:
    """Draw dots, and rings where the body hides the contact, the strongest on top."""
    from matplotlib import colormaps

    some = thinned(np.flatnonzero(np.isfinite(point[:, 0])), DOTS)
    if not len(some):
        return None
    some = some[np.argsort(force[some])]
    most = float(force[some].max())
    behind, seen = some[far[some]], some[~far[some]]
    look: Any = {"cmap": "viridis_r", "vmin": 0.0, "vmax": most, "linewidths": 0, "rasterized": True}
    rings = colormaps["viridis_r"](force[behind] / most if most > 0 else force[behind])
    axes.scatter(*point[behind].T, s=9, facecolors="none", edgecolors=rings, linewidths=0.4, alpha=0.5, rasterized=True)
    return axes.scatter(*point[seen].T, s=6, c=force[seen], **look)


def _number(axes: Any, touches: Sequence[Mark], across: tuple[int, int], wide: float) -> None:
    """Draw numbers of touches in discs `wide` [mm] across that do not cover one another."""
    disc = {"boxstyle": "circle,pad=0.2", "facecolor": RULE, "linewidth": 0, "alpha": 0.85}
    taken = np.zeros((0, 2))
    for touch in touches:
        if np.isfinite(touch.point).all():
            at, said = 1e3 * touch.point[list(across)], f"{HOVER}{touch.tooltip}"
            free = _free(at, taken, wide)
            taken = np.concatenate([taken, free[None]])
            if free is not at:
                axes.plot(*np.stack([at, free], axis=1), color=MUTED, linewidth=0.5)
            axes.text(*free, touch.label, fontsize=6, ha="center", va="center", bbox=disc, gid=said)


def _free(at: Float[np.ndarray, "2"], taken: Float[np.ndarray, "n 2"], wide: float) -> Float[np.ndarray, "2"]:
    """Return the place, or the nearest on a spiral about it, at least `wide` away from those taken."""
    for turn in range(_TRIED):
        way = np.array([np.cos(_GOLDEN * turn), np.sin(_GOLDEN * turn)])
        place = at + 0.3 * wide * turn**0.5 * way if turn else at
        if (np.linalg.norm(taken - place, axis=1) >= wide).all():
            return place
    return at


def _mark(axes: Any, at: float, text: str) -> None:
    axes.axvline(at, color=INK, linewidth=1.0)
    axes.annotate(f" {text}", (at, 1.0), xycoords=("data", "axes fraction"), va="top", fontsize=8.5)


def plain(axis: Any, multiples: tuple[int, ...] = (1,)) -> None:
    """Set a logarithmic axis to decimal numbers, at these multiples of powers of ten."""
    from matplotlib.ticker import LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(subs=multiples))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def named(axes: Any, columns: int) -> None:
    """Add a legend of the lines above the axes, in `columns` columns."""
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, borderaxespad=0.1)


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
