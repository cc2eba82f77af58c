"""Build an arm for a control loop from a robot description (URDF)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from palpate.control.arm import Arm
from palpate.errors import InputError
from palpate.files.units import near
from palpate.files.urdf import Joint, Urdf
from palpate.spatial.pose import Pose


def load_arm(
    urdf: str | Path, base: str, sensor: str, joints: Sequence[str] | None = None, acceleration: float = np.inf
) -> Arm:
    """Return the arm between two links: its moving joints, their limits and the fixed transforms between them.

    Args:
        urdf: the URDF file; xacro must be expanded.
        base: link that twists and poses are given in.
        sensor: link of the force/torque sensor.
        joints: names of the chain's moving joints, in its order; None: whatever they are.
        acceleration: [rad/s^2, m/s^2] limit of every joint.

    Raises:
        InputError: the file is no URDF; there is no such link or joint; nothing moves between the links, or they are
            not connected; `joints` are not those of the chain, in its order; a joint mimics another, or has no range or
            no speed limit; `acceleration` is not positive.
    """
    robot = Urdf(Path(urdf))
    steps = robot.steps(base, sensor)
    moving = [joint for joint, _ in steps if joint.kind != "fixed"]
    names, where = tuple(joint.name for joint in moving), str(urdf)
    if not names:
        what = f"links {base!r} and {sensor!r} have no moving joint between them: choose other links."
        raise InputError(what, where=where)
    _require_asked(names, joints, where)
    for joint in moving:
        if joint.mimics:
            what = f"joint {joint.name!r} follows {joint.mimics!r} and cannot be commanded by itself."
            raise InputError(what, where=where, hint="Choose a sensor link before this joint, or a base link after it.")
    places, axes = _placed(robot, steps)
    limits = np.array([[*robot.limits(joint), acceleration] for joint in moving])
    turning = np.array([joint.kind != "prismatic" for joint in moving])
    signs = np.array([1.0 if down else -1.0 for joint, down in steps if joint.kind != "fixed"])
    try:
        return Arm(names, places, signs[:, None] * axes, turning, *limits.T)
    except InputError as problem:
        raise InputError(problem.what, where=where, hint="Check the joint's <axis> and <limit>.") from problem


def _require_asked(names: tuple[str, ...], joints: Sequence[str] | None, where: str) -> None:
    """Raise an InputError if `joints` are not the chain's, in its order."""
    if joints is None or tuple(joints) == names:
        return
    for name in joints:
        if name not in names:
            raise InputError(f"there is no joint {name!r} in the chain.", where=where, hint=near(name, names))
    for name in names:
        if name not in joints:
            raise InputError(f"joint {name!r} also moves the sensor and must be named.", where=where)
    raise InputError("the joints are not in the order of the chain.", where=where, hint=f"Write {', '.join(names)}.")


def _placed(robot: Urdf, steps: list[tuple[Joint, bool]]) -> tuple[Pose, np.ndarray]:
    """Return the fixed transforms between n joints, a batch of n + 1, and the joints' axes (n, 3)."""
    fixed, places, axes = Pose.identity(), list[Pose](), list[np.ndarray]()
    for joint, down in steps:
        if down:
            fixed = fixed @ joint.origin
        if joint.kind != "fixed":
            places.append(fixed)
            axes.append(robot.axis(joint))
            fixed = Pose.identity()
        if not down:
            fixed = fixed @ joint.origin.inverse()
    places.append(fixed)
    batch = Pose([place.rotation for place in places], [place.translation for place in places])
    return batch, np.array(axes)
