"""An accelerometer fixed to a force/torque sensor, which takes the place of the sensor's orientation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.calls import called_as
from palpate.errors import InputError
from palpate.signals.recording import LARGEST
from palpate.spatial._arrays import Value, frozen
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import rotation_from_quaternion
from palpate.spatial.shown import one_line


@called_as("palpate.signals.Imu(quaternion=[0, 0, 0, 1])")
@takes_arrays
@dataclass(frozen=True, eq=False, init=False)
class Imu(Value):
    """An accelerometer fixed to a sensor: how it is turned, its bias and its noise.

    With f the specific force of the sensor (its acceleration less gravity) in the sensor's axes, it reads

        a = Q f + bias,    Q the rotation from the sensor's axes to the accelerometer's.

    Args:
        quaternion: (4,) x, y, z, w of Q; None: the axes agree.
        bias: (3,) [m/s^2] of a reading at zero specific force, in the accelerometer's axes; None: 0.
        noise: [m/s^2] standard deviation of one reading along each axis.
        covariance: (6, 18) of (rotation vector of Q [rad] about the sensor's axes, bias), the rows, with (weight,
            force_bias, center_of_mass, torque_bias, rotation vector, bias) of its `Payload`; None: 0.

    Raises:
        InputError: an array has another shape or numbers beyond 1e9 or NaN, the quaternion is zero, or the noise is
            negative.
    """

    quaternion: Float[np.ndarray, "4"]
    bias: Float[np.ndarray, "3"]
    noise: float
    covariance: Float[np.ndarray, "6 18"]

    def __init__(
        self,
        quaternion: ArrayLike | None = None,
        bias: ArrayLike | None = None,
        noise: float = 0.0,
        covariance: ArrayLike | None = None,
    ) -> None:
        given = {
            "quaternion": np.array([0.0, 0.0, 0.0, 1.0]) if quaternion is None else quaternion,
            "bias": np.zeros(3) if bias is None else bias,
            "covariance": np.zeros((6, 18)) if covariance is None else covariance,
        }
        shapes = {"quaternion": (4,), "bias": (3,), "covariance": (6, 18)}
        vars(self).update({name: frozen(each, tail=shapes[name], name=name) for name, each in given.items()})
        vars(self)["noise"] = noise
        for name, shape in shapes.items():
            array = vars(self)[name]
            if array.shape != shape or not np.all(np.abs(array) <= LARGEST):
                raise InputError(f"{name} must be finite numbers of shape {shape}, at most {LARGEST:g}.", where="imu")
        if not self.quaternion.any():
            raise InputError("the quaternion must not be zero.", where="imu", hint="Write 0, 0, 0, 1 for no turn.")
        if not 0.0 <= noise <= LARGEST:  # NaN too
            raise InputError(f"noise must be at least 0 m/s^2, not {noise}.", where="imu")

    def __repr__(self) -> str:
        return one_line(self)

    @property
    def rotation(self) -> Float[np.ndarray, "3 3"]:
        """Matrix (3, 3) of Q, from the sensor's axes to the accelerometer's."""
        return rotation_from_quaternion(self.quaternion)

    def forces(self, readings: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Return the specific forces f (n, 3) [m/s^2] in the sensor's axes, of readings (n, 3) as recorded.

        Raises:
            InputError: readings has another shape.
        """
        a, turn = readings - self.bias, self.rotation
        return np.stack([a[:, 0] * turn[0, k] + a[:, 1] * turn[1, k] + a[:, 2] * turn[2, k] for k in range(3)], axis=1)

    def deviations(self, forces: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 1"]:
        """Return the standard deviations (n, 1) [m/s^2] of `forces` (n, 3) along each axis, the rms of the three.

        With errors d of the rotation and b of the bias, a force is f x d - Q^T b off.

        Raises:
            InputError: forces has another shape.
        """
        turned, both, form = self.covariance[:3, 12:15], self.covariance[:3, 15:] @ self.rotation, np.zeros((4, 4))
        across = both - both.T
        form[:3, :3] = np.trace(turned) * np.eye(3) - turned
        form[3, :3] = -2.0 * across[[1, 2, 0], [2, 0, 1]]
        form[3, 3] = np.trace(self.covariance[3:, 15:])
        given = np.concatenate([forces, np.ones((len(forces), 1))], axis=1)
        square = np.einsum("ni,ij,nj->n", given, form, given)
        return np.sqrt(self.noise**2 + np.maximum(square, 0.0) / 3.0)[:, None]

    def upright(
        self, readings: Float[np.ndarray, "n 3"], magnitude: float
    ) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 3"]]:
        """Return rotations (n, 3, 3) and accelerations (n, 3) [m/s^2] that together have the readings' specific force.

        A rotation R takes the sensor to a base whose z axis is against the specific force f, turned about z by an angle
        without meaning. The acceleration in the sensor's axes is f - |g| f/|f|. So the load of a payload of weight
        w = (0, 0, -m |g|) in that base, R^T w - m a, is -m f. Readings that are not finite, or of no length, give NaN.

        Args:
            readings: (n, 3) [m/s^2] as recorded.
            magnitude: |g| [m/s^2].

        Raises:
            InputError: readings has another shape.
        """
        force = self.forces(readings)
        with np.errstate(invalid="ignore", over="ignore"):
            length = np.sqrt(force[:, 0] ** 2 + force[:, 1] ** 2 + force[:, 2] ** 2)
            length = np.where((length > 0.0) & (length <= LARGEST), length, np.nan)
            x, y, z = (force / length[:, None]).T
        sign = np.copysign(1.0, z)  # a right-handed frame about (x, y, z) that needs no case [duff]
        share = -1.0 / (sign + z)
        both = x * y * share
        rows = [1.0 + sign * x * x * share, sign * both, -sign * x, both, sign + y * y * share, -y, x, y, z]
        rotations = np.stack(rows, axis=1).reshape(-1, 3, 3)
        return rotations, force - magnitude * rotations[:, 2]
