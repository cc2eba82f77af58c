"""Everything that was assumed, with its source, written down before the first run. Nothing here was fitted to a result.

`page.template` has the sources.
"""

from dataclasses import dataclass, replace

import numpy as np

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
