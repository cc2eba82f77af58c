"""Describe the drift of a sensor's bias as `palpate calibrate drift` prints and writes it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from palpate.calibration.drift import DriftFit

__all__ = ["CHI_95", "ChannelGroup", "SensorDrift"]

CHI_95 = 2.795  # of three components: the length that 95 % stay below, in deviations of one


class ChannelGroup(NamedTuple):
    """Channels that are printed together: their random walk in one unit, all other figures in another."""

    name: str
    channels: slice
    walk_scale: float
    walk_unit: str
    scale: float
    unit: str


@dataclass(frozen=True)
class SensorDrift:
    """The drift of a sensor's bias, found in a log without contact, and how it is printed.

    Args:
        found: drift of the channels.
        comments: unit of each key of [drift] in a rig.
        groups: groups of channels.
        unsure: takes a standard deviation per channel, and returns the 95 % bound of force and torque in words.
        weight: [N] standard deviation of the payload's weight, by its calibration; 0: none or not known.
        notes: on how the log was read, one sentence each.
    """

    found: DriftFit
    comments: Mapping[str, str]
    groups: tuple[ChannelGroup, ...]
    unsure: Callable[[Float[np.ndarray, " m"]], str]
    weight: float = 0.0
    notes: tuple[str, ...] = ()
