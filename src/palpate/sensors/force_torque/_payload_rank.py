"""Check that a set of poses determines the payload; errors name the missing directions and the turn to add."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.errors import NotIdentifiable
from palpate.sensors.force_torque._payload_fit import force_columns, torque_columns

MIN_SINGULAR = 0.02  # orientations are only good to about a degree: a smaller singular value may be nothing but that
MAX_SHARE = 0.1  # of the weight: largest standard error of a direction of weight or bias that counts as determined


def check_poses(
    rotations: Float[np.ndarray, "n 3 3"], direction: Float[np.ndarray, "3"] | None, weight: Float[np.ndarray, "3"]
) -> None:
    """Require that the poses separate the parameters.

    The singular values of the regressors of force, on (w, f0), and torque, on (|w| c, m0), over sqrt(n) are near 1 for
    poses in all directions; below MIN_SINGULAR they may come from wrong orientations alone.

    Args:
        rotations: (n, 3, 3), sensor in base.
        direction: (3,) unit vector of gravity in the base; None: free.
        weight: (3,) [N] as fitted.

    Raises:
        NotIdentifiable: some direction is not determined; names these directions and the turn to add.
    """
    values, basis = _scaled_svd(force_columns(rotations, direction))
    if values[-1] <= MIN_SINGULAR:
        raise _force_refusal(basis[values <= MIN_SINGULAR], rotations, direction)
    if not weight.any():
        raise _noise_refusal(weight, 0.0, len(rotations), 0)
    values, basis = _scaled_svd(torque_columns(rotations, weight / np.linalg.norm(weight)))
    if values[-1] <= MIN_SINGULAR:
        raise _torque_refusal(basis[values <= MIN_SINGULAR][:, :3])


def check_noise(
    rotations: Float[np.ndarray, "n 3 3"],
    direction: Float[np.ndarray, "3"] | None,
    weight: Float[np.ndarray, "3"],
    noise: float,
) -> None:
    """Require that the poses separate the parameters despite the noise, of standard deviation `noise` [N].

    The standard error of a direction is noise / (s sqrt n) with s its singular value in `check_poses`.

    Raises:
        NotIdentifiable: that of some direction is above MAX_SHARE of the weight; states the noise and the weight.
    """
    values, _ = _scaled_svd(force_columns(rotations, direction))
    known = noise / (values * np.sqrt(len(rotations))) <= MAX_SHARE * float(np.linalg.norm(weight))
    if not known.all():
        raise _noise_refusal(weight, noise, len(rotations), int(known.sum()))


def _scaled_svd(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return singular values over sqrt(n), in decreasing order, and their directions as rows."""
    rows = columns.reshape(-1, columns.shape[-1])
    gram = rows.T @ rows / len(columns)  # values of 0.02 are far above its rounding
    values, vectors = np.linalg.eigh(gram)
    return np.sqrt(np.maximum(values[::-1], 0.0)), vectors.T[::-1]


def _force_refusal(null: np.ndarray, rotations: np.ndarray, direction: np.ndarray | None) -> NotIdentifiable:
    rank = (6 if direction is None else 4) - len(null)
    if direction is not None:
        down = rotations[0].T @ direction
        return NotIdentifiable(
            f"every pose has gravity along {named(down)} of the sensor, so the mass cannot be told from the force "
            f"bias along it. {_turn_across(down)}.",
            rank=rank,
            missing=("mass", f"force_bias along {named(down)} (sensor)"),
        )
    if len(null) > 1:
        return NotIdentifiable(
            "every pose has the same orientation, so the weight cannot be told from the force bias. "
            f"{_turn_across(np.array([0.0, 0.0, 1.0]))}.",
            rank=rank,
            missing=("weight", "force_bias"),
        )
    base, sensor = (part / np.linalg.norm(part) for part in (null[0, :3], -null[0, 3:]))
    sign = 1.0 if base[np.abs(base).argmax()] > 0 else -1.0
    base, sensor = named(sign * base), sign * sensor
    return NotIdentifiable(
        f"every pose turns about one axis, {base} of the base, which is {named(sensor)} of the sensor: the weight "
        f"along it cannot be told from the force bias along it. {_turn_across(sensor)}, or state gravity's direction "
        "if it is not that axis.",
        rank=rank,
        missing=(f"weight along {base} (base)", f"force_bias along {named(sensor)} (sensor)"),
    )


def _turn_across(axis: np.ndarray) -> str:
    """Return advice on two turns: one separates weight from bias, the other helps if the weight is along `axis`."""
    one = across(axis)
    other = np.cross(axis, one)
    turns = (named(turn if turn[np.abs(turn).argmax()] > 0 else -turn) for turn in (one, other))
    return f"Add poses turned by 30 degrees or more about {' and about '.join(turns)} of the sensor"


def _noise_refusal(weight: np.ndarray, noise: float, count: int, rank: int) -> NotIdentifiable:
    newtons = float(np.linalg.norm(weight))
    return NotIdentifiable(
        f"a weight of {newtons:.2g} N cannot be told from the force bias with these poses and residuals of the fit "
        f"({noise:.2g} N in one of {count} readings). Turn further, about two axes, or average more samples; if the "
        "sensor carries nothing, or its driver compensates for gravity already, use a payload without weight (a tare).",
        rank=rank,
        missing=("weight", "force_bias", "center_of_mass"),
    )


def _torque_refusal(null: np.ndarray) -> NotIdentifiable:
    unit = null / np.linalg.norm(null, axis=1, keepdims=True)
    names = tuple(f"center_of_mass along {named(row)} (sensor)" for row in unit)
    return NotIdentifiable(
        f"the weight's direction in the sensor varies too little: {', '.join(names)} cannot be told from the torque "
        f"bias. Add a pose turned by 30 degrees or more about {named(across(unit[0]))} of the sensor.",
        rank=6 - len(null),
        missing=(*names, "torque_bias"),
    )


def across(axis: np.ndarray) -> np.ndarray:
    other = np.eye(3)[np.abs(axis).argmin()]
    across = other - axis * (axis @ other) / (axis @ axis)
    return across / np.linalg.norm(across)


def named(axis: np.ndarray) -> str:
    """Return an axis as text: 'z', '-x', or the three numbers."""
    largest = int(np.abs(axis).argmax())
    if abs(axis[largest]) > 0.9998:  # about a degree
        return ("-" if axis[largest] < 0 else "") + "xyz"[largest]
    return "[" + ", ".join(f"{value:.2f}" for value in np.round(axis, 2) + 0.0) + "]"
