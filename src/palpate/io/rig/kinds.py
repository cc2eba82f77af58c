"""The table of sensors. Add a row, and every command, page and test takes it."""

from __future__ import annotations

from palpate.io.rig.force_torque import FORCE_TORQUE
from palpate.io.rig.fusion import FUSION
from palpate.io.rig.kind import SensorKind
from palpate.io.rig.load_cells import LOAD_CELLS
from palpate.io.rig.marker_ring import MARKER_RING
from palpate.io.rig.skin import SKIN

__all__ = ["KINDS"]

KINDS: dict[str, SensorKind] = {kind.name: kind for kind in (FUSION, FORCE_TORQUE, LOAD_CELLS, MARKER_RING, SKIN)}
"""Name of its table in a rig -> the sensor, in the order in which they are tried on a log."""
