"""Identify how the voltages of unloaded load cells drift."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.calibration.drift import identify_drift
from palpate.console.sensor_drift import CHI_95, ChannelGroup, SensorDrift
from palpate.sensors.load_cells.section import LoadCellSection
from palpate.setup.setup import Setup
from palpate.signals.recording import VOLTAGE, Recording

__all__: list[str] = []  # for the registry alone

GROUPS = (ChannelGroup("voltage", slice(None), 1e6, "uV", 1e3, "mV"),)
COMMENTS = {
    "walk": "V/sqrt(s)",
    "warm_up": "V/min at the start",
    "settle": "s",
    "thermal": "V/K",
    "thermal_deviation": "of it",
}


def voltage_drift(
    setup: Setup, recording: Recording, temperature: Float[np.ndarray, " n"] | None, window: float
) -> SensorDrift:
    """Return the drift of the cells' voltages [V] as a `SensorDrift`; an excluded cell gets the drift of the others.

    Args:
        setup: setup of the cells.
        recording: log in which nothing touches them.
        temperature: (n,) [K or degrees C] of the samples; None: not recorded.
        window: [s] over which readings are averaged at first.

    Raises:
        InputError: the cells' model cannot be read, the log is too short or touched, a channel never changes, or times
            run backwards.
        NotIdentifiable: the cells that are used do not determine a wrench.
    """
    section = setup.of(LoadCellSection)
    cells, sound = section.cells, section.cells.channels(section.used)
    voltages = recording.channels[VOLTAGE]
    beyond = (voltages <= cells.limits[:, 0]) | (voltages >= cells.limits[:, 1])
    picked = np.where(beyond, np.nan, voltages)[:, sound]
    names = np.array(section.table.names(cells.cells))[sound].tolist()
    noise = np.sqrt(np.diag(cells.noise))[sound]
    found = identify_drift(recording.time, picked, noise, temperature, names=names, window=window).spread(sound)
    forces = cells.inverse(sound)[0][:3]

    def unsure(deviation: Float[np.ndarray, " m"]) -> str:
        spread = np.sum((forces * deviation) ** 2) / 3.0
        return f"force by {CHI_95 * float(np.sqrt(spread)):.2g} N"

    return SensorDrift(found, COMMENTS, GROUPS, unsure)
