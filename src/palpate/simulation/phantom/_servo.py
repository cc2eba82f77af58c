"""Compiled: how a joint servo turns its commands into accelerations."""

# pyright: basic
from __future__ import annotations

from palpate.surfaces._jit import entry

__all__ = ["follow"]


@entry
def follow(servo, goal, joints, speeds, law, out):
    """Accelerations wanted of the joints, one time step after another.

    r'' = w^2 (c - r) - 2 w r' with |r'| bounded, then out = r'' + kp (r - q) + kd (r' - q').

    Args:
        servo: (2, n) reference r and its rate, changed in place.
        goal: (n,) command c at this instant [rad].
        joints, speeds: (n,) q and q'.
        law: (5,) w [rad/s], kp [1/s^2], kd [1/s], time step [s], greatest speed [rad/s].
        out: (n,) [rad/s^2].
    """
    w, kp, kd, step, most = law[0], law[1], law[2], law[3], law[4]
    for i in range(goal.shape[0]):
        rate = servo[1, i] + step * (w * w * (goal[i] - servo[0, i]) - 2.0 * w * servo[1, i])
        rate = min(max(rate, -most), most)
        acceleration = (rate - servo[1, i]) / step
        out[i] = acceleration + kp * (servo[0, i] - joints[i]) + kd * (servo[1, i] - speeds[i])
        servo[1, i] = rate
        servo[0, i] += step * rate
