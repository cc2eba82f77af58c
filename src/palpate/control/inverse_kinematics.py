"""From a wanted motion of the sensor to joints: damped least squares, and the limits that no command passes."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.control import _arm
from palpate.control.arm import Arm
from palpate.errors import InputError
from palpate.spatial._arrays import require_out, shaped

__all__: list[str] = []  # for this package alone


def damped_step(
    jacobian: Float[np.ndarray, "6 n"], e: Float[np.ndarray, " 6"], damping: float, out: Float[np.ndarray, " n"]
) -> float:
    """The short step of the joints that comes near to a wanted step of a point, (10) of `probe`.

        dq = (J' J + damping^2 I)^-1 J' e = J' (J J' + damping^2 I)^-1 e

    the minimum of |J dq - e|^2 + damping^2 |dq|^2. Both forms are equal, because J' (J J' + c I) = (J' J + c I) J'; the
    second needs a 6 x 6 matrix for any number of joints. Metres and radians stand beside each other in e, so the
    damping weighs 1 m as 1 rad. With y = (J J' + damping^2 I)^-1 e the part of e that is not reached is
    e - J dq = damping^2 y, exactly: near a singular pose it is what tells.

    Args:
        jacobian: (6, n), linear rows first.
        e: (6,) the wanted step, translation [m] then rotation vector [rad], of the Jacobian's point and axes.
        damping: lambda, 0 or more; 0 holds at a singular pose.
        out: (n,).

    Returns:
        The share |e - J dq| / |e| that is not reached, 0 to 1; NaN, and a step of zero, where there is no answer
        (singular without damping, NaN or infinite numbers).
    """
    n = len(out)
    require_out(out, (n,))
    return _arm.damped_step(shaped(jacobian, (6, n), "jacobian"), shaped(e, (6,), "e"), float(damping), out)


def limited(
    arm: Arm,
    q: Float[np.ndarray, " n"],
    step: Float[np.ndarray, " n"],
    last: Float[np.ndarray, " n"],
    dt: float,
    out: Float[np.ndarray, " n"],
) -> float:
    """The next joint positions: q + step, as far as the arm's limits allow.

    The whole step is first shortened until its fastest joint keeps its speed, which keeps the direction of the motion;
    then joint by joint: the acceleration against the `last` step, the longest step that can still be braked before the
    end of the range, the end of the range. Whatever is put in, `out` is within the range and within speed dt of q; from
    outside its range a joint is only let back. The acceleration is kept as well, if `last` was a step of this function.

    Args:
        arm: whose limits.
        q: (n,) the last command. Where it is not finite there is no answer and `out` is left alone.
        step: (n,) wanted; not finite: the joints are to stop.
        last: (n,) the step before, q less the command before it; not finite: none.
        dt: [s] of the step; not positive and finite: a hold.
        out: (n,); may be q.

    Returns:
        The share of the step that speed left, 0 to 1; NaN where the joints were told to stop.
    """
    n = len(arm.names)
    require_out(out, (n,))
    joints, wanted, before = shaped(q, (n,), "q"), shaped(step, (n,), "step"), shaped(last, (n,), "last")
    if np.may_share_memory(out, before) or np.may_share_memory(out, wanted):
        raise InputError("out must not be the step's own array.")
    return _arm.limit(arm.limits, joints, wanted, before, float(dt), out)
