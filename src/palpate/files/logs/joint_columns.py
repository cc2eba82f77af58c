"""Convert the positions of joints in the columns of a table to the pose of a sensor's link."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.logs.layout import LogLayout
from palpate.files.urdf import Kinematics, Urdf
from palpate.spatial.arguments import takes_arrays


@takes_arrays
class JointColumns:
    """Converter of positions of joints to the pose of the sensor's link in the base, in place of a `SensorPose`.

    Args:
        layout: of the log, with `joints`, `urdf` and `frames`.

    Raises:
        InputError: the URDF cannot be used, has no such link, or a joint that moves the link has no column.
    """

    plain = False
    named = "positions of joints give no pose"

    def __init__(self, layout: LogLayout) -> None:
        if layout.urdf is None or layout.frames is None:
            raise InputError("joints need a urdf, base and sensor.", where="[orientation]")
        self._kinematics = Kinematics(Urdf(layout.urdf), *layout.frames)
        lacking = [joint for joint in self._kinematics.joints if joint not in layout.joints]
        if lacking:
            what = f"joint {lacking[0]!r} moves the sensor, and no column is named for it."
            raise InputError(what, where="[orientation] joints", hint="Add it.")
        self._columns = [layout.joints.index(joint) for joint in self._kinematics.joints]

    def convert(
        self, values: Float[np.ndarray, "n k"], position: Float[np.ndarray, "n 3"] | None
    ) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n 3"]]:
        """Return quaternions x, y, z, w (n, 4) and positions (n, 3) [m] of the link in the base; NaN where unknown.

        Args:
            values: positions [rad, m] of the joints of the layout.
            position: not used.

        Raises:
            InputError: arrays of other shapes, or positions seem to be in degrees.
        """
        values = values[:, self._columns]
        known = np.flatnonzero(np.isfinite(values).all(axis=1))
        self._kinematics.require_radians(values[known], "[orientation] joints")
        quaternions, positions = np.full((len(values), 4), np.nan), np.full((len(values), 3), np.nan)
        turns, moves = self._kinematics.poses(values[known])
        quaternions[known], positions[known] = turns[:, 0], moves[:, 0]
        return quaternions, positions
