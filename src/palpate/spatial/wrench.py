"""A wrench: force and torque that the environment applies to the body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.calls import called_as
from palpate.errors import InputError
from palpate.spatial._arrays import Value, frozen, require_batch, shaped
from palpate.spatial.pose import Pose


@called_as(
    "palpate.Wrench(force=[0, 0, -5], torque=[0.02, 0, 0])",
    from_vector="palpate.Wrench.from_vector([0, 0, -5, 0.02, 0, 0])",
    transformed="wrench.transformed(palpate.Pose.identity())",
)
@dataclass(frozen=True, eq=False, init=False)
class Wrench(Value):
    """Force [N] and torque [N m] on the body, about the origin of the frame in which they are written.

    Batched by leading axes; the arrays are read-only.

    Args:
        force: (*batch, 3) [N].
        torque: (*batch, 3) [N m].
        covariance: (*batch, 6, 6) or (6, 6), force first [N, N m]; None when not known.

    Raises:
        InputError: force and torque have other or different shapes; the covariance cannot be broadcast to them.
    """

    force: Float[np.ndarray, "*batch 3"]
    torque: Float[np.ndarray, "*batch 3"]
    covariance: Float[np.ndarray, "*#batch 6 6"] | None

    def __init__(self, force: ArrayLike, torque: ArrayLike, covariance: ArrayLike | None = None) -> None:
        set_field = object.__setattr__
        set_field(self, "force", frozen(force, tail=(3,), name="force"))
        set_field(self, "torque", frozen(torque, tail=(3,), name="torque"))
        if self.force.shape != self.torque.shape:
            raise InputError(f"force {self.force.shape} and torque {self.torque.shape} must have the same shape.")
        spread = None if covariance is None else frozen(covariance, tail=(6, 6), name="covariance")
        if spread is not None:
            require_batch(spread, self.force.shape[:-1], "covariance")
        set_field(self, "covariance", spread)

    @classmethod
    def from_vector(cls, vector: ArrayLike, covariance: ArrayLike | None = None) -> Wrench:
        """Make a `Wrench` of six-vectors (*batch, 6), force first [N, N m].

        Args:
            vector: force and torque.
            covariance: (*batch, 6, 6) or (6, 6), force first; None when not known.

        Raises:
            InputError: other shapes.
        """
        vector = shaped(vector, (..., 6), "vector")
        return cls(vector[..., :3], vector[..., 3:], covariance)

    def vector(self) -> Float[np.ndarray, "*batch 6"]:
        """Return the six-vectors (*batch, 6), force first [N, N m]."""
        return np.concatenate([self.force, self.torque], axis=-1)

    def transformed(self, pose: Pose) -> Wrench:
        """Return the `Wrench`, with its covariance if known, in another frame: F' = R F, M' = R M + t x (R F).

        Args:
            pose: T_target_source of rotation R and translation t: this wrench's frame in the target frame.

        Raises:
            ValueError: the leading axes of wrench and pose do not fit.
        """
        matrix = pose.wrench_matrix()
        vector = np.einsum("...ij,...j->...i", matrix, self.vector())
        if self.covariance is None:
            return Wrench.from_vector(vector)
        return Wrench.from_vector(vector, matrix @ self.covariance @ np.swapaxes(matrix, -1, -2))
