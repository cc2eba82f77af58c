"""Name small motions of a body, to tell a person which ones the data do not determine."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

NEAR = 0.95  # of its squared length: a direction is called by the axis that it lies along this well


def name_motions(
    basis: Float[np.ndarray, "6 k"], angle: float, length: float, about: Float[np.ndarray, "3"] | None = None
) -> tuple[str, ...]:
    """Return one name for each dimension of a space of small motions.

    Motions along the body's axes come first, as far as the space contains them, then pure translations.

    Args:
        basis: (6, k) orthonormal columns (rotation / angle, translation of a point / length), in the body's axes.
        angle: [rad] that the rotation was divided by.
        length: [m] that the translation was divided by.
        about: (3,) [m] that point of the body; None: its origin.
    """
    names: list[str] = []
    while basis.shape[1]:
        motion, name = _clearest(basis, angle, length, about)
        names.append(name)
        shares = basis.T @ motion  # take the named motion out of the space
        basis = basis @ np.linalg.svd(shares[None, :] / np.linalg.norm(shares))[2][1:].T
    return tuple(names)


def _clearest(
    basis: Float[np.ndarray, "6 k"], angle: float, length: float, about: Float[np.ndarray, "3"] | None
) -> tuple[np.ndarray, str]:
    shares: np.ndarray = np.sum(basis**2, axis=1)
    axis = int(np.argmax(np.round(shares, 2)))  # the first of equals
    if shares[axis] > NEAR and (about is None or axis >= 3):
        kind = "rotation about" if axis < 3 else "translation along"
        return np.eye(6)[axis], f"{kind} {'xyz'[axis % 3]} of the surface"
    left, values, _ = np.linalg.svd(basis[3:])
    if values[0] ** 2 > NEAR:
        return np.r_[np.zeros(3), left[:, 0]], f"translation along {_vector(left[:, 0])} of the surface"
    motion = basis @ np.linalg.svd(basis[:3])[2][0]  # the most rotation that the space holds
    return motion, _screw(motion[:3] * angle, motion[3:] * length, np.zeros(3) if about is None else about)


def _screw(rotation: Float[np.ndarray, "3"], translation: Float[np.ndarray, "3"], about: Float[np.ndarray, "3"]) -> str:
    """Name a rotation about an axis through p + omega x v / |omega|^2, and its slide by omega . v / |omega|^2."""
    square = float(rotation @ rotation)
    through = (about + np.cross(rotation, translation) / square) * 1e3
    slide = float(rotation @ translation) / square * 1e3
    name = f"rotation about {_vector(rotation)} through {_vector(through, 1)} mm of the surface"
    return name if abs(slide) < 1.0 else f"{name}, sliding {slide:.1f} mm a radian"


def _vector(vector: Float[np.ndarray, "3"], digits: int = 2) -> str:
    if digits == 2:  # a direction: of unit length, its largest part positive
        vector = vector / (np.linalg.norm(vector) * np.sign(vector[np.argmax(np.abs(vector))]))
    return "(" + ", ".join(f"{value + 0.0:.{digits}f}" for value in np.round(vector, digits)) + ")"
