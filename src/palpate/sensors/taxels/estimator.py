"""Estimate several contacts at once from readings of taxels."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from palpate.calls import called_as
from palpate.contact.contacts import Contacts
from palpate.contact.estimator import Answered, Channels, ContactEstimator, Counts, Known, Rows, Times
from palpate.contact.taxel_settings import TaxelSettings
from palpate.errors import InputError
from palpate.sensors.taxels._kernels import MOST
from palpate.sensors.taxels.frames import TaxelFrames
from palpate.sensors.taxels.health import FEWEST, Health, examine, tared
from palpate.sensors.taxels.intensity import Intensity, load_direction
from palpate.sensors.taxels.model import TaxelBody
from palpate.sensors.taxels.plausibility import unbelievable_touches, unlike_calibration
from palpate.sensors.taxels.watch import TaxelWatch
from palpate.signals.filters import Filter
from palpate.signals.recording import CELLS, LARGEST, Recording
from palpate.signals.smoothing import BothWays, Forward, known_rate, require_forward
from palpate.signals.wrench_sensor import Tare
from palpate.spatial._arrays import frozen, shaped
from palpate.spatial.arguments import unchecked
from palpate.spatial.pose import Pose

FEATURES = ("area", "load", "peak", "pressure", "axis_long", "axis_short", "angle", "cells")
"""Area [m^2] of the pressed cells; load [N], the sum of the cells' forces along their own normals, on a curved body
more than the force; pressure on one cell at most [Pa], and mean [Pa]; standard deviations of the pressure along its
principal axes [m]; angle of the long axis [rad], from rising rows towards rising columns, or anticlockwise from
`TaxelBody.tangents`; number of cells."""
SIX = ("force_xx", "force_xy", "force_xz", "force_yy", "force_yz", "force_zz")
SHEAR = ("slip", "slip_sd", "torque_sd", *SIX, "shape")
"""Ratio of tangential to normal force, its standard deviation and that of the torque [N m], the force's covariance
[N^2], and the shape, with which deviations grow: by how much the variance of the patch exceeds a usual one [squared
pitches], or the root of the sum of squared loads over the force, if that is their sum; of taxels with three axes."""
SQUARE = [0, 1, 2, 1, 3, 4, 2, 4, 5]  # where the nine numbers of a covariance are among its six
HEAD = 2048  # frames from which rest, noise and faults are taken
_ROWS = 1024  # of a piece of answers


@called_as(
    "palpate.TaxelEstimator(palpate.TaxelBody.anywhere(positions, normals))",
    update="skin.update(time, readings)",
    run='skin.run(palpate.Recording(times, {"cells": readings}))',
    tare='skin.tare(palpate.Recording(times, {"cells": readings}))',
    estimate='skin.run(palpate.Recording(times, {"cells": readings}))',
)
class TaxelEstimator(ContactEstimator):
    """An estimator of contacts in frames of taxel readings; baseline, identities and filter go on between frames.

    A frame is raw readings, rows x columns or one for each taxel; another size, or too many readings that are not
    finite, gives the status INVALID.

    A cell's force is that of its reading less its baseline, which follows drift while nothing touches the cell.
    Contacts are connected cells, split where pressure has two peaks with a saddle between. The place on a sheet is the
    centroid of the forces [skin map, (1) corrected]; for taxels anywhere the middle of a round Gaussian, fitted with
    those of its area to the readings, which an edge or a hole of the skin does not pull, lifted onto the body. Its
    covariance includes that of the taxels' positions, as if their errors in a contact were equal. The force is the sum
    over the cells, each along its own normal; the torque about the normal is NaN. SATURATED: located, but the force is
    a lower bound.

    The features are `FEATURES`, and on a sheet `row` and `column`, integers at cell centres.

    Baseline, noise and bad cells are those of `health`, or found in the first 2,048 frames of `run`, `pairs` or
    `stream`; `tare` sets the baseline, and `update` needs it or `health`.

    Args:
        body: the places of the cells.
        intensity: converts readings to forces; None: one count is taken for 1 N.
        health: from `palpate.sensors.taxels.health.examine`.
        settings: of the contact search.
        filter: of each cell's reading; one of zero phase works in `pairs` and `stream` only.
        rate: [Hz] of the frames; a filter needs it.
        mount: T_sensor_surface.
        falling: readings fall under load; None: as those of `intensity`, or else found in the first frames.

    Raises:
        InputError: body, curves and health differ, no cell is good, or a filter has no rate or an unfit cut-off.
    """

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
        falling: bool | None = None,
    ) -> None:
        features = (*(("row", "column") if body.rows else ()), *FEATURES, *(SHEAR if body.response is not None else ()))
        super().__init__((CELLS,), features, MOST, mount, filter)
        self.body, self.settings, self.rate, self.intensity = body, settings or TaxelSettings(), rate, intensity
        self._whole, self._split = unchecked(body.frames), unchecked(body.split)
        self.health: Health | None = None
        self._tared, self._looked = Tare("", ""), health is not None
        self._ahead = filter is not None and filter.zero_phase
        self._recursion = None if filter is None else filter.recursion(known_rate(rate, "frames"))
        steps = None if self._ahead else self._recursion
        forward = None if steps is None else Forward(steps, known_rate(rate, "frames"), body.axes * len(body))
        self._falling = load_direction(intensity, falling)
        self._frames = TaxelFrames(body, intensity, self.settings, forward, self._falling, filtered=filter is not None)
        self._watch = TaxelWatch(body)
        time, raw, counts = np.zeros(1), np.zeros((1, *body.one)), np.zeros(1, dtype=np.int64)
        shape, loads = (body.shape, (raw, frozen(np.zeros((1, 0))))) if body.response is None else ((), None)
        self._one = time, raw, counts, shape, loads  # of one frame, written; of three axes its loads are made anew
        if health is not None:
            self._know(health)
        if self._ahead:
            self._frames.prepare(*body.split(raw.copy()))  # compiles, before anything is in a hurry
        self._frames.run(time, *body.split(raw.copy()), self.empty(1), counts, self._frames.no_forces)  # compiles
        self.reset()

    def reset(self) -> None:
        """Forget drift of the baseline, wrapped readings, filter and identities."""
        super().reset()
        self._frames.reset()
        self._watch.reset()

    @property
    def force(self) -> Float[np.ndarray, "*cells"]:
        """Return each cell's force [N] in the last frame (`body.shape`), a view that the next frame overwrites."""
        return self._frames.force.reshape(self.body.shape)

    @property
    def rest(self) -> tuple[Float[np.ndarray, "*cells"], Float[np.ndarray, "*cells"]]:
        """Return each cell's baseline [counts] and its standard deviation, 0 if `walk` is 0; each of `body.shape`."""
        rest, deviation = self._frames.rest
        return rest.reshape(self.body.shape), deviation.reshape(self.body.shape)

    @property
    def label(self) -> Int[np.ndarray, "*cells"]:
        """Return the index of each cell's area in the last frame (`body.shape`), from 1; 0: none, negative: its rim."""
        return self._frames.label.reshape(self.body.shape)

    @property
    def misfit(self) -> float:
        """Return the mean square of the misfits of hard touches' loads so far, of taxels with three axes; else NaN."""
        return self._frames.misfit

    def tare(self, recording: Recording) -> Tare:
        """Take each cell's mean reading in a recording as its baseline from now on; return a `Tare`.

        Raises:
            InputError: too few frames, no readings of these taxels, no usable cell, or cells that do not keep still.
        """
        pressed, falling = 3.0 * self.settings.on, self._frames.falling
        rest, self._tared = tared(recording, self.body, self.health, pressed=pressed, falling=falling)
        self._know(rest)
        return self._tared

    def answer(
        self, block: Recording, watched: bool = False, filtered: tuple[np.ndarray, ...] | None = None
    ) -> Answered:
        """Return the contacts of a block's frames as `Answered`, with each taxel's force (n, k) [N] if `watched`.

        `filtered`: readings, statuses and shares of the noise from a filter of zero phase.

        Raises:
            InputError: the block has no readings of these taxels.
        """
        readings, count = self.body.raw(block), len(block)
        raw, sideways = self.body.split(readings)
        counts, out = np.zeros(count, dtype=np.int64), self.empty(_ROWS)
        forces = np.zeros((count, len(self.body))) if watched else self._frames.no_forces
        parts, done = [self.empty(0)], 0
        while done < count:
            values = None if filtered is None else tuple(part[done:] for part in filtered)
            given = block.time[done:], raw[done:], sideways[done:]
            step, used = self._frames.run(*given, out, counts[done:], forces[done:], values)
            parts.append(out[:used].copy())
            done += step
        self._watch.add(block.time, readings, raw, rows := np.concatenate(parts), counts)
        return Answered(block, rows, counts, forces if watched else None)

    def answers(self, blocks: Iterable[Recording], watched: bool = False) -> Iterator[Answered]:
        """Yield an `Answered` for each block of a log; baseline and bad cells not known come from its first frames.

        Raises:
            InputError: too few frames, no usable cell, or no readings of these taxels.
        """
        blocks = self._examined(iter(blocks))
        if not self._ahead or self._recursion is None:
            yield from super().answers(blocks, watched)
            return
        both = BothWays(self._recursion, known_rate(self.rate, "frames"), self.body.axes * len(self.body))
        for (block, status), values, share in both.through(self._prepared(block) for block in blocks):
            yield self.answer(block, watched, (values, status, share))

    def run(self, recording: Recording) -> Contacts:
        """Return the `Contacts` of a block; an unknown baseline, noise and bad cells come from its first frames.

        Raises:
            InputError: a zero-phase filter, too few frames, no usable cell, or no readings of these taxels.
        """
        require_forward(self.filter)
        self.look(recording)
        return super().run(recording)

    def notes(self) -> tuple[str, ...]:
        """Return notes on the body, the baselines and the frames so far, one sentence each."""
        said = list(self.body.notes)
        if self.intensity is None and self.body.response is None:
            said.append("there is no intensity model, so readings are N: palpate calibrate intensity makes one")
        if self.health is None:
            return tuple(said)
        return (*said, *self.health.notes, *filter(None, [self._tared.note]), *self._frames.notes(self.health))

    def warnings(self) -> tuple[str, ...]:
        """Return warnings of dead or stuck cells, a tare that looks like a touch, or a zero that moved."""
        found = [self._tared.warning, *self._frames.warnings(), *self._watch.warnings()]
        return (*(() if self.health is None else self.health.warnings), *filter(None, found))

    @property
    def unbelievable(self) -> str:
        """Return the sentence that no touch of a log can be believed; "" if some can."""
        known, health = (self._watch.loads, self._watch.free, self._frames.touches, self.body), self.health
        unlike = unlike_calibration(self.body, self.misfit, self._frames.falling)
        return "" if health is None else unlike or unbelievable_touches(*known, health)

    def _single(self, time: float, reading: ArrayLike, out: Rows, rotation: Known, acceleration: Known) -> int:
        self.require_rest()
        frame = self.body.picked(shaped(reading, (...,), "reading"))
        when, raw, counts, shape, loads = self._one
        when[0] = time
        raw[0] = frame.reshape(raw.shape[1:]) if frame.shape == shape or self.body.fits(frame.shape) else np.nan
        raw[np.abs(raw) > LARGEST] = np.nan  # a fault of the sensor
        return self._frames.run(when, *(loads or self.body.split(raw)), out, counts, self._frames.no_forces)[1]

    def _arrays(self, time: Times, readings: np.ndarray, beside: Channels, out: Rows, counts: Counts) -> int:
        self.require_rest()
        parts = self._split(self._whole(readings, "the stream"))
        return self._frames.run(time, *parts, out, counts, self._frames.no_forces)[0] if len(out) else 0

    def _know(self, health: Health) -> None:
        if health.baseline.shape != (len(self.body),):
            what = f"health is of frames of {health.baseline.size} cells, but the body has {self.body.named()}."
            raise InputError(what, where="taxels", hint="Examine frames of this body.")
        if not (self.body.usable & health.good).any():
            raise InputError("no cell can be used: all are masked, dead or stuck.", where="taxels")
        self.health = health
        self._frames.know(health)
        self.reset()

    def look(self, recording: Recording) -> None:
        """Set `health` from the first frames of a log, once; a baseline and noise that are known stay.

        Raises:
            InputError: too few frames, no usable cell, or no readings of these taxels.
        """
        if self._looked or not len(recording) or (self.health is not None and len(recording) < FEWEST):
            return
        found, known = examine(recording.picked(slice(HEAD)), self.body, falling=self._falling), self.health
        if known is not None:
            found = replace(found, baseline=known.baseline, noise=known.noise, frames=known.frames)
        else:
            rest = "cells at rest are found in the log itself; give a tare to state when nothing touches"
            found = replace(found, notes=(*found.notes, rest))
        self._looked = True
        self._know(found)

    def _examined(self, blocks: Iterator[Recording]) -> Iterator[Recording]:
        """Return the same blocks, after their first frames were examined."""
        head, count = list[Recording](), 0
        while not self._looked and count < HEAD and (block := next(blocks, None)) is not None:
            head.append(block)
            count += len(block)
        if count:
            cells = np.concatenate([self.body.raw(block) for block in head])
            time = np.concatenate([block.time for block in head])
            self.look(Recording(time, {CELLS: cells}, source=head[0].source))
        return chain(head, blocks)

    def _prepared(self, block: Recording) -> tuple[tuple[Recording, np.ndarray], np.ndarray, np.ndarray, np.ndarray]:
        """Return a block and its status, times, status and values, for `BothWays.through`."""
        values, status = self._frames.prepare(*self.body.loads(block))
        return (block, status), block.time, status, values

    def require_rest(self) -> None:
        """Check that the cells' baseline is known.

        Raises:
            InputError: there is neither `health` nor a tare.
        """
        if self.health is None:
            hint = "Give health=examine(...), or call tare with a recording in which nothing touches."
            raise InputError("the readings of the cells at rest are not known.", hint=hint)
