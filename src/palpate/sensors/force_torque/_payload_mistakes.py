"""Known mistakes in how a log's wrenches and orientations were recorded, and how each is undone.

A log is made in this order: the sensor measures a wrench; its driver may mirror or swap axes of the force, of the
torque or of both, write N mm, or report the reaction; the wrench may be rotated into the base. The orientation may be
stored in another order or direction, or be that of a flange on which the sensor is turned.
"""

from __future__ import annotations

import re
from dataclasses import field
from math import radians

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.spatial.arguments import frozen_value
from palpate.spatial.pose import Pose, quaternion_from_rotation, rotation_from_quaternion

__all__ = ["AS_IS", "BASE", "MISTAKES", "REVERSED", "Mistake", "compose", "corrected", "parts", "reoriented", "turned"]

AS_IS = "as is"
BASE = "base frame"
REVERSED = "sign reversed"
_TURNED = re.compile(r"sensor turned by \(([^,()]+), ([^,()]+), ([^,()]+)\) deg")


@frozen_value
class Mistake:
    """A known mistake in a log, with what undoes it; a mistake of axes, sign or unit is its own kind of `matrices`.

    Attributes:
        meaning: what is wrong, for a sentence that begins with "the log fits better if".
        rig: setting of a rig that undoes it.
        cost: how unlikely it is; of mistakes that explain a log equally well the cheapest is named.
        force, torque: (3, 3) factor that takes the sensor's force or torque to that of the log.
        based: whether force and torque are written in the base frame.
        table: table of a rig that has the setting.
        orientation: "inverse" or "w first", as `reoriented` takes it; "": as it should be.
    """

    meaning: str
    rig: str
    cost: float = 1.0
    force: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))
    torque: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))
    based: tuple[bool, bool] = (False, False)
    orientation: str = ""
    table: str = "force_torque"


def _of_axes() -> dict[str, Mistake]:
    """Return each mirrored axis and each swapped pair: of force and torque, of the force, of the torque."""
    found: dict[str, Mistake] = {}
    for name, order, signs in (
        *((f"{'xyz'[k]} mirrored", (0, 1, 2), np.where(np.arange(3) == k, -1.0, 1.0)) for k in range(3)),
        *((f"{a} and {b} swapped", order, np.ones(3)) for a, b, order in _SWAPS),
    ):
        matrix = np.eye(3)[list(order)] * signs[:, None]
        axes = ", ".join(f'"{"-" if sign < 0 else ""}{"xyz"[k]}"' for k, sign in zip(order, signs, strict=True))
        what = name.replace("mirrored", "is mirrored").replace("swapped", "are swapped")
        both = f"axes = [{axes}] and left_handed = true"
        found[name] = Mistake(f"{what} in force and torque", both, 1.0, matrix, matrix)
        other = 'torque_axes = ["x", "y", "z"]'
        found[f"{name} (force)"] = Mistake(f"{what} in the force alone", f"{both}, {other}", 1.2, force=matrix)
        alone = f"torque_axes = [{axes}]"
        found[f"{name} (torque)"] = Mistake(f"{what} in the torque alone", alone, 1.4, torque=matrix)
    return found


_SWAPS = (("x", "y", (1, 0, 2)), ("y", "z", (0, 2, 1)), ("x", "z", (2, 1, 0)))
MISTAKES = {
    "inverse rotations": Mistake(
        "the rotations are base in sensor", "inverse = true", orientation="inverse", table="orientation"
    ),
    "w first": Mistake(
        "the quaternions are w, x, y, z", 'form = "quaternion_wxyz"', orientation="w first", table="orientation"
    ),
    BASE: Mistake("the wrenches are written in the base frame", 'frame = "base"', based=(True, True)),
    f"{BASE} (force)": Mistake(
        "the force is written in the base frame, and the torque in the sensor's",
        'frame = "base", torque_frame = "sensor"',
        based=(True, False),
    ),
    f"{BASE} (torque)": Mistake(
        "the torque is written in the base frame, and the force in the sensor's",
        'torque_frame = "base"',
        1.2,
        based=(False, True),
    ),
    **_of_axes(),
    REVERSED: Mistake(
        "the sensor reports the reaction", 'acts_on = "environment"', force=-np.eye(3), torque=-np.eye(3)
    ),
    "torque in N mm": Mistake("the torque is in N mm", 'torque = "N mm" in units', torque=1e3 * np.eye(3)),
}


