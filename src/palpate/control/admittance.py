"""Compute velocities from force and contact point: the admittances (7) and (8) of `probe`, and the selection (9)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.spatial._arrays import require_out
from palpate.spatial.arguments import takes_arrays

__all__ = ["Admittance", "force_error", "selected_step", "turning_error"]


@dataclass(frozen=True)
class Admittance:
    """A mass with a damper that an error pushes: M dv/dt + D v = error, (7) and (8) of `probe`.

    As printed, it is integrated by explicit Euler: v_k = v_{k-1} + dt/M (error - D v_{k-1}). In steady state v =
    error / D, reached with the time constant M/D; dt D/M < 2 is necessary for that alone; `palpate.control.stability`
    has the conditions against an environment and with a delay.

    Args:
        mass: [kg] for a force, [m s^2/rad] for a contact point.
        damping: [N s/m] for a force, [m s/rad] for a contact point.

    Raises:
        InputError: one of them is not positive and finite.
    """

    mass: float
    damping: float

    def __post_init__(self) -> None:
        if not (0 < self.mass < math.inf and 0 < self.damping < math.inf):
            raise InputError(f"mass ({self.mass}) and damping ({self.damping}) must be positive.")

    def step(self, velocity: float, error: float, dt: float) -> float:
        """Return the velocity of this cycle, a float [m/s for a force, rad/s for a contact point].

        Args:
            velocity: of the last cycle.
            error: [N] of the force, or [m] of the contact point.
            dt: [s] between them.

        Returns:
            the velocity; 0, which holds the pose, if it would not be finite.
        """
        found = velocity + dt / self.mass * (error - self.damping * velocity)
        return found if math.isfinite(found) else 0.0


def force_error(force: float, wanted: float) -> float:
    """Return the force error f_z - f_d [N] of equation (7) of `probe`, positive if the probe presses too lightly.

    A positive error moves the probe along z, out of the flange and deeper into the tissue. The tissue pushes back, so
    f_z < 0 while pressed, and f_d is -`wanted`.

    Args:
        force: z of the force on the probe, in the sensor's frame [N].
        wanted: wanted contact force, positive [N].
    """
    return force + wanted


def turning_error(x: float, y: float) -> tuple[float, float]:
    """Return the errors that turn the probe about x and y, for a contact at (x, y) from its wanted place [m].

    (8) sets each turn equal to the offset along its own axis; geometry pairs them crosswise. On a convex probe that
    points along z the outward normal at (x, y) is n = (x/R_x, y/R_y, 1) to first order, R its radii there. The tissue
    touches where its own normal is -n. Turning the probe by the rotation vector z x n = (-y/R_y, x/R_x, 0) brings its z
    onto n, and so the contact back to the middle: about x with -y, about y with +x.

    Returns:
        (-y, x) [m].
    """
    return -y, x


@takes_arrays
def selected_step(
    rotation: Float[np.ndarray, "3 3"],
    speed: float,
    turning: tuple[float, float],
    dt: float,
    out: Float[np.ndarray, " 6"],
) -> None:
    """Write the wanted step of the sensor, (9) of `probe`: only along its z, only about its x and y; in base axes.

        e = dt [R (S_z . v), R (S_xy . w)],   S_z = (0, 0, 1),  S_xy = (1, 1, 0)

    The dt is missing in print, where e is called a difference of poses but is made of velocities.

    Args:
        rotation: R of the sensor in the base.
        speed: v_z [m/s].
        turning: w_x, w_y [rad/s].
        dt: [s].
        out: (6,) translation [m], then rotation vector [rad].
    """
    require_out(out, (6,))
    along, about_x, about_y = dt * speed, dt * turning[0], dt * turning[1]
    for r in range(3):
        out[r] = rotation[r, 2] * along
        out[3 + r] = rotation[r, 0] * about_x + rotation[r, 1] * about_y
