"""Good inputs that each target begins with, written once into a folder of the cache."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import polars as pl
import trimesh
from msgspec import msgpack

from claims.evidence.good_files import write_good
from claims.evidence.logs_written import cdr, pose_stamped, write_mcap
from claims.evidence.page_client import CAMERA
from claims.evidence.robot import KINDS, URDF
from claims.evidence.robot import messages as robot_messages
from fuzz.messages import DEFINED, packed
from fuzz.packets import TOKEN, WIDGETS
from palpate.files.models import write_model
from palpate.live.cobs import encoded
from palpate.live.lines import printed
from palpate.live.netft import SAMPLE
from palpate.live.ros_messages import array_message, image_message
from palpate.live.stream_buffer import SlotForm, StreamBuffer
from palpate.sensors.taxels.place_formats import write_taxel_places
from palpate.sensors.taxels.skin_map.files import write_skin_map
from palpate_lab.simulation import simulate_session
from tests.files.test_ati import CALIBRATION, RANGES
from tests.files.test_models import MADE
from tests.live.test_live_netft import PAGE, sample, xml

FILES = {
    "csv": ("touches.csv", "free_motion.csv"),
    "mcap": ("touches.mcap", "plain.mcap", "lz4.mcap", "zstd.mcap", "stored.mcap"),
    "mcap_torn": ("contacts.mcap",),
    "bag": ("touches.bag",),
    "parquet": ("touches.parquet",),
    "contacts_parquet": ("contacts.parquet",),
    "rig": ("rig.toml", "rig_full.toml", "rig_imu.toml", "rig_plane.toml"),
    "contacts": ("contacts.csv",),
    "contacts_mcap": ("contacts.mcap",),
    "truth": ("truth.csv",),
    "stl": ("probe.stl", "ascii.stl"),
    "obj": ("probe.obj",),
    "ply": ("probe.ply",),
}
"""Target -> files of `write_good`."""
ROBOT = """[robot]
urdf = "wrist.urdf"
joints = "/joint_states"
base = "base_link"
gravity = "fixed"
packages = { probe_description = "." }

[time]
column = "time"

[sensors.wrist]
kind = "force_torque"
link = "ft_sensor"
topic = "/wrist"
surface = { link = "probe" }
payload = "payload.toml"

