"""COLLADA files for tests, written by hand: a tetrahedron, with what a file states of its unit and up axis."""

from pathlib import Path

CORNERS = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 3.0))  # in the file's unit and axes
_TEXT = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2026-01-01T00:00:00</created><modified>2026-01-01T00:00:00</modified>{stated}</asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="12">{numbers}</float_array><technique_common>
<accessor source="#a" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/><p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>
"""


def write_collada(path: Path, meter: str | None = None, up: str | None = None, scale: float = 1.0) -> Path:
    """Write a tetrahedron of corners `CORNERS` times `scale`; `meter` of its <unit> and its <up_axis>, if given."""
    stated = "" if meter is None else f'<unit name="unit" meter="{meter}"/>'
    stated += "" if up is None else f"<up_axis>{up}</up_axis>"
    numbers = " ".join(f"{scale * number:g}" for corner in CORNERS for number in corner)
    path.write_text(_TEXT.format(stated=stated, numbers=numbers), "utf-8")
    return path
