"""Readings of taxels become contacts: several at once, each with place, force, pressure, area, axes and identity."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain
from math import inf
from types import ModuleType

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from palpate.calls import called_as
from palpate.contact.contacts import Contacts
from palpate.contact.estimator import NOTHING_BESIDE, instant, rows_of, samples
from palpate.errors import InputError
from palpate.sensors.filters import Filter
from palpate.sensors.intensity import Curve, Intensity
from palpate.sensors.recording import CELLS, LARGEST, Recording
from palpate.sensors.smoothing import BothWays, Forward, known_rate, require_forward
from palpate.sensors.taxel_health import FEWEST, Health, at_rest, examine
from palpate.sensors.taxels import TaxelBody
from palpate.sensors.wrench_sensor import Tare
from palpate.spatial._arrays import require_out, shaped
from palpate.spatial.pose import Pose

__all__ = ["FEATURES", "TaxelEstimator", "TaxelSettings"]

FEATURES = ("area", "load", "peak", "pressure", "axis_long", "axis_short", "angle", "cells")
HEAD = 2048  # frames from which rest, noise and faults are taken
_ROWS = 1024  # of a piece of answers
_UNKNOWN, _CALIBRATED = 0.1, 0.02  # shares by which gains differ: of cells as they are made, and of calibrated ones
_PLAIN = Intensity((Curve("polynomial", np.ones(1), np.zeros((1, 1)), largest=1.0),), unit="newtons")


@dataclass(frozen=True)
class TaxelSettings:
    """How contacts are found.

    Args:
        on, off: a contact begins where a cell stands so many deviations of its noise above its rest, and reaches as far
            as cells that stand `off` above: a threshold of each cell's own, that follows its drift.
        sure, share: two peaks are two contacts if the saddle lies deeper than `sure` deviations and than this share of
            the lower peak.
        unequal: share by which a cell's gain may be off from its curve, beside its noise; None: 0.02 of cells whose
            curves are known, 0.1 of others.
        drift: [s] in which the rest of an untouched cell is followed; inf: it stays.
        walk: [counts/sqrt(s)] by which a cell's rest wanders. Where it is stated, it takes the place of `drift`: the
            rest is followed by a Kalman filter, a second late and while nothing touches the cell, and what is not
            known of it is in the thresholds and the covariance. 0: not known.
        reach, speed, patience: of identities: a contact may be `reach` [m] off from one frame to the next, and move at
            `speed` [m/s] beside that; one that is lost is waited for `patience` [s].
    """

    on: float = 6.0
    off: float = 3.0
    sure: float = 5.0
    share: float = 0.05
    unequal: float | None = None
    drift: float = 10.0
    walk: float = 0.0
    reach: float = 0.012
    speed: float = 0.5
    patience: float = 0.3

    def __post_init__(self) -> None:
        if not 0 < self.off <= self.on < inf:
            raise InputError(f"off ({self.off:g}) must lie between 0 and on ({self.on:g}).")
        if not (self.drift > 0 and self.sure >= 0 and 0 <= self.share < 1):
            raise InputError("drift must be positive, sure not negative and share between 0 and 1.")
        if not 0 <= self.walk < inf:
            raise InputError("walk must not be negative.")
        if self.unequal is not None and not 0 <= self.unequal < inf:
            raise InputError("unequal must not be negative.")
        if not (self.reach > 0 and self.speed >= 0 and self.patience >= 0):
            raise InputError("reach must be positive, speed and patience not negative.")


@called_as(
    "palpate.TaxelEstimator(palpate.TaxelBody.anywhere(positions, normals))",
    update="skin.update(time, readings)",
    run='skin.run(palpate.Recording(times, {"cells": readings}))',
    tare='skin.tare(palpate.Recording(times, {"cells": readings}))',
    estimate='skin.run(palpate.Recording(times, {"cells": readings}))',
)
class TaxelEstimator:
    """The estimator of taxels: each frame is answered with what those before it left (rest, identities, filter).

    A cell's reading is taken from its rest, which follows drift while nothing touches it, and turned into force before
    anything is summed. Contacts are connected cells; one whose pressure has two peaks with a saddle between them is
    two, whose cells are shared out by a mixture of two round Gaussians. The place on a sheet is the centroid, divided
    by the sum of the forces [skin map, (1) corrected], on the map between cell centres. Of taxels anywhere it is the
    middle of a round Gaussian that is fitted to their readings, so that an edge of the skin or a hole does not pull it,
    lifted onto the body. Its covariance holds that of the taxels' own places, where the body has one, as if those of a
    contact erred alike. The force is the sum over the cells, each along its own normal; the torque about the normal is
    NaN, because cells feel no shear. SATURATED: located, but the force is a lower bound.

    Features: on a sheet `row`, `column` between cell centres, which have whole numbers; `area` [m^2] of the cells that
    are pressed; `load` [N], the sum of the cells' forces along their own normals, on a curved body more than the force;
    `peak` [Pa] of one cell; `pressure` [Pa], the mean; `axis_long`, `axis_short` [m], deviations of the pressure along
    its principal axes; `angle` [rad] of the long one, from the direction of rising rows towards that of rising columns,
    or anticlockwise from `TaxelBody.tangents`; `cells`, how many.

    Rest, noise and bad cells are `health`, or found in the first 2,048 frames that `run`, `pairs` or `stream` are
    given; `tare` states the rest, and `update` needs it or `health`.

    Args:
        body: where the cells are.
        intensity: what their readings mean; None: a count is taken for a newton.
        health: from `palpate.sensors.taxel_health.examine`.
        settings: how contacts are found.
        filter: of each cell's reading; None: none. One of zero phase works in `pairs` and `stream` only.
        rate: [Hz] of the frames; a filter needs it.
        mount: T_sensor_surface.

    Raises:
        InputError: body, curves and health are not of one size, no cell is good, or a filter has no rate.
    """

    channels = (CELLS,)

    def __init__(
        self,
        body: TaxelBody,
        intensity: Intensity | None = None,
        health: Health | None = None,
        *,
        settings: TaxelSettings | None = None,
        filter: Filter | None = None,
        rate: float | None = None,
        mount: Pose | None = None,
    ) -> None:
        from palpate.contact import _taxels, _track  # compiled: loaded when first needed

        self.body, self.settings, self.filter, self.rate = body, settings or TaxelSettings(), filter, rate
        self.intensity, self.mount = intensity, Pose.identity() if mount is None else mount
        self.features = ("row", "column", *FEATURES) if body.rows else FEATURES
        self.health: Health | None = None
        self._tared = Tare("", "")
        self._width = _taxels.AREA + len(self.features) + 1
        self._looked = health is not None
        curves = intensity or _PLAIN
        self._falling = curves.curves[0].falling
        which, count = curves.numbers(body.shape), len(body)
        limits = np.array([curve.saturation for curve in curves.curves])
        limits = np.where(np.isnan(limits), -np.inf if self._falling else body.top, limits)
        self._curves = curves.tables()
        grid = np.zeros((0, 0, 6)) if body.grid is None else body.grid.copy()
        vectors = np.stack([body.positions, body.normals, body.tangents])
        known = np.zeros((0, 3, 3)) if body.covariance is None else body.covariance.copy()
        self._place = (vectors, np.stack([body.areas, body.spacing]), grid, body.turn, known)
        tables = (body.neighbours.copy(), body.steps.copy(), body.between.copy())
        self._table = (*tables, max(body.columns, 1))
        self._zero_phase = filter is not None and filter.zero_phase
        self._recursion = None if filter is None else filter.recursion(known_rate(self.rate, "frames"))
        self._forward: Forward | None = None
        if self._recursion is not None and not self._zero_phase:
            self._forward = Forward(self._recursion, known_rate(self.rate, "frames"), count)
        self._clock = np.zeros(2)
        self._zeros = np.zeros((_taxels.SLOTS, count)), np.zeros((_taxels.SLOTS, 3)), np.full(2, np.nan)
        self._turn = 0.0 if body.bits is None else body.top + 1.0
        self._numbers = np.ones((_taxels.NUMBERS, count))
        self._whole = np.zeros((_taxels.WHOLE, count), dtype=np.int64)
        self._numbers[_taxels.LIMIT], self._whole[_taxels.CURVE] = limits[which], which
        self._tracks = np.full((_track.TRACKS, _track.TRACK), -1.0), np.ones(1, dtype=np.int64)
        self._single = np.zeros(1), np.zeros((1, count)), np.zeros(1, dtype=np.int64)
        self._buffer = np.zeros((1, count)), np.zeros(1, dtype=np.int8), np.zeros(0)
        self._compile(health)

    @property
    def most(self) -> int:
        """Contacts of one frame."""
        return self._kernels.MOST

    def empty(self, *batch: int) -> Float[np.ndarray, "*batch w"]:
        """Rows for `update_into`: `contact.estimate.ROW`, then `features`, then the identity."""
        return np.zeros((*batch, self._width))

    def reset(self) -> None:
        """Forget what frames left: the drift of the rest, readings that wrapped around, the filter, identities."""
        kernels, health = self._kernels, self.health
        if health is not None:
            self._numbers[[kernels.BASELINE, kernels.HELD]] = health.baseline
            walks = self.settings.walk > 0.0
            self._numbers[kernels.VARIANCE] = health.noise**2 / max(1, health.frames) if walks else 0.0
        self._zeros[1][:], self._zeros[2][:] = 0.0, np.nan
        self._whole[kernels.TOUCHED] = kernels.NEVER
        self._numbers[kernels.LAST] = np.nan
        self._whole[[kernels.TURNS, kernels.WRAPPED]] = 0
        self._clock[:] = np.nan, 0.0
        self._tracks[0][:], self._tracks[1][:] = -1.0, 1
        if self._forward is not None:
            self._forward.reset()

    @property
    def _kernels(self) -> ModuleType:
        from palpate.contact import _taxels  # no attribute: a module cannot be pickled

        return _taxels

    @property
    def force(self) -> Float[np.ndarray, "*cells"]:
        """[N] of each cell in the last frame, below the thresholds too; a view that the next frame overwrites."""
        return self._numbers[self._kernels.FORCE].reshape(self.body.shape)

    @property
    def rest(self) -> tuple[Float[np.ndarray, "*cells"], Float[np.ndarray, "*cells"]]:
        """[counts] of each cell after the last frame, and its deviation: 0 where no `walk` is stated."""
        kernels = self._kernels
        rest, deviation = self._numbers[kernels.BASELINE].copy(), np.sqrt(self._numbers[kernels.VARIANCE])
        return rest.reshape(self.body.shape), deviation.reshape(self.body.shape)

    @property
    def label(self) -> Int[np.ndarray, "*cells"]:
        """Which area each cell belongs to in the last frame, from 1; 0: none, negative: the rim of that area."""
        return self._whole[self._kernels.LABEL].reshape(self.body.shape)

    @property
    def wrapped(self) -> Int[np.ndarray, "*cells"]:
        """How often each cell's reading went over an end of its range and came out at the other."""
        return self._whole[self._kernels.WRAPPED].reshape(self.body.shape)

    def tare(self, recording: Recording) -> Tare:
        """Take the mean reading of each cell in a window as its rest from now on, in place of another; then `reset`.

        Args:
            recording: steady and untouched.

        Returns:
            what the rest is, and a doubt where it could be a touch, each as a sentence.

        Raises:
            InputError: too few frames, or not steady: what was seen.
        """
        before = self.health
        rest = at_rest(recording, self.body, falling=self._falling)
        noise = float(np.median(rest.noise))
        said = (
            f"tare over {rest.frames} frames: cells rest at {np.median(rest.baseline):.3g}, with noise of {noise:.2g}"
        )
        usual = np.median(rest.baseline) if before is None else before.baseline
        above = (-1.0 if self._falling else 1.0) * (rest.baseline - usual)
        scatter = 0.0 if before is not None else 14.8 * float(np.median(np.abs(above - np.median(above))))
        pressed = np.flatnonzero(self.body.usable & (above > scatter + 3.0 * self.settings.on * rest.noise))
        doubt = ""
        if len(pressed) and len(pressed) < 0.5 * len(self.body):
            where = ", ".join(self.body.name(cell) for cell in pressed[:5].tolist())
            doubt = f"cells {where} rest high, as under a steady touch: make sure that nothing touched them"
        if before is not None:
            rest = replace(rest, dead=before.dead, stuck=before.stuck, notes=before.notes, doubts=before.doubts)
        self._tared = Tare(said, doubt)
        self._know(rest)
        return self._tared

    def update(
        self,
        time: ArrayLike,
        reading: ArrayLike,
        rotation: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> Contacts:
        """The contacts of one frame; one row that says so where there is none.

        Args:
            time: [s] on the clock of the frames.
            reading: raw, rows x columns or one a taxel; another size, or many that are no number, is INVALID.
            rotation: makes no difference to taxels.
            acceleration: makes none either.

        Raises:
            InputError: the rest is not known, or the filter looks ahead.
        """
        rows, time = self.empty(self._kernels.MOST), instant(time)
        rows = rows[: self.update_into(time, reading, rows)]
        return self._contacts(rows, np.zeros(len(rows), np.int64), np.full(len(rows), time, dtype=np.float64))

    def update_into(
        self,
        time: ArrayLike,
        reading: ArrayLike,
        out: Float[np.ndarray, "*rows w"],
        rotation: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> int:
        """`update` into rows of `empty`, for a control loop: how many are written, at least 1, as many as fit."""
        require_forward(self.filter)
        self._require_rest()
        width = self._kernels.AREA + len(self.features) + 1
        writable = rows_of(out, width)
        frame = self.body.picked(shaped(reading, (...,), "reading"))
        fits = frame.shape == self.body.shape or frame.shape == (len(self.body),)
        when, raw, rows = self._single
        when[0] = instant(time)
        raw[0] = frame.reshape(-1) if fits else np.nan
        raw[np.abs(raw) > LARGEST] = np.nan  # a fault of the sensor
        return self._run(when, raw, self._buffer, writable, rows, self._buffer[0][:0])[1]

    def run_into(
        self,
        time: ArrayLike,
        readings: ArrayLike,
        out: Float[np.ndarray, "rows width"],
        counts: Int[np.ndarray, " n"],
        beside: Mapping[str, ArrayLike] = NOTHING_BESIDE,
    ) -> int:
        """`run` of arrays; see `ContactEstimator`. What is known beside makes no difference."""
        require_forward(self.filter)
        self._require_rest()
        require_out(out, (None, self._width))
        time, readings, _ = samples(time, readings, counts)
        if not len(out):
            return 0
        raw = self.body.readings(Recording(time, {CELLS: readings}, source="the stream"))
        return self._run(time, raw, self._buffer, out, counts, self._buffer[0][:0])[0]

    def run(self, recording: Recording) -> Contacts:
        """The contacts of a block, at least one row a frame.

        Raises:
            InputError: frames of another size; the rest is not known and cannot be found; or the filter looks ahead.
        """
        require_forward(self.filter)
        if len(recording):
            self._look(recording)
        return self._answer(recording, 0, None)

    def pairs(
        self,
        blocks: Iterable[Recording],
        forces: Callable[[np.ndarray], None] | None = None,
    ) -> Iterator[tuple[Recording, Contacts]]:
        """Each block with its contacts, in order, as soon as they are known; a filter of zero phase looks ahead.

        Args:
            blocks: of one log, from its start: its first frames say what is not known of rest, noise and bad cells.
            forces: is given the force [N] of each cell of each block, (n, rows, columns) or (n, k).

        Raises:
            InputError: as `run`, but for that filter.
        """
        first, both = 0, None
        if self._zero_phase and self._recursion is not None:
            both = BothWays(self._recursion, known_rate(self.rate, "frames"), len(self.body))
        waiting: deque[tuple[Recording, np.ndarray, np.ndarray]] = deque()
        for block in chain(self._examined(iter(blocks)), [None]):
            if both is not None:
                if block is None:
                    both.finish()
                else:
                    waiting.append((block, *self._prepare(block, both)))
                while waiting and both.ready >= np.count_nonzero(waiting[0][2] < 0):
                    done, values, status = waiting.popleft()
                    good, left = status < 0, np.ones(len(status))
                    values[good], left[good] = both.take(int(np.count_nonzero(good)))
                    yield done, self._answer(done, first, forces, (values, status, left))
                    first += len(done)
            elif block is not None:
                yield block, self._answer(block, first, forces)
                first += len(block)

    def stream(self, blocks: Iterable[Recording]) -> Iterator[Contacts]:
        """The contacts of `pairs` alone."""
        return (found for _, found in self.pairs(blocks))

    def notes(self) -> tuple[str, ...]:
        """What was met so far, one sentence each."""
        said = list(self.body.notes)
        if self.intensity is None:
            said.append("no intensity model: a count is taken for a newton (palpate calibrate intensity makes one)")
        if self.health is None:
            return tuple(said)
        said += [*self.health.notes, *([self._tared.said] if self._tared.said else [])]
        drifted = np.abs(self._numbers[self._kernels.BASELINE] - self.health.baseline) / self.health.noise
        if drifted.max() > self.settings.on:
            cell = self.body.name(int(np.argmax(drifted)))
            moved = f"{drifted.max():.0f} deviations of its noise, most at cell {cell}"
            said.append(f"the rest of cells drifted by up to {moved}; it was followed where nothing touched")
        if self._clock[1]:
            said.append(f"{self._clock[1]:.0f} frames could not be used (another size, or no numbers)")
        wrapped = [self.body.name(cell) for cell in np.flatnonzero(self.wrapped).tolist()]
        if wrapped:
            cells = f"{', '.join(wrapped[:5])}{', ...' if len(wrapped) > 5 else ''}"
            said.append(
                f"readings of {len(wrapped)} cells went over the end of the range and came out at the other "
                f"({cells}): they were put right where it was clear"
            )
        return tuple(said)

    def doubts(self) -> tuple[str, ...]:
        """What may be wrong, one sentence each: cells that are dead or stuck, a tare that looks like a touch."""
        found = () if self.health is None else self.health.doubts
        return (*found, self._tared.doubt) if self._tared.doubt else found

    def _compile(self, health: Health | None) -> None:
        """One frame, before anything is in a hurry; then as new."""
        if health is not None:
            self._know(health)
        else:
            self._same = self._fixed()
        when, raw, rows = self._single
        buffer, status, _ = self._buffer
        if self._zero_phase:
            self._ready(raw, np.zeros(len(self.body)), buffer, status)
        self._run(when, raw, self._buffer, self.empty(1), rows, buffer[:0])
        self.reset()

    def _know(self, health: Health) -> None:
        """Rest, noise and bad cells from now on."""
        if health.baseline.shape != (len(self.body),):
            raise InputError(
                f"the frames examined are of {health.baseline.size} cells, the body has {self.body.named()}.",
                where="taxels",
            )
        good = self.body.usable & health.good
        if not good.any():
            raise InputError("no cell is good: all are masked, dead or stuck.", where="taxels")
        self.health = health
        self._whole[self._kernels.GOOD], self._numbers[self._kernels.NOISE] = good, health.noise
        self._same = self._fixed()
        self.reset()

    def _fixed(self) -> tuple[object, ...]:
        """What the compiled loop takes that is the same from frame to frame, or goes on from it."""
        set_, forward = self.settings, self._forward
        resting = 0.0 if self._recursion is None or self.health is None else 1.0 / self.health.frames
        sign = -1.0 if self._falling else 1.0
        unequal = (_UNKNOWN if self.intensity is None else _CALIBRATED) if set_.unequal is None else set_.unequal
        numbers = (set_.on, set_.off, set_.sure, set_.share, sign, unequal, set_.drift, self._turn, resting)
        settings = tuple(map(float, (*numbers, set_.reach, set_.speed, set_.patience, set_.walk)))
        smoothing = _NO_FILTER if forward is None else (*forward.parts, forward.shares)
        known = (self._place, self._table, self._curves, settings, smoothing)
        return (*known, self._clock, self._zeros, self._numbers, self._whole, *self._tracks)

    def _look(self, head: Recording) -> None:
        """Find what is not known of rest, noise and bad cells in the first frames of a log."""
        if self._looked or (self.health is not None and len(head) < FEWEST):
            return
        found, tared = examine(head.picked(slice(HEAD)), self.body, falling=self._falling), self.health
        if tared is not None:
            found = replace(found, baseline=tared.baseline, noise=tared.noise, frames=tared.frames)
        else:
            rest = "cells at rest are found in the log itself; a tare says when nothing touches"
            found = replace(found, notes=(*found.notes, rest))
        self._looked = True
        self._know(found)

    def _examined(self, blocks: Iterator[Recording]) -> Iterator[Recording]:
        """The same blocks, once the first frames are looked at."""
        head, count = list[Recording](), 0
        while not self._looked and count < HEAD and (block := next(blocks, None)) is not None:
            head.append(block)
            count += len(block)
        if count:
            cells = np.concatenate([self.body.readings(block) for block in head])
            time = np.concatenate([block.time for block in head])
            self._look(Recording(time, {CELLS: cells}, source=head[0].source))
        return chain(head, blocks)

    def _answer(
        self,
        recording: Recording,
        first: int,
        forces: Callable[[np.ndarray], None] | None,
        filtered: tuple[np.ndarray, ...] | None = None,
    ) -> Contacts:
        """A block through the compiled loop, piece by piece as its rows fit."""
        raw, count = self.body.readings(recording), len(recording)
        rows, out = np.zeros(count, dtype=np.int64), self.empty(_ROWS)
        pressed = np.zeros((count if forces is not None else 0, len(self.body)))
        parts, done = [self.empty(0)], 0
        while done < count:
            values = self._buffer if filtered is None else tuple(part[done:] for part in filtered)
            step, used = self._run(recording.time[done:], raw[done:], values, out, rows[done:], pressed[done:])
            parts.append(out[:used].copy())
            done += step
        if forces is not None:
            forces(pressed.reshape(count, *self.body.shape))
        return self._contacts(
            np.concatenate(parts), first + np.repeat(np.arange(count), rows), np.repeat(recording.time, rows)
        )

    def _run(
        self,
        time: Float[np.ndarray, " n"],
        raw: Float[np.ndarray, "n k"],
        values: tuple[np.ndarray, ...],
        out: np.ndarray,
        rows: np.ndarray,
        forces: np.ndarray,
    ) -> tuple[int, int]:
        """The compiled loop, with what stays the same from frame to frame."""
        loop: Callable[..., tuple[int, int]] = self._kernels.frames
        return loop(_constant(time), _constant(raw), *values, *self._same, out, rows, forces)

    def _prepare(self, block: Recording, both: BothWays) -> tuple[np.ndarray, np.ndarray]:
        """Readings on their way through a filter of zero phase, and which of the frames can be used."""
        raw = self.body.readings(block)
        values, status = np.empty(raw.shape), np.empty(len(raw), dtype=np.int8)
        self._ready(raw, np.zeros(0) if self.health is None else self.health.baseline, values, status)
        both.push(block.time, status, values)
        return values, status

    def _ready(self, raw: np.ndarray, rest: np.ndarray, values: np.ndarray, status: np.ndarray) -> None:
        known = (self._table[0], self._turn, self._numbers, self._whole)
        self._kernels.prepare(_constant(raw), _constant(rest), *known, values, status)

    def _contacts(
        self, rows: Float[np.ndarray, "n w"], sample: Int[np.ndarray, " n"], time: Float[np.ndarray, " n"]
    ) -> Contacts:
        return Contacts.of_rows(sample, time, rows, self.features)

    def _require_rest(self) -> None:
        if self.health is None:
            raise InputError(
                "what the cells read at rest is not known.",
                hint="Give health=examine(...), or call tare with a recording in which nothing touches.",
            )


def _constant(values: np.ndarray) -> np.ndarray:
    """A view that cannot be written to: the loops are compiled once, for those."""
    view = values.view()
    view.flags.writeable = False
    return view


_NO_FILTER = (
    np.zeros((0, 6)),
    np.zeros((0, 2)),
    np.zeros(0),
    0.0,
    np.zeros(2),
    np.zeros((1, 1)),
    np.zeros(0),
)
