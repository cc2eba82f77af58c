"""A mistake in a payload's log is named, with outliers in it, and its name undoes it."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import palpate
from claims.evidence.payload_mistakes import CENTRE, WEIGHT, as_logged, log
from palpate.cli import main
from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.force_torque._payload_mistakes import AS_IS, MISTAKES, REVERSED, turned
from palpate.sensors.force_torque._payload_search import likely, search

NAMES = [
    AS_IS,
    *(name for name in MISTAKES if name[:8] in ("x mirror", "y and z ") or ("and" not in name and "irr" not in name)),
]


@pytest.mark.parametrize(("name", "count"), [*((name, 8) for name in NAMES), (AS_IS, 24), (REVERSED, 24)])
def test_a_mistake_is_named_in_spite_of_outliers(name: str, count: int) -> None:
    """The others in 24 poses are in the test below."""
    wrenches, rotations = as_logged(name, *log(count, seed=count))
    assert likely(search(wrenches, rotations, None))[0].name == name


@pytest.mark.parametrize("name", [name for name in NAMES if name not in (AS_IS, REVERSED)])
def test_the_name_undoes_the_mistake(name: str) -> None:
    wrenches, rotations = as_logged(name, *log(24, 5))
    with pytest.raises(InputError) as caught:
        palpate.identify_payload(wrenches, rotations)
    assert f"hypothesis={name!r}" in caught.value.hint
    assert MISTAKES[name].rig in caught.value.hint
    payload = palpate.identify_payload(wrenches, rotations, hypothesis=name)
    np.testing.assert_allclose(payload.weight, WEIGHT, atol=0.1)  # 0.07 N / sqrt 22 seven times over
    np.testing.assert_allclose(payload.center_of_mass, CENTRE, atol=1e-3)


def test_unchecked_returns_a_payload_with_the_mistake_in_its_notes() -> None:
    wrenches, rotations = as_logged("torque in N mm", *log(24, 5))
    payload = palpate.identify_payload(wrenches, rotations, unchecked=True)
    assert any("nearer if the torque is in N mm" in note for note in payload.notes)


def test_a_turned_flange_is_found_to_a_degree() -> None:
    turn = Rotation.from_rotvec(np.radians([20.0, -30.0, 40.0]))
    force, torque, flange = log(24, 9, turn)
    wrenches, rotations = np.concatenate([force, torque], axis=1), flange.as_matrix()
    best = likely(search(wrenches, rotations, None))[0]
    found = np.radians([float(part) for part in best.name.split("(")[1].split(")")[0].split(",")])
    assert np.degrees((Rotation.from_rotvec(found) * turn.inv()).magnitude()) < 1.0
    with pytest.raises(InputError, match=r"the sensor .* is turned by .* sensor_rotation = "):
        palpate.identify_payload(wrenches, rotations)
    np.testing.assert_allclose(
        palpate.identify_payload(wrenches, rotations, hypothesis=best.name).weight, WEIGHT, atol=0.1
    )
    assert turned(np.degrees(found)) == best.name


def test_a_mistake_is_named_before_advice_on_poses() -> None:
    wrenches, rotations = as_logged("x mirrored", *log(24, 2))
    with pytest.raises(InputError, match=r"x is mirrored in force and torque.*Write") as caught:
        palpate.identify_payload(wrenches, rotations)
    assert not isinstance(caught.value, NotIdentifiable)


def test_residuals_of_no_reason_are_refused_unless_forced() -> None:
    force, torque, flange = log(24, 3)
    force += np.random.default_rng(1).normal(size=force.shape) * 3.0
    with pytest.raises(InputError, match=r"no known mistake explains it.*Check"):
        palpate.identify_payload(np.concatenate([force, torque], axis=1), flange.as_matrix())


@pytest.mark.parametrize(
    ("case", "said"),
    [
        ("ok", ""),
        ("tilted_base", ""),
        ("tared_first", ""),
        ("about_tcp", ""),
        ("drift3N", ""),
        ("mirror_x_both", 'axes = ["-x", "y", "z"] and left_handed = true'),
        ("swap_yz", 'axes = ["x", "z", "y"]'),
        ("quat_wxyz_in_xyzw", 'form = "quaternion_wxyz"'),
        ("flange_45deg", "turned by 45.1 degrees about (0, 0, -1) of the frame that is logged. Write"),
        ("flange_90deg", "turned by 90.1 degrees about (0, 0, -1) of the frame that is logged. Write"),
        ("compensated", "compensates for gravity already"),
    ],
)
def test_real_poses_with_a_common_mistake(shared: Path, tmp_path: Path, capsys, case: str, said: str) -> None:
    given = shared / "cases" / "ft" / "payload_frames" / f"{case}.csv"
    output = tmp_path / "payload.toml"
    code = main(["calibrate", "payload", str(given), "-o", str(output)])
    assert (code == 0) is (said == "")
    assert output.exists() is (said == "")
    assert said in capsys.readouterr().err
