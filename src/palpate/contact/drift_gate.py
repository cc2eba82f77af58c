"""May a window of readings be taken for the zero of a sensor, or does something touch?"""

from __future__ import annotations

from collections import deque
from enum import Enum
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from palpate.contact.estimate import Status
from palpate.contact.locate import ON, Locator
from palpate.signals.wrench_sensor import Placement
from palpate.signals.zero_filter import FollowedSensor, ZeroFilter, ZeroWindow
from palpate.spatial.arguments import takes_arrays

__all__ = ["DELAY", "ChangeKind"]

DELAY = 1.0  # s a window waits: a touch that grows by 20 mN/s is noticed within it, at 40 mN of noise and 200 Hz
AFTER = 0.5  # s after a touch that are left out: the end of a release that is as slow
PERSISTS = 2.0  # s for which a change must stay as it is to be taken for a jump of the zero
SPAN, SLOWLY = 3.0, 6.0  # s over which it is told to have been fast, and to have been slow
MEMORY = 12.0  # s in which a touch that has ended must be seen to end: the slowest release
SINGLE, LAGGED, RETURNED = 1e-4, 1e-3, 0.05  # chance that a free window, or the mean of those that wait, is held, or
# is not seen to be free again
SLOW = 0.010  # N/s: half the speed of a touch that reaches 0.2 N in 10 s
SURELY = 3.0  # deviations: more follow more slow ramps of the zero, and eat two touches of 0.2 N that begin within 10 s
SMALL = 2.0  # N: a larger change is never taken for a jump
EXPLAINED = 4.0  # standard deviations from the nearest contact within the bounds: further, and it is none
SLACK = 0.5e-3  # m by which a body differs from its mesh: a contact is still a contact


class ChangeKind(Enum):
    """What the wrench of a change looks like."""

    CONTACT = 0  # or too little to tell
    NO_CONTACT = 1


@takes_arrays
class ContactShape:
    """Can one contact of the body make a wrench? By a `Locator` of its own, which remembers nothing.

    Args:
        locator: on the surface, with the bounds of friction and torsion.
        placement: of the surface on the sensor.
        slack: [m] by which places are off, at least half a millimetre.
    """

    def __init__(self, locator: Locator, placement: Placement, slack: float = 0.0) -> None:
        given = locator.surface, locator.method, locator.friction, locator.torsion
        self._locator = Locator(*given, noise=np.ones(6), indentation=locator.indentation)
        self._placement, self._slack = placement, max(slack, SLACK)
        self.lever = locator.surface.size / 2.0  # of couples, beside forces

    def __call__(self, wrench: Float[np.ndarray, "6"], covariance: Float[np.ndarray, "6 6"]) -> ChangeKind:
        """Of a wrench in the sensor's frame."""
        matrix, factor = self._placement.matrix, self._placement.factor
        located = matrix @ wrench
        force, torque = located[:3], located[3:]
        errors = np.concatenate(
            [np.cross(factor[:, :3], force), np.cross(factor[:, :3], torque) + np.cross(factor[:, 3:], force)], axis=1
        )
        spread = matrix @ covariance @ matrix.T + errors.T @ errors
        spread[3:, 3:] += self._slack**2 * (force @ force) * np.eye(3)
        rows = self._locator.run(located[None], spread[None], sequential=False)
        status, residual = int(rows.status[0]), float(rows.residual[0])
        if status in (Status.NO_CONTACT, Status.TOO_LIGHT) or (np.isfinite(residual) and residual <= EXPLAINED):
            return ChangeKind.CONTACT
        return ChangeKind.NO_CONTACT


class Jump(NamedTuple):
    """A change that no contact explains: when [s], how large [N], and whether it was followed."""

    time: float
    force: float
    followed: bool


class Decided(NamedTuple):
    """What a window brought.

    Attributes:
        unused: windows that were given up, in order.
        used: windows after them that are free and go into the filter, in order.
        jump: [unit of the channels] by which the zero jumped before those that are used; None: it did not.
        withheld: whether this window is held.
        changed: whether it is, though no contact explains it.
    """

    unused: list[int]
    used: list[int]
    jump: Float[np.ndarray, " m"] | None
    withheld: bool
    changed: bool


class _Kept(NamedTuple):
    """A window with its difference from what was expected, and what a skin said."""

    number: int
    window: ZeroWindow
    off: Float[np.ndarray, " m"]
    spread: Float[np.ndarray, "m m"]
    touched: bool | None


