"""`palpate simulate hand` and `humanoid`: sessions in which each sensor alone finds its touches."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest

from palpate.cli import main
from palpate.spatial.pose import Pose
from palpate_lab.simulation.robot.bodies import humanoid

pytest.importorskip("mujoco")
pytest.importorskip("rosbags")

_TABLES = ("filter", "estimate", "contacts")


@pytest.fixture(autouse=True)
def few_presses(monkeypatch: pytest.MonkeyPatch) -> None:
    """Calibrate pads roughly: a second instead of five."""
    monkeypatch.setattr("palpate_lab.cli.robot_models._PRESSES", 40)


def _simulate(robot: str, *words: str | Path) -> int:
    return main(["simulate", robot, *(str(word) for word in words)])


def _alone(folder: Path, name: str) -> Path:
    """Write a rig of one sensor with the keys of its table in the robot's rig."""
    rig = tomllib.loads((folder / "robot.toml").read_text(encoding="utf-8"))
    table: dict[str, Any] = rig["sensors"][name]
    kind, link = table.pop("kind"), table.pop("link")
    made = {each: table.pop(each) for each in _TABLES if each in table}
    surface = {"urdf": "robot.urdf", "link": table.pop("surface", {"link": link})["link"]}
    if kind == "force_torque":
        hand = next(each for each in humanoid(np.random.default_rng(0)).links if each.name == surface["link"])
        made["orientation"] = {"urdf": "robot.urdf", "joints": "/joint_states", "base": "torso", "sensor": link}
        made["acceleration"] = {"from_poses": True}
        surface["pose"] = _stated(hand.origin())
    tables = {"surface": surface, kind: table, **made}
    lines = [f"[{each}]\n" + "\n".join(f"{k} = {_toml(v)}" for k, v in keys.items()) for each, keys in tables.items()]
    path = folder / f"alone_{name}.toml"
    path.write_text("\n\n".join(lines), encoding="utf-8")
    return path


def _stated(pose: Pose) -> dict[str, list[float]]:
    return {"xyz": pose.translation.tolist(), "quaternion_xyzw": pose.quaternion().tolist()}


def _toml(value: object) -> str:
    text = json.dumps(value)
    return re.sub(r'"(\w+)": ', r"\1 = ", text) if isinstance(value, dict) else text


def _errors(folder: Path, name: str) -> np.ndarray:
    """Return the distances [m] of contacts from the true points of a sensor, where the full force acts."""
    found, log = folder / f"{name}.csv", str(folder / "run.mcap")
    assert main(["estimate", log, "--rig", str(_alone(folder, name)), "-o", str(found)]) == 0
    truth = polars.read_csv(folder / "truth.csv").filter((polars.col("sensor") == name) & (polars.col("share") > 0.999))
    contacts = polars.read_csv(found, infer_schema_length=None).filter(polars.col("px").is_not_null())
    time, point = contacts["time"].to_numpy(), contacts.select("px", "py", "pz").to_numpy()
    errors = list[float]()
    for row in truth.select("time", "px", "py", "pz").to_numpy():
        there = np.abs(time - row[0]) < 4e-4
        errors.append(float(np.linalg.norm(point[there] - row[1:], axis=1).min(initial=np.inf)))
    return np.array(errors)


def test_each_kind_of_sensor_alone_finds_its_touches(tmp_path: Path) -> None:
    """To a millimetre, median: a quarter of a pad's pitch, and an eighth of a sheet's."""
    for robot, names in (("hand", ("thumb", "ring")), ("humanoid", ("left_forearm", "left_wrist"))):
        folder = tmp_path / robot
        options = ("--seed", "2", "--seconds", "14", "--touches", "40" if robot == "humanoid" else "20", "--free", "0")
        assert _simulate(robot, "-o", folder, *options) == 0
        for name in names:
            errors = _errors(folder, name)
            assert len(errors) > 30, name
            assert np.median(errors) < 1e-3, name
            assert np.isfinite(errors).mean() > 0.95, name


def test_the_session_is_complete_and_tells_what_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "run"
    assert _simulate("hand", "-o", folder, "--seconds", "6", "--touches", "2", "--free", "6", "--encoder", "0.2") == 0
    assert "13 joints" in capsys.readouterr().out
    files = {"run.mcap", "free.mcap", "robot.urdf", "robot.xml", "robot.toml", "truth.csv", "meshes"}
    rig = tomllib.loads((folder / "robot.toml").read_text(encoding="utf-8"))
    named = {
        str(table[key]) for table in rig["sensors"].values() for key in ("model", "taxels", "response") if key in table
    }
    assert {path.name for path in folder.iterdir()} == files | named
    assert rig["robot"]["encoder"] == 0.2
