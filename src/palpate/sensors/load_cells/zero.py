"""What load cells read unloaded: taken at every start, from a window that is checked to stand still."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.sensors.load_cells.model import LoadCells
from palpate.signals.correlation import correlation_time
from palpate.spatial.arguments import takes_arrays

__all__ = ["Zero", "take_zero"]

FEWEST = 20  # samples
SCATTER, DRIFT = 3.0, 5.0  # times the noise of a sample, and of the difference of the two halves
WARMS = 3.0  # times the noise by which the halves may differ besides: cells warm up
LIKE_TOUCH = 0.05  # of a change of the zero that no wrench explains: less, and it may be a touch
HEAVY = 0.2  # N that such a change must weigh


@takes_arrays
@dataclass(frozen=True, eq=False)
class Zero:
    """What the cells read unloaded.

    Attributes:
        voltage: (m,) [V]; share: its variance over that of one reading.
        note: what was taken. doubt: why it may be wrong, or nothing.
        touch: (6,) the wrench that a change of the zero since the calibration looks like, if it does.
    """

    voltage: Float[np.ndarray, " m"]
    share: float = 0.0
    note: str = ""
    warning: str = ""
    touch: Float[np.ndarray, "6"] | None = None


@takes_arrays
def take_zero(cells: LoadCells, voltages: Float[np.ndarray, "n m"], where: str = "") -> Zero:
    """The mean of a window in which nothing changes but by noise.

    A touch moves all cells: where one alone is not at rest among four or more, it is named, and the others go on. A
    touch that stands still cannot be told from a zero, except by what the calibration knows: a change of the zero since
    then that is nearly a wrench is doubted.

    Args:
        cells: the model, with its noise.
        voltages: (n, m) [V] of the window; rows with NaN are left out.
        where: they came from, for messages.

    Raises:
        InputError: too few samples, or they do not stand still.
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
    restless = np.unique(np.flatnonzero(off > 1.0) // 3)
    if len(restless) > 1 or (len(restless) and cells.cells < 4):
        worst = int(off.argmax())
        raise InputError(
            f"the cells are not at rest at the start: channel {worst + 1} scatters by {deviation[worst]:.2g} V and "
            f"changes by {change[worst]:.2g} V, and its noise is {noise[worst]:.2g} V.",
            where=where,
            hint="Let the log begin with nothing touching the fingertip, and set tare to that time [s].",
        )
    zero = usable.mean(axis=0)
    said = (
        f"zero of the cells from {len(usable)} samples at the start, known to {1e6 * noise.max() / count**0.5:.2g} uV"
    )
    alone = f"cell {restless[0] + 1} alone is not at rest at the start: it drifts" if len(restless) else ""
    touch = None if alone else _touch(cells, zero)
    doubt = "" if touch is None else _LIKE.format(float(np.linalg.norm(touch[:3])))
    return Zero(zero, 1.0 / count, said, alone or doubt, touch)


_LIKE = (
    "since the calibration the zero changed as a touch of {:.2g} N would change it: "
    "make sure that nothing touched at the start"
)


def _touch(cells: LoadCells, zero: Float[np.ndarray, " m"]) -> Float[np.ndarray, "6"] | None:
    """The wrench that explains nearly all of the change of the zero, if there is one of some weight."""
    change = zero - cells.bias
    inverse, _, rest = cells.inverse()
    wrench = inverse @ change
    metric = np.linalg.solve(np.linalg.cholesky(cells.noise), change)
    unlike = float(np.sum((rest @ change) ** 2) / max(metric @ metric, 1e-300))
    like = len(rest) > 0 and unlike <= LIKE_TOUCH and float(np.linalg.norm(wrench[:3])) >= HEAVY
    return wrench if like else None
