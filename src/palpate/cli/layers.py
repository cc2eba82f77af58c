"""What each sensor of a rig adds to the page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from palpate.io.rig import Rig
from palpate.io.rig.load_cells import RigLoadCells
from palpate.io.rig.skin import rig_body
from palpate.viewer.layer import Layer
from palpate.viewer.load_cells import LoadCellLayer
from palpate.viewer.taxels import TaxelLayer

__all__ = ["layers_of"]


def _load_cells(rig: Rig, forces: np.ndarray | None) -> Layer:
    del forces
    return LoadCellLayer(rig.table(RigLoadCells).cells(rig.folder))


def _skin(rig: Rig, forces: np.ndarray | None) -> Layer:
    body = rig_body(rig)
    shape = (body.rows, body.columns) if body.rows else None
    return TaxelLayer(body.positions, body.normals, body.areas, shape, forces)


_LAYERS: dict[str, Callable[[Rig, np.ndarray | None], Layer]] = {"load_cells": _load_cells, "skin": _skin}


def layers_of(rig: Rig, sensor: str, forces: np.ndarray | None = None) -> tuple[Layer, ...]:
    """Of a sensor's kind, if the files that it names are there; `forces` (n, k) [N] are those of a skin's cells."""
    known = sensor in _LAYERS and sensor in rig.sensors and all(path.exists() for path in _files(rig, sensor))
    return (_LAYERS[sensor](rig, forces),) if known else ()


def _files(rig: Rig, sensor: str) -> list[Path]:
    return [path for name, path in rig.files(rig.kind(sensor)).items() if name != "mesh"]
