"""Decide whether a window of readings shows the bias of a sensor or a touch."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from palpate.contact.estimate import Status
from palpate.contact.locate import ON, Locator
from palpate.signals.wrench_sensor import Placement
from palpate.signals.zero_filter import FollowedSensor, ZeroFilter, ZeroStatus, ZeroWindow
from palpate.spatial.arguments import takes_arrays

__all__ = ["DELAY"]

DELAY = 1.0  # s a window waits: a touch that grows by 20 mN/s is noticed within it, at 40 mN of noise and 200 Hz
AFTER = 0.5  # s after a touch that are not used: the end of a release that is as slow
PERSISTS = 2.0  # s for which a change must be steady to be taken for a jump of the bias
SPAN, SLOWLY = 3.0, 6.0  # s over which a change is judged to be fast, and to be slow
MEMORY = 12.0  # s in which a touch that has ended must be seen to end: the slowest release
SINGLE, LAGGED, RETURNED = 1e-4, 1e-3, 0.05  # chance that a free window, or the mean of those that wait, is
# withheld, or that a window is not found free again after a touch
SLOW = 0.010  # N/s: half the speed of a touch that reaches 0.2 N in 10 s
SURELY = 3.0  # standard deviations: a larger value follows more slow ramps, and two touches of 0.2 N within 10 s
SMALL = 2.0  # N: a larger change is never taken for a jump
EXPLAINED = 4.0  # standard deviations from the nearest contact within the bounds: further, and it is none
SLACK = 0.5e-3  # m by which a body differs from its mesh: a contact is still a contact


@takes_arrays
class ContactShape:
    """Test of whether one contact of the body can make a wrench.

    Args:
        locator: on the surface, with the bounds of friction and torsion.
        placement: pose of the surface on the sensor, with its covariance.
        slack: [m] error of the places, at least half a millimetre.

    Attributes:
        lever: [m] half of the body's size, which converts limits of forces to those of torques.
    """

    def __init__(self, locator: Locator, placement: Placement, slack: float = 0.0) -> None:
        given = locator.surface, locator.method, locator.friction, locator.torsion
        self._locator = Locator(*given, noise=np.ones(6), indentation=locator.indentation)
        self._placement, self._slack = placement, max(slack, SLACK)
        self.lever = locator.surface.size / 2.0

    def explains(self, wrench: Float[np.ndarray, "6"], covariance: Float[np.ndarray, "6 6"]) -> bool:
        """Return whether a contact can make a wrench (6,) with covariance (6, 6) in the sensor's frame [N, N m].

        It is also True if the wrench is too small to tell.

        Raises:
            InputError: other shapes.
        """
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
        return status in (Status.NO_CONTACT, Status.TOO_LIGHT) or residual <= EXPLAINED  # NaN is none


class Jump(NamedTuple):
    """A change that no contact explains: its time [s], its force [N], whether the filter followed it."""

    time: float
    force: float
    followed: bool


class Decided(NamedTuple):
    """Decisions that a new window led to.

    Attributes:
        unused: numbers of the windows that are rejected, in order.
        used: numbers of the free windows that go into the filter after them, in order.
        jump: (m,) by which the bias jumped before the windows in `used`; None: it did not.
        status: use of this window; `CHANGED` is also that of a jump that was followed.
    """

    unused: list[int]
    used: list[int]
    jump: Float[np.ndarray, " m"] | None
    status: ZeroStatus


class _Kept(NamedTuple):
    """A window with its difference from the prediction and the verdict of a skin."""

    number: int
    window: ZeroWindow
    off: Float[np.ndarray, " m"]
    spread: Float[np.ndarray, "m m"]
    touched: bool | None


class DriftGate:
    """Gate that decides, window by window, what goes into the filter; each waits a second for a touch that shows late.

    1. A window is free if bias, noise and payload explain its difference from the prediction (chi-square tests of the
       window and of the mean of all that wait), and no sample's force is large enough for a contact. After a touch, a
       window that is free only because the bias may have drifted must also show that the wrench came back.
    2. All others are withheld, and the windows that wait are dropped.
    3. A change of at most 2 N, steady for 2 s, is a jump of the bias if two of these hold: no contact explains it; a
       skin felt nothing meanwhile; it grew by less than 10 mN/s. The first is not enough, as two touches at once are no
       single contact either. Other changes are withheld; both kinds are recorded in `jumps`.

    Args:
        filter: receives the windows; the gate only reads it.
        sensor: owner of the channels.
        shape: test of whether one contact of the body explains a wrench.
        alone: the body is never touched at two places at once, so that the shape alone identifies a jump.

    Attributes:
        jumps: list of each `Jump` so far.
    """

    def __init__(self, filter: ZeroFilter, sensor: FollowedSensor, shape: ContactShape, alone: bool = False) -> None:
        from scipy.special import chdtri  # here: scipy is slow to import, its stats most of all

        self.filter, self.sensor, self.shape, self.alone = filter, sensor, shape, alone
        limits = (float(chdtri(filter.channels, chance)) for chance in (SINGLE, LAGGED, RETURNED))
        self._single, self._lagged, self._returned = limits
        self.jumps = list[Jump]()
        self._pending, self._odd, self._recent = deque[_Kept](), deque[_Kept](), deque[_Kept]()
        self._before: Float[np.ndarray, "n n"] | None = None  # covariance of the state when it was last followed
        self._ended, self._fast, self._told = -np.inf, False, False

    def judge(
        self, number: int, window: ZeroWindow, strength: float, full: bool, touched: bool | None = None
    ) -> Decided:
        """Return the decisions that follow from the next window, as a `Decided`.

        Args:
            number: of the window.
            window: its mean.
            strength: the largest force of its samples, in standard deviations.
            full: whether a channel was at its range.
            touched: whether a skin feels a touch; None: there is no skin.
        """
        expected, spread = self.filter.expected(window.time, window.regressor)
        one = _Kept(number, window, window.value - expected, spread, touched)
        self._recent.append(one)
        while self._recent[0].window.time < window.time - MEMORY:
            self._recent.popleft()
        if full or touched is True or strength >= ON:
            return self._hold(one, ZeroStatus.HELD)
        return self._release(one) if self._free(one) else self._hold(one, ZeroStatus.FAINT)

    def finish(self) -> list[int]:
        """Drop all windows that still wait, and return their numbers, a list of int."""
        left = [one.number for one in (*self._odd, *self._pending)]
        self._pending.clear()
        self._odd.clear()
        return left

    def _free(self, one: _Kept) -> bool:
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
        turned = one.window.regressor - np.mean([each.window.regressor for each in self._pending], axis=0)
        changed = noise * (1.0 + 1.0 / len(others)) + wandered + self.filter.spread_by(turned)
        return _square(apart, changed) <= self._single

    def _came_back(self, one: _Kept, noise: Float[np.ndarray, "m m"]) -> bool:
        """Return whether a touch has ended, and is not merely hidden by the uncertainty that has grown."""
        assert self._before is not None
        if _square(one.off, self.filter.spread(self._before, one.window.regressor) + noise) <= self._returned:
            return True
        moved = max(_square(each.off - one.off, noise) for each in self._recent)
        return moved >= _square(one.off, noise)

    def _release(self, one: _Kept) -> Decided:
        """Let a free window wait; release those that have waited long enough."""
        unused = [each.number for each in self._odd]
        self._odd.clear()
        time = one.window.time
        if self._before is not None:
            self._ended, self._before, self._fast, self._told = time, None, False, False
        if time < self._ended + AFTER:
            return Decided([*unused, one.number], [], None, ZeroStatus.FREE)
        self._pending.append(one)
        return Decided(unused, self._due(time), None, ZeroStatus.FREE)

    def _due(self, time: float) -> list[int]:
        used = list[int]()
        while self._pending and self._pending[0].window.time <= time - DELAY:
            used.append(self._pending.popleft().number)
        return used

    def _hold(self, one: _Kept, status: ZeroStatus) -> Decided:
        """Withhold a window; after a confirmed jump of the bias, release windows."""
        unused = [each.number for each in self._pending]
        self._pending.clear()
        if self._before is None:
            self._before = self.filter.predicted(one.window.time)[1]
        self._odd.append(one)
        self._fast = self._fast or self._speed(one, SPAN)[0] > 1.0
        changed, jump = self._jumped(one)
        if jump is None:
            while self._odd[0].window.time < one.window.time - PERSISTS - DELAY:
                unused.append(self._odd.popleft().number)
            return Decided(unused, [], None, ZeroStatus.CHANGED if changed else status)
        steady = [self._agree(each, jump) for each in self._odd]
        begin = len(steady) - steady[::-1].index(False) if False in steady else 0
        unused += [self._odd.popleft().number for _ in range(begin)]
        self._pending, self._odd = self._odd, deque[_Kept]()
        self._before, self._fast, self._told = None, False, False
        self._recent = deque(each._replace(off=each.off - jump) for each in self._recent)
        return Decided(unused, self._due(one.window.time), jump, ZeroStatus.CHANGED)

    def _agree(self, one: _Kept, level: Float[np.ndarray, " m"]) -> bool:
        return _square(one.off - level, one.window.noise + one.window.stays) <= self._single

    def _jumped(self, one: _Kept) -> tuple[bool, Float[np.ndarray, " m"] | None]:
        """Return whether no contact explains the change, and the jump of the bias or None."""
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
        odd = not self.shape.explains(wrench[0], covariance)
        free = all(each.touched is False for each in self._odd)
        _, fastest, span = self._speed(one, SLOWLY)
        slow = not self._fast and span >= 0.9 * SLOWLY and fastest <= 1.0
        small = force <= SMALL
        if small and ((odd and (slow or free or self.alone)) or (slow and free)):
            self.jumps.append(Jump(time, force, followed=True))
            return odd, level
        if odd and small and not self._told:
            self._told = True
            self.jumps.append(Jump(time, force, followed=False))
        return odd, None

    def _speed(self, one: _Kept, seconds: float) -> tuple[float, float, float]:
        """Return least and greatest speed of change over the last seconds, in `SLOW`, and the span [s] used."""
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
    """Return the squared distance from zero in standard deviations."""
    return float(off @ np.linalg.solve(covariance, off))
