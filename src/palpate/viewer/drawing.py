"""Draw a body with marks as a piece of HTML that a pointer turns, for notebooks and reports."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import field
from html import escape
from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8

from palpate.calls import by_name, called_as
from palpate.errors import InputError
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.surfaces.surface import SurfaceLike, as_surface

FACETS = 8_000  # drawn: more is slow to turn, and no finer to see
LONGEST = 0.3  # of the body: the arrow of the largest force
MARGIN = 0.05  # m about a single point
_STYLE = (
    ".palpate-drawing{position:relative;width:100%;font:13px/1.4 system-ui,sans-serif}.palpate-drawing canvas{display:"
    "block;width:100%;height:420px;touch-action:pan-y;cursor:grab}.palpate-drawing output{position:absolute;"
    "max-width:22em;padding:.3em .6em;border-radius:.3em;background:#1b2530;color:#fff;pointer-events:none;"
    "overflow-wrap:anywhere}.palpate-drawing output[hidden]{display:none}"
)


@frozen_value(eq=True)
class Mark:
    """A mark at a point of the body.

    Attributes:
        point: (3,) [m].
        normal: (3,) unit, outward: the mark is pale where its back is seen.
        tooltip: text shown when a pointer rests on it.
        label: text in the mark, one to three letters; "" gives a small dot.
        force: (3,) [N], drawn as an arrow whose tip is at the point; None: no arrow.
        rim: (r, 3) [m] closed line around it; None: no line.
    """

    point: Float[np.ndarray, "3"]
    normal: Float[np.ndarray, "3"]
    tooltip: str
    label: str = ""
    force: Float[np.ndarray, "3"] | None = None
    rim: Float[np.ndarray, "r 3"] | None = None


@frozen_value
class Specks:
    """Small dots on a body: points [m], outward unit normals, colours (red, green, blue) of 0 to 255."""

    point: Float[np.ndarray, "m 3"]
    normal: Float[np.ndarray, "m 3"]
    colour: UInt8[np.ndarray, "m 3"]


@called_as("contacts.plot(mesh)", save='drawing.save("contacts.html")', show='drawing.save("contacts.html")')
@frozen_value
class Drawing:
    """A body with marks; a notebook shows it, `html` puts it into a page.

    Attributes:
        vertices: (v, 3) [m]; empty if the body is not known.
        faces: (f, 3) facets.
        marks: marks on the body.
        specks: small dots on the body; None: no dots.
        look: (3,) direction from which it is seen first.
        title: label for screen readers.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    marks: Sequence[Mark] = ()
    specks: Specks | None = None
    look: Float[np.ndarray, "3"] = field(default_factory=lambda: np.array([0.55, -0.7, 0.456]))
    title: str = "a body"

    @classmethod
    def of(cls, surface: SurfaceLike | None, marks: Sequence[Mark] = (), title: str = "contacts") -> Drawing:
        """Return a `Drawing` of a surface with marks; without a surface, of the marks alone.

        Raises:
            InputError: it is no surface, such as the path of a mesh file, whose unit is not given.
            GeometryError: an implicit surface cannot be drawn.
        """
        if surface is None:
            return cls(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64), marks, title=title)
        mesh = as_surface(surface).drawn()
        return cls(mesh.vertices, mesh.faces, marks, title=repr(mesh))

    def html(self) -> str:
        """Return HTML elements and a script for a page, which load no file; without scripts nothing is seen.

        Raises:
            InputError: a vertex is not finite.
        """
        return (
            f'<div class="palpate-drawing" hidden><style>{_STYLE}</style>'
            f'<canvas tabindex="0" role="img" aria-label="{escape(self.title)}"></canvas><output hidden></output>'
            f'<script type="application/json">{self._data()}</script><script>{_script()}</script></div>'
        )

    def page(self) -> str:
        """Return an HTML page with the drawing.

        Raises:
            InputError: a vertex is not finite.
        """
        return (
            f'<!DOCTYPE html><html lang="en"><meta charset="utf-8"><body style="margin:0">{self.html()}</body></html>'
        )

    def save(self, path: str | PathLike[str]) -> None:
        """Write the page to a file, .html.

        Raises:
            InputError: it cannot be written, or a vertex is not finite.
        """
        by_name("palpate.files.atomic.write_text")(Path(path), self.page())

    def _repr_html_(self) -> str:
        """Return the drawing for notebooks, isolated in an iframe."""
        return (
            f'<iframe srcdoc="{escape(self.page())}" sandbox="allow-scripts" title="{escape(self.title)}" '
            'style="width:100%;max-width:720px;height:424px;border:0"></iframe>'
        )

    def __repr__(self) -> str:
        marks = f", {len(self.marks):,} marks" if self.marks else ""
        return f'Drawing({len(self.faces):,} facets{marks}; a notebook shows it, .save("contacts.html") makes a page)'

    def _data(self) -> str:
        """Return the data for the script as JSON, centred and scaled to size 1, without "<"."""
        low, high = box(self._drawn_points())
        middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
        vertices, faces = simpler(self.vertices, self.faces, FACETS)
        strong = max((float(np.linalg.norm(m.force)) for m in self.marks if m.force is not None), default=0.0)
        longest = LONGEST / max(strong, 1e-12)
        marks = [_written(mark, middle, size, longest) for mark in self.marks if np.isfinite(mark.point).all()]
        data = {
            "vertices": _packed(np.rint(65535 * ((vertices - middle) / size + 0.5)), np.uint16),
            "faces": _packed(faces, np.uint32),
            "open": not _closed(faces),
            "marks": marks,
            "specks": [] if self.specks is None else _rows(self.specks, middle, size),
            "look": [float(value) for value in self.look],
            "size": " x ".join(f"{1e3 * side:.3g}" for side in high - low) + " mm",
        }
        return json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")

    def _drawn_points(self) -> Float[np.ndarray, "n 3"]:
        """Return the vertices of the facets, else the known points of the marks [m]."""
        if len(self.faces):
            return self.vertices[np.unique(self.faces)]
        return np.array([mark.point for mark in self.marks if np.isfinite(mark.point).all()]).reshape(-1, 3)


