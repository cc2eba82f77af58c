"""A sheet of taxels, and what its cells are worth: at rest, dead, stuck, wrapped around."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float

from palpate.errors import InputError
from palpate.sensors.recording import CELLS, Recording
from palpate.spatial._arrays import frozen

__all__ = ["Health", "Sheet", "examine"]

FEWEST = 8  # frames from which anything can be said of a cell
CLOSE = 4.0  # deviations about the resting value that still are rest
SILENT = 5  # frames in which a cell said nothing between neighbours that were pressed
PRESSED = 0.25  # of the largest excursion in the log: then a cell is pressed
AFTER, LEFT = 0.5, 0.03  # s behind a touch, and the share of a reading that may be left then
WRAP = 0.85  # of the range: a step of a cell alone that is no touch
_QUANTUM = 12**-0.5  # deviation of what is rounded to whole numbers


@dataclass(frozen=True)
class Sheet:
    """What the sheet is.

    Args:
        rows, columns: cells.
        bits: 8 to 16 of a whole-number reading; None: the readings are floats and cannot wrap.
        masked: (row, column) of cells that are not to be used.

    Raises:
        InputError: sizes that no sheet has, or a masked cell that is not on it.
    """

    rows: int
    columns: int
    bits: int | None = 8
    masked: tuple[tuple[int, int], ...] = ()

    def __post_init__(self) -> None:
        if self.rows < 1 or self.columns < 1 or self.cells < 2:
            raise InputError(f"a sheet of {self.rows} x {self.columns} cells is none.", where="skin")
        if self.bits is not None and not 1 <= self.bits <= 16:
            raise InputError(f"bits must lie between 1 and 16, not {self.bits}.", where="skin")
        for row, column in self.masked:
            if not (0 <= row < self.rows and 0 <= column < self.columns):
                raise InputError(
                    f"cell ({row}, {column}) is masked, but there are {self.rows} x {self.columns}, counted from 0.",
                    where="skin",
                )

    @property
    def cells(self) -> int:
        """How many there are."""
        return self.rows * self.columns

    @property
    def top(self) -> float:
        """The largest reading; inf for floats."""
        return np.inf if self.bits is None else 2.0**self.bits - 1.0

    def mask(self) -> Bool[np.ndarray, "rows columns"]:
        """True where a cell is used."""
        used = np.ones((self.rows, self.columns), dtype=bool)
        for row, column in self.masked:
            used[row, column] = False
        return used


@dataclass(frozen=True, eq=False)
class Health:
    """What the cells are at rest, and which are no good.

    Attributes:
        baseline: (rows, columns) reading without a touch.
        noise: (rows, columns) standard deviation of it.
        dead: (rows, columns) silent between neighbours that were pressed.
        stuck: (rows, columns) at one value that is not that of the others' rest.
        notes: one sentence each.
        hysteresis: what is left of a reading `AFTER` seconds behind a touch, as a share of its height (median over
            releases); NaN where the start of the log holds none.
    """

    baseline: Float[np.ndarray, "rows columns"]
    noise: Float[np.ndarray, "rows columns"]
    dead: Bool[np.ndarray, "rows columns"]
    stuck: Bool[np.ndarray, "rows columns"]
    notes: tuple[str, ...] = field(default=())
    hysteresis: float = float("nan")

    def turned(self) -> Health:
        """Of readings with the other sign."""
        return replace(self, baseline=frozen(-self.baseline))

    @property
    def good(self) -> Bool[np.ndarray, "rows columns"]:
        """Cells to be used."""
        return ~(self.dead | self.stuck)


def examine(frames: Recording, sheet: Sheet, *, seconds: float | None = None) -> Health:
    """Rest, noise and faults of every cell, from the start of a log; it may hold touches.

    A cell rests where its readings crowd at their lower end: within `CLOSE` deviations of it, whatever touches do
    above (a falling sensor is turned by the caller). With `seconds` the start is known to be untouched.

    Args:
        frames: with `CELLS`, (n, rows, columns) or (n, rows * columns); at least `FEWEST` of them.
        sheet: what it is.
        seconds: at the start, in which nothing was touched; None: not known.

    Raises:
        InputError: no or too few frames, or no cell ever moves from a value that is not rest.
    """
    raw = frames.channels.get(CELLS, np.empty(0))
    if raw.size != len(frames) * sheet.cells:
        raise InputError(f"has no frames of {sheet.rows} x {sheet.columns} cells.", where=frames.source)
    raw = raw.reshape(-1, sheet.rows, sheet.columns)
    known = np.isfinite(raw).all(axis=(1, 2))
    cells = raw[known]
    if len(cells) < FEWEST:
        raise InputError(
            f"{len(cells)} frames of {sheet.rows} x {sheet.columns} cells could be read of {len(frames)}; "
            f"at least {FEWEST} are needed to know the sheet at rest.",
            where=frames.source,
            mend="Does the rig's [skin] state rows and columns as the log has them?",
        )
    cells, wrapped = _unwrapped(cells, sheet)
    rest = cells
    if seconds is not None:
        time = frames.time[known]
        rest = cells[time <= time[0] + seconds]
        if len(rest) < FEWEST:
            raise InputError(f"{len(rest)} frames are too few to tare with ({seconds:g} s).", where=frames.source)
    baseline, noise = _resting(rest, whole=sheet.bits is not None)
    still = np.ptp(cells, axis=0) == 0
    stuck = _stuck(baseline, still, sheet)
    if stuck.all() or (still.all() and np.ptp(baseline) > 0 and sheet.bits is not None):
        raise InputError(
            f"every cell keeps its value in the first {len(cells):,} frames: all cells are stuck.",
            where=frames.source,
            mend="Is the sheet connected, and are the columns those of its cells?",
        )
    dead = _dead(cells - baseline, noise, still, stuck)
    good = np.where(stuck | dead, 0.0, cells - baseline)
    hysteresis = _hysteresis(frames.time[known], good, noise)
    said = [
        *_named("dead: silent between cells that are pressed", dead),
        *_named("stuck at one value", stuck),
        *_named("wrapped around (readings jump from one end of the range to the other)", wrapped),
    ]
    if still.all():
        said.append(f"no cell moves in the first {len(cells):,} frames")
    if hysteresis > LEFT:
        share = f"{100 * hysteresis:.0f} % of a reading is left {AFTER:g} s after a touch"
        said.append(f"{share}: hysteresis, or slow recovery, by which forces are too large for a while")
    return Health(frozen(baseline), frozen(noise), dead, stuck, tuple(said), hysteresis)


def _hysteresis(
    time: Float[np.ndarray, " n"], above: Float[np.ndarray, "n rows columns"], noise: Float[np.ndarray, "rows columns"]
) -> float:
    """Median over releases of cells whose surroundings were let go too; NaN where there is none."""
    flat, limit = above.reshape(len(above), -1), 0.25 * float(above.max(initial=0.0))
    if not limit > 20 * float(np.median(noise)):
        return float("nan")
    pressed = flat > limit
    later = np.searchsorted(time, time + AFTER)  # of sorted times
    found: list[float] = []
    for start, cell in np.argwhere(pressed[:-1] & ~pressed[1:]).tolist():
        end = int(later[start])
        if end < len(flat) and not pressed[start + 1 : end + 1].any() and abs(time[end] - time[start] - AFTER) < AFTER:
            found.append(float(flat[end, cell] / flat[max(start - 5, 0) : start + 1, cell].max()))
    return float(np.median(found)) if found else float("nan")


def _resting(
    cells: Float[np.ndarray, "n rows columns"], *, whole: bool
) -> tuple[Float[np.ndarray, "rows columns"], Float[np.ndarray, "rows columns"]]:
    """Mean and deviation of the crowd at each cell's lower end."""
    steps = np.abs(np.diff(cells, axis=0))
    low = np.quantile(cells, 0.1, axis=0)
    rough = np.maximum(np.median(steps, axis=0) / 0.954, 1.0 if whole else 1e-12 + 1e-6 * np.ptp(cells))
    near = np.abs(cells - low) <= 2 * CLOSE * rough
    middle = np.nanmedian(np.where(near, cells, np.nan), axis=0)
    near = np.abs(cells - middle) <= CLOSE * rough
    count = near.sum(axis=0)
    baseline = np.where(near, cells, 0.0).sum(axis=0) / count
    variance = np.where(near, (cells - baseline) ** 2, 0.0).sum(axis=0) / np.maximum(count - 1, 1)
    least = _QUANTUM if whole else 1e-9 + 1e-3 * float(np.median(np.sqrt(variance)))
    return baseline, np.sqrt(np.maximum(variance, least**2))


