"""Where a Locator's settings and its state stand in the arrays that the compiled loops read."""

from __future__ import annotations

__all__ = [
    "ACCURACY",
    "CENTRE",
    "DEPTH",
    "EXPONENT",
    "FRICTION",
    "HAS_PREVIOUS",
    "LARGEST",
    "NOISY",
    "OFF",
    "ON",
    "PREVIOUS",
    "SCALE",
    "SOFT",
    "STATE",
    "TORSION",
    "TOUCHING",
]

# settings: what a Locator was made with, as numbers
CENTRE, SCALE, SOFT, FRICTION, TORSION, ON, OFF, NOISY = 0, 3, 4, 5, 6, 7, 8, 9
DEPTH, EXPONENT, ACCURACY = 10, 11, 12
# state: what one sample leaves to the next
STATE = 5
TOUCHING, HAS_PREVIOUS, PREVIOUS = 0, 1, 2
LARGEST = 1e9  # spatial.uncertain.LARGEST: a wrench beyond is invalid, as its powers would overflow
