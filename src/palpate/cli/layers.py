"""What each sensor of a rig adds to the page."""

from __future__ import annotations

import numpy as np

from palpate.io.rig import Rig
from palpate.io.rig.load_cells import rig_cells
from palpate.io.rig.skin import rig_body
from palpate.viewer.layer import Layer
from palpate.viewer.load_cells import LoadCellLayer
from palpate.viewer.taxels import TaxelLayer

__all__ = ["layers_of"]


def layers_of(rig: Rig, sensor: str, forces: np.ndarray | None = None) -> tuple[Layer, ...]:
    """Of a sensor's kind, if the files that it names are there; `forces` (n, k) [N] are those of a skin's cells."""
    if sensor not in rig.sensors:
        return ()
    there = all(path.exists() for name, path in rig.files(rig.kind(sensor)).items() if name != "mesh")
    if there and sensor == "load_cells":
        return (LoadCellLayer(rig_cells(rig)),)
    return (TaxelLayer(rig_body(rig), forces),) if there and sensor == "skin" else ()
