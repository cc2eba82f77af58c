"""Check whether a log's touches can be believed: the order of its cells, and touches that never pause."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from palpate.sensors.taxels.health import Health
from palpate.sensors.taxels.model import TaxelBody
from palpate.spatial.arguments import takes_arrays

ANSWERS, SHARE = 20.0, 0.2  # deviations of its noise, and of the largest answer, that a cell answers with
WIDE = 8  # cells that answer in a frame, which a touch presses side by side,
FEWEST = 8  # in at least so many frames
SCATTERED = 0.75  # of the roughness of cells in a wrong order, which is 0.7 to 1.3; wide touches have 0.1 to 0.5
UNLIKE = 5.0  # times the misfits of the presses: touches have up to 2, wrong orders 9 or more
HUNDREDS, ALWAYS = 100, 0.95  # touches, and of the frames with a touch: noise or a wrong zero


def unlike_calibration(body: TaxelBody, misfit: float, falling: bool) -> str:
    """Return a sentence if the loads of touches are not those that taxels with three axes were calibrated by, else "".

    Args:
        body: the body that was recorded.
        misfit: as of `TaxelEstimator`.
        falling: the loads fall under touches.
    """
    if body.response is None or not body.calibrated:
        return ""
    if falling:
        return (
            "no result to trust: touches pull at the skin by its readings, and pressed in the calibration: correct the "
            "sign of z in the log, or calibrate again; falling in [skin] is not for calibrated taxels of three axes"
        )
    if not misfit > UNLIKE * body.response.usual_misfit:
        return ""
    return (
        "no result to trust: the loads of most touches differ from those of a force by far more than in the "
        "calibration: correct the order of the taxels or of their axes in [skin], unless the touches are much "
        "wider than the tips of the calibration"
    )


@takes_arrays
def unbelievable_touches(
    loads: Float[np.ndarray, "n k"], free: Bool[np.ndarray, " m"], touches: int, body: TaxelBody, health: Health
) -> str:
    """Return a sentence if no touch of a log can be believed, else "".

    Args:
        loads: (n, k) changes of the readings by contacts, evenly spread over the log.
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
    if roughness(loads, body, health) > SCATTERED:
        return (
            "no result to trust: cells that are pressed together are not neighbours on the map, so its order is not "
            "that of the readings; correct rows and columns, or the order of the cells, in [skin]"
        )
    return ""


@takes_arrays
def roughness(loads: Float[np.ndarray, "n k"], body: TaxelBody, health: Health) -> float:
    """Return the median over wide touches of the squared difference of neighbours over that of any two cells; 0: none.

    It is Geary's contiguity ratio: 1 where the cells are in any order, near 0 under a wide touch.

    Raises:
        InputError: arrays of other shapes.
    """
    good = body.usable & health.good
    above = (-1.0 if health.falling else 1.0) * loads
    above = np.where(good & np.isfinite(above), np.maximum(above, 0.0), 0.0)
    answers = above > np.maximum(ANSWERS * health.noise, SHARE * above.max(axis=1, initial=0.0, keepdims=True))
    above = above[np.count_nonzero(answers, axis=1) >= WIDE]
    if len(above) < FEWEST:
        return 0.0
    one, slot = np.nonzero((body.neighbours >= 0) & (body.between[..., 0] < 0))
    other = body.neighbours[one, slot]
    both = good[one] & good[other]
    square = ((above[:, one[both]] - above[:, other[both]]) ** 2).mean(axis=1)
    return float(np.median(square / (2.0 * above[:, good].var(axis=1))))
