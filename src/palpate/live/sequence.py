"""Find missing, late and repeated samples and restarts of a Net F/T by its two counters."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

_ROUND = 1 << 32
_LATE = 4096  # positions behind the last within which a sample is late or repeated, not the first of another count
_FASTEST = 20_000.0  # Hz: no Net F/T counts faster, so a larger jump is no loss of samples


class SequenceCounters:
    """A reader of both counters of samples, modulo 2^32.

    `rdt` counts those sent since sending was started, `ft` those measured since the device was started: each step of
    `rdt` is the same number of steps of `ft`.

    Attributes:
        gaps, missing: number of gaps, and of samples missing in them.
        late: number of samples counted as missing that arrived later.
        repeated: number of samples dropped because they arrived twice.
        restarts: number of restarts of `rdt`.
        unknown: number of restarts of both, after which the number of missing samples is unknown.
    """

    def __init__(self) -> None:
        self.gaps = self.missing = self.late = self.repeated = self.restarts = self.unknown = 0
        self._last: tuple[int, int, int] | None = None  # rdt, ft, stamp of the newest
        self._ratio = 1  # steps of `ft` in one of `rdt`
        self._absent: dict[int, None] = {}
        self._expected = False

    @property
    def position(self) -> tuple[int, ...]:
        """Counters of the newest sample, its stamp [ns], and steps of `ft` in one of `rdt`; () before the first."""
        return () if self._last is None else (*self._last, self._ratio)

    def resume(self, position: tuple[int, ...]) -> None:
        """Continue at the position of an earlier reader, after which the device was requested to start again."""
        *last, self._ratio = position
        self._last, self._expected = (last[0], last[1], last[2]), True

    def expect_restart(self) -> None:
        """Note that the device was requested to start again: a fall of `rdt` is a restart then."""
        self._expected = True

    def follow(
        self, rdt: list[int], ft: list[int], stamp: list[int], lost: Int[np.ndarray, " room"]
    ) -> list[int] | None:
        """Follow the counters through a block of samples, and return the indices of those to keep; None: all.

        Args:
            rdt: counter of sent samples, in order of arrival; not empty.
            ft: counter of measured samples.
            stamp: [ns] of arrival.
            lost: filled from its start with the number of samples missing before each that is kept.
        """
        last, first, count = self._last, rdt[0], len(rdt)
        if (last is None or first == (last[0] + 1) % _ROUND) and rdt == list(range(first, first + count)):
            before = last or (first, ft[0], 0)
            self._learn(before[0], before[1], rdt[-1], ft[-1])
            self._last = rdt[-1], ft[-1], stamp[-1]
            self._expected = False
            lost[:count] = 0
            return None
        kept = [
            (k, before)
            for k, newest in enumerate(zip(rdt, ft, stamp, strict=True))
            if (before := self._one(*newest)) is not None
        ]
        lost[: len(kept)] = [before for _, before in kept]
        return [k for k, _ in kept]

    def _one(self, rdt: int, ft: int, stamp: int) -> int | None:
        """Return the number of samples missing before one; None if it is repeated."""
        if self._last is None:
            return self._newest(rdt, ft, stamp, 0)
        step, seconds = _signed(rdt - self._last[0]), (stamp - self._last[2]) * 1e-9
        if 0 < step <= _LATE + max(seconds, 0.0) * _FASTEST:
            self._learn(self._last[0], self._last[1], rdt, ft)
            return self._newest(rdt, ft, stamp, step - 1)
        if rdt in self._absent:
            del self._absent[rdt]
            self.late += 1
            return 0
        advance = _signed(ft - self._last[1])
        if abs(step) <= _LATE and advance <= 0 and not self._expected:
            self.repeated += 1
            return None
        self.restarts += 1
        self._absent.clear()
        if 0 < advance <= (_LATE + max(seconds, 0.0) * _FASTEST) * self._ratio:
            return self._newest(rdt, ft, stamp, advance // self._ratio - 1, numbered=False)
        self.unknown += 1
        return self._newest(rdt, ft, stamp, 0)

    def _newest(self, rdt: int, ft: int, stamp: int, before: int, *, numbered: bool = True) -> int:
        before = max(before, 0)
        if before:
            self.gaps += 1
            self.missing += before
            if numbered and before <= _LATE:
                self._absent.update(dict.fromkeys((rdt - back) % _ROUND for back in range(before, 0, -1)))
                for oldest in list(self._absent)[: max(0, len(self._absent) - _LATE)]:
                    del self._absent[oldest]
        self._last, self._expected = (rdt, ft, stamp), False
        return before

    def _learn(self, rdt: int, ft: int, later_rdt: int, later_ft: int) -> None:
        steps = (later_rdt - rdt) % _ROUND
        if steps and (advance := _signed(later_ft - ft)) > 0:
            self._ratio = max(1, round(advance / steps))


def _signed(step: int) -> int:
    """Return a step modulo 2^32 as a number from -2^31 to 2^31 - 1."""
    return (step + _ROUND // 2) % _ROUND - _ROUND // 2
