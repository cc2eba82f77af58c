"""The table of sensors. Add a row, or an entry point of another package, and every command, page and test takes it."""

from __future__ import annotations

from palpate.registry import Registry
from palpate.setup.setup import SensorKind

__all__ = ["ASSUMED", "KINDS"]

ASSUMED = "force_torque"
"""The sensor of a rig that states none."""
KINDS = Registry(
    {
        "fusion": "palpate.sensors.fused.section.FUSION",
        "force_torque": "palpate.sensors.force_torque.section.FORCE_TORQUE",
        "load_cells": "palpate.sensors.load_cells.section.LOAD_CELLS",
        "marker_ring": "palpate.sensors.marker_ring.section.MARKER_RING",
        "skin": "palpate.sensors.taxels.section.SKIN",
    },
    SensorKind,
    "palpate.sensors",
    first=True,
)
"""Name of a sensor's table in a rig -> the sensor, in the order in which they are tried on a log."""
