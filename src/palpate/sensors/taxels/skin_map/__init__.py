"""Spatial calibration of a taxel sheet: from a link's mesh to where every cell sits."""

from palpate.sensors.taxels.skin_map.layout import LaidSheet, Sheet
from palpate.sensors.taxels.skin_map.sheet import fit_stretch, map_skin
from palpate.sensors.taxels.skin_map.shell import Mode, Planes

__all__ = ["LaidSheet", "Mode", "Planes", "Sheet", "fit_stretch", "map_skin"]
