"""Compute a sensor's wrenches in the surface's frame, with covariances."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int8
from numpy.typing import ArrayLike

from palpate.contact.drift_gate import ContactShape
from palpate.contact.drift_tracker import DriftTracker
from palpate.contact.estimator import Answered
from palpate.errors import InputError
from palpate.signals.drift import Drift
from palpate.signals.filters import Filter
from palpate.signals.recording import Recording
from palpate.signals.smoothing import BothWays, Forward, known_rate
from palpate.signals.wrench_sensor import Measured, Placement, WrenchSensor
from palpate.signals.zero_filter import FollowedSensor, ZeroHistory, ZeroState

__all__: list[str] = []  # for this package alone

PIECE = 4096  # samples at a time: what lies between two steps stays in the cache
ALL = np.ones(1)  # share of the noise's variance where there is no filter


class Piece(NamedTuple):
    """Samples that are measured together, of one window of the bias if it is followed.

    Attributes:
        samples: the samples.
        ends: the block that ends with them; None if it continues.
        touched: whether a skin feels a touch; None if it cannot tell.
        averaged: (n,) number of readings of which each wrench is the mean; None: 1.
        skin: the contacts of the skin, if there is one.
    """

    samples: Recording
    ends: Recording | None
    touched: bool | None = None
    averaged: Float[np.ndarray, " n"] | None = None
    skin: Answered | None = None


class Wrenches(NamedTuple):
    """Wrenches about the surface's frame.

    Attributes:
        wrench: (n, 6) [N, N m].
        covariance: (n, 6, 6), or None where the noise is not known.
        status: (n,) `Status`, -1 for samples to locate.
    """

    wrench: Float[np.ndarray, "n 6"]
    covariance: Float[np.ndarray, "n 6 6"] | None
    status: Int8[np.ndarray, " n"]


class SurfaceWrenches:
    """Conversion of a sensor's readings into wrenches about the surface's frame, sample by sample or from a log.

    The filter acts in the sensor's frame. In a log, the smoothing of the bias and a filter of zero phase use later
    samples, for which pieces wait.

    Args:
        sensor: wrench sensor.
        placement: pose of the surface on the sensor, with its covariance.
        filter: applied to the wrenches; None: none.
        rate: [Hz] of the samples, required with a filter; `of`: name of the samples in error messages.
        drift: model of the bias's drift; None: the bias is not followed.
        shape: test of whether a contact explains a wrench, for a bias that is followed.
        logs: smooth the bias in logs.

    Raises:
        InputError: a filter without a rate, or a drift for a sensor whose bias cannot be followed.
    """

    def __init__(
        self,
        sensor: WrenchSensor,
        placement: Placement,
        filter: Filter | None,
        rate: float | None,
        drift: Drift | None,
        shape: ContactShape | None,
        *,
        logs: bool,
        of: str = "samples",
    ) -> None:
        self.sensor, self.placement, self._logs = sensor, placement, logs
        self._drift, self._shape = drift, shape
        self._recursion = None if filter is None else filter.recursion(known_rate(rate, of))
        self._rate = 0.0 if filter is None else known_rate(rate, of)
        self._ahead = filter is not None and filter.zero_phase
        self._forward = None if self._recursion is None else Forward(self._recursion, self._rate)
        if self._forward is not None:
            self._forward(np.zeros(1), np.zeros(1, np.int8), np.zeros((1, 6)))  # compiles
        sensor.smoothed_by(filter, rate, self._least())
        self._follower = self._told = self._follows(smooth=False)

    @property
    def smoothing(self) -> Forward | None:
        """Filter of samples as they come; None: none, or one that waits for later samples."""
        return None if self._ahead else self._forward

    @property
    def followed(self) -> bool:
        """True if the bias is followed."""
        return self._follower is not None

    def reset(self) -> None:
        """Forget the state that samples left behind in sensor, filter and bias tracker; keep the tare."""
        self.sensor.reset()
        if self._forward is not None:
            self._forward.reset()
        if self._follower is not None:
            self._follower.reset()
        self._told = self._follower

    def cuts(self, time: Float[np.ndarray, " n"]) -> list[slice]:
        """Return the slices, at least one, of times (n,) [s] that are measured together: windows, or 4,096 samples."""
        if self._follower is not None:
            return list(self._follower.pieces(time)) or [slice(0, 0)]
        return [slice(start, min(start + PIECE, len(time))) for start in range(0, max(1, len(time)), PIECE)]

    def pieces(self, blocks: Iterable[Recording]) -> Iterator[Piece]:
        """Yield each `Piece` of blocks, in order, cut by `cuts`."""
        for block in blocks:
            cuts = self.cuts(block.time)
            for cut in cuts:
                yield Piece(block.picked(cut), block if cut is cuts[-1] else None)

    def forward(self, pieces: Iterable[Piece]) -> Iterator[tuple[Piece, Wrenches]]:
        """Yield (`Piece`, `Wrenches`) for each piece, computed from this and earlier samples.

        Raises:
            InputError: a channel is missing or has another shape.
        """
        for piece in pieces:
            samples, follower = piece.samples, None
            if len(samples):
                follower = self.entered(float(samples.time[0]), DriftTracker.kelvin(samples.channels))
            measured = self.sensor.measure(samples)
            if follower is not None:
                follower.add(samples.time, follower.sensor.kept(samples), piece.touched)
            yield piece, self.convert(measured, piece.averaged)

    def convert(self, measured: Measured, averaged: Float[np.ndarray, " n"] | None = None) -> Wrenches:
        """Return the next samples as filtered `Wrenches`; each is the mean of `averaged` (n,) readings (None: 1)."""
        return self._placed(measured, *self._filtered(measured), averaged)

    def of_log(self, pieces: Iterable[Piece]) -> Iterator[tuple[Piece, Wrenches]]:
        """Yield (`Piece`, `Wrenches`) for each piece of a log, smoothed by later samples if requested.

        Raises:
            InputError: a channel is missing or has another shape; the bias of this sensor cannot be followed.
        """
        smoother = self._follows(smooth=True) if self._logs or self._ahead else None
        if smoother is None and not self._ahead:
            yield from self.forward(pieces)
            return
        zeros = ((piece, None) for piece in pieces)
        if smoother is not None:
            self._told = smoother
            zeros = smoother.both_sides((piece.samples, piece.touched, piece) for piece in pieces)
        measured = ((piece, zero, self._measured(piece, zero)) for piece, zero in zeros)
        if not self._ahead or self._recursion is None:
            for piece, _, made in measured:
                yield piece, self.convert(made, piece.averaged)
            return
        given = ((each, each[2].time, each[2].status, each[2].wrench) for each in measured)
        for (piece, zero, made), wrenches, share in BothWays(self._recursion, self._rate).through(given):
            self._follow(zero)
            yield piece, self._placed(made, wrenches, share, piece.averaged)

    def single(
        self,
        time: float,
        reading: ArrayLike,
        rotation: ArrayLike | None,
        acceleration: ArrayLike | None,
        *,
        kelvin: float = np.nan,
        averaged: np.ndarray | None = None,
        touched: bool | None = None,
    ) -> Wrenches:
        """Return the `Wrenches` (n = 1) of one live sample, which is the mean of `averaged` readings (None: 1).

        Raises:
            InputError: the reading has another shape, or the rotation is needed and missing.
        """
        follower = self.entered(time, kelvin)
        measured = self.sensor.single(time, reading, rotation, acceleration)
        made = self.convert(measured, averaged)
        if follower is not None:
            follower.add(time, follower.sensor.kept_of(follower.sensor.live_inputs, 1), touched)
        return made

    def entered(self, time: float, kelvin: float) -> DriftTracker | None:
        """Announce the time [s] and temperature [K or degrees C] of the next samples to the bias tracker.

        Returns:
            the `DriftTracker`; None if the bias is not followed.
        """
        if self._follower is not None:
            self._follower.enter(time, kelvin)
            self._told = self._follower
        return self._follower

    def unfiltered(self, recording: Recording) -> Wrenches:
        """Return the unfiltered `Wrenches` of a recording in the surface's frame.

        Raises:
            InputError: a channel is missing or has another shape.
        """
        measured = self.sensor.measure(recording)
        return self._placed(measured, measured.wrench, ALL)

    def history(self) -> ZeroHistory | None:
        """Return the bias over time since the last reset as a `ZeroHistory`; None if it is not followed."""
        return None if self._told is None else self._told.history()

    def notes(self) -> tuple[str, ...]:
        """Return remarks on the sensor and its bias so far, a tuple of sentences."""
        return (*self.sensor.notes(), *(() if self._told is None else self._told.notes()))

    def warnings(self) -> tuple[str, ...]:
        """Return possible faults of the sensor and its bias, a tuple of sentences or ()."""
        return (*self.sensor.warnings(), *(() if self._told is None else self._told.warnings()))

    def _least(self) -> float:
        """Return the least share of white noise's variance that the filter leaves."""
        if self._recursion is None:
            return 1.0
        return BothWays(self._recursion, self._rate).least if self._ahead else float(self._recursion.share.min())

    def _follows(self, smooth: bool) -> DriftTracker | None:
        if self._drift is None or self._shape is None:
            return None
        if not isinstance(self.sensor, FollowedSensor):
            raise InputError(
                "cannot be used with this sensor, whose zero cannot be followed: leave drift out.", where="drift"
            )
        return DriftTracker(self.sensor, self._drift, self._shape, smooth=smooth)

    def _measured(self, piece: Piece, zero: ZeroState | None) -> Measured:
        self._follow(zero)
        return self.sensor.measure(piece.samples)

    def _follow(self, zero: ZeroState | None) -> None:
        if zero is not None and isinstance(self.sensor, FollowedSensor):
            self.sensor.follow(zero)

    def _filtered(self, measured: Measured) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, " k"]]:
        """Return filtered wrenches, and the share of the noise that remains."""
        if self._forward is None or self._ahead:
            return measured.wrench, ALL
        wrenches = measured.wrench
        return wrenches, self._forward.share(self._forward(measured.time, measured.status, wrenches))

    def _placed(
        self,
        measured: Measured,
        wrenches: Float[np.ndarray, "n 6"],
        share: Float[np.ndarray, " k"],
        averaged: Float[np.ndarray, " _"] | None = None,
    ) -> Wrenches:
        if averaged is not None:
            share = share * (1.0 / np.maximum(np.nan_to_num(averaged, nan=1.0), 1.0))
        return Wrenches(*self.sensor.place(measured, wrenches, share, self.placement), measured.status)
