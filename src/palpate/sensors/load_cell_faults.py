"""Which cell is wrong, and how: from what the others say that it should read."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float

from palpate.errors import NotIdentifiable
from palpate.sensors.load_cells import LoadCells

__all__ = ["Fault", "find_faults"]

CHANCE = 1e-6  # that sound cells contradict each other so much in a sample
RARE = 0.002  # share of samples that may contradict
AGREE = 0.9  # share of the contradicting samples that a cause must explain
STILL = 0.02  # of what it should move: a cell that moves less is dead
CLIPPED = 0.1  # share of samples that repeat the one before exactly
SAME_GAIN = 0.1  # by which a drifting cell may still answer differently to load
LAGS = 100  # parts of a log over which a cell's movement is looked at
PREFIX = 300.0  # a gain so far off is a prefix of the unit


@dataclass(frozen=True)
class Fault:
    """What is wrong.

    Attributes:
        cells: numbers from 0; kind: "dead", "saturated", "swapped", "drifting", "unit", "gain" or "several".
        share: of the samples in which it shows.
        said: the sentence, with what to do.
    """

    cells: tuple[int, ...]
    kind: str
    share: float
    said: str


def find_faults(
    cells: LoadCells,
    readings: Float[np.ndarray, "n m"],
    sound: Bool[np.ndarray, " k"] | None = None,
    names: tuple[str, ...] = (),
) -> list[Fault]:
    """What is wrong with the cells of a log, worst first; nothing where they agree.

    A wrench explains six of 3 k voltages. Where chi-square of the others is beyond its bound, each cell in turn is left
    out, then each pair exchanged; what makes the samples agree is the cause, and how the cell's readings differ from
    what the others foretell is its kind. Three cells have none to spare: only a cell that stands still or is at its
    range is named then, and an exchanged pair.

    Args:
        cells: the model.
        readings: (n, m) [V] less the zero; rows of NaN are left out.
        sound: (k,) cells to judge; None: all.
        names: of the channels, for messages.
    """
    kept = np.ones(cells.cells, dtype=bool) if sound is None else sound
    usable = readings[np.isfinite(readings).all(axis=1)]
    if not len(usable):
        return []
    bad = cells.chi_square(usable, kept) > _bound(3 * int(kept.sum()) - 6)
    if bad.mean() <= RARE:
        return []
    some = usable[bad]
    share = float(bad.mean())
    cause = _alone(cells, usable, bad, kept, names) or _swapped(cells, some, kept, share)
    if cause is None and int(kept.sum()) == 3:
        cause = _still(cells, usable, kept, share)
    return [cause or Fault((), "several", share, _several(share))]


def _bound(freedom: int) -> float:
    from scipy.stats import chi2

    return float(chi2.isf(CHANCE, freedom)) if freedom > 0 else np.inf


def _alone(
    cells: LoadCells, usable: np.ndarray, bad: np.ndarray, kept: np.ndarray, names: tuple[str, ...]
) -> Fault | None:
    """The cell without which the others agree."""
    some = usable[bad]
    freedom = 3 * (int(kept.sum()) - 1) - 6
    if freedom < 1:
        return None
    agree = np.zeros(cells.cells)
    for cell in np.flatnonzero(kept):
        others = kept & (np.arange(cells.cells) != cell)
        try:
            agree[cell] = np.mean(cells.chi_square(some, others) <= _bound(freedom))
        except NotIdentifiable:
            continue
    if agree.max() < AGREE:
        return None
    stuck = [cell for cell in np.flatnonzero(agree >= AGREE) if _repeats(usable[:, 3 * cell : 3 * cell + 3])]
    cell = int(stuck[0]) if len(stuck) == 1 else int(agree.argmax())  # one channel's fault can look like another's
    others = kept & (np.arange(cells.cells) != cell)
    rows = slice(3 * cell, 3 * cell + 3)
    due = cells.wrenches(usable, others)[0] @ cells.matrix[rows].T
    return _named(cell, usable[:, rows], due, bad, names[rows] if names else ())


def _named(cell: int, seen: np.ndarray, due: np.ndarray, bad: np.ndarray, names: tuple[str, ...]) -> Fault:
    """What a cell's readings say of its fault, beside what they should be."""
    name, share = f"cell {cell + 1}", float(bad.mean())
    rest = "; the other cells go on without it, with wider covariances"
    if np.all(_moves(seen) <= STILL * _moves(due).max()) or np.all(seen.std(axis=0) <= STILL * due.std(axis=0).max()):
        return Fault((cell,), "dead", share, f"{name} is dead: it does not answer to load{rest}")
    seen, due = seen[bad], due[bad]
    gains = np.sum(seen * due, axis=0) / np.sum(due**2, axis=0)
    odd = np.flatnonzero((np.abs(gains) > PREFIX) | (np.abs(gains) < 1 / PREFIX))
    if len(odd):
        which = names[int(odd[0])] if names else f"channel {'xyz'[int(odd[0])]} of {name}"
        return Fault(
            (cell,),
            "unit",
            share,
            f"{which} reads {abs(gains[odd[0]]):.3g} times what it should: is it in another unit (mV for V)?",
        )
    if _repeats(seen):
        return Fault((cell,), "saturated", share, f"{name} is saturated: it goes no further than one voltage{rest}")
    off = seen - due
    if np.all(np.abs(gains - 1.0) < SAME_GAIN) or _steady(off, due):
        volts = float(np.abs(off.mean(axis=0)).max())
        return Fault((cell,), "drifting", share, f"{name} drifts: it is off by {volts:.2g} V whatever the load{rest}")
    return Fault((cell,), "gain", share, f"{name} answers differently to load than when it was calibrated{rest}")


