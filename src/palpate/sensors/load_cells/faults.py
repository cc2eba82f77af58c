"""Find faults of cells and channels by comparing their readings with those that the others predict."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float

from palpate.sensors.load_cells.explanations import Explanations, explanations, unlikely
from palpate.sensors.load_cells.model import LoadCells
from palpate.spatial.arguments import takes_arrays

RARE = 0.002  # share of samples that may contradict
AGREE = 0.9  # share of the contradicting samples that a cause must explain
STILL = 0.02  # of the predicted movement: a cell that moves less is dead
QUIET, MOST = 4.0, 0.9  # times the noise: less than this is most of the changes of a channel that has died
LOADED = 10.0  # times the noise, by which it must have been loaded before and after
SAME = 7.0  # median deviations within which a channel that died keeps its level
CLIPPED = 0.1  # share of samples that repeat the one before exactly
SAME_GAIN = 0.1  # by which the gain of a drifting cell may differ
LAGS = 100  # parts of a log over which a cell's movement is measured
PREFIX = 300.0  # a gain wrong by this factor is a prefix of the unit
PROPORTIONAL = 0.01  # largest relative squared residual of a channel in another unit, after its gain is divided out


@dataclass(frozen=True)
class CellFault:
    """A fault of one or more cells.

    Attributes:
        cells: numbers, from 0; () for "several".
        kind: "dead", "stuck", "saturated", "swapped", "drifting", "unit", "gain", "unclear" where any one of the cells
            may be wrong, or "several" where no single cause explains the readings.
        share: of the samples in which the fault shows.
        text: sentence about the fault, with advice.
        channels: numbers, from 0, of those that are or may be wrong; () where they are not known.
    """

    cells: tuple[int, ...]
    kind: str
    share: float
    text: str
    channels: tuple[int, ...] = ()


@takes_arrays
def find_faults(
    cells: LoadCells,
    readings: Float[np.ndarray, "n m"],
    sound: Bool[np.ndarray, " some"] | None = None,
    names: tuple[str, ...] = (),
    time: Float[np.ndarray, " n"] | None = None,
) -> list[CellFault]:
    """Return a list of one `CellFault` where the cells of a log contradict each other, else [].

    They do if the chi-square of the readings exceeds its bound in more than 0.2 % of the samples. The cause is each
    channel or cell without which the samples agree, or the pair of cells whose exchange makes them agree. Of three
    cells only a wrong channel, an exchanged pair, or a cell that does not move or repeats its reading is found.

    Args:
        cells: the model.
        readings: (n, a k) [V] less the zero; rows that are not finite are omitted.
        sound: (k,) cells or (a k,) channels to judge; None: all.
        names: names of the channels, for messages.
        time: (n,) [s] of the readings, for the message on a channel that dies during the log; None: not known.

    Raises:
        InputError: arrays of other shapes.
        NotIdentifiable: the channels to judge do not determine a wrench.
    """
    kept = cells.channels(sound)
    finite = np.isfinite(readings).all(axis=1)
    usable, when = readings[finite], None if time is None else time[finite]
    if not len(usable):
        return []
    made = explanations(cells, kept)
    agree, fits = made.fits(usable)
    bad = ~agree
    share = float(bad.mean())
    if share <= RARE:
        return []
    whole = np.asarray(kept.reshape(-1, len(cells.axes)).any(axis=1))
    cause = _explained(made, usable, bad, fits, names, when) or _other_gain(cells, usable[bad], kept, share)
    cause = cause or _swapped(cells, usable[bad], whole, share)
    if cause is None and (int(whole.sum()) == 3 or len(cells.axes) == 1):
        cause = _still(cells, usable, whole, share)
    said = (
        f"the cells contradict each other in {share:.1%} of the samples, and no single cell explains it: check that "
        "this is the calibration of these cells, and that the columns are in the order of the calibration"
    )
    return [cause or CellFault((), "several", share, said)]


def _explained(
    made: Explanations,
    usable: np.ndarray,
    bad: np.ndarray,
    fits: np.ndarray,
    names: tuple[str, ...],
    when: np.ndarray | None,
) -> CellFault | None:
    """Return the fault of the channel or cell without which the others agree, or of all candidates."""
    share = np.mean(fits[bad], axis=0)
    if share.max() < AGREE:
        return None
    likely = made.simplest(share >= max(AGREE, share.max() - RARE))
    candidates = np.flatnonzero(likely).tolist()
    stuck = [e for e in np.flatnonzero(share >= AGREE).tolist() if _repeats(usable[:, made.channels(e)]).all()]
    still = [e for e in stuck if e < made.cells.cells] or stuck  # the whole cell, where all of it stands still
    odd = [e for e in candidates if _in_other_unit(*_beside(made, usable, e))]
    for marked in (still, odd):
        if len(marked) == 1:
            candidates = marked
    if len(candidates) > 1:
        return _unclear(made, candidates, float(bad.mean()))
    seen, due = _beside(made, usable, candidates[0])
    return _died(made, candidates[0], seen, due, bad, when) or _named(made, candidates[0], seen, due, bad, names)


def _beside(made: Explanations, usable: np.ndarray, which: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the readings of an explanation's channels, and those that the others predict, (n, c) each."""
    out = made.channels(which)
    return usable[:, out], made.wrenches(usable, which) @ made.cells.matrix[out].T


