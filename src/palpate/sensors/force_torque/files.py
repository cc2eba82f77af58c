"""The table of a payload in a model file, and its summary."""

from __future__ import annotations

import numpy as np

from palpate.files.models.model import Lines, Model
from palpate.files.schema import Key, TableForm
from palpate.files.units import measured
from palpate.signals.imu import Imu
from palpate.signals.payload import Payload


def of_payload(payload: Payload) -> Lines:
    """Return the payload's figures as a list of pairs (name, text), with standard deviations where they were fitted."""
    spread = np.sqrt(np.diag(payload.covariance))
    weight = float(np.linalg.norm(payload.weight))
    along = payload.weight / weight if weight else np.zeros(3)
    mass_spread = float(np.sqrt(along @ payload.covariance[:3, :3] @ along)) / payload.magnitude
    imu, gravity = payload.imu, f"({along[0]:.4f}, {along[1]:.4f}, {along[2]:.4f}), its direction in the base"
    return [
        ("mass", measured([payload.mass], [mass_spread], "kg")),
        ("gravity", gravity if imu is None else "from an IMU on the sensor"),
        ("centre of mass", measured(1e3 * payload.center_of_mass, 1e3 * spread[6:9], "mm")),
        ("force bias", measured(payload.force_bias, spread[3:6], "N")),
        ("torque bias", measured(payload.torque_bias, spread[9:], "N m")),
        ("residual", f"{1e3 * payload.residual[0]:.3g} mN, {1e3 * payload.residual[1]:.3g} N mm rms"),
        *([] if imu is None else _of_imu(imu)),
    ]


def _of_imu(imu: Imu) -> Lines:
    from scipy.spatial.transform import Rotation  # here: it takes 0.1 s to import

    spread = np.sqrt(np.diag(imu.covariance[:, 12:]))
    turned = Rotation.from_quat(imu.quaternion).as_rotvec(degrees=True)
    return [
        ("IMU turned", measured(turned, np.degrees(spread[:3]), "degrees, rotation vector from the sensor's axes")),
        ("IMU bias", measured(imu.bias, spread[3:], "m/s^2")),
    ]


PAYLOAD = Model(
    Payload,
    "a payload model",
    "Payload and bias of a force/torque sensor.",
    "palpate calibrate payload",
    of_payload,
    {
        Payload: TableForm(
            {
                "weight": Key("N, in the base frame", required=True),
                "force_bias": Key("N, in the sensor's frame, as all that follows", required=True),
                "center_of_mass": Key("m", required=True),
                "torque_bias": Key("N m", required=True),
                "magnitude": Key("m/s^2, of gravity: mass is |weight| over it"),
                "residual": Key("N, N m: rms of the fit", least=0.0, required=True),
                "samples": Key("that were used", least=0.0),
                "covariance": Key("of weight, force_bias, center_of_mass, torque_bias, in this order", required=True),
            }
        ),
        Imu: TableForm(
            {
                "quaternion": Key("x, y, z, w: rotation from the sensor's axes to the IMU's", required=True),
                "bias": Key("m/s^2, in the IMU's axes", required=True),
                "noise": Key("m/s^2, of one reading along each axis", least=0.0),
                "covariance": Key("of rotation [rad, the sensor's axes] and bias, with the 12 above and themselves"),
            }
        ),
    },
)
