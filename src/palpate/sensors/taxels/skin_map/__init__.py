"""Calibrate a taxel sheet in space: compute the place of every cell from a link's mesh."""

from palpate.sensors.taxels.skin_map.layout import LaidSheet, Sheet
from palpate.sensors.taxels.skin_map.sheet import fit_stretch, map_skin
from palpate.sensors.taxels.skin_map.shell import Mode, Planes

__all__ = ["LaidSheet", "Mode", "Planes", "Sheet", "fit_stretch", "map_skin"]
