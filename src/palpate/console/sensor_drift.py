"""Describe the drift of a sensor's bias as `palpate calibrate drift` prints and writes it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from palpate.calibration.drift import DriftFit

CHI_95 = 2.795  # length that 95 % of three-component normal vectors stay below, in deviations of one component


class ChannelGroup(NamedTuple):
    """Channels that are printed together: random walk and noise in one unit, warm-up and temperature in another.

    Args:
        name: such as "force".
        channels: columns of the reading.
        walk_scale: `walk_unit` per SI unit.
        walk_unit: unit of random walk and noise.
        scale: `unit` per SI unit.
        unit: unit of warm-up and temperature dependence.
    """

    name: str
    channels: slice
    walk_scale: float
    walk_unit: str
    scale: float
    unit: str


@dataclass(frozen=True)
class SensorDrift:
    """The drift of a sensor's bias in a log without contact, and how it is printed.

    Args:
        found: drift of the channels.
        comments: key of [drift] in a rig -> its unit.
        groups: all channels.
        unsure: takes a standard deviation per channel (m,), and returns the 95 % bound of force and torque as text.
        notes: on how the log was read, one sentence each.
    """

    found: DriftFit
    comments: Mapping[str, str]
    groups: tuple[ChannelGroup, ...]
    unsure: Callable[[Float[np.ndarray, " m"]], str]
    notes: tuple[str, ...] = ()
