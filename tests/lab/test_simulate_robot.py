"""`palpate simulate hand` and `humanoid`: sessions in which each sensor alone finds its touches."""

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
from tests.conformance.fields import run
from tests.support.robots import rough_pads

pytest.importorskip("mujoco")
pytest.importorskip("rosbags")

_TABLES = ("filter", "estimate", "contacts")


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Sessions of both robots, whose pads are calibrated roughly."""
    made = tmp_path_factory.mktemp("robots")
    asked = {"hand": (13, "--touches 12 --free 6 --encoder 0.2"), "humanoid": (14, "--touches 24 --free 0")}
    with rough_pads():
        for robot, (joints, words) in asked.items():
            said = run("simulate", robot, "-o", str(made / robot), "--seed", "2", "--seconds", "8", *words.split())
            assert f"{joints} joints" in said
    return {robot: made / robot for robot in asked}


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
    found, log = folder.with_name(f"{name}.csv"), str(folder / "run.mcap")
    assert main(["estimate", log, "--rig", str(_alone(folder, name)), "-o", str(found)]) == 0
    truth = polars.read_csv(folder / "truth.csv").filter((polars.col("sensor") == name) & (polars.col("share") > 0.999))
    contacts = polars.read_csv(found, infer_schema_length=None).filter(polars.col("px").is_not_null())
    time, point = contacts["time"].to_numpy(), contacts.select("px", "py", "pz").to_numpy()
    errors = list[float]()
    for row in truth.select("time", "px", "py", "pz").to_numpy():
        there = np.abs(time - row[0]) < 4e-4
        errors.append(float(np.linalg.norm(point[there] - row[1:], axis=1).min(initial=np.inf)))
    return np.array(errors)


@pytest.mark.parametrize(
    ("robot", "name"), [("hand", "thumb"), ("hand", "ring"), ("humanoid", "left_forearm"), ("humanoid", "left_wrist")]
)
def test_each_kind_of_sensor_alone_finds_its_touches(folders: dict[str, Path], robot: str, name: str) -> None:
    """To a millimetre, median: a quarter of a pad's pitch, and an eighth of a sheet's."""
    errors = _errors(folders[robot], name)
    assert len(errors) > 15
    assert np.median(errors) < 1e-3
    assert np.isfinite(errors).mean() > 0.95


def test_the_session_is_complete_and_tells_what_it_is(folders: dict[str, Path]) -> None:
    files = {"run.mcap", "free.mcap", "robot.urdf", "robot.xml", "robot.toml", "truth.csv", "meshes"}
    rig = tomllib.loads((folders["hand"] / "robot.toml").read_text(encoding="utf-8"))
    named = {
        str(table[key]) for table in rig["sensors"].values() for key in ("model", "taxels", "response") if key in table
    }
    made = {path.name for path in folders["hand"].iterdir()}
    assert {name for name in made if not name.startswith("alone_")} == files | named
    assert rig["robot"]["encoder"] == 0.2
