"""Everything that was assumed, with its source, written down before the first run. Nothing here was fitted to a result.

The README's table is made from the texts beside the numbers.
"""

from __future__ import annotations

import numpy as np

__all__ = ["ASSUMED", "BROAD", "DRIFT", "FORCE_SPAN", "LEVER", "NOISE", "RATE", "SENSOR", "Pad", "tip"]

from dataclasses import dataclass, replace

RATE = 200.0  # Hz, the paper's sensor
FORCE_SPAN = (8.0, 10.0)  # N, when the paper took its readings
LEVER = 0.12  # m from the sensor's origin to the crown of the probe's face
NOISE = np.array([0.02] * 3 + [0.0008] * 3)  # N, N m: one reading, white
RANGE = np.array([150.0] * 3 + [8.0] * 3)  # N, N m
SENSOR = 0.0018  # of the range: entries of the sensor's error matrix
DRIFT = np.array([0.006] * 3 + [0.0002] * 3)  # N, N m
WEIGHT, CENTRE = 3.0, 0.06  # N, m from the sensor
ORIENTATION = np.radians(0.1)  # rad, of the robot's pose
ZEROING = 100 * 12  # readings behind the payload model: 12 poses of half a second
WORSE_RESIDUE = 0.281 / 12.16  # of the weight
PRINTED = 0.2e-3  # m, bound
CLAMP = 0.040  # m long, each of the connector's two fits
FITS = (0.0, 0.06)  # m from the sensor's origin: its flange, the grip on the probe
PEN = 0.25e-3  # m, bound: half the width of a pen's dot, and of the cross's line


@dataclass(frozen=True)
class Pad:
    """The rounded tip that presses, as an elastic foundation.

    Attributes:
        radius: [m]; stiffness: [N/m^3] normal; shear: of the normal stiffness; friction: Coulomb's coefficient.
    """

    radius: float = 3e-3
    stiffness: float = 5e9
    shear: float = 2 / 3
    friction: float = 0.5


BROAD = Pad(radius=20e-3, stiffness=1e9)  # not in the paper: skin rather than a synapse


def tip(radius: float) -> Pad:
    """The same pad with another radius [m]."""
    return replace(Pad(), radius=radius)


ASSUMED: list[tuple[str, str, str]] = [
    (
        "tip",
        "half ball of 3 mm radius",
        "the paper draws a `synapse` with a cross and gives no size; 1.5 and 6 mm are run beside it",
    ),
    (
        "foundation",
        "5 N/mm^3; pressure = stiffness times depth",
        "silicone lens of 1 mm, Shore A 65, E = 5 MPa (Gent 1958)",
    ),
    ("shear", "2/3 of the normal stiffness", "Mindlin 1949, 2(1 - nu)/(2 - nu) with nu = 1/2"),
    (
        "friction",
        "0.5, Coulomb, element by element",
        "dry printed plastic on silicone, a round figure",
    ),
    ("lever", "120 mm from sensor to face", "a hand-held probe in a printed connector; not given in the paper"),
    (
        "noise of one reading",
        "0.02 N, 0.8 mN m, white, 200 Hz",
        "rms over the axes of the first 100 unloaded rows of a real recording of a sensor of this class (ATI Gamma, "
        "pad/data_two_payloads_ft.csv); no data sheet of the SRI M3815B was at hand",
    ),
    ("filter", "the paper's Kalman, Q 1e-6, R 2e-4", "section II-A; 0.034 of the variance of white noise is left"),
    (
        "sensor error",
        "matrix of 0.18 % of range, each entry normal; range 150 N, 8 N m",
        "certificate of a real six-axis sensor (nano17/cert_FT44297_loadcases.csv): 0.20 % of range rms at two axes "
        "near 0.78 of it; range assumed",
    ),
    (
        "payload residue",
        "6 mN, 0.2 mN m drift a press; 0.1 degree of orientation under 3 N at 60 mm; noise of 12 poses",
        "drift: change of the unloaded reading between the first and last half second of two real recordings (pad/); "
        "orientation and weight assumed",
    ),
    (
        "simplified mesh",
        "edges of 4 mm, vertices on the surface (580 to 780 facets)",
        "the paper simplifies its mesh and does not say how far",
    ),
    (
        "assembly",
        "a printed connector with two fits, at 0 and 60 mm, each 40 mm long; both ends of a fit off by up to 0.2 mm in "
        "each direction, uniform; drawn once a build",
        "accuracy of the paper's printer (Stratasys F170: 0.2 mm or 0.2 %)",
    ),
    (
        "marking",
        "printed housing 0.2 mm (a build), its hole 0.2 mm (a mark), pen dot 0.25 mm (a mark), cross on dot by camera "
        "0.25 mm (a press); bounds of uniform draws, each tangent direction",
        "the same printer; half the width of a drawn line",
    ),
]
