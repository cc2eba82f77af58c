"""The table of surfaces that every law runs over: add a row and it is tested.

Bodies stand off the frame's origin, as they do in a sensor's frame, so that nothing holds only about a centre.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from claims.evidence.bodies import prism
from palpate.surfaces import Mesh, plane
from palpate_lab.simulation.shapes import Body, BumpySphere, EllipsoidBody, Superquadric

R = 0.01  # m
PLACE = np.array([0.004, -0.003, 0.03])  # m, of a body in the sensor's frame

Arrays = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Surfaced:
    """One row: a mesh, what is known about it, and the analytic body it was made from, where there is one."""

    make: Callable[[], Mesh]
    closed: bool = True
    convex: bool = False
    analytic: Body | None = None

    @functools.cached_property
    def mesh(self) -> Mesh:
        """Made once: the tree is built on the first use."""
        return self.make()


def box(sides: tuple[float, float, float] = (2 * R, 1.4 * R, R)) -> Arrays:
    """A box about the origin of twelve facets."""
    square = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * 0.5
    return prism(square * sides[:2], sides[2])


def cylinder(radius: float = 0.7 * R, height: float = 2 * R, around: int = 32) -> Arrays:
    """A round prism: smooth sides (11 degrees a step), flat lids, sharp rims."""
    turn = np.arange(around) * 2 * np.pi / around
    return prism(radius * np.c_[np.cos(turn), np.sin(turn)], height)


def _l_body() -> Arrays:
    """Concave: a force along -x or -y may meet it twice. The first corner is the inner one, which sees all others."""
    outline = np.array([(0, 0), (0, 1), (-1, 1), (-1, -1), (1, -1), (1, 0)]) * R
    return prism(outline, R)


def _patch() -> Arrays:
    """A dome without a bottom, over a square."""
    side = np.linspace(-R, R, 13)
    x, y = np.meshgrid(side, side, indexing="ij")
    vertices = np.c_[x.ravel(), y.ravel(), -(x.ravel() ** 2 + 0.5 * y.ravel() ** 2) / (4 * R)]
    at = np.arange(169).reshape(13, 13)
    a, b, c, d = (at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:])
    return vertices, np.concatenate([np.c_[a.ravel(), b.ravel(), c.ravel()], np.c_[a.ravel(), c.ravel(), d.ravel()]])


def _hull() -> Arrays:
    """The convex hull of an ellipsoid's vertices: their stretched triangles have saddles, a hull has none."""
    vertices, _ = ELLIPSOID.mesh(500)
    return vertices, ConvexHull(vertices).simplices.astype(np.int64)


def _placed(arrays: Arrays, **options: object) -> Mesh:
    return Mesh.from_arrays(arrays[0] + PLACE, arrays[1], **options)


AXES = (R, 0.7 * R, 0.5 * R)
ELLIPSOID, SUPERQUADRIC, BUMPY = EllipsoidBody(AXES), Superquadric(AXES), BumpySphere(R)

BODIES: dict[str, Surfaced] = {
    "ellipsoid": Surfaced(lambda: _placed(ELLIPSOID.mesh(1280)), convex=True, analytic=ELLIPSOID),
    "convex hull": Surfaced(lambda: _placed(_hull(), smooth=False), convex=True),
    "faceted ellipsoid": Surfaced(lambda: _placed(ELLIPSOID.mesh(500), smooth=False)),
    "superquadric": Surfaced(lambda: _placed(SUPERQUADRIC.mesh(1280)), convex=True, analytic=SUPERQUADRIC),
    "bumpy sphere": Surfaced(lambda: _placed(BUMPY.mesh(1280)), analytic=BUMPY),
    "faceted bumpy sphere": Surfaced(lambda: _placed(BUMPY.mesh(500), smooth=False)),
    "box": Surfaced(lambda: _placed(box()), convex=True),
    "L": Surfaced(lambda: _placed(_l_body())),
    "cylinder": Surfaced(lambda: _placed(cylinder()), convex=True),
    "open patch": Surfaced(lambda: _placed(_patch()), closed=False),
    "plane": Surfaced(lambda: plane(PLACE, (0.1, -0.2, 1.0), 0.8 * R), closed=False),
}
CLOSED = [name for name, row in BODIES.items() if row.closed]


def on_mesh(mesh: Mesh, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random points of the facets, by area, with the normals that the mesh interpolates there, and the facets."""
    facet = rng.choice(len(mesh.faces), count, p=mesh.areas / mesh.areas.sum())
    weights = rng.dirichlet(np.ones(3), count)
    points = np.einsum("ni,nik->nk", weights, mesh.vertices[mesh.faces[facet]])
    normals = np.einsum("ni,nik->nk", weights, mesh.corner_normals[facet])
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True), facet


def pressing(point: np.ndarray, normal: np.ndarray, force: np.ndarray, pitch: float) -> np.ndarray:
    """The wrench (6,) of a soft finger at a point; the pitch h = F . M/|F|^2 fixes the torsion."""
    torsion = pitch * (force @ force) / (force @ normal)
    return np.concatenate([force, np.cross(point, force) + torsion * normal])
