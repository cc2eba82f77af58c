"""Files for the scenes of the law of rig keys: models, maps, a log of messages in which each topic has a double."""

import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from scipy.spatial.transform import Rotation

from claims.evidence.logs_written import header, pose_stamped, vector, write_mcap
from claims.evidence.robot import TYPES, URDF, joints, transform, tree, wrench
from palpate.files.models import read_model, write_model
from palpate.sensors.load_cells.model import LoadCells
from palpate.sensors.marker_ring.model import MarkerRing
from palpate.sensors.taxels.response import TaxelResponse
from palpate_lab.simulation.shapes import icosphere
from tests.support.rig_scenes import V03

STEP, COUNT = 10**7, 60  # ns between messages
RADIUS = 0.02  # m, of the robot's tip
KINDS = {
    "/wrench": "geometry_msgs/msg/WrenchStamped",
    "/pose": "geometry_msgs/msg/PoseStamped",
    "/joints": "sensor_msgs/msg/JointState",
    "/imu": "sensor_msgs/msg/Imu",
    "/pushed": "geometry_msgs/msg/Vector3Stamped",
    "/warm": "sensor_msgs/msg/Temperature",
    "/cells": "std_msgs/msg/Float64MultiArray",
    "/skin": "std_msgs/msg/Float64MultiArray",
    "/image": "sensor_msgs/msg/Image",
}


def write_files(folder: Path) -> Path:
    """Write all of them and return the folder."""
    for name, kind in (("robot", "1.0 0.9 0.8"), ("other", "0.5 0.9 0.8")):
        text = URDF.replace("1 2 0", kind).replace("0.0 0.0 0.4", f"0 0 {kind[:3]}")
        (folder / f"{name}.urdf").write_text(text)
    for name, size in (("thick", 1.0), ("thin", 0.8)):
        _mesh(folder / name / "meshes" / "probe.stl", 1e3 * RADIUS * size)
    (folder / "boxes.urdf").write_text(_BOXES)
    (folder / "boxes2.urdf").write_text(_BOXES.replace("0.1 0.2 0.3", "0.3 0.2 0.1"))
    _shells(folder / "shells.stl")
    _places(folder)
    cells = read_model(V03 / "load_cells" / "tip.toml", LoadCells)
    ring = read_model(V03 / "marker_ring" / "ring.toml", MarkerRing)
    write_model(folder / "ring.toml", replace(ring, radius=0.06))
    write_model(folder / "tip.toml", replace(cells, matrix=1.2 * cells.matrix))
    response = TaxelResponse.guessed(12, 0.01)
    write_model(folder / "response.toml", replace(response, gains=1.5 * response.gains))
    write_model(folder / "warm.toml", replace(response, temperature=20.0, thermal=np.ones((12, 3)), fade=0.1))
    topics = {name + more: kind for name, kind in KINDS.items() for more in ("", "2")}
    tf = dict.fromkeys(("/tf", "/tf_static"), "tf2_msgs/msg/TFMessage")
    write_mcap(folder / "log.mcap", sorted(_messages(), key=lambda each: each[0]), topics | tf)
    _tables(folder)
    return folder


