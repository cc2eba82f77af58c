"""Convert the orientations of a log, in any form that robots write, to quaternions of the sensor in the base."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.spatial.arguments import takes_arrays

QUATERNION = "quaternion"
FORMS = {  # name -> numbers of a pose
    QUATERNION: (4,),
    "quaternion_wxyz": (4,),
    "matrix_rows": (9, 16),
    "matrix_columns": (9, 16),
    "rotation_vector": (3,),
}
_EULER = re.compile(r"euler_([xyz]{3}|[XYZ]{3})(?:_deg)?")
_SKEWED = 0.05  # the most that a product of a matrix with its transpose is off from the identity


@takes_arrays
class SensorPose:
    """Converter of the logged orientation, and of the position, to the pose of the sensor in the base.

    Args:
        form: one of `FORMS`, or Euler angles: "euler_xyz" about fixed axes in this order, or "euler_ZYX" about moving
            axes, in rad; with "_deg" at the end in degrees.
        inverse: whether the log has the base in the sensor.
        sensor_rotation: quaternion x, y, z, w of the sensor in the frame whose orientation is logged.

    Raises:
        InputError: there is no such form.

    Attributes:
        numbers: how many columns an orientation of this form may have.
    """

    def __init__(self, form: str = QUATERNION, *, inverse: bool = False, sensor_rotation: Sequence[float] = ()) -> None:
        self.numbers = (3,) if _EULER.fullmatch(form) else FORMS.get(form, ())
        if not self.numbers:
            known = ", ".join([*FORMS, "euler_xyz (fixed axes)", "euler_XYZ (moving axes)", "euler_xyz_deg"])
            raise InputError(f"there is no form {form!r}.", where="orientation.form", hint=f"Use one of {known}.")
        self._form, self._inverse, self._turn = form, inverse, tuple(sensor_rotation)

    @property
    def plain(self) -> bool:
        """True if logged orientations are quaternions x, y, z, w of the sensor in the base already."""
        return self._form == QUATERNION and not self._inverse and not self._turn

    @property
    def named(self) -> str:
        """Words for orientations that are no rotations."""
        plain = self._form.startswith("quaternion")
        return "quaternions have a length far from 1" if plain else "orientations are no rotations"

    def convert(
        self, values: Float[np.ndarray, "n k"], position: Float[np.ndarray, "n 3"] | None
    ) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n 3"] | None]:
        """Return quaternions x, y, z, w (n, 4) and positions (n, 3) [m] of the sensor in the base; NaN where unknown.

        Args:
            values: the columns of the orientation as logged.
            position: as logged; None: those of a 4 x 4 matrix, if there is one.

        Raises:
            InputError: arrays of other shapes.
        """
        from scipy.spatial.transform import Rotation  # here: it takes 0.1 s to import

        known = np.asarray(np.isfinite(values).all(axis=1), dtype=bool)
        if self._form.startswith("matrix"):
            matrices, moved = self._matrices(values)
            position = moved if position is None else position
            off = np.abs(matrices @ matrices.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2), initial=0.0)
            known &= (off < _SKEWED) & (np.linalg.det(np.where(known[:, None, None], matrices, np.eye(3))) > 0)
            made = Rotation.from_matrix(matrices[known])
        elif self._form.startswith("quaternion"):
            order = [1, 2, 3, 0] if self._form.endswith("wxyz") else [0, 1, 2, 3]
            length = np.linalg.norm(values, axis=1)
            known &= (length > 0.5) & (length < 2.0)
            made = Rotation.from_quat(values[known][:, order])
        elif self._form == "rotation_vector":
            made = Rotation.from_rotvec(values[known])
        else:
            _, axes, *unit = self._form.split("_")
            made = Rotation.from_euler(axes, values[known], degrees=bool(unit))
        if self._inverse:
            made = made.inv()
            if position is not None:
                position = position.copy()
                position[known] = -made.apply(position[known])
                position[~known] = np.nan
        if self._turn:
            made = made * Rotation.from_quat(self._turn)
        found = np.full((len(values), 4), np.nan)
        found[known] = made.as_quat(canonical=True)
        return found, position

    def _matrices(self, values: Float[np.ndarray, "n k"]) -> tuple[np.ndarray, Float[np.ndarray, "n 3"] | None]:
        """Return rotations (n, 3, 3), and positions (n, 3) of 4 x 4 matrices, else None."""
        side = 3 if values.shape[1] == 9 else 4
        matrices = values.reshape(-1, side, side)
        matrices = matrices if self._form == "matrix_rows" else matrices.swapaxes(1, 2)
        if side == 4 and _transposed(matrices):
            other = "matrix_columns" if self._form == "matrix_rows" else "matrix_rows"
            hint = f'Write form = "{other}".'
            raise InputError("has its positions in the last row, not column.", where="orientation.form", hint=hint)
        return matrices[:, :3, :3], matrices[:, :3, 3] if side == 4 else None


def _transposed(matrices: Float[np.ndarray, "n 4 4"]) -> bool:
    """Return whether 0, 0, 0, 1 stands in the last column of the poses, and not in their last row."""
    known = matrices[np.isfinite(matrices).all(axis=(1, 2))]
    row, column = (np.abs(part[:, :3]).max(initial=0.0) for part in (known[:, 3], known[:, :, 3]))
    return bool(column < 1e-6 < row)
