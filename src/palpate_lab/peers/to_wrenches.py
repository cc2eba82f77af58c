"""Turn readings into wrenches by plain least squares, for the peers that take a wrench."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.spatial._arrays import require_finite
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import skew


@takes_arrays
def payload_and_bias(
    wrenches: Float[np.ndarray, "n 6"], rotations: Float[np.ndarray, "n 3 3"]
) -> Float[np.ndarray, "12"]:
    """Fit weight, force bias, centre of mass and torque bias to free readings, all with equal weight.

    F = R' w + b is linear in (w, b); then M = c x (R' w) + d is linear in (c, d).

    Args:
        wrenches: (n, 6) of the sensor that carries the tool, with no contact.
        rotations: (n, 3, 3) of the sensor in the base.

    Returns:
        (12,) w in the base [N], b [N], c [m] and d [N m].

    Raises:
        InputError: wrenches or rotations are not finite.
    """
    require_finite(wrenches, "wrenches")
    require_finite(rotations, "rotations")
    one = np.broadcast_to(np.eye(3), rotations.shape)
    turned = np.swapaxes(rotations, 1, 2)
    first = np.concatenate([turned, one], axis=2).reshape(-1, 6)
    weight = np.linalg.lstsq(first, wrenches[:, :3].ravel(), rcond=None)[0]
    down = turned @ weight[:3]
    require_finite(down, "the weight that wrenches and rotations give")
    second = np.concatenate([-skew(down), one], axis=2).reshape(-1, 6)
    return np.concatenate([weight, np.linalg.lstsq(second, wrenches[:, 3:].ravel(), rcond=None)[0]])


@takes_arrays
def contact_wrenches(
    wrenches: Float[np.ndarray, "n 6"], rotations: Float[np.ndarray, "n 3 3"], known: Float[np.ndarray, "12"]
) -> Float[np.ndarray, "n 6"]:
    """Subtract the weight and biases of `payload_and_bias` from readings, (n, 6) [N, N m] in the sensor's frame.

    Raises:
        InputError: arrays of other shapes.
    """
    weight, bias, centre, moment = known.reshape(4, 3)
    down = np.swapaxes(rotations, 1, 2) @ weight
    return wrenches - np.concatenate([down + bias, np.cross(centre, down) + moment], axis=1)


@takes_arrays
def linear_map(
    channels: Float[np.ndarray, "n m"], points: Float[np.ndarray, "n 3"], forces: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "m 6"]:
    """Fit the matrix (m, 6) that turns channels into wrenches (F, p x F) by least squares, wrench = channels @ matrix.

    There is no constant term.

    Args:
        channels: (n, m) of any unit, with their biases subtracted.
        points: (n, 3) [m] the points p at which the forces press.
        forces: (n, 3) [N] the forces F.

    Raises:
        InputError: a channel, point or force is not finite.
    """
    wrenches = np.concatenate([forces, np.cross(points, forces)], axis=1)
    require_finite(channels, "channels")
    require_finite(wrenches, "points and forces")
    return np.linalg.lstsq(channels, wrenches, rcond=None)[0]
