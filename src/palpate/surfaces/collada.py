"""Read the unit and the up axis that a COLLADA file states of itself."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError

_UPRIGHT: dict[str, tuple[tuple[int, int, int], ...]] = {  # rows: x, y, z of the same body with z up
    "X_UP": ((0, -1, 0), (0, 0, -1), (1, 0, 0)),
    "Y_UP": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    "Z_UP": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
}


@dataclass(frozen=True)
class ColladaAsset:
    """The unit and the up axis in the <asset> of a COLLADA file, neither of which trimesh applies.

    Attributes:
        metres: length of the file's unit [m]; None: the file states none.
        up: "X_UP", "Y_UP" or "Z_UP"; "": the file states none, and its numbers are taken as they are.
    """

    metres: float | None = None
    up: str = ""

    @classmethod
    def of(cls, path: Path) -> ColladaAsset:
        """Return the `ColladaAsset` of a mesh file; an empty one for other formats and for files that are not XML.

        Raises:
            InputError: the unit is not a positive number, or the up axis is not X_UP, Y_UP or Z_UP.
        """
        if path.suffix.lower() != ".dae":
            return cls()
        try:
            unit, up = _stated(path)
        except (OSError, ElementTree.ParseError, ValueError, LookupError):
            return cls()  # the reader of the mesh reports it
        if up and up not in _UPRIGHT:
            raise InputError(f"states <up_axis> {up!r}.", where=str(path), hint=f"Write {', '.join(_UPRIGHT)}.")
        return cls(None if unit is None else _length(unit, path), up)

    @property
    def note(self) -> str:
        """Sentence that a mesh of the file was turned; "" if it was not."""
        return f"the file states {self.up}: the mesh is turned so that z points up" if self.turned else ""

    @property
    def turned(self) -> bool:
        """True if another axis than z points up."""
        return self.up in ("X_UP", "Y_UP")

    def upright(self, vertices: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v 3"]:
        """Return vertices (v, 3) of the file so that z points up: of Y_UP, (x, y, z) becomes (x, -z, y)."""
        return vertices @ np.array(_UPRIGHT[self.up], dtype=np.float64).T if self.turned else vertices


def _stated(path: Path) -> tuple[str | None, str]:
    """Return the text of the unit's length, or None, and the up axis, or "", from the file's first <asset>."""
    unit, up = None, ""
    with path.open("rb") as file:
        for _, element in ElementTree.iterparse(file):
            tag = element.tag.rpartition("}")[2]
            if tag == "unit":
                unit = element.get("meter", "1")
            elif tag == "up_axis":
                up = (element.text or "").strip().upper()
            elif tag == "asset":  # the document's, which comes first: libraries may have their own
                break
    return unit, up


def _length(text: str, path: Path) -> float:
    try:
        metres = float(text)
    except ValueError:
        metres = 0.0
    if not 0 < metres < inf:
        what = f"states a <unit> of {text!r} metres, which is not a positive number."
        raise InputError(what, where=str(path), hint='Correct it, such as <unit name="millimeter" meter="0.001"/>.')
    return metres