class DriftGate:
    """Decides, window by window, what may go into the filter; each waits `DELAY` for a touch that shows late.

    1. A window is free where it differs from the prediction by what zero, noise and payload explain (chi-square, its
       own and that of the mean of those that wait) and no sample's force is a contact by itself. Free windows go into
       the filter a delay later. After a touch, the zero is unsure by all that it may have wandered: what is free by
       that alone must also have been seen to come back, so that a light touch is not taken for the zero when enough
       time has passed.
    2. Others are held, and those that wait are dropped. While one contact of the body explains the change, nothing
       more happens.
    3. A change that no contact explains, of at most 2 N, steady for 2 s, is a jump of the zero where a skin felt
       nothing meanwhile, or where it came at less than `SLOW`: two touches at once are no contact's shape either.
       Otherwise it is held, and counted in `jumps`.

    Args:
        filter: that windows go into; it is asked here, never changed.
        sensor: whose channels these are.
        shape: of contacts of the body.
        alone: nothing ever touches at two places at once, so that shape alone tells a jump.
    """

    def __init__(self, filter: ZeroFilter, sensor: FollowedSensor, shape: ContactShape, alone: bool = False) -> None:
        from scipy.special import chdtri  # here: scipy is slow to import, its stats most of all

        self.filter, self.sensor, self.shape, self.alone = filter, sensor, shape, alone
        limits = (float(chdtri(filter.channels, chance)) for chance in (SINGLE, LAGGED, RETURNED))
        self._single, self._lagged, self._returned = limits
        self.jumps = list[Jump]()
        self.reset()

    def reset(self) -> None:
        """Nothing waits, nothing is held."""
        self._pending, self._odd, self._recent = deque[_Kept](), deque[_Kept](), deque[_Kept]()
        self._before: Float[np.ndarray, "m m"] | None = None  # covariance of the zero when it began to be held
        self._ended, self._fast, self._told = -np.inf, False, False

    @property
    def waiting(self) -> int:
        """Windows that are not decided."""
        return len(self._pending) + len(self._odd)

    def judge(
        self, number: int, window: ZeroWindow, strength: float, full: bool, touched: bool | None = None
    ) -> Decided:
        """The next window.

        Args:
            number: of it.
            window: its mean.
            strength: the largest force of its samples, in standard deviations.
            full: whether a channel was at its range.
            touched: what a skin says, if there is one.
        """
        expected, spread = self.filter.expected(window.time, window.regressor)
        one = _Kept(number, window, window.value - expected, spread, touched)
        self._recent.append(one)
        while self._recent[0].window.time < window.time - MEMORY:
            self._recent.popleft()
        held = full or touched is True or strength >= ON or not self._free(one)
        return self._hold(one) if held else self._release(one)

    def finish(self) -> list[int]:
        """What still waits, given up."""
        left = [one.number for one in (*self._odd, *self._pending)]
        self._pending.clear()
        self._odd.clear()
        return left

    def _free(self, one: _Kept) -> bool:
        """By statistics."""
        noise = one.window.noise + one.window.stays
        square = _square(one.off, one.spread + noise)
        if self._before is not None:
            return square <= self._returned and self._came_back(one, noise)
        if square > self._single:
            return False
        waiting = [*self._pending, one]
        count = len(waiting)
        mean = np.array([each.off for each in waiting]).sum(axis=0) / count
        middle = waiting[count // 2]
        if _square(mean, middle.spread + one.window.noise / count + one.window.stays) > self._lagged:
            return False
        others = [each.off for each in self._pending]
        if len(others) < 3:
            return True
        apart = one.off - np.array(others).sum(axis=0) / len(others)
        wandered = np.diag(self.filter.drift.walk**2 * (one.window.time - self._pending[0].window.time))
        return _square(apart, noise * (1.0 + 1.0 / len(others)) + wandered) <= self._single

    def _came_back(self, one: _Kept, noise: Float[np.ndarray, "m m"]) -> bool:
        """Has a touch ended, or is only so much unknown by now that it might be none?"""
        assert self._before is not None
        if _square(one.off, self._before + noise) <= self._returned:
            return True
        moved = max(_square(each.off - one.off, noise) for each in self._recent)
        return moved >= _square(one.off, noise)

    def _release(self, one: _Kept) -> Decided:
        """A free window: it waits; those that waited long enough are used."""
        unused = [each.number for each in self._odd]
        self._odd.clear()
        time = one.window.time
        if self._before is not None:
            self._ended, self._before, self._fast, self._told = time, None, False, False
        if time < self._ended + AFTER:
            return Decided([*unused, one.number], [], None, withheld=False, changed=False)
        self._pending.append(one)
        return Decided(unused, self._due(time), None, withheld=False, changed=False)

    def _due(self, time: float) -> list[int]:
        used = list[int]()
        while self._pending and self._pending[0].window.time <= time - DELAY:
            used.append(self._pending.popleft().number)
        return used

    def _hold(self, one: _Kept) -> Decided:
        """A touch, or a jump of the zero."""
        unused = [each.number for each in self._pending]
        self._pending.clear()
        if self._before is None:
            self._before = one.spread
        self._odd.append(one)
        self._fast = self._fast or self._speed(one, SPAN)[0] > 1.0
        changed, jump = self._jumped(one)
        if jump is None:
            while self._odd[0].window.time < one.window.time - PERSISTS - DELAY:
                unused.append(self._odd.popleft().number)
            return Decided(unused, [], None, withheld=True, changed=changed)
        steady = [self._agree(each, jump) for each in self._odd]
        begin = len(steady) - steady[::-1].index(False) if False in steady else 0
        unused += [self._odd.popleft().number for _ in range(begin)]
        self._pending, self._odd = self._odd, deque[_Kept]()
        self._before, self._fast, self._told = None, False, False
        self._recent = deque(each._replace(off=each.off - jump) for each in self._recent)
        return Decided(unused, self._due(one.window.time), jump, withheld=False, changed=True)

    def _agree(self, one: _Kept, level: Float[np.ndarray, " m"]) -> bool:
        """Is a window of this level, but for noise?"""
        return _square(one.off - level, one.window.noise + one.window.stays) <= self._single

    def _jumped(self, one: _Kept) -> tuple[bool, Float[np.ndarray, " m"] | None]:
        """Whether no contact explains the change, and by how much the zero jumped, if it did."""
        time = one.window.time
        if self._odd[0].window.time > time - PERSISTS + 1e-6 or any(each.touched for each in self._odd):
            return False, None
        last = [each for each in self._odd if each.window.time > time - 1.0]
        level = np.mean([each.off for each in last], axis=0)
        noise, stays = one.window.noise, one.window.stays
        if not all(self._agree(each, level) for each in last):
            return False, None  # it still moves
        wrench, covariance = self.sensor.as_wrench(level[None], one.spread + noise / len(last) + stays)
        force = float(np.linalg.norm(wrench[0, :3]))
        odd = self.shape(wrench[0], covariance) is ChangeKind.NO_CONTACT
        free = all(each.touched is False for each in self._odd)
        slow = not self._fast and self._slow(one)
        small = force <= SMALL
        if small and ((odd and (slow or free or self.alone)) or (slow and free)):
            self.jumps.append(Jump(time, force, followed=True))
            return odd, level
        if odd and small and not self._told:
            self._told = True
            self.jumps.append(Jump(time, force, followed=False))
        return odd, None

    def _slow(self, one: _Kept) -> bool:
        """Is it known to have come slowly?"""
        _, most, span = self._speed(one, SLOWLY)
        return span >= 0.9 * SLOWLY and most <= 1.0

    def _speed(self, one: _Kept, seconds: float) -> tuple[float, float, float]:
        """How fast it changed over the last seconds, in `SLOW`, at least and at most; and over how many it is known."""
        part = [each for each in self._recent if each.window.time > one.window.time - seconds]
        times = np.array([each.window.time for each in part])
        if np.ptp(times) < seconds / 2.0:
            return 0.0, np.inf, 0.0
        centred = times - times.mean()
        slope = centred @ np.array([each.off for each in part]) / (centred @ centred)
        walked = np.diag(1.2 * self.filter.drift.walk**2 / np.ptp(times))  # of a line through a walk
        wrench, covariance = self.sensor.as_wrench(slope[None], one.window.noise / (centred @ centred) + walked)
        limit = SLOW * np.array([1.0, self.shape.lever])
        size = np.array([np.linalg.norm(wrench[0, :3]), np.linalg.norm(wrench[0, 3:])])
        sure = np.sqrt(np.array([np.trace(covariance[:3, :3]), np.trace(covariance[3:, 3:])]) / 3.0)
        least = np.sqrt(np.maximum(size**2 - 3.0 * sure**2, 0.0))  # noise makes every length longer
        return (
            float(np.max((least - SURELY * sure) / limit)),
            float(np.max((size + sure) / limit)),
            float(np.ptp(times)),
        )


def _square(off: Float[np.ndarray, " m"], covariance: Float[np.ndarray, "m m"]) -> float:
    """How many standard deviations, squared."""
    return float(off @ np.linalg.solve(covariance, off))
