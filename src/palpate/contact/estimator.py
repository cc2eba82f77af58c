"""What turns readings into contacts, for every sensor: what commands, pages and live loops know."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from palpate.contact.contacts import Contacts
from palpate.errors import InputError
from palpate.sensors.recording import Recording
from palpate.sensors.wrench_sensor import Tare
from palpate.spatial._arrays import FLOAT, shaped
from palpate.spatial.pose import Pose

__all__ = ["NOTHING_BESIDE", "ContactEstimator"]

NOTHING_BESIDE: Mapping[str, np.ndarray] = MappingProxyType({})

_COUNT = np.dtype(np.int64)


def instant(time: ArrayLike) -> float:
    """Return the time [s] of one sample as a number, whatever holds it.

    Raises:
        InputError: it is not one number.
    """
    return cast("float", time) if type(time) is float else float(shaped(time, (), "time"))


def samples(
    time: ArrayLike,
    readings: ArrayLike,
    counts: np.ndarray,
    beside: Mapping[str, ArrayLike] = NOTHING_BESIDE,
    dtype: np.dtype[Any] = FLOAT,
) -> tuple[Float[np.ndarray, " n"], np.ndarray, dict[str, np.ndarray]]:
    """Return times, readings and other channels of `run_into` as compiled loops take them: contiguous, float64.

    Args:
        time: (n,) [s].
        readings: (n, ...).
        counts: to be written into.
        beside: other channels, each (n, ...).
        dtype: of the readings.

    Raises:
        InputError: there is not one reading and one row of each other channel a time, or `counts` cannot take as many
            whole numbers.
    """
    time = shaped(time, (None,), "time")
    made = {"readings": shaped(readings, (...,), "readings", dtype)}
    made |= {name: shaped(values, (...,), name) for name, values in beside.items()}
    for name, values in made.items():
        if values.shape[:1] != time.shape:
            raise InputError(f"{name} must have one row for each of {len(time)} times, not shape {values.shape}.")
    if (
        type(counts) is not np.ndarray
        or counts.shape != time.shape
        or counts.dtype != _COUNT
        or not counts.flags.carray
    ):
        seen = f"{getattr(counts, 'dtype', type(counts).__name__)} of shape {getattr(counts, 'shape', ())}"
        raise InputError(f"counts must be a writable, contiguous array of int64 and shape {time.shape}, not {seen}.")
    return time, made.pop("readings"), made


def rows_of(out: Any, width: int) -> Float[np.ndarray, "rows width"]:
    """Rows that an estimator's `update_into` can write into; raise an InputError where they are not as of `empty`."""
    known = type(out) is np.ndarray and out.dtype == np.float64
    if known and out.shape[-1:] == (width,) and out.ndim <= 2 and out.flags.carray and out.size:
        return out.reshape(-1, width)
    seen = [str(getattr(out, each)) for each in ("dtype", "shape") if hasattr(out, each)] or [type(out).__name__]
    raise InputError(f"out must be rows of {width} as `empty` makes them, not {' '.join(seen)}.")


@runtime_checkable
class ContactEstimator(Protocol):
    """Each sample is answered with what those before it left; blocks of any size give the same to the last bit."""

    @property
    def channels(self) -> tuple[str, ...]:
        """That a recording must have."""
        ...

    @property
    def features(self) -> tuple[str, ...]:
        """Names of the columns that the sensor adds."""
        ...

    @property
    def most(self) -> int:
        """Rows that one sample has at most."""
        ...

    @property
    def mount(self) -> Pose:
        """T_sensor_surface, for results in other frames."""
        ...

    def empty(self, *batch: int) -> Float[np.ndarray, "*batch width"]:
        """Rows to write into: `ROW`, then features, then the identity where there are several contacts."""
        ...

    def reset(self) -> None:
        """Forget what samples left; not the tare."""
        ...

    def tare(self, recording: Recording) -> Tare:
        """Take what a steady, untouched window reads off from now on, in place of an earlier tare; then `reset`."""
        ...

    def run(self, recording: Recording) -> Contacts:
        """Contacts of a block, in the surface's frame."""
        ...

    def pairs(self, blocks: Iterable[Recording]) -> Iterator[tuple[Recording, Contacts]]:
        """Each block with its contacts, in order, as soon as they are known."""
        ...

    def stream(self, blocks: Iterable[Recording]) -> Iterator[Contacts]:
        """The contacts alone."""
        ...

    def update(
        self,
        time: ArrayLike,
        reading: ArrayLike,
        rotation: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> Contacts:
        """Of one live sample."""
        ...

    def update_into(
        self,
        time: ArrayLike,
        reading: ArrayLike,
        out: Float[np.ndarray, "*rows width"],
        rotation: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> int:
        """`update` into rows of `empty`; how many were written."""
        ...

    def run_into(
        self,
        time: ArrayLike,
        readings: ArrayLike,
        out: Float[np.ndarray, "rows width"],
        counts: Int[np.ndarray, " n"],
        beside: Mapping[str, ArrayLike] = NOTHING_BESIDE,
    ) -> int:
        """`run` of arrays into rows of `empty`, for streams.

        Args:
            time: [s].
            readings: (n, ...) as `update` takes each.
            out: written from its first row on.
            counts: how many rows each sample has, in order.
            beside: other channels of a `Recording`, such as `ORIENTATION`, as far as they are known.

        Returns:
            how many samples were answered: all, or as many as have room in `out`. Give the others again.
        """
        ...

    def notes(self) -> tuple[str, ...]:
        """What was met so far, one sentence each."""
        ...

    def doubts(self) -> tuple[str, ...]:
        """What may be wrong."""
        ...
