"""Pose of one frame in another: names read T_target_source and cancel, T_base_tool @ T_tool_sensor."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.calls import called_as
from palpate.errors import InputError
from palpate.spatial._arrays import Value, frozen, shaped
from palpate.spatial.arguments import frozen_value, takes_arrays

_EYE = np.eye(3)
_ROUNDED = 1e-6 + 1e-5 * _EYE  # by how much a rotation times its transpose may be off


def skew(vector: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Return the matrix [v]x with [v]x u = v x u, (*batch, 3, 3).

    Raises:
        InputError: the last axis is not three real numbers.
    """
    vector = shaped(vector, (..., 3), "vector")
    matrix = np.zeros((*vector.shape[:-1], 3, 3))
    x, y, z = np.moveaxis(vector, -1, 0)
    matrix[..., 0, 1], matrix[..., 0, 2] = -z, y
    matrix[..., 1, 0], matrix[..., 1, 2] = z, -x
    matrix[..., 2, 0], matrix[..., 2, 1] = -y, x
    return matrix


def rotation_from_quaternion(quaternion: Float[np.ndarray, "*batch 4"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Return rotation matrices (*batch, 3, 3) of quaternions x, y, z, w of any length; NaN of a zero or NaN one.

    Raises:
        InputError: the last axis is not four real numbers.
    """
    quaternion = shaped(quaternion, (..., 4), "quaternion")
    unit = quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)
    x, y, z, w = unit.reshape(-1, 4).T
    made = np.empty((9, len(x)))  # rows of R, one after the other: quicker than products of small matrices
    doubled = 2.0 * x, 2.0 * y, 2.0 * z
    for k, (one, other) in enumerate(((y, z), (z, x), (x, y))):
        i, j = (k + 1) % 3, (k + 2) % 3
        made[4 * k] = 1.0 - doubled[i] * one - doubled[j] * other
        both, twist = doubled[i] * other, doubled[k] * w
        made[3 * i + j], made[3 * j + i] = both - twist, both + twist
    return np.ascontiguousarray(made.T).reshape(*quaternion.shape[:-1], 3, 3)


@takes_arrays
def quaternion_from_rotation(rotation: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 4"]:
    """Return unit quaternions x, y, z, w with w >= 0, (*batch, 4), of rotation matrices (*batch, 3, 3).

    A matrix that is not orthonormal, such as a scaled one, counts as a rotation near it.

    Raises:
        InputError: a determinant is not positive, such as of a reflection; a number is not finite.
    """
    if not np.isfinite(rotation).all():
        raise InputError("rotation must be finite.")
    if (np.linalg.det(rotation) <= 0.0).any():
        raise InputError("rotation is not a rotation matrix (orthonormal, determinant +1).")
    gram = rotation @ np.swapaxes(rotation, -1, -2)
    skewed = ~np.isclose(gram, np.eye(3), atol=1e-12).all(axis=(-2, -1))
    if skewed.any():
        left, _, right = np.linalg.svd(rotation[skewed])
        rotation = rotation.copy()
        rotation[skewed] = left @ right
    return _unit_quaternion(rotation)


def _unit_quaternion(rotation: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 4"]:
    """Return unit quaternions, w >= 0, of orthonormal matrices: the longest row of 4 q q^T, linear in the rotation.

    The steps are those of SciPy's `Rotation`, which takes 0.2 s to import.
    """
    turned, trace = np.swapaxes(rotation, -1, -2), np.trace(rotation, axis1=-2, axis2=-1)
    sizes = np.concatenate([np.diagonal(rotation, axis1=-2, axis2=-1), trace[..., None]], axis=-1)
    products = np.empty((*trace.shape, 4, 4))
    products[..., :3, :3] = rotation + turned
    products[..., 3, :3] = products[..., :3, 3] = (rotation - turned)[..., [2, 0, 1], [1, 2, 0]]
    products[..., range(4), range(4)] = 1.0 - trace[..., None] + 2.0 * sizes
    products[..., 3, 3] = 1.0 + trace
    row = np.take_along_axis(products, sizes.argmax(axis=-1)[..., None, None], axis=-2)[..., 0, :]
    row /= np.linalg.norm(row, axis=-1, keepdims=True)
    w_first = np.roll(row, 1, axis=-1)
    first = np.take_along_axis(w_first, (w_first != 0.0).argmax(axis=-1)[..., None], axis=-1)
    return row * np.sign(first)  # of w, or where it is zero, of the next


@called_as(
    "palpate.Pose.from_quaternion([0, 0, 0, 1], [0, 0, 0.085])",
    from_quaternion="palpate.Pose.from_quaternion([0, 0, 0, 1], [0, 0, 0.085])",
    from_matrix="palpate.Pose.from_matrix(np.eye(4))",
    from_rotation_vector="palpate.Pose.from_rotation_vector([0, 0, 1.57], [0, 0, 0.085])",
    apply="pose.apply(contact.point)",
    inv="pose.inverse()",
    __matmul__="T_base_sensor @ T_sensor_surface, pose.apply(point) or contact.in_frame(pose)",
)
@frozen_value(init=False)
class Pose(Value):
    """Rotation and translation [m] of a source frame in a target frame, batched by leading axes.

    Args:
        rotation: (*batch, 3, 3), orthonormal, determinant +1.
        translation: (*batch, 3) [m].

    Raises:
        InputError: a rotation is not one (a reflection, a scaled matrix); the leading axes cannot be broadcast.
    """

    rotation: Float[np.ndarray, "*batch 3 3"]
    translation: Float[np.ndarray, "*batch 3"]

    def __init__(self, rotation: ArrayLike, translation: ArrayLike) -> None:
        object.__setattr__(self, "rotation", frozen(rotation, tail=(3, 3), name="rotation"))
        object.__setattr__(self, "translation", frozen(translation, tail=(3,), name="translation"))
        gram = self.rotation @ np.swapaxes(self.rotation, -1, -2)
        if not (np.abs(gram - _EYE) <= _ROUNDED).all() or np.any(np.linalg.det(self.rotation) < 0):
            raise InputError("rotation is not a rotation matrix (orthonormal, determinant +1).")
        try:  # one of them may be for all of the other
            np.broadcast_shapes(self.rotation.shape[:-2], self.translation.shape[:-1])
        except ValueError as problem:
            what = f"rotation {self.rotation.shape} and translation {self.translation.shape}"
            raise InputError(f"{what} must have the same leading axes.") from problem

    @classmethod
    def identity(cls) -> Pose:
        """Return the `Pose` without rotation and translation."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_quaternion(cls, quaternion_xyzw: ArrayLike, translation: ArrayLike) -> Pose:
        """Make a `Pose` of quaternions x, y, z, w (*batch, 4) of any length, and translations (*batch, 3) [m].

        Raises:
            InputError: other shapes; a quaternion is zero or not finite; both are swapped.
        """
        shapes = np.shape(quaternion_xyzw)[-1:], np.shape(translation)[-1:]
        if shapes == ((3,), (4,)):
            line = "palpate.Pose.from_quaternion([0, 0, 0, 1], [0, 0, 0.085])"
            raise InputError("quaternion and translation are swapped.", hint=f"Write {line}: x, y, z, w, then metres.")
        return cls(rotation_from_quaternion(shaped(quaternion_xyzw, (..., 4), "quaternion_xyzw")), translation)

    @classmethod
    def from_matrix(cls, matrix: Float[np.ndarray, "*batch 4 4"]) -> Pose:
        """Make a `Pose` of homogeneous matrices (*batch, 4, 4), whose last row is 0, 0, 0, 1.

        Raises:
            InputError: another shape or last row; the upper left block is no rotation.
        """
        if not np.allclose(matrix[..., 3, :], (0.0, 0.0, 0.0, 1.0), atol=1e-9):
            last = matrix[..., 3, :].tolist()
            raise InputError(
                f"the last row of matrix must be 0, 0, 0, 1, not {last}.",
                hint="Transpose it if the translation is in that row.",
            )
        return cls(matrix[..., :3, :3], matrix[..., :3, 3])

    @classmethod
    def from_translation(cls, translation: ArrayLike) -> Pose:
        """Make a `Pose` of translations (*batch, 3) [m] alone.

        Raises:
            InputError: another shape.
        """
        return cls(np.eye(3), translation)

    @classmethod
    def from_rotation_vector(cls, rotation_vector: ArrayLike, translation: ArrayLike) -> Pose:
        """Make a `Pose` of rotation vectors, axis times angle (*batch, 3) [rad], and translations (*batch, 3) [m].

        Raises:
            InputError: other shapes; a rotation vector is not finite.
        """
        from scipy.spatial.transform import Rotation

        vector = shaped(rotation_vector, (..., 3), "rotation_vector")
        turns = Rotation.from_rotvec(vector.reshape(-1, 3)).as_matrix()
        return cls(turns.reshape(*vector.shape, 3), translation)

    def quaternion(self) -> Float[np.ndarray, "*batch 4"]:
        """Return unit quaternions x, y, z, w with w >= 0, (*batch, 4)."""
        quaternions = quaternion_from_rotation(self.rotation)
        batch = np.broadcast_shapes(quaternions.shape[:-1], self.translation.shape[:-1])
        return np.broadcast_to(quaternions, (*batch, 4)).copy()

    def rotation_vector(self) -> Float[np.ndarray, "*batch 3"]:
        """Return rotation vectors, axis times angle, (*batch, 3) [rad]."""
        from scipy.spatial.transform import Rotation

        quaternions = self.quaternion()
        vectors = Rotation.from_quat(quaternions.reshape(-1, 4)).as_rotvec()
        return vectors.reshape((*quaternions.shape[:-1], 3))

    def inverse(self) -> Pose:
        """Return the inverse, T_source_target, as a `Pose`."""
        transposed = np.swapaxes(self.rotation, -1, -2)
        return Pose(transposed, -np.einsum("...ij,...j->...i", transposed, self.translation))

    def __matmul__(self, other: Pose) -> Pose:
        return Pose(self.rotation @ other.rotation, self.apply(other.translation))

    def apply(self, points: Float[np.ndarray, "*#batch 3"]) -> Float[np.ndarray, "*#batch 3"]:
        """Return points (*batch, 3) [m] of the source frame in the target frame: rotated, then translated.

        Raises:
            InputError: points has another shape.
        """
        return self.rotate(points) + self.translation

    def rotate(self, vectors: Float[np.ndarray, "*#batch 3"]) -> Float[np.ndarray, "*#batch 3"]:
        """Return directions (*batch, 3) of the source frame in the target frame: rotated only.

        Raises:
            InputError: vectors has another shape.
        """
        return np.einsum("...ij,...j->...i", self.rotation, vectors)

    def wrench_matrix(self) -> Float[np.ndarray, "*batch 6 6"]:
        """Return matrices (*batch, 6, 6) that take wrenches, force first, from the source to the target frame."""
        matrix = np.zeros((*self.rotation.shape[:-2], 6, 6))
        matrix[..., :3, :3] = self.rotation
        matrix[..., 3:, 3:] = self.rotation
        matrix[..., 3:, :3] = skew(self.translation) @ self.rotation
        return matrix
