"""Compiled: turn the commands of a joint servo into accelerations."""

# pyright: basic
from __future__ import annotations

from palpate.surfaces._jit import entry


@entry("servo out 2 n, goal n, joints n, speeds n, law 6, out out n")
def follow(servo, goal, joints, speeds, law, out):
    """Compute the accelerations that the servo requests of the joints, for one time step.

    r'' = w^2 (c - r) - 2 w r' with |r'| and |r''| bounded, then out = r'' + kp (r - q) + kd (r' - q').

    Args:
        servo: (2, n) reference r and its rate, changed in place.
        goal: (n,) command c at this instant [rad].
        joints: (n,) q [rad].
        speeds: (n,) q' [rad/s].
        law: (6,) w [rad/s], kp [1/s^2], kd [1/s], time step [s], greatest speed [rad/s] and acceleration [rad/s^2].
        out: (n,) [rad/s^2].
    """
    w, kp, kd, step, fastest, hardest = law[0], law[1], law[2], law[3], law[4], law[5]
    for i in range(goal.shape[0]):
        wanted = w * w * (goal[i] - servo[0, i]) - 2.0 * w * servo[1, i]
        rate = servo[1, i] + step * min(max(wanted, -hardest), hardest)
        rate = min(max(rate, -fastest), fastest)
        acceleration = (rate - servo[1, i]) / step
        out[i] = acceleration + kp * (servo[0, i] - joints[i]) + kd * (servo[1, i] - speeds[i])
        servo[1, i] = rate
        servo[0, i] += step * rate
