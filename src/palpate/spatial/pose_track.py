"""The sensor's pose between recorded poses, on the clock of the wrenches."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from palpate.spatial._arrays import shaped
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.stamped_rows import SLACK, StampedRows


@takes_arrays
class PoseTrack(StampedRows):
    """Track of recorded poses, added in pieces as they come, which answers at any times between them.

    A pose no newer than one before it, or without a stamp or a quaternion, is left out and counted. How the poses are
    cut into pieces makes no difference.

    Args:
        offset: [s] added to the poses' stamps to put them on the wrenches' clock.
        max_gap: [s] between neighbours, beyond which there is no answer between them.

    Attributes:
        late: number of poses left out because their stamp was not newer than an earlier one.
        unreadable: number of poses left out because stamp or quaternion was unusable.
    """

    def __init__(self, offset: float = 0.0, max_gap: float = 0.25) -> None:
        super().__init__(8, max_gap)  # stamp, quaternion, position
        self.offset, self.unreadable = offset, 0

    def add(
        self,
        time: Float[np.ndarray, " n"],
        quaternion: Float[np.ndarray, "n 4"],
        position: Float[np.ndarray, "n 3"] | None = None,
    ) -> None:
        """Add poses to the track; those no later than one before, or unusable, are only counted (`late`, `unreadable`).

        Args:
            time: (n,) [s] stamps on the poses' own clock.
            quaternion: (n, 4) x, y, z, w: sensor in base.
            position: (n, 3) [m] of the sensor's origin in the base; None or NaN where it is not known.

        Raises:
            InputError: arrays of other or different shapes.
        """
        position = np.full((len(time), 3), np.nan) if position is None else position
        rows = np.column_stack([time + self.offset, quaternion, position])
        sound = np.isfinite(rows[:, 0]) & sound_quaternions(quaternion)
        self.unreadable += int(np.count_nonzero(~sound))
        self._append(rows[sound])

    def answerable(self, time: Float[np.ndarray, " n"]) -> int:
        """Return how many of the times (n,) [s], from the first on, have answers that later poses will not change.

        Raises:
            InputError: time has another shape.
        """
        return self._before_waiting(time > self._newest)

    def at(self, time: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n 3"]]:
        """Return quaternions x, y, z, w (n, 4) and positions (n, 3) [m] at times (n,) [s] on the wrenches' clock.

        At a pose's stamp it is that pose to the last bit; between two at most `max_gap` apart, the rotation turns at
        constant speed and the position runs straight; elsewhere NaN.

        Raises:
            InputError: the times are not (n,) numbers.
        """
        rows = self._gathered()
        answers = np.full((len(time), 7), np.nan)
        before = np.searchsorted(rows[:, 0], time, side="right") - 1
        inside = (before >= 0) & (time <= self._newest)  # not NaN
        stamp = np.where(inside, rows[before, 0] if len(rows) else np.nan, np.nan)
        exact = stamp == time
        answers[exact] = rows[before[exact], 1:]
        between = np.flatnonzero(inside & ~exact)
        first, second = rows[before[between]], rows[before[between] + 1]
        with np.errstate(over="ignore"):  # stamps of nonsense
            gap = second[:, 0] - first[:, 0]
        near = gap <= self.max_gap + SLACK
        between, first, second, gap = between[near], first[near], second[near], gap[near]
        share = (time[between] - first[:, 0]) / gap
        answers[between, :4] = slerp(first[:, 1:5], second[:, 1:5], share)
        with np.errstate(invalid="ignore"):  # an infinite position
            answers[between, 4:] = first[:, 5:] + share[:, None] * (second[:, 5:] - first[:, 5:])
        return answers[:, :4], answers[:, 4:]

    @property
    def stamps(self) -> Float[np.ndarray, " k"]:
        """Stamps of the poses that are kept, on the wrenches' clock, (k,) [s]."""
        return self._gathered()[:, 0].copy()

    def forget(self, before: float) -> None:
        """Drop the poses that answers at `before` [s], on the wrenches' clock, and later do not need."""
        self._drop(int(np.searchsorted(self._gathered()[:, 0], before, side="right")) - 1)

    def notes(self) -> tuple[str, ...]:
        """Return how many poses were left out and why, a tuple of sentences; () without any."""
        said = (
            (self.late, "are not newer than an earlier one and were left out"),
            (self.unreadable, "have no stamp, or a quaternion that is not of length 1, and were left out"),
        )
        return tuple(f"{count} poses {what}" for count, what in said if count)


def sound_quaternions(quaternion: Float[np.ndarray, "n 4"]) -> Bool[np.ndarray, " n"]:
    """Return a mask (n,) of the quaternions (n, 4) that are finite and of a length between 0.5 and 2.

    Raises:
        InputError: the quaternions have another shape.
    """
    quaternion = shaped(quaternion, (None, 4), "quaternion")
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.sqrt(np.sum(quaternion * quaternion, axis=1))
    return (length > 0.5) & (length < 2.0)


@takes_arrays
def slerp(
    first: Float[np.ndarray, "*batch 4"], second: Float[np.ndarray, "*batch 4"], share: Float[np.ndarray, "*batch"]
) -> Float[np.ndarray, "*batch 4"]:
    """Return unit quaternions (*batch, 4) from `first` (share 0) to `second` (1), the shortest way at constant speed.

    q = (sin((1 - u) a) q0 + sin(u a) q1) / sin a [Shoemake 1985], with a half of the rotation's angle, from the chords:
    a = 2 atan2(|q1 - q0|, |q1 + q0|). The arc cosine of q0 . q1 is not exact for small angles.

    Args:
        first: (*batch, 4) x, y, z, w of any length but zero; NaN gives NaN.
        second: the same.
        share: (*batch,) u; beyond 0 to 1 it extrapolates.

    Raises:
        InputError: other shapes, or batches that differ.
    """
    start, end = (q / _length(q) for q in (first, second))
    end = np.where(np.sum(start * end, axis=-1, keepdims=True) < 0, -end, end)
    angle = 2.0 * np.arctan2(_length(end - start), _length(end + start))
    u = share[..., None]
    still = angle == 0.0
    whole = np.where(still, 1.0, np.sin(angle))
    before = np.where(still, 1.0 - u, np.sin((1.0 - u) * angle) / whole)
    after = np.where(still, u, np.sin(u * angle) / whole)
    return before * start + after * end


def _length(q: Float[np.ndarray, "*batch 4"]) -> Float[np.ndarray, "*batch 1"]:
    return np.sqrt(np.sum(q * q, axis=-1, keepdims=True))
