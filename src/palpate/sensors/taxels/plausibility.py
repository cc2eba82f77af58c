"""Check whether a log's touches can be believed: the order of its cells, and touches that never pause."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from palpate.sensors.taxels.health import Health
from palpate.sensors.taxels.model import TaxelBody
from palpate.spatial.arguments import takes_arrays

ANSWERS = 20.0  # deviations of its noise that a cell moves if it answers,
SHARE = 0.1  # and of the largest answer
FEWEST = 8  # cells that answer, and frames with an answer
TOGETHER = 0.7  # correlation of two cells that answer together
NEAR = 0.4  # of the cells have a neighbour as their nearest partner; of a wrong order some 8 of all
HUNDREDS, ALWAYS = 100, 0.95  # touches, and of the frames with a touch: noise or a wrong zero


@takes_arrays
def unbelievable_touches(
    frames: Float[np.ndarray, "n k"], free: Bool[np.ndarray, " m"], touches: int, body: TaxelBody, health: Health
) -> str:
    """Return a sentence if no touch of a log can be believed, else "".

    Args:
        frames: (n, k) readings, evenly spread over the log.
        free: (m,) whether each frame has no contact.
        touches: number of touches in them.
        body: the body that was recorded.
        health: baseline and noise of its cells.

    Raises:
        InputError: arrays of other shapes.
    """
    if touches >= HUNDREDS and np.mean(~free) > ALWAYS:
        return (
            f"no result to trust: {touches:,} touches, and {np.mean(~free):.0%} of the frames have one: the noise of "
            "the cells is larger than at the start, or their rest is wrong; state a tare in which nothing touches"
        )
    near = partners(frames, body, health)
    if near < NEAR:
        return (
            f"no result to trust: of the cells that answer together only {near:.0%} are neighbours on the map, so its "
            "order is not that of the readings: check the order of the cells in [skin]"
        )
    return ""


@takes_arrays
def partners(frames: Float[np.ndarray, "n k"], body: TaxelBody, health: Health) -> float:
    """Return the share of the cells whose readings go most together with those of a neighbour; 1: not known.

    Raises:
        InputError: arrays of other shapes.
    """
    above = np.where(np.isfinite(frames), (-1.0 if health.falling else 1.0) * (frames - health.baseline), 0.0)
    above = above[(above > ANSWERS * health.noise).any(axis=1)]
    most = above.max(axis=0, initial=0.0)
    cells = np.flatnonzero(body.usable & health.good & (most > np.maximum(ANSWERS * health.noise, SHARE * most.max())))
    degree = np.count_nonzero(body.neighbours[cells] >= 0, axis=1)
    if min(len(above), len(cells)) < FEWEST or degree.mean() > 0.5 * NEAR * len(cells):
        return 1.0
    alike = np.corrcoef(above[:, cells], rowvar=False) - 2.0 * np.eye(len(cells))
    partner, sure = cells[alike.argmax(axis=1)], alike.max(axis=1) > TOGETHER
    near = (body.neighbours[cells] == partner[:, None]).any(axis=1)
    return float(near[sure].mean()) if np.count_nonzero(sure) >= FEWEST else 1.0
