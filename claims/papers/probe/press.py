"""A rounded, compliant tip pressed on a probe: pressure and friction summed over the surface. No estimator is in here.

Elastic foundation (Winkler): where the ball of the tip reaches a depth t below an element of the surface, measured
along the element's normal, the pressure is K t along -n. Friction is a bristle on every element: its deflection grows
with the tip's tangential motion there, and its stress is held to Coulomb's bound mu K t, element by element.
"""

from dataclasses import dataclass

import numpy as np

from claims.papers.probe.assumed import Pad
from claims.papers.probe.shapes import Probe

LARGEST = 21.0  # N, a little over the paper's 20
STEPS = 60  # of the tip's way, about
SPACING = 0.15e-3  # m between elements
HALF = 5.5e-3  # m, of the patch that is looked at


@dataclass(frozen=True, eq=False)
class Press:
    """One press from first touch to 21 N: at each step what the probe felt, and where the pressure's centre was.

    Attributes:
        force: (s,) [N] |F|, rising; wrench: (s, 6) about the sensor's origin; centroid: (s, 3) [m] on the surface.
        slipping: (s,) the share of the touched elements that slip.
    """

    force: np.ndarray
    wrench: np.ndarray
    centroid: np.ndarray
    slipping: np.ndarray

    def at(self, forces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Wrenches (n, 6) and centroids (n, 3) when |F| was (n,) [N], straight between the steps."""
        return tuple(
            np.column_stack([np.interp(forces, self.force, column) for column in values.T])
            for values in (self.wrench, self.centroid)
        )


def tilted(normal: np.ndarray, degrees: float, plane: str) -> np.ndarray:
    """The way (3,) of a tip onto a surface with this normal, tilted in the plane of the image or out of it."""
    across = np.array([0.0, 1.0, 0.0]) if plane == "in-plane" else np.array([1.0, 0.0, 0.0])
    axis = across - normal * (normal @ across)
    axis /= np.linalg.norm(axis)
    angle = np.radians(degrees)
    return -(np.cos(angle) * normal + np.sin(angle) * np.cross(axis, normal))


def press(
    probe: Probe,
    mark: np.ndarray,
    way: np.ndarray,
    pad: Pad,
    twist: float = 0.0,
    spacing: float = SPACING,
    aim: np.ndarray | None = None,
) -> Press:
    """Push the tip along `way`, its axis through the mark, to 21 N.

    Args:
        probe: the surface.
        mark: (3,) [m] on it.
        way: (3,) unit vector of the tip's motion.
        pad: the tip.
        twist: [rad] by which it turns meanwhile about the normal at the mark.
        spacing: [m] between the elements of the surface.
        aim: (3,) [m] a point of the tip's axis, instead of the mark.
    """
    points, normals, areas = _elements(probe, mark, spacing)
    reduced = 1.0 / (1.0 / pad.radius + 1.0 / 0.03)  # only to choose a step: the probes curve with some 30 mm
    deepest = np.sqrt(LARGEST / (pad.stiffness * np.pi * reduced))
    begin = _touching(points, way, mark if aim is None else aim, pad.radius)
    upright = probe.normals(mark)
    bristles, wrenches, middles, slips = np.zeros_like(points), [], [], []
    step, turn = deepest / STEPS, twist / STEPS
    for number in range(1, 6 * STEPS):
        centre = begin + number * step * way
        depth = _depth(points - centre, normals, pad.radius)
        pressure = pad.stiffness * depth
        motion = step * way + turn * np.cross(upright, points - mark)
        motion -= normals * np.sum(motion * normals, axis=1)[:, None]
        bristles = (bristles + pad.shear * pad.stiffness * motion) * (depth > 0)[:, None]
        size = np.linalg.norm(bristles, axis=1)
        bound = pad.friction * pressure
        slides = size > bound
        bristles *= np.where(slides, bound / np.maximum(size, 1e-300), 1.0)[:, None]
        stress = (bristles - pressure[:, None] * normals) * areas[:, None]
        force = stress.sum(axis=0)
        if not np.any(force):
            continue
        wrenches.append(np.concatenate([force, np.cross(points, stress).sum(axis=0)]))
        weight = pressure * areas
        middles.append(np.concatenate([weight @ points, weight @ normals]) / weight.sum())
        slips.append(float(np.mean(slides[depth > 0])))
        if np.linalg.norm(force) >= LARGEST:
            break
    wrench, middle = np.array(wrenches), np.array(middles)
    out = middle[:, 3:] / np.linalg.norm(middle[:, 3:], axis=1, keepdims=True)
    centroid = probe.land(middle[:, :3], out)  # the mean of points of a bulging surface lies a little below it
    return Press(np.linalg.norm(wrench[:, :3], axis=1), wrench, centroid, np.array(slips))


def _elements(probe: Probe, mark: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of the surface about a mark, normals there and areas, on a square grid of the tangent plane."""
    normal = probe.normals(mark)
    first = np.cross(normal, np.array([0.0, 1.0, 0.0]))
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    ticks = spacing * np.arange(-round(HALF / spacing), round(HALF / spacing) + 1)
    u, v = (grid.ravel() for grid in np.meshgrid(ticks, ticks))
    points = probe.land(mark + u[:, None] * first + v[:, None] * second, normal)
    normals = probe.normals(points)
    facing = normals @ normal
    kept = (facing > 0.2) & (np.abs(probe.value(points)) < 1e-9)
    return points[kept], normals[kept], spacing**2 / facing[kept]


def _touching(points: np.ndarray, way: np.ndarray, aim: np.ndarray, radius: float) -> np.ndarray:
    """Where the ball's middle is when it first touches an element, coming along `way` with its axis through a point."""
    off = points - aim
    along = off @ way
    aside = np.sum(off**2, axis=1) - along**2
    near = aside < radius**2
    return aim + np.min(along[near] - np.sqrt(radius**2 - aside[near])) * way


def _depth(off: np.ndarray, normals: np.ndarray, radius: float) -> np.ndarray:
    """How far below each element the ball reaches along its normal [m]; `off` from the ball's middle."""
    inward = np.sum(off * normals, axis=1)
    room = radius**2 - np.sum(off**2, axis=1)
    return np.where(room > 0, inward + np.sqrt(np.maximum(inward**2 + room, 0.0)), 0.0)
