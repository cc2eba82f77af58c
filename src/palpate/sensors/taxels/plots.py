"""Draw maps of a skin's taxels, unrolled about the cylinder that fits them best."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from palpate.spatial.arguments import takes_arrays
from palpate.viewer._style import AXES, MUTED, figure, plotted

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@takes_arrays
def unroll(points: Float[np.ndarray, "k 3"], *others: Float[np.ndarray, "k 3"]) -> list[Float[np.ndarray, "k 2"]]:
    """Return each point set as (k, 2) [m] along and around the cylinder that fits the first set best.

    Raises:
        InputError: points has another shape.
    """
    middle = points.mean(axis=0)
    axes = np.linalg.svd(points - middle, full_matrices=True)[2]
    fits = [_circle(points - middle, np.roll(axes, -k, axis=0)) for k in range(3)]
    _, frame, centre, radius = min(fits, key=lambda each: each[0])
    flat = [(each - middle) @ frame.T for each in (points, *others)]
    angles = [np.arctan2(z - centre[1], y - centre[0]) for _, y, z in (each.T for each in flat)]
    start = np.arctan2(np.sin(angles[0]).mean(), np.cos(angles[0]).mean())
    around = [radius * np.angle(np.exp(1j * (angle - start))) for angle in angles]
    return [np.column_stack([each[:, 0], arc]) for each, arc in zip(flat, around, strict=True)]


def _circle(
    away: Float[np.ndarray, "k 3"], frame: Float[np.ndarray, "3 3"]
) -> tuple[float, Float[np.ndarray, "3 3"], Float[np.ndarray, "2"], float]:
    """Fit x^2 + y^2 = 2 a x + 2 b y + c across `frame`'s first axis; return scatter, frame, centre, radius."""
    flat = away @ frame[1:].T
    table = np.column_stack([2 * flat, np.ones(len(flat))])
    a, b, c = (float(value) for value in np.linalg.pinv(table) @ (flat**2).sum(axis=1))
    centre = np.array([a, b])
    radius = float(np.sqrt(max(c + a * a + b * b, 1e-12)))
    return float(np.std(np.linalg.norm(flat - centre, axis=1))), frame, centre, radius


@plotted
def error_map(points: Float[np.ndarray, "k 3"], error: Float[np.ndarray, " k"]) -> Figure:
    """Draw the error [mm] of each taxel on the unrolled skin, a matplotlib `Figure`.

    Raises:
        InputError: matplotlib is not installed; or arrays of other shapes.
    """
    flat = 1e3 * unroll(points)[0]
    drawn = figure(3.0)
    axes: Any = drawn.subplots()
    dots = axes.scatter(flat[:, 0], flat[:, 1], c=error, s=22, cmap="viridis_r", vmin=0.0, rasterized=len(flat) > 500)
    drawn.colorbar(dots, ax=axes, label="error [mm]", shrink=0.8)
    axes.set(xlabel="along [mm]", ylabel="around [mm]", aspect="equal")
    return drawn


@plotted
def moved_map(estimate: Float[np.ndarray, "k 3"], truth: Float[np.ndarray, "k 3"]) -> Figure:
    """Draw the true and estimated places of taxels [m] on the unrolled skin, a matplotlib `Figure`.

    Raises:
        InputError: matplotlib is not installed; or arrays of other shapes.
    """
    there, found = (1e3 * each for each in unroll(truth, estimate))
    drawn = figure(3.0)
    axes: Any = drawn.subplots()
    axes.plot(*np.stack([there, found], axis=1).transpose(2, 1, 0), color=MUTED, linewidth=0.8)
    axes.scatter(there[:, 0], there[:, 1], s=16, facecolors="none", edgecolors=MUTED, linewidths=0.8, label="true")
    axes.scatter(found[:, 0], found[:, 1], s=8, color=AXES[2], label="found")
    axes.set(xlabel="along [mm]", ylabel="around [mm]", aspect="equal")
    axes.legend(loc="upper right", frameon=False)
    return drawn
