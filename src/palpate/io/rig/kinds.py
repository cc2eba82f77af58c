"""The table of sensors. Add a row, or an entry point of another package, and every command, page and test takes it."""

from __future__ import annotations

from palpate.io.rig.setup import SensorKind
from palpate.registry import Registry

__all__ = ["ASSUMED", "KINDS"]

ASSUMED = "force_torque"
"""The sensor of a rig that states none."""
KINDS = Registry(
    {
        "fusion": "palpate.io.rig.fusion.FUSION",
        "force_torque": "palpate.io.rig.force_torque.FORCE_TORQUE",
        "load_cells": "palpate.io.rig.load_cells.LOAD_CELLS",
        "marker_ring": "palpate.io.rig.marker_ring.MARKER_RING",
        "skin": "palpate.io.rig.skin.SKIN",
    },
    SensorKind,
    "palpate.sensors",
    first=True,
)
"""Name of a sensor's table in a rig -> the sensor, in the order in which they are tried on a log."""
