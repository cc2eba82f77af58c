"""Record the course of a bias in bounded memory, with notes and warnings."""

from __future__ import annotations

import numpy as np

from palpate.contact.drift_gate import Jump
from palpate.signals.zero_filter import FollowedSensor, ZeroHistory, ZeroState, ZeroStatus

KEPT = 20_000  # windows, evenly spread
MOSTLY = 0.9  # share of the time: a bias not followed for longer gives a warning, in a log of
LEAST = 3000  # or more windows
SHORT, OFTEN = 600, 0.2  # windows of a log, and the share of them that are faint, from which there is a warning
SELDOM = 0.05  # share of faint windows that is not mentioned: those in which touches begin and end
SAID = 3  # jumps that notes list


class ZeroRecord:
    """Record of windows, thinned in a long log.

    Args:
        sensor: converts a change of the bias into a wrench.
    """

    def __init__(self, sensor: FollowedSensor) -> None:
        self._sensor = sensor
        self._rows, self._stride, self._seen = list[tuple[float, ZeroState, ZeroStatus]](), 1, 0
        self._counts = np.zeros(len(ZeroStatus), dtype=np.int64)
        self._last: tuple[float, ZeroState] | None = None

    def add(self, time: float, state: ZeroState, status: ZeroStatus) -> None:
        """Add the next window: its time [s], its bias, and whether it was used."""
        self._counts[status] += 1
        self._last = time, state
        if self._seen % self._stride == 0:
            self._rows.append((time, state, status))
        self._seen += 1
        if len(self._rows) > 2 * KEPT:
            self._rows, self._stride = self._rows[::2], 2 * self._stride

    def value(self) -> ZeroHistory:
        """Return the bias of the windows that were kept as a `ZeroHistory`."""
        states = [state for _, state, _ in self._rows]
        count, channels = len(states), len(states[0].zero if states else self._sensor.start()[1].zero)
        variances = [np.diag(state.covariance)[:channels] for state in states]
        return ZeroHistory(
            np.array([time for time, _, _ in self._rows], dtype=np.float64),
            np.array([state.zero for state in states], dtype=np.float64).reshape(count, channels),
            np.sqrt(np.array(variances, dtype=np.float64).reshape(count, channels)),
            np.array([state.coefficient for state in states], dtype=np.float64).reshape(count, -1 if count else 0),
            np.array([status for _, _, status in self._rows], dtype=np.int8),
        )

    def notes(self, jumps: list[Jump]) -> tuple[str, ...]:
        """Return the change of the bias, how long it was not followed, and followed jumps, a tuple of sentences."""
        if self._last is None:
            return ()
        (begun, first, _), (ended, last) = self._rows[0], self._last
        channels = len(last.zero)
        moved = (last.zero - first.zero)[None]
        wrench, _ = self._sensor.as_wrench(moved, last.covariance[:channels, :channels])
        force, torque = (float(np.linalg.norm(part)) for part in (wrench[0, :3], wrench[0, 3:]))
        went = f"moved by {force:.2g} N and {1e3 * torque:.2g} mN m" if moved.any() else "was never followed"
        said = [
            f"the zero {went} over {ended - begun:.0f} s; in {self._held():.0%} of the time it was kept{self._why()}"
        ]
        followed = [jump for jump in jumps if jump.followed]
        if followed:
            said.append(f"the zero jumped {_times(len(followed))}, and was followed: {_named(followed)}")
        return tuple(said)

    def warnings(self, jumps: list[Jump]) -> tuple[str, ...]:
        """Return warnings of jumps that may be touches and of a bias rarely followed, a tuple of sentences or ()."""
        left = [jump for jump in jumps if not jump.followed]
        said = list[str]()
        if left:
            said.append(
                f"{_times(len(left))} the wrench changed as no single contact of the body explains, too fast to be "
                f"distinguished from two touches at once, so the bias was not tracked: {_named(left)}; tare again if "
                "nothing touched"
            )
        if (self._seen >= LEAST and self._held() > MOSTLY) or (self._seen >= SHORT and self._faint() > OFTEN):
            said.append(
                f"the zero was kept in {self._held():.0%} of the time{self._why()}: if nothing touched then, the drift "
                "or the noise is stated too small, or the payload has to be calibrated again"
            )
        return tuple(said)

    def _held(self) -> float:
        return float(1.0 - self._counts[ZeroStatus.FREE] / max(1, self._seen))

    def _faint(self) -> float:
        return float(self._counts[ZeroStatus.FAINT] / max(1, self._seen))

    def _why(self) -> str:
        if self._faint() <= SELDOM:
            return ", as something touched"
        return (
            f" ({self._held() - self._faint():.0%} as something touched, {self._faint():.0%} as the readings changed "
            "by more than drift, noise and payload explain, and by less than a touch)"
        )


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _named(jumps: list[Jump]) -> str:
    first = ", ".join(f"{jump.force:.2g} N at {jump.time:.1f} s" for jump in jumps[:SAID])
    return first + (", ..." if len(jumps) > SAID else "")
