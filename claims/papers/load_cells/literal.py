"""The paper's own estimator as it is printed, (8) and (13) to (18): what ours is to be compared with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from palpate_lab.simulation.ball_on_ellipse import FINGERTIP, Ellipse

SENSITIVITY = 10.0  # N/V: where the search starts, the same for all axes
RATIO = (
    1e3  # N a metre: newtons and millimetres are added, as the paper's units suggest; SI leaves the point nearly free
)


@dataclass(frozen=True)
class Literal:
    """Sensitivities S_i [N/V] and places l_i [m] of the cells; a rigid ellipse."""

    sensitivity: Float[np.ndarray, "k 3 3"]
    position: Float[np.ndarray, "k 3"]
    ellipse: Ellipse = FINGERTIP

    @classmethod
    def fit(
        cls,
        voltages: Float[np.ndarray, "n k 3"],
        force: Float[np.ndarray, "n 3"],
        point: Float[np.ndarray, "n 3"],
        position: Float[np.ndarray, "k 3"],
    ) -> Literal:
        """(18): least squares on force and contact point together, from roughly known places.

        Args:
            voltages: without bias.
            force: of the reference [N].
            point: of the reference, on the surface [m].
            position: of the cells as drawn [m].
        """
        cells = len(position)

        def model(x: np.ndarray) -> Literal:
            return cls(x[: 9 * cells].reshape(cells, 3, 3), 1e-3 * x[9 * cells :].reshape(cells, 3))

        def residuals(x: np.ndarray) -> np.ndarray:
            found_force, found_point = model(x).estimate(voltages)
            return np.concatenate([found_force - force, RATIO * (found_point - point)], axis=1).ravel()

        def slopes(x: np.ndarray) -> np.ndarray:
            return model(x)._slopes(voltages)

        start = np.concatenate([np.tile(SENSITIVITY * np.eye(3).ravel(), cells), 1e3 * position.ravel()])
        return model(least_squares(residuals, start, slopes, method="lm").x)

    def estimate(
        self, voltages: Float[np.ndarray, "n k 3"]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """(17): force, the sum of the cells' (13), and where its line of action meets the ellipse (14), (15)."""
        each = np.einsum("iab,nib->nia", self.sensitivity, voltages)
        force, moment = each.sum(axis=1), np.cross(self.position, each).sum(axis=1)
        start = np.cross(force, moment) / np.sum(force**2, axis=1, keepdims=True)
        shape = np.array([self.ellipse.a**-2, 0.0, self.ellipse.b**-2])
        square, cross = np.sum(force**2 * shape, axis=1), np.sum(force * start * shape, axis=1)
        root = np.sqrt(np.maximum(cross**2 - square * (np.sum(start**2 * shape, axis=1) - 1.0), 0.0))
        return force, start + ((-cross - root) / square)[:, None] * force

    def _slopes(self, voltages: np.ndarray) -> Float[np.ndarray, "r p"]:
        """Of the residuals by S, row by row, and by l [mm]; the moment along the force moves no line of action."""
        count, cells = len(voltages), len(self.position)
        each = np.einsum("iab,nib->nia", self.sensitivity, voltages)
        force, point = self.estimate(voltages)
        by_force = np.einsum("nib,ac->nciab", voltages, np.eye(3)).reshape(count, 3, 9 * cells)
        arms = self.position[None] - point[:, None]  # m about the point: (l_i - p) x df_i
        turned = np.cross(arms[:, :, None, :], np.eye(3)[None, None])  # of a unit of force along each axis
        moment = np.einsum("nib,niac->nciab", voltages, turned).reshape(count, 3, 9 * cells)
        moved = -np.cross(each[:, :, None, :], np.eye(3)[None, None])  # of a unit of place
        moment = np.concatenate([moment, 1e-3 * np.moveaxis(moved, 3, 1).reshape(count, 3, 3 * cells)], axis=2)
        shift = np.cross(force[:, None], np.swapaxes(moment, 1, 2)) / np.sum(force**2, axis=1)[:, None, None]
        normal = point * [self.ellipse.a**-2, 0.0, self.ellipse.b**-2]
        along = np.einsum("npa,na->np", shift, normal) / np.sum(force * normal, axis=1)[:, None]
        place = np.swapaxes(shift - along[..., None] * force[:, None], 1, 2)
        first = np.concatenate([by_force, np.zeros((count, 3, 3 * cells))], axis=2)
        return np.concatenate([first, RATIO * place], axis=1).reshape(6 * count, 12 * cells)