def _in_other_unit(seen: np.ndarray, due: np.ndarray) -> bool:
    """Return whether a channel is its prediction times a large or small factor, with no other difference."""
    gains = np.sum(seen * due, axis=0) / np.maximum(np.sum(due**2, axis=0), 1e-300)
    rest = np.sum((seen - gains * due) ** 2, axis=0) <= PROPORTIONAL * np.sum(seen**2, axis=0)
    return bool(np.any(rest & _far(gains)))


def _far(gains: np.ndarray) -> np.ndarray:
    return (np.abs(gains) > PREFIX) | (np.abs(gains) < 1 / PREFIX)


def _unclear(made: Explanations, candidates: list[int], share: float) -> CellFault:
    count, cells = made.cells.cells, tuple(made.cell(e) for e in candidates)
    names = made.cells.axes if len(made.cells.axes) > 1 else ("",)
    axes = {names[(e - count) % len(names)] if e >= count else "" for e in candidates}
    if len(axes) == 1:
        axis, numbers = axes.pop(), ", ".join(str(cell + 1) for cell in cells)
        which = f"channel {axis} of one of cells {numbers}" if axis else f"one of cells {numbers}"
    else:
        which = "one of " + ", ".join(_label(made, e) for e in candidates)
    said = (
        f"{which} is wrong, and their readings cannot tell which. Contacts are the mean of those found without each, "
        "and their covariances include all of these"
    )
    channels = np.concatenate([np.flatnonzero(made.channels(e)) for e in candidates])
    return CellFault(cells, "unclear", share, said, tuple(channels.tolist()))


def _label(made: Explanations, which: int) -> str:
    count = made.cells.cells
    return f"cell {which + 1}" if which < count else made.cells.label(which - count)


def _died(
    made: Explanations, which: int, seen: np.ndarray, due: np.ndarray, bad: np.ndarray, when: np.ndarray | None
) -> CellFault | None:
    """Return the fault of a cell or channel that answered to load at first, and later only has its noise."""
    channels = np.flatnonzero(made.channels(which))
    noise = np.sqrt(np.diag(made.cells.noise))[channels]
    begin = int(np.argmax(bad))
    before, after = slice(begin), slice(begin, None)
    loaded = [np.any(due[part].std(axis=0) > LOADED * noise) for part in (before, after) if len(bad[part])]
    still = np.maximum(QUIET * noise, STILL * _moves(due[after]).max())
    if len(loaded) < 2 or not all(loaded) or np.any(_moves(seen[after], MOST) > still):
        return None
    first = seen[after][:LAGS]
    level, scatter = np.median(first, axis=0), np.median(np.abs(first - np.median(first, axis=0)), axis=0)
    if np.any(_repeats(seen[after], AGREE) & (np.abs(level) > np.abs(seen[before]).max(axis=0))):
        return None  # a voltage that it never had, without noise: it is stuck
    moving = np.flatnonzero(np.any(np.abs(seen[before] - level) > SAME * scatter, axis=1))
    since = "" if when is None else f" from {when[moving[-1] + 1 if len(moving) else 0]:.4g} s on"
    rest = f"the other {'cells' if len(channels) > 1 else 'channels'} go on without it, with wider covariances"
    said = f"{_label(made, which)} is dead{since}: it does not answer to load; {rest}"
    return CellFault((made.cell(which),), "dead", float(bad.mean()), said, tuple(channels.tolist()))


