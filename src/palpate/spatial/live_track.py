"""The sensor's pose live, when poses lag behind the samples."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose_track import PoseTrack, slerp
from palpate.spatial.stamped_rows import SLACK

_JUMP = 1.0  # s: a pose that is older than the newest by more than this begins another clock
_RECENT = 48  # poses from which the unsteadiness of the motion is taken
_RENEWED = 12  # poses after which it is taken anew: that costs 0.2 ms
_LONG = 8  # poses apart: the longer of the two lags


class LiveTrack(PoseTrack):
    """Track of live poses, of which the newest is usually older than the requested time.

    Up to the newest pose it answers as `PoseTrack`. For an age t beyond it, and up to `max_gap`, the last motion goes
    on at constant angular and linear velocity, measured over a time B as long as t where there are such poses (and at
    least one spacing D of poses): a shorter one would multiply the noise of the poses by t / B.

    The rms angle s(t) [rad] between the answer and the true orientation is

        s(t)^2 = (a t (t + B) / 2)^2 + n^2 ((1 + u)^2 + u^2 - 1),   u = t / B,

    with a^2 the mean square of the angular acceleration and n the rms angle of a pose's noise, which is left out at age
    0. Second differences of the last orientations over lags of m spacings, whose mean square is a^2 (m D)^4 + 6 n^2,
    give both. With `hold`, s^2 = (w t)^2 + (a t^2 / 2)^2 with w^2 the mean square of the angular velocity.

    Args:
        offset, max_gap: as of `PoseTrack`; beyond an age of `max_gap` there is no answer.
        hold: answer with the newest pose, without extrapolation.

    Attributes:
        restarts: number of times that the poses' clock went back, and the track began anew.
    """

    def __init__(self, offset: float = 0.0, max_gap: float = 0.25, *, hold: bool = False) -> None:
        super().__init__(offset, max_gap)
        self._hold, self.restarts = hold, 0
        self._moved: tuple[float, float, float] | None = None  # mean squares of acceleration, noise, velocity
        self._since = 0  # poses that have come since

    @takes_arrays
    def add(
        self,
        time: Float[np.ndarray, " n"],
        quaternion: Float[np.ndarray, "n 4"],
        position: Float[np.ndarray, "n 3"] | None = None,
    ) -> None:
        """Add poses as `PoseTrack.add`; stamps that go back by more than a second begin the track anew.

        Raises:
            InputError: arrays of other or different shapes.
        """
        stamps = time + self.offset
        reached = np.fmax.accumulate(np.append(self._newest, stamps))[:-1]
        back = np.flatnonzero(stamps < reached - _JUMP)
        if len(back):
            for part, begins in ((slice(int(back[0])), False), (slice(int(back[0]), None), True)):
                if begins:
                    self._rows, self._fresh, self._newest, self._moved = np.zeros((0, 8)), [], -np.inf, None
                    self.restarts += 1
                self.add(time[part], quaternion[part], None if position is None else position[part])
            return
        self._since += len(time)
        super().add(time, quaternion, position)

    @property
    def newest(self) -> float:
        """Stamp [s] of the newest pose, on the samples' clock; -inf where there is none."""
        return self._newest

    @takes_arrays
    def at(self, time: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n 3"]]:
        """Return quaternions x, y, z, w (n, 4) and positions (n, 3) [m] at times (n,) [s].

        They are interpolated between poses, and held or extrapolated after the newest; NaN before the first pose, in
        gaps longer than `max_gap`, and later than `max_gap` after the newest.

        Raises:
            InputError: the times are not (n,) numbers.
        """
        if (time > self._newest).all():  # as a rule
            answers = np.full((len(time), 7), np.nan)
            quaternion, position = answers[:, :4], answers[:, 4:]
        else:
            quaternion, position = super().at(time)
        late = np.flatnonzero((time > self._newest) & (time <= self._newest + self.max_gap + SLACK))
        if not len(late):
            return quaternion, position
        rows = self._gathered()
        last = rows[-1]
        if self._hold:
            quaternion[late], position[late] = last[1:5], last[5:]
        elif len(rows) > 1:
            age = time[late] - last[0]
            first = rows[self._before(age)]
            share = 1.0 + age / (last[0] - first[:, 0])
            quaternion[late] = slerp(first[:, 1:5], np.broadcast_to(last[1:5], (len(late), 4)), share)
            position[late] = first[:, 5:] + share[:, None] * (last[5:] - first[:, 5:])
        return quaternion, position

    @takes_arrays
    def lag(self, time: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Return the age of the newest pose at times (n,) [s], at least 0, and the rms angle error s, (n,) [rad].

        s is 0 at age 0, and else NaN with fewer than three poses.

        Raises:
            InputError: the times are not (n,) numbers.
        """
        age = np.maximum(time - self._newest, 0.0)
        turned = np.zeros(len(time))
        late = np.flatnonzero(age > 0)
        if len(late):
            turned[late] = self._turned(age[late])
        return age, turned

    def _turned(self, age: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        rows = self._gathered()
        if len(rows) < 3:
            return np.full(len(age), np.nan)
        if self._moved is None or self._since >= _RENEWED or len(rows) < _RECENT:
            self._moved, self._since = _motion(rows[-_RECENT:]), 0
        acceleration, noise, velocity = self._moved
        if self._hold:
            return np.sqrt(velocity * age**2 + acceleration * age**4 / 4.0)
        base = rows[-1, 0] - rows[self._before(age), 0]
        share = age / base
        return np.sqrt(acceleration * (age * (age + base) / 2.0) ** 2 + noise * 2.0 * share * (1.0 + share))

    def _before(self, age: Float[np.ndarray, " k"]) -> np.ndarray:
        """Return the rows (k,) that are about as long before the newest as the age."""
        stamps: Float[np.ndarray, " n"] = self._rows[:, 0]
        wanted: Float[np.ndarray, " k"] = stamps[-1] - age
        found: Int[np.ndarray, " k"] = np.searchsorted(stamps, wanted, side="right") - 1
        return np.clip(found, 0, len(stamps) - 2)


def _motion(rows: Float[np.ndarray, "k 8"]) -> tuple[float, float, float]:
    """Return mean squares of angular acceleration [rad^2/s^4], noise [rad^2] and velocity [rad^2/s^2]."""
    stamps, quaternion = rows[:, 0], rows[:, 1:5] / np.linalg.norm(rows[:, 1:5], axis=1, keepdims=True)
    spacing = float(stamps[-1] - stamps[0]) / (len(rows) - 1)
    short, speed = _missed(stamps, quaternion, 1)
    apart = min(_LONG, (len(rows) - 1) // 2)
    if apart == 1:
        return short / spacing**4, 0.0, speed
    long, _ = _missed(stamps, quaternion, apart)
    acceleration = max(long - short, 0.0) / ((apart**4 - 1) * spacing**4)
    return acceleration, max(short - acceleration * spacing**4, 0.0) / 6.0, speed


def _missed(stamps: Float[np.ndarray, " k"], quaternion: Float[np.ndarray, "k 4"], apart: int) -> tuple[float, float]:
    """Return mean squares of the second difference [rad^2] over `apart` poses and of the velocity [rad^2/s^2]."""
    vector, w = _turn(quaternion[:-apart], quaternion[apart:])
    length = np.linalg.norm(vector, axis=1)
    angle = 2.0 * np.arctan2(length, w)
    scale = np.divide(angle, length, out=np.full(len(length), 2.0), where=length > 0)
    velocity = vector * (scale / (stamps[apart:] - stamps[:-apart]))[:, None]
    lag = (stamps[apart:] - stamps[:-apart]).mean()
    missed = (velocity[apart:] - velocity[:-apart]) * lag
    return float((missed**2).sum(axis=1).mean()), float((velocity**2).sum(axis=1).mean())


def _turn(first: Float[np.ndarray, "k 4"], second: Float[np.ndarray, "k 4"]) -> tuple[np.ndarray, np.ndarray]:
    """Return vector (k, 3) and scalar (k,) part of the short turn from first to second."""
    a, b = first[:, :3], second[:, :3]
    scalar = (first * second).sum(axis=1)
    vector = first[:, 3:] * b - second[:, 3:] * a + np.cross(a, b)
    return np.where(scalar[:, None] < 0, -vector, vector), np.abs(scalar)
