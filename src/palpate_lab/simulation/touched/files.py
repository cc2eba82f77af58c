"""Write a run of the touched forearm: logs of both sensors in one recording, models, a rig, and the truth."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from palpate.files.models.kinds import write_model
from palpate.sensors.taxels.intensity import Curve, Intensity
from palpate.sensors.taxels.skin_map.model import SkinMap
from palpate.signals.payload import Payload
from palpate.signals.recording import CELLS, ORIENTATION, Recording
from palpate_lab.simulation.bags import Stamped, poses, readings, wrenches, write_bag
from palpate_lab.simulation.skin_bench import HIGH, JOINT, LOW
from palpate_lab.simulation.skin_session import load_cell_presses
from palpate_lab.simulation.touched.run import ForearmRun, ForearmTruth
from palpate_lab.simulation.touched.settings import GRAVITY, ForearmSettings

WRENCH_TOPIC, SKIN_TOPIC, POSE_TOPIC = "/forearm/wrench", "/forearm/skin", "/forearm/pose"
TRUTH = ("time", "px", "py", "pz", "nx", "ny", "nz", "fx", "fy", "fz", "touch", "seen", "share", "speed")
_POSE_RATE = 100  # Hz
_ORIGIN = (0.4, 0.0, 0.6)  # m: the arm turns the sensor about its origin
_PRESSES = 20  # of each cell on the bench
_LARGEST = 19.0  # N on one cell, where its 8 bits end
_KINDS = {WRENCH_TOPIC: "geometry_msgs/msg/WrenchStamped", POSE_TOPIC: "geometry_msgs/msg/PoseStamped"}
_RIG = """# A simulated forearm: a taxel skin round a link, which a force/torque sensor carries. What really touched it
# is in truth.csv; nothing here knows of it.
[surface]
mesh = "link.stl"
unit = "m"
crease = 30                          # degrees: normals are smooth within it, split across it
pose = {{ xyz = {xyz}, quaternion_xyzw = {quaternion} }}  # of the link in the sensor's frame

[skin]
map = "skin_map.toml"
intensity = "intensity.toml"
rows = {rows}
columns = {columns}
bits = 8
topic = "{skin_topic}"
tare = {tare}                           # s: the log starts so long untouched

[contacts]
unequal = {unequal}                       # share by which a cell's gain may be off from its curve

[force_torque]
topic = "{wrench_topic}"
noise = {{ force = {force}, torque = {torque} }}   # N, N m: one standard deviation of one reading
payload = "payload.toml"

[orientation]
topic = "{pose_topic}"               # of the sensor in the base

[estimate]
method = "soft_finger"
contact = {{ on = 0.5, off = 0.3 }}    # N
"""
_MADE = {"made by": "palpate simulate forearm, which knows it"}
_README = """A simulated forearm, touched at up to {touches} places at once (MuJoCo): `palpate simulate forearm`.

both.mcap       {wrench_topic} (WrenchStamped, {wrench_rate} Hz), {skin_topic} (UInt8MultiArray, {skin_rate} Hz),
                {pose_topic} (PoseStamped, 100 Hz); the first {quiet:g} s are untouched and at rest
free.mcap       {free}
load_cell_log.csv  presses of each cell under a load cell: force [N], intensity [counts], row, column
both.toml       the rig; with it skin_map.toml, intensity.toml, payload.toml, link.stl
truth.csv       a row a contact and frame of the skin, on the clock of the wrenches, in the link's frame: point [m],
                normal out of the link, force [N] on the link, touch (which one it is), share (of the normal force that
                lies on cells), seen (1: most of it does), speed [m/s] of what touches, along the surface

  palpate inspect both.mcap --rig both.toml
  palpate estimate both.mcap --rig both.toml -o contacts.csv
  palpate evaluate contacts.csv truth.csv
  palpate view both.mcap --rig both.toml
"""


def write_forearm(run: ForearmRun, folder: Path, free: Recording | None = None) -> None:
    """Write both.mcap, both.toml, skin_map.toml, intensity.toml, payload.toml, link.stl, truth.csv and README.txt.

    It also writes load_cell_log.csv, presses of each of its cells on a bench, from which intensity.toml can be
    identified.

    Args:
        run: run of the forearm.
        folder: created if it does not exist.
        free: a log without touches, written as free.mcap; None: none is written.

    Raises:
        InputError: rosbags is not installed.
    """
    import trimesh

    folder.mkdir(parents=True, exist_ok=True)
    settings = run.settings
    _write_both(run, folder / "both.mcap")
    if free is not None:
        write_free(free, folder / "free.mcap", settings)
    trimesh.Trimesh(*link_mesh(settings), process=False).export(folder / "link.stl")
    for name, text in (
        ("both.toml", _rig(settings)),
        ("README.txt", _about(settings, free)),
    ):
        (folder / name).write_text(text, encoding="utf-8")
    write_model(folder / "payload.toml", _payload(settings))
    write_model(folder / "intensity.toml", intensity_model())
    write_model(folder / "skin_map.toml", _map(settings))
    _write_truth(run.truth, folder / "truth.csv")
    _write_presses(run, folder / "load_cell_log.csv")


def write_free(log: Recording, path: Path, settings: ForearmSettings) -> None:
    """Write a log without touches as MCAP: wrenches and poses.

    Raises:
        InputError: rosbags is not installed.
    """
    write_bag(path, _KINDS, lambda types: tuple(_wrench_topics(log, settings, types)))


def link_mesh(settings: ForearmSettings, around: int = 120) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Return the closed cylinder in the link's frame: vertices (v, 3) [m] and facets (f, 3), about square.

    The facets lie up to 12 um inside it.
    """
    radius, half = settings.sheet.radius, settings.half_length
    rings = max(2, round(around * half / (np.pi * radius))) + 1
    angle, height = np.meshgrid(2 * np.pi * np.arange(around) / around, np.linspace(-half, half, rings))
    side = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1).reshape(-1, 3)
    vertices = np.concatenate([side, [[0.0, 0.0, -half], [0.0, 0.0, half]]])
    here, beside = np.arange(around), np.roll(np.arange(around), -1)
    up = around * np.arange(rings - 1)[:, None]
    lower = np.stack([up + here, up + beside, up + around + beside], axis=-1).reshape(-1, 3)
    upper = np.stack([up + here, up + around + beside, up + around + here], axis=-1).reshape(-1, 3)
    top = around * (rings - 1)
    bottom_end = np.stack([np.full(around, len(side)), beside, here], axis=-1)
    top_end = np.stack([np.full(around, len(side) + 1), top + here, top + beside], axis=-1)
    return vertices, np.concatenate([lower, upper, bottom_end, top_end])