def _messages() -> Iterator[tuple[int, str, Any]]:
    """Each topic, and its double with other numbers; the tip is pressed in the second half."""
    rng = np.random.default_rng(0)
    angles = rng.uniform(-0.5, 0.5, 3) + np.arange(COUNT)[:, None] * [0.01, 0.02, -0.015]
    pressed, turned = _pressed(angles), Rotation.from_euler("ZYX", angles).as_quat()
    yield 0, "/tf_static", TYPES["tf2_msgs/msg/TFMessage"]([transform(0, "world", "base_link", (1.0, 2.0, 0.0))])
    for k in range(COUNT):
        stamp = STEP * k
        yield stamp, "/tf", TYPES["tf2_msgs/msg/TFMessage"]([*tree(stamp, angles[k]).transforms, _mount(stamp)])
        for more, share in (("", 1.0), ("2", 0.6)):
            yield stamp, f"/wrench{more}", wrench(stamp, share * pressed[k], "ft_sensor")
            yield stamp, f"/pose{more}", pose_stamped(stamp + STEP // 3, turned[k], share * angles[k])
            yield stamp, f"/joints{more}", joints(stamp + STEP // 3, share * angles[k])
            yield stamp, f"/imu{more}", _imu(stamp, Rotation.from_rotvec([share, 0.1, 0.01 * k]))
            pushed = vector(share * np.sin(0.2 * k + np.arange(3)))
            yield stamp, f"/pushed{more}", TYPES["geometry_msgs/msg/Vector3Stamped"](header(stamp), pushed)
            yield stamp, f"/warm{more}", TYPES["sensor_msgs/msg/Temperature"](header(stamp), 20.0 + share * k, 0.0)
            yield stamp, f"/cells{more}", _array(share * np.sin(k + np.arange(12)))
            yield stamp, f"/skin{more}", _array(share * np.arange(6.0) + k)
            yield stamp, f"/image{more}", _image(stamp, round(100 * share) + k)


def _pressed(angles: np.ndarray) -> np.ndarray:
    """Wrenches (n, 6) in the sensor, with the payload of `tests/v03`, of 4 N on the tip in the second half."""
    load = tomllib.loads((V03 / "six-axis" / "payload.toml").read_text())
    turn = Rotation.from_euler("ZYX", angles) * Rotation.from_euler("z", np.pi / 6)
    weight = turn.inv().apply(load["weight"])
    force, torque = weight + load["force_bias"], np.cross(load["center_of_mass"], weight) + load["torque_bias"]
    normal = np.array([0.48, 0.36, 0.8])
    push = np.where(np.arange(len(angles))[:, None] > len(angles) // 2, -4.0 * normal, 0.0)
    return np.column_stack([force + push, torque + np.cross(RADIUS * normal + [0.0, 0.0, 0.085], push)])


def _mount(stamp: int) -> Any:
    return transform(stamp, "flange", "ft_sensor", (0, 0, 0.05), Rotation.from_euler("z", np.pi / 6).as_quat())


def _imu(stamp: int, turn: Rotation) -> Any:
    known, nothing = np.zeros(9), vector(np.array([0.0, 0.0, 9.81]))
    make = TYPES["sensor_msgs/msg/Imu"]
    turned = TYPES["geometry_msgs/msg/Quaternion"](*turn.as_quat())
    return make(header(stamp, "base_link"), turned, known, nothing, known, nothing, known)


def _image(stamp: int, grey: int) -> Any:
    pixels = np.full(64, grey, np.uint8)
    return TYPES["sensor_msgs/msg/Image"](header(stamp), 8, 8, "mono8", 0, 8, pixels)


def _array(values: np.ndarray) -> Any:
    layout = TYPES["std_msgs/msg/MultiArrayLayout"]([], 0)
    return TYPES["std_msgs/msg/Float64MultiArray"](layout, np.asarray(values, dtype=float))


def _mesh(path: Path, radius: float) -> None:
    import trimesh

    path.parent.mkdir(parents=True)
    vertices, faces = icosphere(6)
    trimesh.Trimesh(radius * vertices, faces, process=False).export(path)


def _shells(path: Path) -> None:
    """One ball in another, mm."""
    import trimesh

    vertices, faces = icosphere(4)
    inner, outer = (trimesh.Trimesh(size * vertices, faces, process=False) for size in (20.0, 50.0))
    trimesh.util.concatenate([inner, outer]).export(path)


def _places(folder: Path) -> None:
    """Twelve taxels in a plane, and the same wider apart."""
    grid = np.stack(np.meshgrid(np.arange(4.0), np.arange(3.0)), axis=-1).reshape(-1, 2)
    for name, pitch in (("places", 0.01), ("wide", 0.012)):
        table = {"x": pitch * grid[:, 0], "y": pitch * grid[:, 1], "z": np.zeros(12)}
        normal = {"nx": np.zeros(12), "ny": np.zeros(12), "nz": np.ones(12)}
        pl.DataFrame(table | normal).write_csv(folder / f"{name}.csv")


def _tables(folder: Path) -> None:
    """Logs whose columns have doubles: of pokes as a log and one a row, of a bench, of two episodes, of poses."""
    rng, time = np.random.default_rng(1), np.arange(30) / 100.0
    wrenches = {name: rng.normal(size=30) for name in ("fx", "fy", "fz", "tx", "ty", "tz")}
    poses = dict[str, np.ndarray]()
    for more in ("", "2"):
        turns = Rotation.random(30, random_state=2 + len(more)).as_quat()
        poses |= {f"q{axis}{more}": turns[:, k] for k, axis in enumerate("xyzw")}
        poses |= {f"{axis}{more}": rng.normal(size=30) for axis in "xyz"}
    angles = {f"{name}_joint": rng.uniform(-1, 1, 30) for name in ("shoulder", "elbow", "flange")}
    taxels = {f"t{k}": np.where((time > 0.1) & (np.arange(30) % 6 == k), 40.0 + 9.0 * k, 0.0) for k in range(6)}
    log = {"time": time} | wrenches | poses | angles | taxels
    pl.DataFrame(log).write_csv(folder / "pokes_log.csv")
    pl.DataFrame({"configuration": np.arange(30) // 15} | wrenches | poses | taxels).write_csv(folder / "pokes.csv")
    later = {"time": np.concatenate([time, time + 0.005]), "episode_index": np.repeat([0, 1], 30)}
    doubled = {name: np.concatenate([values, 0.5 * values]) for name, values in wrenches.items()}
    pl.DataFrame(later | doubled).write_parquet(folder / "episodes.parquet")
    bench = {f"u{k + 1}{axis}": rng.normal(size=30) for k in range(4) for axis in "xyz"}
    known = {f"{head}_{name}": rng.normal(size=30) for head in ("ref", "alt") for name in ("fx", "fy", "fz", *"xyz")}
    pl.DataFrame({"time": time} | bench | known).write_csv(folder / "bench.csv")
    place = {axis: 0.01 * rng.normal(size=6) for axis in "xyz"} | {
        f"n{axis}": np.eye(3)[2][k] * np.ones(6) for k, axis in enumerate("xyz")
    }
    pl.DataFrame(place).write_csv(folder / "six.csv")
    six = pl.read_csv(V03 / "six-axis" / "log.csv", n_rows=250)
    stamped = six.select("qx", "qy", "qz", "qw", *"xyz", "time", stamp=1e3 * six["time"], late=1e3 * six["time"] + 40.0)
    stamped.write_csv(folder / "poses.csv")
    stamped.with_columns(x=-stamped["x"]).write_csv(folder / "poses2.csv")


_BOXES = """<robot name="boxes">
<link name="one"><visual><geometry><box size="0.1 0.2 0.3"/></geometry></visual>
<collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision></link>
<link name="two"><visual><geometry><sphere radius="0.05"/></geometry></visual></link>
<joint name="j" type="fixed"><parent link="one"/><child link="two"/></joint></robot>
"""
