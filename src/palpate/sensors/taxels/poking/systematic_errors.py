"""Model errors of sensor and robot in pokes, and predict the torque of a poke with them.

    w_measured = (I + C) [f, c x f] + b,    c = R (Exp(phi) p + rho) + o

with p the contact in the link's frame, (R, o) the link's reported pose, rho and phi the error of this pose: the sum of
that of all configurations and that of this one. Measurements are not corrected: a free cross-talk C would shrink the
residual with the measurement.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from palpate.sensors.taxels.poking.pokes import Pokes
from palpate.sensors.taxels.poking.priors import Priors
from palpate.spatial._arrays import Value
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.spatial.pose import Pose, skew


@frozen_value
class Nuisances(Value):
    """Errors that are estimated in addition to the taxels, for d configurations.

    Attributes:
        frames: (d, 6) of each configuration and common: (6,) of all, rho [m] then phi [rad].
        bias: (d, 6) [N, N m].
        cross_talk: (6, 6).
    """

    frames: Float[np.ndarray, "d 6"]
    common: Float[np.ndarray, "6"]
    bias: Float[np.ndarray, "d 6"]
    cross_talk: Float[np.ndarray, "6 6"]

    @classmethod
    def none(cls, configurations: int) -> Nuisances:
        """Return `Nuisances` of d configurations that are all 0."""
        return cls(np.zeros((configurations, 6)), np.zeros(6), np.zeros((configurations, 6)), np.zeros((6, 6)))

    def vector(self) -> Float[np.ndarray, " q"]:
        """Return all errors (12 d + 42,): frames, common, bias [m, rad; N, N m], cross-talk by rows."""
        return np.concatenate([part.ravel() for part in vars(self).values()])

    def moved(self, by: Float[np.ndarray, " q"]) -> Nuisances:
        """Return `Nuisances` with a vector (q,), in the order of `vector`, added.

        Raises:
            InputError: another length.
        """
        own = list[np.ndarray](vars(self).values())
        added = np.split(by, np.cumsum([part.size for part in own])[:-1])
        return Nuisances(*(part + more.reshape(part.shape) for part, more in zip(own, added, strict=True)))

    @staticmethod
    def columns(configuration: Int[np.ndarray, " n"], configurations: int) -> Int[np.ndarray, "n 54"]:
        """Return the indices (n, 54) in `vector` of the errors in `Predicted.by_nuisance`, for configurations (n,).

        Raises:
            InputError: configuration has another shape.
        """
        own, common, six = 6 * configuration[:, None], 6 * configurations, np.arange(6)
        alike = np.zeros_like(own) + common
        return np.concatenate(
            [own + six, alike + six, alike + 6 + own + six, alike + 6 + common + np.arange(36)], axis=1
        )

    @staticmethod
    def deviations(priors: Priors, configurations: int) -> Float[np.ndarray, " q"]:
        """Return the prior standard deviation (q,) of each error, in the order of `vector`; 0: not estimated."""
        frame = [priors.frame] * 3 + [priors.frame_angle] * 3
        common = [priors.common] * 3 + [priors.common_angle] * 3
        bias = [priors.bias_force] * 3 + [priors.bias_torque] * 3
        cross = np.full((6, 6), float(priors.cross_talk))
        cross[:3, 3:] /= priors.lever
        cross[3:, :3] *= priors.lever
        return np.concatenate([np.tile(frame, configurations), common, np.tile(bias, configurations), cross.ravel()])


@frozen_value
class Predicted:
    """The torque that pokes should show, and its derivatives.

    Attributes:
        torque: (n, 3) [N m].
        by_point: (n, 3, 3) by the contact in the link's frame.
        by_nuisance: (n, 3, 54) by frame, common, bias of the poke's configuration and cross-talk, in this order.
        by_wrench: (n, 3, 6) by the measured wrench, through the force.
    """

    torque: Float[np.ndarray, "n 3"]
    by_point: Float[np.ndarray, "n 3 3"]
    by_nuisance: Float[np.ndarray, "n 3 54"]
    by_wrench: Float[np.ndarray, "n 3 6"]


@takes_arrays
def predicted(pokes: Pokes, points: Float[np.ndarray, "n 3"], nuisances: Nuisances) -> Predicted:
    """Return the torque of pokes at points (n, 3) [m] of the link, and its derivatives, as `Predicted`.

    Raises:
        InputError: points or nuisances that do not fit the pokes, or a cross-talk by which I + C is singular.
    """
    d, cross = pokes.configuration, nuisances.cross_talk
    error, bias = nuisances.frames[d] + nuisances.common, nuisances.bias[d]
    turn = Pose.from_rotation_vector(error[:, 3:], error[:, :3])
    turned = turn.rotate(points)
    place = np.einsum("nij,nj->ni", pokes.rotation, turned + error[:, :3]) + pokes.origin
    back = np.linalg.inv(np.eye(6) + cross)
    true = (pokes.wrench - bias) @ back.T
    force, gain = true[:, :3], np.eye(3) + cross[3:, 3:]
    moment = np.cross(place, force)
    found = moment @ gain.T + force @ cross[3:, :3].T + bias[:, 3:]
    by_force = gain @ skew(place) + cross[3:, :3]
    by_link = -gain @ skew(force) @ pokes.rotation
    by_wrench = by_force @ back[:3]
    rows = np.zeros((len(points), 3, 54))
    rows[..., :3] = rows[..., 6:9] = by_link
    rows[..., 3:6] = rows[..., 9:12] = -by_link @ skew(turned) @ _left_jacobian(error[:, 3:])
    rows[..., 12:18] = -by_wrench
    rows[..., 15:18] += np.eye(3)
    # entries of the cross-talk row by row: all of them act through the true force, those of torques also directly
    rows[..., 18:54] = np.einsum("nil,nk->nilk", -by_wrench, true).reshape(-1, 3, 36)
    direct = np.einsum("il,nk->nilk", np.eye(3), np.concatenate([force, moment], axis=1))
    rows[..., 36:54] += direct.reshape(-1, 3, 18)
    return Predicted(found, by_link @ turn.rotation, rows, by_wrench)


def _left_jacobian(phi: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """Return the left Jacobian of Exp(phi), to third order."""
    cross = skew(phi)
    return np.eye(3) + cross / 2.0 + cross @ cross / 6.0
