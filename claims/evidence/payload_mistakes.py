"""Mistakes in payload logs with outliers: are they named, and nothing else?"""

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

import palpate
from claims.row import Row

WEIGHT, CENTRE = np.array([0.0, 0.0, -9.0]), np.array([0.02, -0.03, 0.05])
AXES = {
    **{f"{axis} mirrored": np.diag(1.0 - 2.0 * np.eye(3)[k]) for k, axis in enumerate("xyz")},
    **{f"{a} and {b} swapped": np.eye(3)[order] for a, b, order in (("x", "y", [1, 0, 2]), ("y", "z", [0, 2, 1]))},
}
MISTAKES = (  # names as `identify_payload(hypothesis=...)` takes them
    "inverse rotations", "w first", "base frame", "base frame (force)", "base frame (torque)", "torque in N mm",
    *(f"{name}{part}" for name in AXES for part in ("", " (force)", " (torque)")),
)  # fmt: skip


def log(count: int, seed: int, turn: Rotation | None = None) -> tuple[np.ndarray, np.ndarray, Rotation]:
    """Return forces, torques and logged rotations of poses, two of which were touched."""
    rng = np.random.default_rng(seed)
    flange = Rotation.random(count, random_state=rng)
    weights = (flange if turn is None else flange * turn).inv().apply(WEIGHT)
    force = weights + [5.0, -2.0, 8.0] + rng.normal(size=(count, 3)) * 0.07
    torque = np.cross(CENTRE, weights) + [0.3, -0.2, 0.1] + rng.normal(size=(count, 3)) * 0.004
    touched = rng.choice(count, 2, replace=False)
    force[touched] += rng.normal(size=(2, 3)) * 5.0
    torque[touched] += rng.normal(size=(2, 3)) * 0.5
    return force, torque, flange


def as_logged(name: str, force: np.ndarray, torque: np.ndarray, flange: Rotation) -> tuple[np.ndarray, np.ndarray]:
    """Return wrenches and rotation matrices as a log with the mistake has them, written without the code under test."""
    if name == "inverse rotations":
        flange = flange.inv()
    if name == "w first":
        flange = Rotation.from_quat(flange.as_quat()[:, [3, 0, 1, 2]])
    if name.startswith("base frame"):
        force = force if "(torque)" in name else flange.apply(force)
        torque = torque if "(force)" in name else flange.apply(torque)
    for word, matrix in AXES.items():
        if word in name:
            force = force if "(torque)" in name else force @ matrix
            torque = torque if "(force)" in name else torque @ matrix
    if name == "sign reversed":
        force, torque = -force, -torque
    if name == "torque in N mm":
        torque = 1e3 * torque
    return np.concatenate([force, torque], axis=1), flange.as_matrix()


def rows(small: bool) -> Iterator[Row]:
    """Name each mistake in 24 and in 8 poses; small: some in 8."""
    seeds, names = (1, MISTAKES[::6]) if small else (20, MISTAKES)
    for count in (8,) if small else (24, 8):
        said = [(name, _named(*as_logged(name, *log(count, seed)))) for name in names for seed in range(seeds)]
        right = sum(name == found for name, found in said)
        wrong = sum(found not in (name, "") for name, found in said)
        got = f"right {right} of {len(said)}, wrong {wrong}, not named {len(said) - right - wrong}"
        what = f"{len(names)} mistakes in {count} poses, two of them touched"
        yield Row(what, "right >= 95 %, wrong <= 1 %", got, right >= 0.95 * len(said) and wrong <= 0.01 * len(said))
        good = [_named(*as_logged("", *log(count, seed))) for seed in range(100, 100 + 2 * seeds)]
        got = f"{sum(map(bool, good))} of {len(good)}"
        yield Row(f"a mistake named in good logs of {count} poses", "0", got, not any(good))
    off = [_turned_off(seed) for seed in range(seeds)]
    yield Row("a flange turned by any rotation: largest error", "1 deg", f"{max(off):.2f} deg", max(off) <= 1.0)


def _named(wrenches: np.ndarray, rotations: np.ndarray) -> str:
    """Return the hypothesis that the refusal names first, or "" where the log is taken as it is or none is named."""
    try:
        palpate.identify_payload(wrenches, rotations)
    except palpate.InputError as refusal:
        return (refusal.hint or "").partition("hypothesis='")[2].partition("'")[0]
    except palpate.NotIdentifiable:
        return ""
    return ""


def _turned_off(seed: int) -> float:
    """Return the error [deg] of the rotation that is named for a flange turned by more than 10 degrees."""
    turn = Rotation.from_rotvec(np.random.default_rng(500 + seed).normal(size=3))
    force, torque, flange = log(24, seed, turn)
    name = _named(np.concatenate([force, torque], axis=1), flange.as_matrix())
    if not name.startswith("sensor turned"):
        return np.inf
    found = Rotation.from_rotvec([float(part) for part in name.split("(")[1].split(")")[0].split(",")], degrees=True)
    return float(np.degrees((found * turn.inv()).magnitude()))
