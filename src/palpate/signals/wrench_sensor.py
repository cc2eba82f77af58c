"""Protocol of a wrench sensor: readings in, wrenches with covariance and status out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int8
from numpy.typing import ArrayLike

from palpate.signals.filters import Filter
from palpate.signals.recording import Recording
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.spatial.pose import Pose
from palpate.spatial.uncertain import inverse_pose_covariance


@runtime_checkable
class Measured(Protocol):
    """Samples as wrenches; a sensor may add what its covariances need."""

    @property
    def time(self) -> Float[np.ndarray, " n"]:
        """Times of the samples, (n,) [s]."""
        ...

    @property
    def wrench(self) -> Float[np.ndarray, "n 6"]:
        """Wrenches (n, 6) [N, N m] in the sensor's frame, force first; a filter may overwrite them."""
        ...

    @property
    def status(self) -> Int8[np.ndarray, " n"]:
        """`Status` of each sample, (n,), if known beforehand; -1 for a sample to locate."""
        ...


@frozen_value
class Tare:
    """Result of a tare.

    Attributes:
        note: a sentence.
        warning: why it may be wrong, or "".
        touch: (6,) wrench in the sensor's frame of the steady contact that the tare may have subtracted; None: no
            contact explains it.
        least: force [N] below which such a contact is not worth a warning.
    """

    note: str
    warning: str = ""
    touch: Float[np.ndarray, "6"] | None = None
    least: float = 0.0


@takes_arrays
class Placement:
    """Place of the surface on the sensor, in the form that compiled loops take.

    Args:
        mount: T_sensor_surface.
        covariance: (6, 6) of its (rotation vector [rad], translation [m]), perturbed on the left; None: exact.

    Attributes:
        matrix: (6, 6) takes wrenches from the sensor's frame to the surface's.
        factor: (q, 6) S with S^T S the covariance of T_surface_sensor.
    """

    def __init__(self, mount: Pose, covariance: Float[np.ndarray, "6 6"] | None = None) -> None:
        self.matrix: Float[np.ndarray, "6 6"] = mount.inverse().wrench_matrix()
        self.factor: Float[np.ndarray, "q 6"] = square_root(
            np.zeros((6, 6)) if covariance is None else inverse_pose_covariance(mount, covariance)
        )


@runtime_checkable
class WrenchSensor(Protocol):
    """A wrench sensor in two steps, `measure` and `place`, with a filter between them.

    Results do not depend on how samples are cut into blocks.
    """

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that a recording must have."""
        ...

    @property
    def noise(self) -> Float[np.ndarray, "6 6"] | None:
        """Usual covariance (6, 6) of a wrench in the sensor's frame; None: not known."""
        ...

    def smoothed_by(self, filter: Filter | None, rate: float | None, share: float) -> None:
        """Set the filter that wrenches pass before `place`.

        Args:
            filter: of the wrenches; None: none.
            rate: [Hz] of the samples; None: not known.
            share: least share of white noise's variance that it keeps.

        Raises:
            InputError: the filter's cut-off does not fit the rate.
        """
        ...

    def ready(self, blocks: Iterable[Recording]) -> Iterator[Recording]:
        """Yield the same rows with added channels that need later samples, such as accelerations from poses.

        Raises:
            InputError: a channel that these need is missing.
        """
        ...

    def measure(self, recording: Recording) -> Measured:
        """Return the samples of a block as `Measured`.

        Raises:
            InputError: a channel is missing or has another shape.
        """
        ...

    def single(
        self, time: float, reading: ArrayLike, rotation: ArrayLike | None, acceleration: ArrayLike | None
    ) -> Measured:
        """Return one live sample as `Measured`, valid until the next call.

        Args:
            time: [s].
            reading: values of `channels`, one after the other.
            rotation: (3, 3), sensor in base; None: not known.
            acceleration: (3,) [m/s^2] in the sensor's frame; None: not known.

        Raises:
            InputError: an argument has another shape, or the rotation is needed and None.
        """
        ...

    def place(
        self, measured: Any, wrenches: Float[np.ndarray, "n 6"], share: Float[np.ndarray, " k"], placement: Placement
    ) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 6 6"] | None]:
        """Return wrenches (n, 6) [N, N m] in the surface's frame and covariances (n, 6, 6), None if noise is unknown.

        Args:
            measured: from `measure` or `single`.
            wrenches: (n, 6) of it, filtered or not.
            share: (n,) or (1,) share of the noise's variance that the filter kept.
            placement: of the surface.

        Raises:
            InputError: arrays of other shapes.
        """
        ...

    def tare(self, recording: Recording) -> Tare:
        """Subtract a recording's mean from now on, in place of an earlier tare, and return a `Tare`.

        Raises:
            InputError: the sensor is not at rest.
        """
        ...

    def reset(self) -> None:
        """Forget the state from earlier samples, but not the tare."""
        ...

    def notes(self) -> tuple[str, ...]:
        """Return notes on the samples so far, one sentence each."""
        ...

    def warnings(self) -> tuple[str, ...]:
        """Return warnings, one sentence each, such as of a dead cell."""
        ...


@runtime_checkable
class MovedSensor(Protocol):
    """A wrench sensor whose readings depend on its acceleration."""

    def moved(self, channels: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
        """Return the channels of live samples with accelerations as `single` takes them, instead of as recorded."""
        ...


@runtime_checkable
class UnloadedSensor(Protocol):
    """A sensor that becomes a `WrenchSensor` when nothing is mounted on it, such as a `ForceTorque`."""

    def unloaded(self) -> WrenchSensor:
        """Return a `WrenchSensor` without a payload, to be tared."""
        ...


@takes_arrays
def square_root(covariance: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "r n"]:
    """Return S (r, n) with S^T S the covariance (n, n); r is its rank in units in which its diagonal is 1.

    Raises:
        InputError: covariance has another shape.
    """
    scale = np.sqrt(np.diag(covariance))
    scale = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    kept = values > 1e-14
    return np.ascontiguousarray((vectors[:, kept] * np.sqrt(values[kept])).T * scale)
