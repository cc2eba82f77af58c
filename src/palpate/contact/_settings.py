"""Indices of a Locator's settings and state in the arrays that the compiled loops read."""

from __future__ import annotations

# settings: what a Locator was made with, as numbers. ON, OFF: forces [N], or minus standard deviations of the force
CENTRE, SCALE, SOFT, FRICTION, TORSION, ON, OFF, NOISY = 0, 3, 4, 5, 6, 7, 8, 9
DEPTH, EXPONENT, ACCURACY, EDGED = 10, 11, 12, 13  # EDGED: sharp edges are looked at
# state: what one sample leaves to the next. PREVIOUS: the last contact, and its normal; FOLLOW: nothing but the nearest
# to it is believed; SAMPLES since the touch began; CONTESTED: a branch is not told apart from the one that is believed;
# BEFORE: its weight and mean place before the sample; then the branches (`_touch`), the one that is believed first
TOUCHING, HAS_PREVIOUS, PREVIOUS, FOLLOW, SAMPLES, CONTESTED, BEFORE, BRANCHES = 0, 1, 2, 8, 9, 10, 11, 18
MOST, BRANCH = 6, 24  # branches, and numbers of each
STATE = BRANCHES + MOST * BRANCH
LARGEST = 1e9  # spatial.uncertain.LARGEST: a wrench beyond is invalid, as its powers would overflow
