"""What a sensor of wrenches is to the rest: readings in, wrenches with covariance and status out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int8
from numpy.typing import ArrayLike

from palpate.signals.filters import Filter
from palpate.signals.recording import Recording
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import Pose
from palpate.spatial.uncertain import inverse_pose_covariance

__all__ = ["Measured", "Placement", "Tare", "UnloadedSensor", "WrenchSensor", "square_root"]


@runtime_checkable
class Measured(Protocol):
    """Samples as wrenches; what else a sensor keeps beside them for their covariance is its own."""

    @property
    def time(self) -> Float[np.ndarray, " n"]:
        """(n,) [s]."""
        ...

    @property
    def wrench(self) -> Float[np.ndarray, "n 6"]:
        """(n, 6) [N, N m] in the sensor's frame, force first; a filter may overwrite it."""
        ...

    @property
    def status(self) -> Int8[np.ndarray, " n"]:
        """(n,) `Status` known beforehand, -1 for a sample to locate."""
        ...


@takes_arrays
@dataclass(frozen=True, eq=False)
class Tare:
    """What a tare took off.

    Attributes:
        note: a sentence.
        warning: why it may be wrong, or "".
        touch: (6,) in the sensor's frame, the wrench that a steady touch would have to have for the tare to have taken
            it off; None where it was none.
        least: [N] a touch with less force is not worth a doubt.
    """

    note: str
    warning: str = ""
    touch: Float[np.ndarray, "6"] | None = None
    least: float = 0.0


@takes_arrays
class Placement:
    """Where the surface sits on the sensor, as the compiled loops take it.

    Args:
        mount: T_sensor_surface.
        covariance: (6, 6) of its (rotation vector [rad], translation [m]), perturbed on the left; None: exact.

    Attributes:
        matrix: (6, 6) takes wrenches from the sensor's frame to the surface's.
        factor: (q, 6) of the covariance that the mounting adds, in the surface's frame: factor' factor.
    """

    def __init__(self, mount: Pose, covariance: Float[np.ndarray, "6 6"] | None = None) -> None:
        self.matrix: Float[np.ndarray, "6 6"] = mount.inverse().wrench_matrix()
        self.factor: Float[np.ndarray, "q 6"] = square_root(
            np.zeros((6, 6)) if covariance is None else inverse_pose_covariance(mount, covariance)
        )


@runtime_checkable
class WrenchSensor(Protocol):
    """A wrench passes in two steps, so that a filter can stand between them: `measure`, then `place`.

    Each step is the same to the last bit however samples are cut into blocks.
    """

    @property
    def channels(self) -> tuple[str, ...]:
        """That a recording must have."""
        ...

    @property
    def noise(self) -> Float[np.ndarray, "6 6"] | None:
        """Usual covariance of a wrench in the sensor's frame, thresholds follow from it; None: not known."""
        ...

    def smoothed_by(self, filter: Filter | None, rate: float | None, share: float) -> None:
        """Learn which filter wrenches pass before `place`.

        Args:
            filter: of the wrenches; None: none.
            rate: [Hz] of the samples.
            share: least share of white noise's variance that it leaves.
        """
        ...

    def ready(self, blocks: Iterable[Recording]) -> Iterator[Recording]:
        """The same rows, with what needs to look ahead, such as accelerations from poses."""
        ...

    def measure(self, recording: Recording) -> Measured:
        """Of a block; an InputError where a channel is missing or has another shape."""
        ...

    def single(
        self, time: float, reading: ArrayLike, rotation: ArrayLike | None, acceleration: ArrayLike | None
    ) -> Measured:
        """Of one live sample; valid until the next."""
        ...

    def place(
        self, measured: Any, wrenches: Float[np.ndarray, "n 6"], share: Float[np.ndarray, " k"], placement: Placement
    ) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 6 6"] | None]:
        """Wrenches in the surface's frame, and their covariances where the noise is known.

        Args:
            measured: what `measure` or `single` gave.
            wrenches: (n, 6) of it, filtered or not.
            share: (n,) or (1,) of the variance of a reading's noise that the filter left.
            placement: of the surface.
        """
        ...

    def tare(self, recording: Recording) -> Tare:
        """Take what is read there off from now on, in place of an earlier tare; an InputError if it is not at rest."""
        ...

    def reset(self) -> None:
        """Forget what samples left, not the tare."""
        ...

    def notes(self) -> tuple[str, ...]:
        """What was met so far, one sentence each."""
        ...

    def warnings(self) -> tuple[str, ...]:
        """What may be wrong: a dead cell, a zero that looks like a touch."""
        ...


@runtime_checkable
class UnloadedSensor(Protocol):
    """A sensor that becomes a sensor of wrenches when nothing is mounted on it, such as a `ForceTorque`."""

    def unloaded(self) -> WrenchSensor:
        """Return the sensor without a payload, to be tared."""
        ...


@takes_arrays
def square_root(covariance: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "r n"]:
    """Vectors whose squares sum to a covariance, as many as its rank; in units in which its diagonal is 1."""
    scale = np.sqrt(np.diag(covariance))
    scale = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    kept = values > 1e-14
    return np.ascontiguousarray((vectors[:, kept] * np.sqrt(values[kept])).T * scale)
