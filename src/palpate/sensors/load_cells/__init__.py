"""A fingertip on three-axis load cells."""

from palpate.sensors.load_cells.array import LoadCellArray
from palpate.sensors.load_cells.model import LoadCells

__all__ = ["LoadCellArray", "LoadCells"]
