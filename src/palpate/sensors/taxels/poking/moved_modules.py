"""Compare modules with the places that they had before."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.sensors.taxels.modules import ModuleLayout
from palpate.spatial.arguments import takes_arrays

NAMED = 12  # modules in a sentence


@takes_arrays
def moved_far(
    layout: ModuleLayout, before: Float[np.ndarray, "k 3"], after: Float[np.ndarray, "k 3"]
) -> tuple[str, ...]:
    """Return a warning, or (), about modules whose taxels moved farther, on average, than the module is large.

    Args:
        layout: of the modules.
        before: (k, 3) [m] expected places of the taxels, NaN if not known.
        after: (k, 3) [m] places that were found.
    """
    moved = np.linalg.norm(after - before, axis=1)
    far, size = dict[int, float](), 0.0
    for number in range(layout.modules):
        rows = (layout.module == number) & np.isfinite(moved) & np.isfinite(layout.places).all(axis=1)
        if not rows.any():
            continue
        flat = layout.places[rows]
        across = float(np.linalg.norm(flat[:, None] - flat, axis=2).max())
        if moved[rows].mean() > across:
            far[number], size = float(moved[rows].mean()), max(size, across)
    if not far:
        return ()
    named = ", ".join(map(str, [*far][:NAMED])) + (", ..." if len(far) > NAMED else "")
    return (
        f"modules {named} moved by up to {1e3 * max(far.values()):.0f} mm from where they were expected, farther than "
        f"they are large ({1e3 * size:.0f} mm): check that the surface and the expected places are in one frame and "
        "unit ([surface] pose and unit), and that the layout and its numbers are those of this skin",
    )