def _named(
    made: Explanations, which: int, seen: np.ndarray, due: np.ndarray, bad: np.ndarray, names: tuple[str, ...]
) -> CellFault:
    """Return the fault of a cell or channel, its kind judged by its readings and their prediction."""
    name, share, channels = _label(made, which), float(bad.mean()), np.flatnonzero(made.channels(which)).tolist()

    def fault(kind: str, text: str) -> CellFault:
        return CellFault((made.cell(which),), kind, share, text, tuple(channels))

    rest = f"; the other {'cells' if len(channels) > 1 else 'channels'} go on without it, with wider covariances"
    if np.all(_moves(seen) <= STILL * _moves(due).max()) or np.all(seen.std(axis=0) <= STILL * due.std(axis=0).max()):
        return fault("dead", f"{name} is dead: it does not answer to load{rest}")
    clipped = _clipped(seen, due, bad)
    seen, due = seen[bad], due[bad]
    gains = np.sum(seen * due, axis=0) / np.sum(due**2, axis=0)
    odd = np.flatnonzero(_far(gains) & ~_repeats(seen, AGREE))
    if len(odd):
        channel = channels[int(odd[0])]
        label = names[channel] if names else made.cells.label(channel)
        factor = abs(gains[odd[0]])
        return fault("unit", f"{label} reads {factor:.3g} times what it should: check its unit (mV for V)")
    if _repeats(seen).any() and clipped:
        return fault("saturated", f"{name} is saturated: it does not go beyond one voltage{rest}")
    if _repeats(seen).any():
        return fault("stuck", f"{name} is stuck: it stays at one voltage whatever the load{rest}")
    off = seen - due
    if np.all(np.abs(gains - 1.0) < SAME_GAIN) or _steady(off, due):
        volts = float(np.abs(off.mean(axis=0)).max())
        return fault("drifting", f"{name} drifts: it is off by {volts:.2g} V whatever the load{rest}")
    return fault("gain", f"{name} answers differently to load than when it was calibrated{rest}")


def _repeats(values: np.ndarray, share: float = CLIPPED) -> Bool[np.ndarray, " c"]:
    """Return which channels (c,) repeat their last reading exactly in more than `share` of the samples."""
    if len(values) < 2:
        return np.zeros(int(values.shape[1]), dtype=bool)
    return np.asarray(np.mean(np.diff(values, axis=0) == 0, axis=0) > share, dtype=bool)


def _clipped(seen: np.ndarray, due: np.ndarray, bad: Bool[np.ndarray, " n"]) -> bool:
    """Return whether the load lies beyond repeated readings, away from zero, as at the end of a range."""
    held = (np.diff(seen, axis=0, prepend=np.nan) == 0) & bad[:, None]
    beyond = np.where(seen == 0, True, np.sign(seen) * (due - seen) >= 0)
    return bool(np.count_nonzero(held & beyond) > 0.5 * np.count_nonzero(held))