def intensity_model() -> Intensity:
    """Return the `Intensity` of cells of gain 1."""
    nothing = np.zeros((3, 3))
    curve = Curve("two_range", np.array([LOW, 0.0, HIGH]), nothing, _LARGEST, saturation=255.0, joint=JOINT)
    return Intensity((curve,), provenance=_MADE)


def _write_both(run: ForearmRun, path: Path) -> None:
    counts = run.skin.channels[CELLS].astype(np.uint8)

    def made(types: Any) -> Iterable[Iterable[Stamped]]:
        skin = readings(types, SKIN_TOPIC, run.skin.time, counts, ("rows", "columns"))
        return *_wrench_topics(run.wrench, run.settings, types), skin

    write_bag(path, _KINDS | {SKIN_TOPIC: "std_msgs/msg/UInt8MultiArray"}, made)


def _wrench_topics(log: Recording, settings: ForearmSettings, types: Any) -> Iterator[Iterator[Stamped]]:
    every = max(1, settings.wrench_rate // _POSE_RATE)
    yield wrenches(types, WRENCH_TOPIC, log.time, log.wrenches())
    yield poses(types, POSE_TOPIC, log.time[::every], log.channels[ORIENTATION][::every], _ORIGIN)


def _rig(settings: ForearmSettings) -> str:
    return _RIG.format(
        xyz=settings.mount.translation.tolist(),
        quaternion=settings.mount.quaternion().tolist(),
        rows=settings.sheet.rows,
        columns=settings.sheet.columns,
        tare=max(round(settings.quiet - 0.5, 3), 0.1),
        unequal=settings.unequal,
        force=max(settings.force_noise, 1e-4),
        torque=max(settings.torque_noise, 1e-6),
        wrench_topic=WRENCH_TOPIC,
        skin_topic=SKIN_TOPIC,
        pose_topic=POSE_TOPIC,
    )


def _payload(settings: ForearmSettings) -> Payload:
    """Return the payload before the bias drifted; its weight is as uncertain as the drift states."""
    covariance = np.zeros((12, 12))
    covariance[2, 2] = 0.0 if settings.drift is None else settings.drift.weight**2
    weight, centre = np.array([0.0, 0.0, -GRAVITY * settings.mass]), settings.mount.apply(np.array(settings.centre))
    force, torque = np.split(np.array(settings.bias), 2)
    return Payload(weight, force, centre, torque, covariance, GRAVITY, provenance=_MADE)


def _map(settings: ForearmSettings) -> SkinMap:
    place = settings.sheet.layout()
    return replace(place, uv=np.zeros((*place.areas.shape, 2)), provenance=_MADE)


def _about(settings: ForearmSettings, free: Recording | None) -> str:
    span = "not written" if free is None else f"wrenches and poses for {free.time[-1]:.0f} s in which nothing touches"
    return _README.format(
        touches=settings.touches,
        wrench_rate=settings.wrench_rate,
        skin_rate=settings.skin_rate,
        quiet=settings.quiet,
        free=span,
        wrench_topic=WRENCH_TOPIC,
        skin_topic=SKIN_TOPIC,
        pose_topic=POSE_TOPIC,
    )


def _write_truth(truth: ForearmTruth, path: Path) -> None:
    about = (truth.touch, truth.seen, truth.share, truth.speed)
    numbers = np.column_stack([truth.time, truth.point, truth.normal, truth.force, *about])
    layout = ["%.6f"] * 10 + ["%d", "%d", "%.4f", "%.6f"]
    np.savetxt(path, numbers, fmt=layout, delimiter=",", header=",".join(TRUTH), comments="", encoding="utf-8")


def _write_presses(run: ForearmRun, path: Path) -> None:
    """Write presses of each cell, with noise of another day than the run: drawn separately, the same for all."""
    force, counts, cell = load_cell_presses(run.settings.sheet, run.sheet, np.random.default_rng(0), presses=_PRESSES)
    numbers = np.column_stack([force, counts, cell])
    header, layout = "force,intensity,row,column", ["%.4f", "%d", "%d", "%d"]
    np.savetxt(path, numbers, fmt=layout, delimiter=",", header=header, comments="", encoding="utf-8")