@takes_arrays
def box(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "2 3"]:
    """Return the least and the largest coordinates, (2, 3) [m]; 50 mm around a single point, or 0 without any.

    Raises:
        InputError: points has another shape.
    """
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else np.zeros((2, 3))
    margin = 0.0 if np.linalg.norm(high - low) > 0 else MARGIN
    return np.stack([low - margin, high + margin])


@takes_arrays
def corners(bounds: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "8 3"]:
    """Return the corners (8, 3) [m] of a box.

    Raises:
        InputError: bounds has another shape.
    """
    return np.stack(np.meshgrid(*bounds.T, indexing="ij"), axis=-1).reshape(-1, 3)


@takes_arrays
def simpler(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], most: int
) -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "g 3"]]:
    """Return vertices (w, 3) and at most `most` faces (g, 3): vertices in one cell of the finest grid become one.

    Rossignac and Borrel, Multi-resolution 3D approximations for rendering complex scenes, 1993.

    Raises:
        InputError: faces name vertices that do not exist, a vertex is not finite, or `most` is negative; or arrays of
            other shapes.
    """
    if faces.size and not (faces.min() >= 0 and faces.max() < len(vertices)):
        raise InputError(f"faces must be indices, from 0, of the {len(vertices)} vertices.")
    if most < 0 or not np.isfinite(vertices).all():  # it would never end
        raise InputError(f"most ({most}) must be 0 or more, and vertices finite.")
    used, corners = np.unique(faces, return_inverse=True)
    points, few = vertices[used], corners.reshape(-1, 3)
    cell = float(np.ptp(points, axis=0).max()) / 200 if len(points) else 0.0
    while len(few) > most:
        keys = np.floor((vertices[used] - vertices[used].min(axis=0)) / cell).astype(np.int64)
        _, which, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
        which = which.reshape(-1)
        points = np.column_stack([np.bincount(which, column) for column in vertices[used].T]) / count[:, None]
        few = which[corners.reshape(-1, 3)]
        few = few[(few[:, 0] != few[:, 1]) & (few[:, 1] != few[:, 2]) & (few[:, 2] != few[:, 0])]
        _, first = np.unique(np.sort(few, axis=1), axis=0, return_index=True)
        few, cell = few[np.sort(first)], 1.25 * cell
    return points, few.astype(np.int64)


def _closed(faces: Int[np.ndarray, "f 3"]) -> bool:
    """Return whether every edge belongs to two facets: the inside cannot be seen."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    return bool((count > 1).all())


def _written(mark: Mark, middle: np.ndarray, size: float, longest: float) -> dict[str, Any]:
    """Return a mark as the dictionary that the script reads."""
    made: dict[str, Any] = {"point": _short((mark.point - middle) / size), "normal": _short(mark.normal)}
    made |= {"said": mark.tooltip, "label": mark.label}
    if mark.force is not None and np.isfinite(mark.force).all():
        made["force"] = _short(longest * mark.force)
    if mark.rim is not None and np.isfinite(mark.rim).all():
        made["rim"] = [_short(point) for point in (mark.rim - middle) / size]
    return made


def _rows(specks: Specks, middle: np.ndarray, size: float) -> list[list[float | int]]:
    known = np.isfinite(specks.point).all(axis=1) & np.isfinite(specks.normal).all(axis=1)
    places = np.column_stack([(specks.point[known] - middle) / size, specks.normal[known]])
    return [[*_short(place), *map(int, ink)] for place, ink in zip(places, specks.colour[known], strict=True)]


def _short(values: np.ndarray) -> list[float]:
    return [round(float(value), 4) for value in np.nan_to_num(values)]


def _packed(values: np.ndarray, kind: type[np.unsignedinteger[Any]]) -> str:
    return b64encode(np.ascontiguousarray(values.astype(kind)).tobytes()).decode()


def _script() -> str:
    return files("palpate.viewer").joinpath("drawing.js").read_text(encoding="utf-8")
