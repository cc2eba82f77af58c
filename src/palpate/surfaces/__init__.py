"""Surfaces of bodies: meshes, quadrics and implicit surfaces."""

from palpate.surfaces.implicit import ImplicitSurface, superquadric
from palpate.surfaces.mesh import UNITS, Mesh, plane
from palpate.surfaces.quadric import Cylinder, Ellipsoid, EllipticCylinder, Paraboloid, Sphere
from palpate.surfaces.surface import Surface

__all__ = [
    "UNITS",
    "Cylinder",
    "Ellipsoid",
    "EllipticCylinder",
    "ImplicitSurface",
    "Mesh",
    "Paraboloid",
    "Sphere",
    "Surface",
    "plane",
    "superquadric",
]
