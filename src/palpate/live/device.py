"""The protocol of simulated devices, which play a log to try a set-up without the real device."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int


@runtime_checkable
class Device(Protocol):
    """A simulated device, which sends given samples by the protocol of the real one."""

    def open(self) -> str:
        """Begin to listen, and return the [source] of a rig that reaches the device, as TOML.

        Raises:
            InputError: the port or file is taken, or may not be used.
        """
        ...

    def send(self, stamp: Int[np.ndarray, " n"], values: Float[np.ndarray, "n k"]) -> int:
        """Send samples to the listeners that requested them, and return how many were sent; 0 while nobody listens.

        Args:
            stamp: (n,) [ns] time of each sample in the log.
            values: (n, k) in SI units and in the sensor's axes; a wrench has its force first.
        """
        ...

    def close(self) -> None:
        """Stop the device; calling it again does nothing."""
        ...
