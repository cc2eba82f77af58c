"""What stands for a device, so that a set-up can be tried without one: a log is played through it."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

__all__ = ["Device"]


@runtime_checkable
class Device(Protocol):
    """Speaks as the real device does, to whoever asks; samples are sent when they are given."""

    def open(self) -> str:
        """Begin to listen.

        Returns:
            the [source] of a rig that reaches it, as lines of TOML.

        Raises:
            InputError: the port or file is taken, or may not be used.
        """
        ...

    def send(self, stamp: Int[np.ndarray, " n"], values: Float[np.ndarray, "n k"]) -> int:
        """Send samples now, to those who asked for them.

        Args:
            stamp: [ns] of each in the log.
            values: SI, of a wrench force first, in the sensor's axes.

        Returns:
            how many were sent: 0 while nobody listens.
        """
        ...

    def close(self) -> None:
        """Stop; may be called twice."""
        ...
