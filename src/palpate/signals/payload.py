"""The payload of a force/torque sensor, which is subtracted from a reading to get the contact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from os import PathLike
from types import MappingProxyType

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.calls import by_name, called_as
from palpate.errors import InputError
from palpate.signals.imu import Imu
from palpate.signals.recording import LARGEST
from palpate.spatial._arrays import Value, frozen
from palpate.spatial.arguments import frozen_value
from palpate.spatial.pose import skew
from palpate.spatial.shown import vector

STANDARD_GRAVITY = 9.80665  # m/s^2


@called_as(
    "palpate.Payload(mass=0.4, center_of_mass=[0, 0, 0.05])",
    load='palpate.Payload.load("payload.toml")',
    save='payload.save("payload.toml")',
    compensate="payload.compensate(wrenches, rotations)",
)
@frozen_value(init=False)
class Payload(Value):
    """The payload mounted on a force/torque sensor, and the sensor's bias.

    With R the sensor's orientation in the base, w the weight, c its centre, f0 and m0 the biases [probe, (1)]:

        F_s = R^T w + f0 + F_contact
        M_s = c x (R^T w) + m0 + M_contact

    Args:
        weight: (3,) [N] of the payload, in the base frame; None: by `mass`, or 0.
        force_bias: (3,) [N], in the sensor frame; None: 0.
        center_of_mass: (3,) [m], in the sensor frame; None: 0.
        torque_bias: (3,) [N m], in the sensor frame; None: 0.
        covariance: (12, 12) of weight, force_bias, center_of_mass, torque_bias in this order; None: 0.
        magnitude: of gravity [m/s^2].
        residual: (2,) rms of the fit's force [N] and torque [N m], per axis; None: 0.
        samples: number of wrenches used.
        provenance: origin of the payload: input hashes, version, options.
        notes: remarks on the fit for the user, one sentence each.
        imu: accelerometer on the sensor, from which gravity is taken in place of the orientation; the base is then the
            one of `Imu.upright`, whose z axis points up. None: none.
        mass: [kg] in place of the weight, in a base whose z axis points up.

    Raises:
        InputError: an array has another shape or numbers beyond 1e9 or NaN, the magnitude is not from 1e-9 to 1e9, the
            mass is negative, or a weight and a mass are given.
    """

    weight: Float[np.ndarray, "3"]
    force_bias: Float[np.ndarray, "3"]
    center_of_mass: Float[np.ndarray, "3"]
    torque_bias: Float[np.ndarray, "3"]
    covariance: Float[np.ndarray, "12 12"]
    magnitude: float
    residual: Float[np.ndarray, "2"]
    samples: int
    provenance: Mapping[str, str]
    notes: tuple[str, ...]
    imu: Imu | None

    def __init__(
        self,
        weight: ArrayLike | None = None,
        force_bias: ArrayLike | None = None,
        center_of_mass: ArrayLike | None = None,
        torque_bias: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        magnitude: float = STANDARD_GRAVITY,
        residual: ArrayLike | None = None,
        samples: int = 0,
        provenance: Mapping[str, str] = MappingProxyType({}),
        notes: Sequence[str] = (),
        imu: Imu | None = None,
        *,
        mass: float | None = None,
    ) -> None:
        if not 1 / LARGEST <= magnitude <= LARGEST:  # NaN too
            bounds = f"{1 / LARGEST:g} and {LARGEST:g} m/s^2"
            raise InputError(f"magnitude of gravity must be between {bounds}, not {magnitude}.", where="payload")
        if mass is not None:
            if weight is not None or not mass >= 0:
                raise InputError(
                    f"a mass ({mass}) must be >= 0 kg, and cannot be stated with a weight.", where="payload"
                )
            weight = np.array([0.0, 0.0, -mass * magnitude])
        vars(self).update(
            weight=_finite("weight", weight, (3,)),
            force_bias=_finite("force_bias", force_bias, (3,)),
            center_of_mass=_finite("center_of_mass", center_of_mass, (3,)),
            torque_bias=_finite("torque_bias", torque_bias, (3,)),
            covariance=_finite("covariance", covariance, (12, 12), LARGEST**2),
            magnitude=magnitude,
            residual=_finite("residual", residual, (2,)),
            samples=samples,
            provenance=MappingProxyType(dict(provenance)),
            notes=tuple(notes),
            imu=imu,
        )
        if imu is not None and (self.weight[:2].any() or self.weight[2] > 0):
            raise InputError(
                "the weight of a payload with an IMU must be (0, 0, -m g).", where="payload", hint="State the mass."
            )

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Payload:
        """Read a `Payload` from a file of `save` or `palpate calibrate payload`.

        Raises:
            InputError: the file cannot be read, or is not a payload.
        """
        return by_name("palpate.files.models.read_model")(path, cls)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the payload to a TOML file, every number to the last bit.

        Raises:
            InputError: the file cannot be written.
        """
        by_name("palpate.files.models.write_model")(path, self)

    def __reduce__(self) -> tuple[type[Payload], tuple[object, ...]]:
        """Pickle the fields, so that arrays and mappings are restored read-only."""
        values = {**vars(self), "provenance": dict(self.provenance)}
        return Payload, tuple(values[name.name] for name in fields(self))

    def __repr__(self) -> str:
        held = f"{self.mass:.4g} kg at {vector(1e3 * self.center_of_mass, 1)} mm" if self.weight.any() else "no weight"
        held += "" if self.imu is None else ", gravity from an IMU"
        bias = f"bias {vector(self.force_bias)} N, {vector(self.torque_bias, 4)} N m"
        return f"Payload({held}, {bias}{f', from {self.samples:,} samples' if self.samples else ''})"

    @property
    def mass(self) -> float:
        """Mass [kg], the weight over `magnitude`."""
        return float(np.linalg.norm(self.weight)) / self.magnitude

    @property
    def gravity(self) -> Float[np.ndarray, "3"]:
        """Gravity (3,) [m/s^2] in the base frame, of the stated magnitude; NaN without weight."""
        if not self.weight.any():
            return np.full(3, np.nan)
        return self.weight * (self.magnitude / float(np.linalg.norm(self.weight)))

    def compensate(
        self,
        wrenches: Float[np.ndarray, "*batch 6"],
        rotations: Float[np.ndarray, "*batch 3 3"] | None,
        accelerations: Float[np.ndarray, "*batch 3"] | None = None,
    ) -> tuple[Float[np.ndarray, "*batch 6"], Float[np.ndarray, "*batch 6 6"]]:
        """Return the wrench of the contact alone, and the covariance that the payload's uncertainty adds to it.

        An accelerated payload weighs u = R^T w - m a, so that

            F_contact = F_s - f0 - u,    M_contact = M_s - m0 - c x u.

        The acceleration of the sensor's origin is taken for that of the payload's centre, and the payload's rotational
        inertia is left out.

        Args:
            wrenches: (*batch, 6) [N, N m] in the sensor frame.
            rotations: (*batch, 3, 3), sensor in base; a NaN in one gives a NaN wrench. None: the payload has no weight,
                or an IMU.
            accelerations: (*batch, 3) [m/s^2] of the sensor's origin in the sensor frame, without gravity; None: at
                rest. With an IMU its readings, gravity included. Beyond 1e9 it gives a NaN wrench.

        Returns:
            Wrenches (*batch, 6) in the sensor frame and covariances (*batch, 6, 6), an error common to all samples.

        Raises:
            InputError: no rotations for a payload that weighs something; with an IMU rotations, or no readings of it;
                arrays of other shapes.
        """
        if self.imu is not None:
            if accelerations is None or rotations is not None:
                what = "the payload takes gravity from an IMU: give accelerations, as it reads them, and no rotations."
                raise InputError(what, where="payload")
            flat = np.broadcast_to(accelerations, (*wrenches.shape[:-1], 3)).reshape(-1, 3)
            rotations, accelerations = (
                each.reshape(*wrenches.shape[:-1], *each.shape[1:]) for each in self.imu.upright(flat, self.magnitude)
            )
        transposed = self._base_in_sensor(wrenches, rotations)
        weight = transposed @ self.weight
        jacobian_weight = transposed
        if accelerations is not None:
            accelerations = np.where(np.abs(accelerations) <= LARGEST, accelerations, np.nan)
            weight = weight - self.mass * accelerations
            direction = self.gravity / self.magnitude if self.weight.any() else np.zeros(3)
            jacobian_weight = transposed - accelerations[..., :, None] * (direction / self.magnitude)
        load = np.concatenate([weight + self.force_bias, np.cross(self.center_of_mass, weight) + self.torque_bias], -1)
        jacobian = self.load_jacobian(jacobian_weight, weight)  # of the load; the contact's is its negative
        return wrenches - load, jacobian @ self.load_covariance @ np.swapaxes(jacobian, -1, -2)

    def load_jacobian(
        self, turn: Float[np.ndarray, "*batch 3 3"], weight: Float[np.ndarray, "*batch 3"]
    ) -> Float[np.ndarray, "*batch 6 p"]:
        """Return the Jacobian (*batch, 6, p) of the load by the parameters of `load_covariance`.

        Args:
            turn: (*batch, 3, 3) Jacobian of the payload's force in the sensor's frame by its weight.
            weight: (*batch, 3) [N] that force.
        """
        jacobian = np.zeros((*weight.shape[:-1], 6, 12 if self.imu is None else 15))
        jacobian[..., :3, :3] = turn
        jacobian[..., 3:, :3] = skew(self.center_of_mass) @ turn
        jacobian[..., :3, 3:6] = np.eye(3)
        jacobian[..., 3:, 6:9] = -skew(weight)
        jacobian[..., 3:, 9:12] = np.eye(3)
        if self.imu is not None:
            jacobian[..., :3, 12:] = skew(weight)
            jacobian[..., 3:, 12:] = skew(self.center_of_mass) @ skew(weight)
        return jacobian

    @property
    def load_covariance(self) -> Float[np.ndarray, "p p"]:
        """Covariance (12, 12) of the parameters; with an IMU (15, 15), with its rotation vector [rad] behind them.

        An error of the IMU's bias is one of the biases of force and torque, into which it is put.
        """
        if self.imu is None:
            return self.covariance
        joint = self.joint_covariance
        push, parts = self.mass * self.imu.rotation.T, np.eye(15, 18)
        parts[3:6, 15:], parts[9:12, 15:] = push, skew(self.center_of_mass) @ push
        return parts @ joint @ parts.T

    @property
    def joint_covariance(self) -> Float[np.ndarray, "p p"]:
        """Covariance (12, 12), or with an IMU (18, 18), with its rotation vector [rad] and bias [m/s^2] behind."""
        if self.imu is None:
            return self.covariance
        own = self.imu.covariance
        return np.block([[self.covariance, own[:, :12].T], [own]])

    def _base_in_sensor(self, wrenches: np.ndarray, rotations: np.ndarray | None) -> np.ndarray:
        """Return R^T, every entry NaN where one is."""
        if rotations is None:
            if self.weight.any() or self.covariance[:3, :3].any():
                newtons = float(np.linalg.norm(self.weight))
                raise InputError(
                    f"the payload weighs {newtons:.3g} N, so the orientation of the sensor is needed.",
                    where="payload",
                    hint="Record the orientation, or use a payload without weight (a tare).",
                )
            rotations = np.broadcast_to(np.eye(3), (*wrenches.shape[:-1], 3, 3))
        lost = ~np.isfinite(rotations).all(axis=(-2, -1), keepdims=True)
        return np.where(lost, np.nan, np.swapaxes(rotations, -1, -2))


def _finite(
    name: str, values: ArrayLike | None, shape: tuple[int, ...], largest: float = LARGEST
) -> Float[np.ndarray, "..."]:
    """Return a read-only copy of this shape, zeros for None."""
    array = frozen(np.zeros(shape) if values is None else values, tail=shape, name=name)
    if array.shape != shape or not np.all(np.abs(array) <= largest):
        raise InputError(f"{name} must be finite numbers of shape {shape}, at most {largest:g}.", where="payload")
    return array
