"""Three shapes of ultrasound probe: a curved face with rounded edges on a straight body, as cells and as a mesh.

A probe is the sum of a ball of the edge's radius r and an inner body with straight walls whose face is a patch of a
torus with the outer radii less r: so the face is the wanted torus, edges and corners are round, and every point has one
normal. The sensor's frame is used throughout: x along the face's long side, y along its short side, z out of the flange
through the tip.

The convex probe's radii are about those of `UsProbe_Ultrasonix_C5-2_60.stl` (60 mm), the linear probe's face that of
`UsProbe_Ultrasonix_L14-5_38.stl` (38 mm wide).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError
from palpate.spatial._arrays import Value, frozen

TIP = 0.150  # [m] above the sensor's origin
TOP = 0.020  # [m] the body begins above the sensor
WALL = 0.010  # [m] of the walls, from the edge on, that can touch

Surface = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]  # parameters -> points, outward normals


@dataclass(frozen=True)
class Shape:
    """The dimensions of a probe's shape [m].

    Attributes:
        in_plane, out_of_plane: radii of the face along its long and its short side; inf is flat.
        length, width: size of the complete outline, along x and along y.
        edge: radius of its edges and corners.
    """

    in_plane: float
    out_of_plane: float
    length: float
    width: float
    edge: float


PROBES = {
    "convex": Shape(in_plane=0.060, out_of_plane=0.018, length=0.064, width=0.025, edge=0.002),
    "linear": Shape(in_plane=np.inf, out_of_plane=np.inf, length=0.040, width=0.010, edge=0.002),
    "t-shaped": Shape(in_plane=0.120, out_of_plane=0.040, length=0.050, width=0.014, edge=0.002),
}


@dataclass(frozen=True, eq=False)
class Probe(Value):
    """A probe on its sensor.

    Attributes:
        name: one of `PROBES`.
        points, normals: (n, 3) middles [m] and outward normals of the cells that can touch.
        areas: (n,) areas of the cells [m^2].
        vertices, faces: the closed mesh [m].
        tip: lowest point of the face when the probe points down [m].
        mass, centre, inertia: [kg], [m], and about the centre along the axes [kg m^2]: those of a block of
            140 x 50 x 35 mm, 70 mm above the tip.
    """

    name: str
    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    areas: Float[np.ndarray, " n"]
    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    tip: Float[np.ndarray, "3"] = field(default_factory=lambda: frozen((0.0, 0.0, TIP)))
    mass: float = 0.35
    centre: tuple[float, float, float] = (0.0, 0.0, 0.080)
    inertia: tuple[float, float, float] = (6.1e-4, 6.6e-4, 1.1e-4)


def probe(name: str, spacing: float = 0.001) -> Probe:
    """Build the `Probe` of a name.

    Args:
        name: convex, linear or t-shaped.
        spacing: spacing of its cells and of the mesh on the face [m].

    Raises:
        InputError: no probe of that name.
    """
    if name not in PROBES:
        raise InputError(f"the probe {name!r} is unknown.", hint=f"Use one of {', '.join(PROBES)}.")
    shape = PROBES[name]
    loop = _loop(shape, spacing)
    along, across = _edges(shape, spacing)
    around = np.arange(len(loop[0]), dtype=np.float64)
    arc = np.linspace(0.0, 1.0, 9)
    wall = np.linspace(0.0, 1.0, 2)
    rows = np.linspace(0.0, WALL / _wall_length(shape), 1 + round(WALL / spacing))
    face, fillet, side = partial(_face, shape), partial(_fillet, shape, loop), partial(_side, shape, loop)
    cells = [_cells(face, along, across), _cells(fillet, around, arc[::2]), _cells(side, around, rows)]
    points, normals, areas = (np.concatenate(parts) for parts in zip(*cells, strict=True))
    patches = [_patch(face, along, across), _patch(fillet, around, arc)[::-1], _patch(side, around, wall)[::-1]]
    vertices, faces = _closed(patches)
    return Probe(name, frozen(points), frozen(normals), frozen(areas), frozen(vertices), faces)


def _edges(shape: Shape, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the edges of the face's cells along x and y, for the inner body, smaller by the edges' radius."""
    x, y = shape.length / 2 - shape.edge, shape.width / 2 - shape.edge
    return np.linspace(-x, x, 1 + 2 * round(x / spacing)), np.linspace(-y, y, 1 + 2 * round(y / spacing))


