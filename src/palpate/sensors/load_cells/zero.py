"""The zero of load cells, their unloaded reading: taken at every start, from a window that is checked to be at rest."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.sensors.load_cells.model import LoadCells
from palpate.signals.correlation import correlation_time
from palpate.spatial.arguments import frozen_value, takes_arrays

FEWEST = 20  # samples
SCATTER, DRIFT = 3.0, 5.0  # times the noise of a sample, and of the difference of the two halves
WARMS = 3.0  # times the noise by which the halves may also differ: cells warm up
LIKE_TOUCH = 0.05  # of a change of the zero that no wrench explains: less, and it may be a touch
HEAVY = 0.2  # N: least force of such a change


@frozen_value
class Zero:
    """The unloaded reading of load cells.

    Attributes:
        voltage: (m,) [V].
        share: variance of `voltage` over that of one reading.
        note: sentence about the window, or "".
        warning: reason why the zero may be wrong, or "".
        touch: (6,) [N, N m] wrench that would explain the zero's change since the calibration; None: none does.
    """

    voltage: Float[np.ndarray, " m"]
    share: float = 0.0
    note: str = ""
    warning: str = ""
    touch: Float[np.ndarray, "6"] | None = None


@takes_arrays
def take_zero(cells: LoadCells, voltages: Float[np.ndarray, "n m"], where: str = "") -> Zero:
    """Return the mean reading of a window without contact as a `Zero`.

    One cell of four or more that is not at rest gives a warning, as a touch would move all; so does a change since the
    calibration that is nearly a wrench, as under a steady touch.

    Args:
        cells: the model.
        voltages: (n, m) [V] of the window; rows that are not finite are omitted.
        where: source of the voltages, for messages.

    Raises:
        InputError: the window has fewer than 20 samples, or more than one cell (any, of three) is not at rest; or
            arrays of other shapes.
    """
    usable = voltages[np.isfinite(voltages).all(axis=1)]
    if len(usable) < FEWEST:
        raise InputError(
            f"the zero of the cells needs {FEWEST} samples, and {len(usable)} can be used.",
            where=where,
            hint="Let the log begin unloaded, for half a second or more.",
        )
    noise = np.sqrt(np.diag(cells.noise))
    deviation = usable.std(axis=0)
    tau = float(np.median(correlation_time(usable)))
    count = max(1.0, len(usable) / max(tau, cells.correlation))
    first, second = np.array_split(usable, 2)
    change = np.abs(second.mean(axis=0) - first.mean(axis=0))
    allowed = noise * (DRIFT * 2.0 / np.sqrt(count) + WARMS + cells.drift)
    off = np.maximum(deviation / (SCATTER * noise * (1.0 + cells.drift)), change / allowed)
    restless = np.unique(np.flatnonzero(off > 1.0) // len(cells.axes))
    if len(restless) > 1 or (len(restless) and cells.cells < 4):
        worst = int(off.argmax())
        raise InputError(
            f"the cells are not at rest at the start: channel {worst + 1} scatters by {deviation[worst]:.2g} V and "
            f"changes by {change[worst]:.2g} V, and its noise is {noise[worst]:.2g} V.",
            where=where,
            hint="Let the log begin with nothing touching the body, and set tare to that time [s].",
        )
    zero = usable.mean(axis=0)
    force = 1e3 * float(np.diag(cells.inverse()[1])[:3].max() / count) ** 0.5
    said = f"zero of the cells from {len(usable)} samples at the start, known to {force:.2g} mN"
    alone = f"cell {restless[0] + 1} alone is not at rest at the start: it drifts" if len(restless) else ""
    touch = None if alone else _touch(cells, zero)
    if touch is None:
        return Zero(zero, 1.0 / count, said, alone)
    doubt = (
        f"since the calibration the zero changed as much as under a touch of {float(np.linalg.norm(touch[:3])):.2g} N: "
        "make sure that nothing touched at the start"
    )
    return Zero(zero, 1.0 / count, said, doubt, touch)


def _touch(cells: LoadCells, zero: Float[np.ndarray, " m"]) -> Float[np.ndarray, "6"] | None:
    """Return the wrench that explains nearly all of the zero's change, if it is `HEAVY`; else None."""
    change = zero - cells.bias
    inverse, _, rest = cells.inverse()
    wrench = inverse @ change
    metric = np.linalg.solve(np.linalg.cholesky(cells.noise), change)
    unlike = float(np.sum((rest @ change) ** 2) / max(metric @ metric, 1e-300))
    like = len(rest) > 0 and unlike <= LIKE_TOUCH and float(np.linalg.norm(wrench[:3])) >= HEAVY
    return wrench if like else None
