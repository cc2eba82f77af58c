"""Compute a payload's acceleration live, from the latest poses of its sensor."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.signals._curvature import LONGEST
from palpate.signals.motion import ARM, UNKNOWN

__all__: list[str] = []  # for this package alone: arrays are checked where they come in


class RecentMotion:
    """A payload's acceleration at each sample, from the poses up to it; `Motion` needs later ones too.

    The path of the lever over the last window, in nine parts, is fitted by a cubic through their means, whose second
    derivative at the sample's time is the acceleration. The deviation is that of the residuals' noise, and of the
    fourth order that the cubic leaves out.

    Args:
        lever: (3,) [m] the payload's centre of mass in the sensor's frame.
        window: [s] over which the path is fitted; longer where samples are slower than nine in it.
        answers: give accelerations; else 0, and their size as the deviation where the motion exceeds the noise.
    """

    def __init__(self, lever: Float[np.ndarray, "3"], window: float = 0.2, *, answers: bool = True) -> None:
        from palpate.signals import _recent_motion as loops  # compiled: loaded when first needed

        self._follow, self._state = loops.follow.unchecked, np.zeros(loops.STATE)
        self._state[:1] = np.nan
        self._settings = window, max(window, LONGEST) / loops.PARTS, ARM / 3**0.5, UNKNOWN if answers else 0.0
        self._lever = lever
        nothing = np.zeros((0, 4))
        self.at(nothing[:, 0], nothing, nothing[:, :3], nothing[:, :1])  # compiles, before samples come

    def at(
        self,
        time: Float[np.ndarray, " n"],
        quaternion: Float[np.ndarray, "n 4"],
        position: Float[np.ndarray, "n 3"],
        unsteady: Float[np.ndarray, "n 1"],
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 1"]]:
        """Return accelerations (n, 3) in the sensor's frame and their deviations (n, 1) along an axis [m/s^2].

        A deviation is about 1 g until there is a window of poses, and after a gap; without accelerations it is 0 there.

        Args:
            time: (n,) [s] of samples, later than those of earlier calls.
            quaternion: (n, 4) x, y, z, w: sensor in base; NaN: unknown.
            position: (n, 3) [m]; NaN: unknown, for which a lever is assumed.
            unsteady: (n, 1) [m/s^2] deviations from other causes, which are added.
        """
        accelerations, deviations = np.empty((len(time), 3)), unsteady.copy()
        self._follow(time, quaternion, position, self._lever, *self._settings, self._state, accelerations, deviations)
        return accelerations, deviations
