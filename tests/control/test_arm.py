"""An arm: placed and moved as pinocchio, a product of poses and finite differences say; what is missing is said."""

import pickle
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.control.arm import Arm
from palpate.errors import InputError
from palpate.files.arm import load_arm
from palpate.spatial.pose import Pose
from tests.support.arms import SIX, SLIDING, write_arm

pin: Any = import_module("pinocchio")
POINT = np.array([0.01, -0.02, 0.15])
ARMS = [(SIX, "base", "ft"), (SIX, "link2", "link5"), (SIX, "link5", "base"), (SLIDING, "a", "ft"), (SLIDING, "d", "a")]


def state(arm: Arm, seed: int) -> list[np.ndarray]:
    """Positions, rates and their changes."""
    rng = np.random.default_rng(seed)
    return [rng.uniform(-1.5, 1.5, len(arm.names)) for _ in range(3)]


def product(arm: Arm, q: np.ndarray) -> Pose:
    """T_base_sensor as the docstring writes it."""
    whole = Pose(arm.placements.rotation[0], arm.placements.translation[0])
    for k, value in enumerate(q):
        moved = Pose.from_rotation_vector(arm.axes[k] * value, np.zeros(3))
        if not arm.revolute[k]:
            moved = Pose(np.eye(3), arm.axes[k] * value)
        whole = whole @ moved @ Pose(arm.placements.rotation[k + 1], arm.placements.translation[k + 1])
    return whole


def pinocchios(path: Path, base: str, sensor: str, q: dict[str, float], rates: list[dict[str, float]]) -> Any:
    """Pose, Jacobian by joint, and motion of POINT, of a base that stands still."""
    model = pin.buildModelFromUrdf(str(path))
    data, numbers = model.createData(), [pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)]
    for name, value in q.items():
        one = model.joints[model.getJointId(name)]
        numbers[0][one.idx_q : one.idx_q + one.nq] = (np.cos(value), np.sin(value)) if one.nq == 2 else value
        for row, change in zip(numbers[1:], rates, strict=True):
            row[one.idx_v] = change[name]
    frame = model.addFrame(
        pin.Frame(
            "point",
            model.frames[model.getFrameId(sensor)].parentJoint,
            model.frames[model.getFrameId(sensor)].placement * pin.SE3(np.eye(3), POINT),
            pin.FrameType.OP_FRAME,
        )
    )
    data = model.createData()
    pin.forwardKinematics(model, data, *numbers)
    pin.updateFramePlacements(model, data)
    turn: np.ndarray = data.oMf[model.getFrameId(base)].rotation.T  # of a base that no joint moves
    axes = np.zeros((6, 6))
    axes[:3, :3] = axes[3:, 3:] = turn
    aligned = pin.LOCAL_WORLD_ALIGNED
    pin.computeJointJacobians(model, data, numbers[0])
    whole = axes @ pin.getFrameJacobian(model, data, frame, aligned)
    columns = np.array([whole[:, model.joints[model.getJointId(name)].idx_v] for name in q]).T
    velocity = axes @ pin.getFrameVelocity(model, data, frame, aligned).vector
    change = axes @ pin.getFrameClassicalAcceleration(model, data, frame, aligned).vector
    pose = data.oMf[model.getFrameId(base)].actInv(data.oMf[model.getFrameId(sensor)])
    return pose, columns, np.concatenate([velocity, change])


@pytest.mark.parametrize(("text", "base", "sensor"), [ARMS[0], ARMS[3]])
def test_it_moves_as_pinocchio_says(tmp_path: Path, text: str, base: str, sensor: str) -> None:
    """Lengths and rates of 1; sums of some hundred products round by 1e-14."""
    path = write_arm(tmp_path, text)
    arm = load_arm(path, base, sensor)
    for seed in range(5):
        q, rate, change = state(arm, seed)
        named = [dict(zip(arm.names, values.tolist(), strict=True)) for values in (q, rate, change)]
        pose, columns, moving = pinocchios(path, base, sensor, named[0], named[1:])
        ours, out = arm.pose(q), np.empty(12)
        arm.motion_into(q, rate, change, POINT, out)
        assert np.abs(ours.rotation - pose.rotation).max() < 1e-12
        assert np.abs(ours.translation - pose.translation).max() < 1e-12
        assert np.abs(arm.jacobian(q, POINT) - columns).max() < 1e-12
        assert np.abs(out - moving).max() < 1e-11


