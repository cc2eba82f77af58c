"""The protocol of simulated devices, through which a log is played to try a set-up without the real device."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

__all__ = ["Device"]


@runtime_checkable
class Device(Protocol):
    """A simulated device that speaks the real device's protocol and sends the samples that it is given."""

    def open(self) -> str:
        """Begin to listen for connections.

        Returns:
            The [source] of a rig that reaches the device, as a text of lines of TOML.

        Raises:
            InputError: the port or file is taken, or may not be used.
        """
        ...

    def send(self, stamp: Int[np.ndarray, " n"], values: Float[np.ndarray, "n k"]) -> int:
        """Send samples now to the listeners that requested them.

        Args:
            stamp: (n,) [ns] time of each sample in the log.
            values: (n, k) in SI units and in the sensor's axes; a wrench has its force first.

        Returns:
            The number of samples sent; 0 while nobody listens.
        """
        ...

    def close(self) -> None:
        """Stop the device; calling it again does nothing."""
        ...