def _inner(shape: Shape, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points and normals of the inner body's face: a torus about an axis along y, with radii less the edge's."""
    normal = np.zeros((*np.broadcast_shapes(x.shape, y.shape), 3))
    point = np.zeros_like(normal)
    point[..., 0], point[..., 1] = x, y
    inner_tip = TIP - shape.edge
    if np.isinf(shape.in_plane):
        point[..., 2], normal[..., 2] = inner_tip, 1.0
        return point, normal
    big, small = shape.in_plane - shape.edge, shape.out_of_plane - shape.edge
    lift = np.sqrt(small**2 - y**2)
    radius = big - small + lift  # of revolution, at this y
    rise = np.sqrt(radius**2 - x**2)
    point[..., 2] = inner_tip - big + rise
    cosine = lift / small
    normal[..., 0], normal[..., 1], normal[..., 2] = cosine * x / radius, y / small, cosine * rise / radius
    return point, normal


def _face(shape: Shape, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points and normals of the face."""
    point, normal = _inner(shape, x, y)
    return point + shape.edge * normal, normal


def _loop(shape: Shape, spacing: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the closed outline of the inner body, corners as fans: x, y and the outward direction [rad]."""
    along, across = _edges(shape, spacing)
    fan = np.linspace(0.0, np.pi / 2, 5)[1:-1]
    sides = [(along[-1] * np.ones_like(across), across), (along[::-1], across[-1] * np.ones_like(along)),
             (along[0] * np.ones_like(across), across[::-1]), (along, across[0] * np.ones_like(along))]  # fmt: skip
    xs: list[np.ndarray] = []
    ys: list[np.ndarray] = []
    turns: list[np.ndarray] = []
    for quarter, (x, y) in enumerate(sides):
        xs += [x, np.full_like(fan, x[-1])]
        ys += [y, np.full_like(fan, y[-1])]
        turns += [np.full_like(x, quarter * np.pi / 2), quarter * np.pi / 2 + fan]
    xs.append(xs[0][:1])
    ys.append(ys[0][:1])
    turns.append(np.array([2 * np.pi]))
    return np.concatenate(xs), np.concatenate(ys), np.concatenate(turns)


def _on_loop(
    shape: Shape, loop: tuple[np.ndarray, ...], place: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the inner body's points and normals at places in its outline, and the outward directions there."""
    x, y, turn = (np.interp(place, np.arange(len(values)), values) for values in loop)
    return *_inner(shape, x, y), np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=-1)


def _fillet(
    shape: Shape, loop: tuple[np.ndarray, ...], place: np.ndarray, share: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return points and normals of the round edge, at places in the loop, shares 0 (face) to 1 (wall)."""
    point, start, end = _on_loop(shape, loop, place)
    angle = np.arccos((start * end).sum(axis=-1))[..., None]
    share = share[..., None]
    normal = (np.sin((1 - share) * angle) * start + np.sin(share * angle) * end) / np.sin(angle)
    return point + shape.edge * normal, normal


def _wall_length(shape: Shape) -> float:
    return TIP - TOP - shape.edge


def _side(
    shape: Shape, loop: tuple[np.ndarray, ...], place: np.ndarray, share: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return points and normals of the straight walls, at places in the loop, shares 0 (edge) to 1 (top)."""
    point, _, normal = _on_loop(shape, loop, place)
    point = point + shape.edge * normal
    point[..., 2] += share * (TOP - point[..., 2])
    return point, normal


def _patch(surface: Surface, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the points of a grid of parameters, (m, n, 3)."""
    return surface(*np.meshgrid(first, second, indexing="ij"))[0]


def _cells(surface: Surface, first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return middles, normals and areas of the cells of a grid of parameters, without those of no area."""
    grid = _patch(surface, first, second)
    diagonals = np.cross(grid[1:, 1:] - grid[:-1, :-1], grid[:-1, 1:] - grid[1:, :-1])
    area = 0.5 * np.linalg.norm(diagonals, axis=-1).ravel()
    middles = np.meshgrid(0.5 * (first[1:] + first[:-1]), 0.5 * (second[1:] + second[:-1]), indexing="ij")
    point, normal = surface(*middles)
    some = area > 1e-12
    return point.reshape(-1, 3)[some], normal.reshape(-1, 3)[some], area[some]


def _closed(patches: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and faces of all patches and a flat cap on the last row of the last, welded, facing outward."""
    places: list[np.ndarray] = []
    triangles: list[np.ndarray] = []
    number, count = np.empty((0, 0), dtype=np.int64), 0
    for patch in patches:
        number = count + np.arange(patch[..., 0].size).reshape(patch.shape[:2])
        a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
        triangles += [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
        places.append(patch.reshape(-1, 3))
        count += len(places[-1])
    top = number[:, -1]
    places.append(np.array([[0.0, 0.0, TOP]]))
    triangles.append(np.stack([top[:-1], top[1:], np.full(len(top) - 1, count)], axis=1))
    _, first, welded = np.unique(np.round(np.concatenate(places), 9), axis=0, return_index=True, return_inverse=True)
    faces = welded.ravel()[np.concatenate(triangles)]
    kept = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return np.concatenate(places)[first], faces[kept]
