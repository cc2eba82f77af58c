"""Surfaces: what a body is to a wrench."""

from palpate.surfaces.mesh import UNITS, Mesh
from palpate.surfaces.plane import plane
from palpate.surfaces.surface import Surface

__all__ = ["UNITS", "Mesh", "Surface", "plane"]