def _stuck(
    baseline: Float[np.ndarray, "rows columns"], still: Bool[np.ndarray, "rows columns"], sheet: Sheet
) -> Bool[np.ndarray, "rows columns"]:
    """Never moves, away from where the others rest."""
    usual = np.median(baseline)
    spread = 1.4826 * np.median(np.abs(baseline - usual))
    far = max(10 * float(spread), 0.05 * sheet.top if sheet.bits else 0.05 * float(np.ptp(baseline)), 1e-12)
    return still & (np.abs(baseline - usual) > far)


def _dead(
    above: Float[np.ndarray, "n rows columns"],
    noise: Float[np.ndarray, "rows columns"],
    still: Bool[np.ndarray, "rows columns"],
    stuck: Bool[np.ndarray, "rows columns"],
) -> Bool[np.ndarray, "rows columns"]:
    """Cells that say nothing in frames in which both of two opposite neighbours are pressed hard."""
    above = np.where(stuck, 0.0, np.abs(above))
    hard = above > max(PRESSED * float(above.max(initial=0.0)), 10 * float(np.median(noise)))
    between = np.zeros_like(hard)
    between[:, 1:-1] |= hard[:, :-2] & hard[:, 2:]
    between[:, :, 1:-1] |= hard[:, :, :-2] & hard[:, :, 2:]
    silent = above <= CLOSE * np.maximum(noise, np.median(noise))
    said_nothing = (between & silent).sum(axis=0)
    answered = (between & ~silent).sum(axis=0)
    never = above.max(axis=0) <= 2 * CLOSE * np.maximum(noise, np.median(noise))
    return ((said_nothing >= SILENT) & (answered == 0) & (never | still)) & ~stuck


