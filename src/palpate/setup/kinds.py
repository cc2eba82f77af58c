"""List the kinds of sensors; a new row, or an entry point of another package, serves every command, page and test."""

from __future__ import annotations

from palpate.registry import Registry
from palpate.setup.setup import SensorKind

ASSUMED = "force_torque"
"""Name of the sensor of a rig that has no sensor's table."""
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
"""Name of a sensor's table in a rig -> the kind of sensor, in the order in which the kinds are tried on a log."""
