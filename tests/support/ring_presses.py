"""Presses of the coarse simulated barrel, as a camera without lens would see them: made once for all tests."""

from collections.abc import Sequence
from functools import cache

import numpy as np

from palpate.optical.ring_response import RingResponse
from palpate.sensors.marker_ring.response_fit import RingPresses, fit_response
from palpate_lab.simulation.barrel import Barrel, Indenter, Pressed
from palpate_lab.simulation.barrel_elasticity import COARSE_ROWS, BarrelSettings

MARKERS = 2.0 * np.pi * np.arange(24) / 24
NOISE = np.tile([0.1e-3, 0.05e-3], (24, 1))  # m: of 0.2 px
DEPTHS = (0.002, 0.005, 0.009)


@cache
def barrel(seed: int = 1) -> Barrel:
    """Seconds to build."""
    return Barrel.built(BarrelSettings(around=48, rows=COARSE_ROWS, seed=seed))


def plate(angle: float, depth: float) -> Indenter:
    """100 mm wide."""
    return Indenter("plate", angle, depth)


def tip(angle: float, depth: float, radius: float = 0.01, slide: float = 0.0) -> Indenter:
    """Round."""
    return Indenter("tip", angle, depth, radius=radius, slide=slide)


def moved(pressed: Pressed, rng: np.random.Generator | None = None, seed: int = 1) -> np.ndarray:
    """(m, 2) [m] of the markers, outwards and along, with noise."""
    way = pressed.markers - barrel(seed).rest[:, 0]
    c, s = np.cos(MARKERS), np.sin(MARKERS)
    seen = np.stack([way[:, 0] * c + way[:, 1] * s, way[:, 1] * c - way[:, 0] * s], axis=1)
    return seen if rng is None else seen + NOISE * rng.standard_normal(seen.shape)


def presses(bodies: Sequence[Indenter], rng: np.random.Generator, seed: int = 1) -> RingPresses:
    """Single contacts, one after the other."""
    done = [barrel(seed).press([body]) for body in bodies]
    angle, depth, force, shear = (
        np.array([getattr(each, name)[0] for each in done]) for name in ("angle", "depth", "force", "shear")
    )
    ways = np.stack([moved(each, rng, seed) for each in done])
    return RingPresses(np.mod(angle, 2.0 * np.pi), depth, force, shear, ways, MARKERS, NOISE)


def all_round(seed: int, angles: int = 24) -> RingPresses:
    """Of a plate and a narrow tip, every third of the tip dragged."""
    rng, bodies = np.random.default_rng(seed), list[Indenter]()
    for k in range(angles):
        at = 2.0 * np.pi * (k + rng.random()) / angles
        slide = (0.0, 0.002, -0.002)[k % 3]
        bodies += [plate(at, depth) for depth in DEPTHS] + [tip(at, depth, slide=slide) for depth in DEPTHS]
    return presses(bodies, rng, seed)


@cache
def calibrated() -> tuple[RingResponse, RingPresses]:
    """The first unit."""
    made = all_round(1)
    return fit_response(made), made