def _unwrapped(
    cells: Float[np.ndarray, "n rows columns"], sheet: Sheet
) -> tuple[Float[np.ndarray, "n rows columns"], Bool[np.ndarray, "rows columns"]]:
    """At rest a whole-number reading that falls below 0 comes out at the top: such readings, put where they belong."""
    if sheet.bits is None or cells.min() < 0:  # floats, or turned: rest is at the top, and falls
        return cells, np.zeros(cells.shape[1:], dtype=bool)
    turn = sheet.top + 1.0
    noise = np.median(np.abs(np.diff(cells, axis=0)), axis=0) if len(cells) > 1 else np.zeros(cells.shape[1:])
    rest = np.quantile(cells, 0.25, axis=0)
    below = (cells > WRAP * turn) & (rest <= 1.0 + 3.0 * noise)  # noise takes no other rest below 0
    alone = np.zeros_like(below)  # a touch presses neighbours too
    for axis in (1, 2):
        for shift in (1, -1):
            alone |= np.roll(cells, shift, axis=axis) > 0.25 * turn
    below &= ~alone
    return np.where(below, cells - turn, cells), np.asarray(below.any(axis=0))


def _named(what: str, which: Bool[np.ndarray, "rows columns"]) -> list[str]:
    """A sentence that names some cells."""
    found = [f"({row}, {column})" for row, column in np.argwhere(which).tolist()]
    if not found:
        return []
    cells = f"cell{'s' if len(found) > 1 else ''} {', '.join(found[:6])}{', ...' if len(found) > 6 else ''}"
    return [f"{len(found)} of {which.size} cells {what}: {cells}"]
