"""The form of quaternions is found from a payload's weight, and is never assumed in silence."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from palpate.sensors.force_torque.orientation_form import orientation_form
from palpate.setup.new import propose_rig

FORMS = [(form, inverse) for form in ("quaternion", "quaternion_wxyz") for inverse in (False, True)]


def recorded(
    form: str, inverse: bool, *, weight: float = 4.0, based: bool = False, seed: int = 1, count: int = 120
) -> tuple[np.ndarray, np.ndarray]:
    """Return wrenches and quaternions of a turning sensor, touched in a tenth of the rows; F = R^T w + f0."""
    rng = np.random.default_rng(seed)
    turns = Slerp(np.linspace(0, 1, 8), Rotation.random(8, random_state=seed))(np.linspace(0, 1, count))
    force = turns.inv().apply([0.0, 0.0, -weight]) + [1.0, -0.5, 0.3] + 0.05 * rng.normal(size=(count, 3))
    force[: count // 10] += rng.normal(size=3) * 10
    force = turns.apply(force) if based else force
    quaternion = (turns.inv() if inverse else turns).as_quat()[
        :, [3, 0, 1, 2] if form.endswith("wxyz") else [0, 1, 2, 3]
    ]
    return np.hstack([force, 0.01 * rng.normal(size=(count, 3))]), quaternion


@pytest.mark.parametrize(("form", "inverse"), FORMS)
def test_the_weight_shows_order_and_direction(form: str, inverse: bool) -> None:
    found = orientation_form(*recorded(form, inverse, based=inverse), based=inverse)
    assert found is not None
    assert found[:2] == (form, inverse)


def test_without_a_weight_or_without_turning_nothing_is_found() -> None:
    for seed in range(3):
        assert orientation_form(*recorded("quaternion", False, weight=0.0, seed=seed)) is None
    wrenches, quaternions = recorded("quaternion_wxyz", False)
    assert orientation_form(wrenches, np.repeat(quaternions[:1], len(quaternions), axis=0)) is None


@pytest.mark.parametrize(
    "names", [("q0", "q1", "q2", "q3"), ("orientation[1]", "orientation[2]", "orientation[3]", "orientation[4]")]
)
@pytest.mark.parametrize("weight", [0.0, 4.0])
def test_a_rig_states_the_order_or_what_is_assumed(tmp_path: Path, names: tuple[str, ...], weight: float) -> None:
    wrenches, quaternions = recorded("quaternion_wxyz", False, weight=weight)
    table = np.column_stack([np.arange(len(wrenches)) / 100, wrenches, quaternions])
    header = ",".join(["time", "fx", "fy", "fz", "tx", "ty", "tz", *names])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=header, comments="")
    made = propose_rig(tmp_path / "log.csv", None, tmp_path)
    stated = tomllib.loads(made.text).get("orientation")
    if weight:
        assert stated == {"columns": list(names), "form": "quaternion_wxyz"}
    else:
        assert stated is None
        assert any("assumed" in remark and "quaternion_wxyz" in remark for remark in made.remarks)
    np.savetxt(tmp_path / "log.csv", table + 2.0, delimiter=",", header=header, comments="")
    assert "q" not in str(tomllib.loads(propose_rig(tmp_path / "log.csv", None, tmp_path).text).get("orientation", ""))


def test_arrays_of_an_archive_are_found(tmp_path: Path) -> None:
    wrenches, quaternions = recorded("quaternion_wxyz", True)
    time = np.arange(len(wrenches)) / 100
    np.savez(tmp_path / "log.npz", time=time, force=wrenches[:, :3], torque=wrenches[:, 3:], quat=quaternions)
    stated = tomllib.loads(propose_rig(tmp_path / "log.npz", None, tmp_path).text)["orientation"]
    assert stated == {"columns": [f"quat[{k}]" for k in range(4)], "form": "quaternion_wxyz", "inverse": True}