def compose(*hypotheses: str) -> str:
    """Join several names into one, in the order of `MISTAKES`; "as is" without any."""
    given = {part for name in hypotheses for part in parts(name)}
    return " + ".join([*(part for part in MISTAKES if part in given), *sorted(given - MISTAKES.keys())]) or AS_IS


def parts(hypothesis: str) -> tuple[str, ...]:
    """Return the simple names in a name such as "base frame + sign reversed".

    Raises:
        InputError: a simple name is not known.
    """
    found = tuple(part.strip() for part in hypothesis.split("+") if part.strip() not in ("", AS_IS))
    unknown = [part for part in found if part not in MISTAKES and not _TURNED.fullmatch(part)]
    if unknown:
        known = ", ".join(repr(name) for name in (AS_IS, *MISTAKES, "sensor turned by (0, 0, 90) deg"))
        raise InputError(
            f"hypothesis {unknown[0]!r} is not known.", hint=f"Use one of these, or several joined by ' + ': {known}."
        )
    return found


def turned(rotation_vector: Float[np.ndarray, "3"]) -> str:
    """Return the name of a sensor turned on its flange by a rotation vector (3,) [degrees] in the flange's frame."""
    return "sensor turned by ({:.1f}, {:.1f}, {:.1f}) deg".format(*rotation_vector + 0.0)


def of_turn(part: str) -> Pose | None:
    """Return the sensor's pose in the flange of a name by `turned`; None of any other name."""
    if (match := _TURNED.fullmatch(part)) is None:
        return None
    return Pose.from_rotation_vector([radians(float(number)) for number in match.groups()], np.zeros(3))


def mistake_of(part: str) -> Mistake:
    """Return the mistake of a simple name."""
    if (turn := of_turn(part)) is None:
        return MISTAKES[part]
    vector = np.degrees(turn.rotation_vector())
    angle = float(np.linalg.norm(vector))
    x, y, z = (round(number / angle, 2) + 0.0 for number in vector)
    what = "the sensor (or else the axes of its numbers: touch a known place to see which)"
    meaning = f"{what} is turned by {angle:.1f} degrees about ({x:g}, {y:g}, {z:g}) of the frame that is logged"
    rig = f"sensor_rotation = [{', '.join(f'{number:.5g}' for number in turn.quaternion() + 0.0)}]"
    return Mistake(meaning, rig, 1.5, table="orientation")


def reoriented(rotations: Float[np.ndarray, "n 3 3"], orientation: str) -> Float[np.ndarray, "n 3 3"]:
    """Return rotations as they are if the log stored them as "inverse", "w first", or "w first inverse"."""
    if "w first" in orientation:
        rotations = rotation_from_quaternion(quaternion_from_rotation(rotations)[:, [1, 2, 3, 0]])
    return rotations.swapaxes(-1, -2) if "inverse" in orientation else rotations


def corrected(
    wrenches: Float[np.ndarray, "n 6"], rotations: Float[np.ndarray, "n 3 3"], hypothesis: str
) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 3 3"]]:
    """Return wrenches in the sensor frame and rotations of the sensor in the base if the hypothesis is true."""
    names = parts(hypothesis)
    found = [mistake_of(name) for name in names]
    rotations = reoriented(rotations, " ".join(mistake.orientation for mistake in found))
    for turn in map(of_turn, names):
        rotations = rotations if turn is None else rotations @ turn.rotation
    halves = [wrenches[:, :3], wrenches[:, 3:]]
    for k in range(2):
        if any(mistake.based[k] for mistake in found):
            halves[k] = np.einsum("nji,nj->ni", rotations, halves[k])
        for mistake in found:
            halves[k] = halves[k] @ np.linalg.inv((mistake.force, mistake.torque)[k]).T
    return np.concatenate(halves, axis=1), rotations