[sensors.palm]
kind = "skin"
link = "probe"
taxels = "taxels.toml"
"""
RIGS = (
    '[skin]\nmap = "skin_map.toml"\n',
    '[skin]\ntaxels = "taxels.toml"\n\n[surface]\nmesh = "probe.stl"\nunit = "mm"\n',
    '[load_cells]\nmodel = "load_cells.toml"\n\n[surface]\nmesh = "probe.stl"\nunit = "mm"\n',
    '[marker_ring]\nmodel = "marker_ring.toml"\n',
    '[force_torque]\nnoise = { force = 0.1, torque = 0.01 }\n[skin]\nmap = "skin_map.toml"\n'
    '[surface]\nmesh = "probe.stl"\nunit = "mm"\n',
)
LENS = """image_width: 640
image_height: 480
distortion_model: equidistant
camera_matrix: {rows: 3, cols: 3, data: [200, 0, 320, 0, 200, 240, 0, 0, 1]}
distortion_coefficients: {rows: 1, cols: 4, data: [0.01, 0, 0, 0]}
"""
POKES = "configuration,fx,fy,fz,tx,ty,tz,qx,qy,qz,qw,x [mm],y [mm],z [mm],t0,t1\n"
OBJ = """mtllib a.mtl
o a
v 0 0 0 1
v 1 0 0
v 0 1 0
v 0 0 1
vt 0 0
vn 0 0 1
g b
usemtl m
s off
f 1/1/1 3/1/1 2//1
f 1 2 4
f -1 -2 -3
f 1 2 3 4
"""
LINES = (
    b"12.5,-3,4,0.1,0.2,0.3\r\n",
    b"Fx=1.2 Fy=-0.5 Fz=+ 3.1kg Tx:0.1 N Ty:0.2 Tz:nan\n",
    b"1,5;2,5;-0,25;1;2;3e-2\n",
    b"$4711 ( 0.12 , -3.4 , 1, 2, 3, 4)*3F\n",
)


def write_seeds(folder: Path) -> None:
    """Write good inputs of each target into a folder of its name, and the files that a good rig names into `files`."""
    files = folder / "files"
    files.mkdir(parents=True)
    with contextlib.redirect_stdout(io.StringIO()):
        write_good(files)
    (files / "wrist.urdf").write_text(URDF)
    (files / "meshes").mkdir()
    shutil.copy(files / "probe.stl", files / "meshes")
    for name, given in FILES.items():
        for each in given:
            _put(folder, name, each, (files / each).read_bytes())
    for make in (_packets, _messages, _tables, _models, _meshes, _others):
        for name, found in make(files).items():
            for k, content in enumerate(found):
                _put(folder, name, str(k), content)


def _put(folder: Path, name: str, file: str, content: bytes | str) -> None:
    (folder / name).mkdir(exist_ok=True)
    (folder / name / file).write_bytes(content if isinstance(content, bytes) else content.encode())


def _packets(_: Path) -> dict[str, list[bytes]]:
    values = np.random.default_rng(0).normal(size=(40, 6))
    samples = [b"\0" + sample(k + (k > 20), 7 * k, 0x80020000 * (k == 9)) for k in range(30)]
    assert len(samples[0]) == 1 + SAMPLE.itemsize
    lines = [b"\x09\x20\x31\0" + b"head\n" + line * 20 for line in LINES] + [b"\x3c" * 4 + printed(values, 5)[0]]
    update = [{"type": "GuiUpdateMessage", "uuid": name, "updates": {"value": each}}
              for name in WIDGETS for each in (True, 0.5, "a")]  # fmt: skip
    picture = {
        "type": "GetRenderResponseMessage",
        "render_uuid": "a",
        "payload": cv2.imencode(".png", _image())[1].tobytes(),
    }
    door = f"/?token={TOKEN}\nHost: localhost:8080\nOrigin: http://localhost:8080\nCookie: palpate_8080={TOKEN}; a=b\n"
    return {
        "netft": [b"".join(samples), b"".join([*samples[:5], b"\x51" + bytes(40), *samples[9:], *samples[7:9]])],
        "netft_page": [xml(**PAGE), b"HTTP/1.0 200 OK\r\nContent-Length: 9\r\n\r\n<netft/>\n"],
        "lines": lines,
        "lines_named": lines,
        "cobs": [b"\x1c" * 4 + encoded(values, 250, number)[0] for number in ("f4", "i2")],
        "page": [msgpack.encode(each) for each in (CAMERA, picture, *update)],
        "door": [door.encode(), door.replace(TOKEN, "other").encode()],
    }


def _messages(_: Path) -> dict[str, list[bytes]]:
    log = simulate_session(touches=2, facets=80).touches.picked(slice(30))
    raws = dict[str, list[bytes]]()
    for _stamp, topic, message in robot_messages(log):
        raws.setdefault(KINDS[topic].replace("/msg/", "/"), []).append(cdr(message))
    own = "std_msgs/Header header\nown_msgs/Cell[] cells\nfloat32[] data\n" + "=" * 80
    own += (
        "\nMSG: std_msgs/Header\ntime stamp\nstring frame_id\n" + "=" * 80 + "\nMSG: own_msgs/Cell\nuint16[4] values\n"
    )
    raw = b"\0\1\0\0" + bytes(8) + b"\2\0\0\0a\0\0\0" + b"\2\0\0\0" + bytes(16) + b"\3\0\0\0" + bytes(12)
    arrays = [array_message(np.arange(12.0).reshape(3, 4)), array_message(np.arange(3.0))]
    compressed = b"\0\1\0\0" + bytes(8) + b"\1\0\0\0\0\0\0\0" + b"\4\0\0\0png\0"
    png = cv2.imencode(".png", _image())[1].tobytes()
    return {
        "messages": [
            *(packed(kind, each[:12]) for kind, each in raws.items()),
            packed("geometry_msgs/PoseStamped", [cdr(pose_stamped(k, np.eye(4)[3], np.zeros(3))) for k in range(4)]),
            packed("std_msgs/Float64MultiArray", arrays),
            packed("sensor_msgs/Image", [image_message(9, "camera", _image())]),
            packed("sensor_msgs/CompressedImage", [compressed + len(png).to_bytes(4, "little") + png]),
            packed(DEFINED, [own.encode(), raw, raw]),
            packed("geometry_msgs/Wrench", [np.arange(6.0).tobytes()], "ros1"),
        ]
    }


def _tables(files: Path) -> dict[str, list[str | bytes]]:
    rows = "".join(f"{k},0,0,-1,0,0,0,0,0,0,1,{k},2,3,{k},0\n" for k in range(4))
    touches = "start,end,px,py,pz,label\n0.1,0.2,0.01,0.02,0.03,a\n0.4,0.5,0.01,0.02,0.03,b\n"
    german = "Messung;Kraft\nDatum;01.02.2024\nZeit [ms];fx;fy;fz;tx;ty;tz\n" + "1,5;2;3;4;0,1;0,2;0,3\n" * 9
    stamped = "# rate: 100 Hz\ntimestamp,fx [mN],fy,fz,tx,ty,tz\n" + "".join(
        f"2024-01-02T03:04:{k:02}.5Z,1,2,3,4,5,6\n" for k in range(9)
    )
    return {
        "csv": [german, stamped, "\t".join("abcdefg") + "\n" + "0\t1\t2\t3\t4\t5\t6\n" * 4],
        "truth": [touches, "time,px,py,pz,nx,ny,nz,sensor\n0.1,1,2,3,0,0,1,wrist\n"],
        "pokes": [POKES + rows],
        "lens": [LENS, "%YAML:1.0\n---\n" + LENS.replace("distortion_model: equidistant", "fisheye_model: 1")],
        "ati": [CALIBRATION.format(axes="".join(f'<UserAxis Name="{n}" max="{m}"/>' for n, m in RANGES.items()))],
        "urdf": [path.read_text() for path in sorted((Path("claims/evidence/robots")).glob("*.urdf"))],
        "robot": [ROBOT, ROBOT.replace("/joint_states", "/tf")],
        "rig": [*RIGS, (files / "rig.toml").read_text() + '\n[source]\nkind = "netft"\naddress = "localhost"\n'],
    }


def _models(files: Path) -> dict[str, list[str | bytes]]:
    found, path = dict[str, list[str | bytes]](), files / "model.toml"
    for kind, make in MADE.items():
        for seed in range(2) if kind != "ball gain" else ():
            write_model(path, make(seed))
            shutil.copy(path, files / f"{kind.replace(' ', '_')}.toml")
            found.setdefault("model", []).append(path.read_bytes())
    for suffix in (".txt", ".csv", ".urdf"):
        write_taxel_places(path.with_suffix(suffix), MADE["taxels"](1))
        found.setdefault("places", []).append(path.with_suffix(suffix).read_bytes())
    write_skin_map(path.with_suffix(".csv"), MADE["skin map"](0))
    return {**found, "skin_map": [path.with_suffix(".csv").read_bytes()]}


def _meshes(files: Path) -> dict[str, list[bytes | str]]:
    mesh: Any = trimesh.load_mesh(files / "probe.ply")
    mesh.merge_vertices()
    box: Any = trimesh.creation.box((10, 20, 30))
    written = {kind: [each.export(file_type=kind) for each in (mesh, box)] for kind in ("obj", "ply", "stl")}
    written["ply"] += [box.export(file_type="ply", encoding="ascii")]
    written["obj"] += [OBJ]
    return {**written, "dae": [trimesh.exchange.dae.export_collada(box)]}


def _others(files: Path) -> dict[str, list[bytes | str]]:
    times = np.arange(20) / 100
    table = {"time": times, **{name: times for name in ("fx", "fy", "fz", "tx", "ty", "tz")}}
    npy = [_saved(np.save, np.column_stack([times] * 7)), _saved(np.save, np.zeros((20, 8, 8), np.uint16))]
    npz = [_saved(np.savez, **table), _saved(np.savez_compressed, **table, cells=np.zeros((20, 2, 2)))]
    small = simulate_session(touches=2, facets=80).touches.picked(slice(40))
    write_mcap(files / "robot.mcap", sorted(robot_messages(small), key=lambda each: each[0]), KINDS)
    frame = pl.DataFrame({**table, "cells": [[1.0, 2.0]] * 20, "when": pl.Series(times * 1e9).cast(pl.Datetime("ns"))})
    parquet = [_saved(frame.write_parquet, compression=kind) for kind in ("zstd", "snappy", "uncompressed", "lz4")]
    form = SlotForm("force_torque", (6,), False, (), 20, 4)
    StreamBuffer.make(files / "made.ring", form, 1).close()
    head = (files / "made.ring").read_bytes()
    assert json.dumps(asdict(form)).encode() in head
    video = cv2.VideoWriter(str(files / "made.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 10, (32, 24))
    for _ in range(3):
        video.write(_image())
    video.release()
    return {
        "npy": npy,
        "npz": npz,
        "parquet": parquet,
        "mcap": [(files / "robot.mcap").read_bytes()],
        "db3": [each.read_bytes() for each in islice((files / "bag").glob("*.db3"), 1)],
        "ring": [head],
        "video": [(files / "made.avi").read_bytes()],
    }


def _saved(save: Any, *what: Any, **named: Any) -> bytes:
    buffer = io.BytesIO()
    save(buffer, *what, **named)
    return buffer.getvalue()


def _image() -> np.ndarray:
    return np.random.default_rng(1).integers(0, 255, (24, 32, 3), np.uint8)
