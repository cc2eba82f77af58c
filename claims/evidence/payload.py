"""Payload: public recordings of an Axia80 on an arm, mistakes that must be named, an IMU, a payload that is off."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

import palpate
from claims.evidence import payload_imu, payload_mistakes, payload_wrong
from claims.row import Row, shared, skipped
from palpate.spatial.pose import rotation_from_quaternion

AUTHORS = np.array([-10.80391, -2.13583, -2.76399, -13.07675])  # weight along z and force bias [N], 7 poses
MASS, BIAS, CENTRE = 1.2396, np.array([-3.468, -4.577, -16.719]), np.array([-0.0010, -0.0001, 0.0451])
SWAP = [0, 2, 1, 3, 5, 4]


def rows(small: bool) -> Iterator[Row]:
    """Real recordings, turns about one axis, mistakes, an IMU, and a payload that is off."""
    folder = shared()
    if folder is None:
        yield from skipped("seven and a hundred real poses", "")
    else:
        yield from _real(folder / "data" / "payload")
    yield from _one_axis()
    yield from payload_mistakes.rows(small)
    yield from payload_imu.rows(small)
    yield from payload_wrong.rows(small)


def _real(folder: Path) -> Iterator[Row]:
    wrenches, rotations = _read(folder, "")
    payload = palpate.identify_payload(wrenches, rotations, gravity=[0, 0, -1], hypothesis="base frame")
    got = np.array([payload.weight[2], *payload.force_bias])
    met = bool(np.all(np.round(got, 5) == AUTHORS))
    yield Row("seven poses, vertical gravity: force part [N]", _list(AUTHORS, 5), _list(got, 5), met)

    wrenches, rotations = _read(folder, "_100")
    payload = palpate.identify_payload(wrenches, rotations, hypothesis="base frame")
    off = abs(payload.mass - MASS) <= 5e-4 and np.all(np.abs(payload.force_bias - BIAS) <= 0.01)
    off = bool(off and np.all(np.abs(payload.center_of_mass - CENTRE) <= 5e-4))
    target = f"{MASS} +- 0.0005 kg, {_list(BIAS, 3)} +- 0.01 N, {_list(CENTRE, 4)} +- 0.0005 m"
    got_text = f"{payload.mass:.4f} kg, {_list(payload.force_bias, 3)} N, {_list(payload.center_of_mass, 4)} m"
    yield Row("a hundred poses, gravity free: mass, bias, centre", target, got_text, off)

    # The hundred poses as logged are in the base frame, which is the mistake to name.
    sensor = np.einsum("nji,nkj->nki", rotations, wrenches.reshape(-1, 2, 3)).reshape(-1, 6)
    for what, name, mistaken in (
        ("wrenches in the base frame", "base frame", wrenches),
        ("y and z swapped", "y and z swapped", sensor[:, SWAP]),
    ):
        try:
            said = " ".join(palpate.identify_payload(mistaken, rotations).notes)
        except palpate.InputError as refusal:
            said = str(refusal)
        yield Row(f"a hundred poses, {what}", "named", said, f"hypothesis={name!r}" in said)


def _one_axis() -> Iterator[Row]:
    """Turns about one axis only: simulated, so that the truth is known."""
    rng = np.random.default_rng(31)
    bias = np.array([-3.0, 4.0, -9.0, 0.1, -0.2, 0.3])
    for axis, text, gravity, accepted in (
        ("x", "gravity free", None, False),
        ("x", "gravity given, across the axis", [0.0, 0.0, -1.0], True),
        ("z", "gravity given, along the axis", [0.0, 0.0, -1.0], False),
    ):
        rotations = _about(axis, np.linspace(0.0, 2 * np.pi, 12, endpoint=False))
        weight = np.einsum("nji,j->ni", rotations, np.array([0.0, 0.0, -12.0]))
        log = np.concatenate([weight, np.cross([0.004, -0.01, 0.05], weight)], axis=1) + bias
        log += rng.standard_normal(log.shape) * ([0.02] * 3 + [0.001] * 3)
        what = f"poses about the base's {axis} axis only, {text}"
        try:
            found = palpate.identify_payload(log, rotations, gravity=gravity)
            got, met = f"accepted: {found.mass:.4f} kg of {12 / 9.80665:.4f}", accepted
        except palpate.NotIdentifiable as refusal:
            got, met = f"refused: {refusal}", not accepted
        yield Row(what, "accepted" if accepted else "refused, naming it", got, met)


def hundred_poses() -> tuple[np.ndarray, np.ndarray] | None:
    """Wrenches (100, 6) of the real log in the sensor's frame, and rotations; None where the data is absent."""
    folder = shared()
    if folder is None:
        return None
    wrenches, rotations = _read(folder / "data" / "payload", "_100")
    return np.einsum("nji,nkj->nki", rotations, wrenches.reshape(-1, 2, 3)).reshape(-1, 6), rotations


def _read(folder: Path, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Wrenches as logged, rotated into the base frame, and rotations of the sensor in it."""
    poses = np.loadtxt(folder / f"recorded_messages_pose{name}.txt", delimiter=",")
    wrenches = np.loadtxt(folder / f"recorded_messages_wrench{name}.txt", delimiter=",")
    return wrenches, rotation_from_quaternion(poses[:, 3:])


def _about(axis: str, angles: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler(axis, angles[:, None]).as_matrix()


def _list(values: np.ndarray, digits: int) -> str:
    return "(" + ", ".join(f"{value:.{digits}f}" for value in values) + ")"