@pytest.mark.parametrize(("text", "base", "sensor"), ARMS)
def test_pose_jacobian_and_motion_agree(tmp_path: Path, text: str, base: str, sensor: str) -> None:
    """Central differences: h^2 f'''/6 = 4e-10 for the speed and 4e-12/h^2 rounding for the acceleration, h = 2e-5."""
    arm, h = load_arm(write_arm(tmp_path, text), base, sensor), 2e-5
    q, rate, change = state(arm, 3)
    before, now, after = (product(arm, q + t * rate + 0.5 * t * t * change) for t in (-h, 0.0, h))
    places = [pose.apply(POINT) for pose in (before, now, after)]
    out = np.empty(12)
    arm.motion_into(q, rate, change, POINT, out)
    assert np.abs(arm.pose(q).rotation - now.rotation).max() < 1e-12
    assert np.abs(arm.pose(q).translation - now.translation).max() < 1e-12
    turned = Pose(after.rotation @ before.rotation.T, np.zeros(3)).rotation_vector() / (2 * h)
    assert np.abs(out[:3] - (places[2] - places[0]) / (2 * h)).max() < 1e-7
    assert np.abs(out[3:6] - turned).max() < 1e-7
    assert np.abs(out[6:9] - (places[2] - 2 * places[1] + places[0]) / h**2).max() < 1e-5
    assert np.abs(arm.jacobian(q, POINT) @ rate - out[:6]).max() < 1e-12
    ends = [arm.jacobian(q + t * rate, POINT) @ (rate + t * change) for t in (-h, h)]
    assert np.abs((ends[1] - ends[0]) / (2 * h) - out[6:]).max() < 1e-7


@pytest.mark.parametrize(("text", "base", "sensor"), [(SIX, "base", "ft"), (SLIDING, "a", "ft")])
def test_the_way_back_is_the_inverse(tmp_path: Path, text: str, base: str, sensor: str) -> None:
    path = write_arm(tmp_path, text)
    there, back = load_arm(path, base, sensor), load_arm(path, sensor, base)
    q = state(there, 1)[0]
    round_trip = there.pose(q) @ back.pose(q[::-1])
    assert there.names == back.names[::-1]
    assert np.abs(round_trip.rotation - np.eye(3)).max() < 1e-12
    assert np.abs(round_trip.translation).max() < 1e-12


def test_limits_are_those_of_the_file(tmp_path: Path) -> None:
    arm = load_arm(str(write_arm(tmp_path, SLIDING)), "a", "ft", ["lift", "spin", "reach", "wrist"])
    assert arm.lower.tolist() == [-2.5, -np.inf, -2.5, -2.5]
    assert arm.upper.tolist() == [2.6, np.inf, 2.6, 2.6]
    assert arm.speed.tolist() == [1.57, 2.0, 1.57, 1.57]
    assert arm.middle == pytest.approx([0.05, 0.0, 0.05, 0.05])
    again = pickle.loads(pickle.dumps(arm))
    assert np.array_equal(again.limits, arm.limits)
    assert not arm.lower.flags.writeable


def test_no_file_and_arrays_of_another_shape_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"urdf: the file does not exist"):
        load_arm(tmp_path / "none.urdf", "a", "b")
    arm = load_arm(write_arm(tmp_path), "base", "ft")
    with pytest.raises(InputError, match="joints must have shape"):
        arm.pose(np.zeros(5))
    with pytest.raises(InputError, match="7 placements"):
        Arm(arm.names, Pose.identity(), arm.axes, arm.revolute, arm.lower, arm.upper, arm.speed)
