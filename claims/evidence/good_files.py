"""One short session in every format that is read, with a rig that has every table: what mutations start from."""

import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import tomlkit
import trimesh
from rosbags.rosbag1 import Writer as Writer1

from claims.command import must
from claims.evidence.logs_written import ROS1, ROS2, STAMPED, write_ros2
from claims.evidence.mcap_records import CHANNEL, MESSAGE, SCHEMA, Record, chunk, chunk_records, pack, unpack
from palpate_lab.simulation import Session, simulate_session, write_session
from palpate_lab.simulation.session_files import POSE_TOPIC, WRENCH_TOPIC
from palpate_lab.simulation.session_mcap import write_session_mcap

SAMPLES = 300  # of the touches: one of them, and what is before it
MCAP = {"plain": None, "stored": "", "lz4": "lz4", "zstd": "zstd"}
PLANE = """[surface]
kind = "plane"
point = [0.0, 0.0, 0.0]
normal = [0.0, 0.0, 1.0]
half_width = 0.2

[filter]
kind = "zero_phase"
cutoff = 20
order = 3
rate = 200.0

[orientation]
offset = 0.03
max_gap = 0.25
"""


def write_good(folder: Path) -> None:
    """Logs touches.* and free_motion.csv, rigs, payload.toml, probe.*, contacts.*, truth.csv, marks.csv."""
    session = simulate_session(touches=2, facets=80)
    write_session(session, folder)
    must("calibrate", "payload", str(folder / "free_motion.csv"), "-o", str(folder / "payload.toml"))
    write_session(_shorter(session), folder)
    write_session_mcap(_shorter(session), folder)
    _tables(folder)
    _rigs(folder)
    _meshes(folder)
    _topics(folder)
    for suffix in ("csv", "parquet", "mcap"):
        command = ("estimate", "touches.csv", "--rig", "rig.toml", "-o", f"contacts.{suffix}")
        must(*(str(folder / word) if "." in word else word for word in command))


def _shorter(session: Session) -> Session:
    touches, free = session.touches.picked(slice(SAMPLES)), session.free_motion.picked(slice(0, None, 10))
    return replace(session, touches=touches, free_motion=free)


def _tables(folder: Path) -> None:
    log = pl.read_csv(folder / "touches.csv")
    others = {
        name: 0.1 * np.sin(np.arange(log.height) / (20 + k)) for k, name in enumerate(("x", "y", "z", "ax", "ay", "az"))
    }
    log = log.with_columns(**{name: pl.Series(values).round(6) for name, values in others.items()})
    log.write_csv(folder / "touches.csv")
    log.write_parquet(folder / "touches.parquet", row_group_size=97, compression="uncompressed")


def _rigs(folder: Path) -> None:
    (folder / "rig_plane.toml").write_text(PLANE)
    full: Any = tomlkit.parse((folder / "rig.toml").read_text())
    full["surface"]["region"] = {"box": [[-1.0] * 3, [1.0] * 3]}
    full["surface"]["pose_covariance"] = (1e-6 * np.eye(6)).tolist()
    full["time"] = {"column": "time", "unit": "s"}
    full["force_torque"]["left_handed"] = False
    full["orientation"].update({"position": ["x", "y", "z"], "offset": 0.03, "max_gap": 0.25})
    full["acceleration"] = {"kind": "imu", "from_poses": True, "window": 0.1}
    (folder / "rig_imu.toml").write_text(tomlkit.dumps(full))
    full["acceleration"] = {"columns": ["ax", "ay", "az"], "kind": "motion", "from_poses": False}
    full["filter"] = {"kind": "kalman", "q": 1e-6, "r": 2e-4}
    full["estimate"]["tare"] = 0.05
    (folder / "rig_full.toml").write_text(tomlkit.dumps(full))


def _meshes(folder: Path) -> None:
    mesh: Any = trimesh.load_mesh(folder / "probe.stl", process=False)
    mesh.export(folder / "ascii.stl", file_type="stl_ascii")
    mesh.merge_vertices()
    for suffix in ("obj", "ply"):
        mesh.export(folder / f"probe.{suffix}")


def _topics(folder: Path) -> None:
    """MCAP in four forms, a ROS 1 bag, and the folder of a ROS 2 bag in SQLite."""
    records: list[Record] = []
    for kind, content in unpack((folder / "touches.mcap").read_bytes())[0]:
        records += chunk_records(content)[0] if kind == 6 else [(kind, content)]
    declared = [record for record in records if record[0] in (SCHEMA, CHANNEL)][:4]
    messages = [record for record in records if record[0] == MESSAGE]
    for name, compression in MCAP.items():
        (folder / f"{name}.mcap").write_bytes(_mcap(declared, messages, compression))
    _bags(folder, messages, declared)


def _mcap(declared: list[Record], messages: list[Record], compression: str | None) -> bytes:
    """With an index of channels and counts at its end, as the libraries write it."""
    data: list[Record] = [(1, struct.pack("<I4sI", 4, b"ros2", 0))]
    if compression is None:
        data += [*declared, *messages]
    else:
        data += [
            chunk([*(declared if k == 0 else ()), *messages[k : k + 60]], compression)
            for k in range(0, len(messages), 60)
        ]
    data.append((15, bytes(4)))
    keys = [struct.unpack_from("<H", content)[0] for _, content in messages]
    counts = b"".join(struct.pack("<HQ", key, keys.count(key)) for key in sorted(set(keys)))
    statistics = struct.pack("<QHIIIIQQI", len(messages), 2, 2, 0, 0, 0, 0, 0, len(counts)) + counts
    foot = (2, struct.pack("<QQI", len(pack(data)), 0, 0))
    return pack([*data, *declared, (11, statistics), foot]) + b"\x89MCAP0\r\n"


def _bags(folder: Path, messages: list[Record], declared: list[Record]) -> None:
    kinds, keys = dict(zip((WRENCH_TOPIC, POSE_TOPIC), STAMPED.values(), strict=True)), dict[int, str]()
    for kind, content in declared:
        if kind == CHANNEL:
            keys[struct.unpack_from("<H", content)[0]] = next(name for name in kinds if name.encode() in content)
    heads = [struct.unpack_from("<HIQ", content) for _, content in messages]
    rows = [(stamp, keys[key], content[22:]) for (key, _, stamp), (_, content) in zip(heads, messages, strict=True)]
    write_ros2(folder / "bag", rows, kinds=kinds)
    with Writer1(folder / "touches.bag") as bag:
        first = {name: bag.add_connection(name, kind, typestore=ROS1) for name, kind in kinds.items()}
        for stamp, name, raw in rows:
            bag.write(first[name], stamp, _ros1(raw, kinds[name]))


def _ros1(raw: bytes, kind: str) -> bytes:
    message: Any = ROS2.deserialize_cdr(raw, kind)
    header = message.header
    message.header = ROS1.types["std_msgs/msg/Header"](0, header.stamp, header.frame_id)
    return bytes(ROS1.serialize_ros1(message, kind))