def _repeats(values: np.ndarray) -> bool:
    """Whether a channel often reads exactly what it read before, as one at its range does."""
    return bool(np.mean(np.diff(values, axis=0) == 0, axis=0).max(initial=0.0) > CLIPPED)


def _moves(values: np.ndarray) -> Float[np.ndarray, "3"]:
    """How much each channel usually changes meanwhile; jumps between logs do not count."""
    lag = max(1, len(values) // LAGS)
    return np.median(np.abs(values[lag:] - values[:-lag]), axis=0) if len(values) > lag else np.zeros(3)


def _steady(off: np.ndarray, due: np.ndarray) -> bool:
    """Whether what a cell is off by has little to do with its load."""
    centred, load = off - off.mean(axis=0), due - due.mean(axis=0)
    explained = np.sum(centred * load, axis=0) ** 2 / np.maximum(np.sum(load**2, axis=0), 1e-300)
    return bool(np.sum(explained) < 0.1 * np.sum(off**2))


def _swapped(cells: LoadCells, some: np.ndarray, kept: np.ndarray, share: float) -> Fault | None:
    """The two cells that agree with the others when they are exchanged."""
    best, least, bound = None, AGREE, _bound(3 * int(kept.sum()) - 6)
    for one, other in combinations(np.flatnonzero(kept).tolist(), 2):
        order = np.arange(len(some.T)).reshape(-1, 3)
        order[[one, other]] = order[[other, one]]
        agree = float(np.mean(cells.chi_square(some[:, order.reshape(-1)], kept) <= bound))
        if agree > least:
            best, least = (one, other), agree
    if best is None:
        return None
    one, other = best
    return Fault(
        best,
        "swapped",
        share,
        f"cells {one + 1} and {other + 1} are exchanged: exchange their columns in [load_cells] columns",
    )


def _still(cells: LoadCells, usable: np.ndarray, kept: np.ndarray, share: float) -> Fault | None:
    """Of three cells, the one that does not move while the others do."""
    size = np.sqrt(np.diag(cells.noise)).reshape(-1, 3)
    moves = (usable.std(axis=0).reshape(-1, 3) / size).max(axis=1)
    for cell in np.flatnonzero(kept):
        others = [other for other in np.flatnonzero(kept) if other != cell]
        column = usable[:, 3 * cell : 3 * cell + 3]
        if moves[cell] <= STILL * moves[others].max() or moves[cell] < 0.1:
            return Fault((int(cell),), "dead", share, f"cell {cell + 1} is dead, and of three none can be spared")
        if _repeats(column) and not _repeats(np.delete(usable, np.s_[3 * cell : 3 * cell + 3], axis=1)):
            said = f"cell {cell + 1} is saturated, and of three none can be spared"
            return Fault((int(cell),), "saturated", share, said)
    return None


def _several(share: float) -> str:
    return (
        f"the cells contradict each other in {share:.1%} of the samples, and no single cell explains it: "
        "is this the calibration of these cells, and are the columns in the order in which they were calibrated?"
    )