def _moves(values: np.ndarray, share: float = 0.5) -> Float[np.ndarray, " c"]:
    """Return the change (c,) of each channel over a hundredth of the log, the median or another quantile."""
    lag = max(1, len(values) // LAGS)
    if len(values) <= lag:
        return np.zeros(int(values.shape[1]))
    return np.asarray(np.quantile(np.abs(values[lag:] - values[:-lag]), share, axis=0), dtype=np.float64)


def _steady(off: np.ndarray, due: np.ndarray) -> bool:
    """Return whether the error `off` of a cell hardly depends on its load."""
    centred, load = off - off.mean(axis=0), due - due.mean(axis=0)
    explained = np.sum(centred * load, axis=0) ** 2 / np.maximum(np.sum(load**2, axis=0), 1e-300)
    return bool(np.sum(explained) < 0.1 * np.sum(off**2))


def _other_gain(cells: LoadCells, some: np.ndarray, kept: np.ndarray, share: float) -> CellFault | None:
    """Return the fault of the one cell of a single axis that agrees with the others if its gain is another.

    Of four cells, no three can judge the fourth in a sample; that the error grows with its load can, over many.
    """
    if len(cells.axes) > 1:
        return None
    _, _, rest = cells.inverse(kept)
    bound, more, agreeing = unlikely(len(rest)), np.zeros(cells.cells), np.zeros(cells.cells)
    for cell in np.flatnonzero(kept).tolist():
        alone = np.outer(some[:, cell], rest[:, cell])
        part = float(np.sum(alone * (some @ rest.T)) / max(float(np.sum(alone**2)), 1e-300))
        mended = some.copy()
        mended[:, cell] *= 1.0 - part
        more[cell] = part / (1.0 - part) if part != 1.0 else np.inf
        agreeing[cell] = np.mean(cells.chi_square(mended, kept) <= bound)
    named = np.flatnonzero(agreeing > max(AGREE, agreeing.max() - RARE))
    if not len(named) or not np.isfinite(more[named]).all():
        return None
    numbers = ", ".join(str(cell + 1) for cell in named)
    which = f"cell {numbers} reads" if len(named) == 1 else f"one of cells {numbers} reads"
    size = ", ".join(_otherwise(share) for share in more[named].tolist())
    said = f"{which} {size} than when it was calibrated: check what else carries it, and calibrate again"
    kind = "gain" if len(named) == 1 else "unclear"
    return CellFault(tuple(named.tolist()), kind, share, said, tuple(named.tolist()))


def _otherwise(share: float) -> str:
    """Return text on by what share a cell reads more."""
    return "with the other sign" if share < -1.0 else f"{100 * abs(share):.2g} % {'more' if share > 0 else 'less'}"


def _swapped(cells: LoadCells, some: np.ndarray, kept: np.ndarray, share: float) -> CellFault | None:
    """Return the fault of the two cells that agree with the others when exchanged."""
    each = len(cells.axes)
    bound = unlikely(each * int(kept.sum()) - cells.measured.shape[1])

    def agreeing(pair: tuple[int, int]) -> float:
        order = np.arange(len(some.T)).reshape(-1, each)
        order[list(pair)] = order[list(pair[::-1])]
        return float(np.mean(cells.chi_square(some[:, order.reshape(-1)], kept) <= bound))

    pair = max(combinations(np.flatnonzero(kept).tolist(), 2), key=agreeing)
    if agreeing(pair) <= AGREE:
        return None
    said = f"cells {pair[0] + 1} and {pair[1] + 1} are exchanged: exchange their columns in [load_cells] columns"
    return CellFault(pair, "swapped", share, said)


def _still(cells: LoadCells, usable: np.ndarray, kept: np.ndarray, share: float) -> CellFault | None:
    """Return the fault of the cell, of as few as are needed, that does not move or repeats its readings alone."""
    each, need = len(cells.axes), "all three cells are needed" if kept.sum() == 3 else "its load is missing"
    moves = (usable.std(axis=0) / np.sqrt(np.diag(cells.noise))).reshape(-1, each).max(axis=1)
    for cell in np.flatnonzero(kept).tolist():
        others, its = kept & (np.arange(len(kept)) != cell), slice(each * cell, each * (cell + 1))
        column = usable[:, its]
        if moves[cell] <= STILL * moves[others].max() or moves[cell] < 0.1:
            kind = "dead"
        elif _repeats(column).any() and not _repeats(np.delete(usable, its, axis=1)).any():
            kind = "saturated" if _leaves(column) else "stuck"
        else:
            continue
        return CellFault((cell,), kind, share, f"cell {cell + 1} is {kind}, and {need}")
    return None


def _leaves(column: np.ndarray) -> bool:
    """Return whether channels mostly stop repeating a reading before the log ends, as at a range's end."""
    held = np.diff(column, axis=0) == 0
    last = np.logical_and.accumulate(held[::-1], axis=0)[::-1]
    return bool(np.count_nonzero(held & ~last) > 0.5 * np.count_nonzero(held))
