"""Ground truth of contacts from another source: at instants, or for each touch."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError
from palpate.spatial._arrays import Value, frozen
from palpate.spatial.arguments import frozen_value


@frozen_value
class TrueSamples(Value):
    """True contacts at instants.

    Attributes:
        time: (n,) [s], on the log's clock.
        point: (n, 3) [m] in the frame of the estimates.
        normal: (n, 3) outward, or None.
        force: (n, 3) [N] on the body, or None.
        sensor: name of the robot's sensor that is touched, of each instant; () if they are of one sensor.

    Raises:
        InputError: arrays of other or different shapes.
    """

    time: Float[np.ndarray, " n"]
    point: Float[np.ndarray, "n 3"]
    normal: Float[np.ndarray, "n 3"] | None = None
    force: Float[np.ndarray, "n 3"] | None = None
    sensor: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("time", "point", "normal", "force"):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, frozen(value))
        _require_names(self.sensor, len(self.time))

    def __getitem__(self, which: Int[np.ndarray, " k"]) -> TrueSamples:
        """Return the instants of these numbers (k,)."""
        normal, force = (None if each is None else each[which] for each in (self.normal, self.force))
        return TrueSamples(self.time[which], self.point[which], normal, force, _picked(self.sensor, which))


@frozen_value
class TrueTouches(Value):
    """Intervals in which one known point was touched.

    Attributes:
        start: (n,) [s].
        end: (n,) [s], included.
        point: (n, 3) [m] in the frame of the estimates.
        label: n names.
        sensor: name of the robot's sensor that is touched, of each touch; () if they are of one sensor.
        force: (n, 3) [N] on the body during all of a touch, or None.

    Raises:
        InputError: arrays of other or different shapes.
    """

    start: Float[np.ndarray, " n"]
    end: Float[np.ndarray, " n"]
    point: Float[np.ndarray, "n 3"]
    label: tuple[str, ...]
    sensor: tuple[str, ...] = ()
    force: Float[np.ndarray, "n 3"] | None = None

    def __post_init__(self) -> None:
        for name in ("start", "end", "point", "force"):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, frozen(value))
        _require_names(self.sensor, len(self.start))

    def __getitem__(self, which: Int[np.ndarray, " k"]) -> TrueTouches:
        """Return the touches of these numbers (k,)."""
        labels, sensors = (_picked(names, which) for names in (self.label, self.sensor))
        force = None if self.force is None else self.force[which]
        return TrueTouches(self.start[which], self.end[which], self.point[which], labels, sensors, force)

    def instants(self) -> TrueSamples:
        """Return points and forces at the start of each touch."""
        return TrueSamples(self.start, self.point, force=self.force)

    def __len__(self) -> int:
        return len(self.label)


def _picked(names: tuple[str, ...], which: Int[np.ndarray, " k"]) -> tuple[str, ...]:
    return tuple(names[int(k)] for k in which) if names else ()


def _require_names(sensor: tuple[str, ...], count: int) -> None:
    """Raise InputError unless there are as many names as rows, or none."""
    if sensor and len(sensor) != count:
        raise InputError(f"sensor must be {count} names, one for each row, not {len(sensor)}.")
