"""Make samples of a taxel skin around a link, with a force/torque sensor below, from MuJoCo's contacts."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate.files.models.kinds import write_model
from palpate.signals.recording import CELLS
from palpate_lab.benchmark.task import MadeTask, TaskTruth, write_body, write_table
from palpate_lab.simulation.skin_bench import PaperSheet, Rolled
from palpate_lab.simulation.touched.files import intensity_model, link_mesh
from palpate_lab.simulation.touched.run import simulate_forearm
from palpate_lab.simulation.touched.settings import ForearmSettings

LEAST = 1.0  # N: a frame with a lighter contact is not judged
QUIET = 1.5  # s at the start
RIG = """# What task.toml says, as a rig of Palpate.
[surface]
mesh = "body.stl"
unit = "m"
crease = 30
pose = {{ xyz = {xyz}, quaternion_xyzw = {quaternion} }}

[skin]
map = "cells.csv"
intensity = "intensity.toml"
rows = {rows}
columns = {columns}
bits = 8
tare = {tare}
cells = {cells}

[contacts]
unequal = {unequal}

[force_torque]
noise = {{ force = {force}, torque = {torque} }}

[estimate]
contact = {{ on = 0.5, off = 0.3 }}
tare = {tare}
"""


def skin(folder: Path, rng: np.random.Generator, *, small: bool) -> MadeTask:
    """Make samples of one to three contacts at once on a sheet of taxels, on an arm that does not move.

    Returns a `MadeTask`; the files are written into `folder`.

    Raises:
        InputError: MuJoCo is not installed.
    """
    sheet = Rolled(rows=6 if small else 10)
    settings = ForearmSettings(
        sheet=sheet, moving=False, seconds=8.0 if small else 20.0, quiet=QUIET, unseen=0.0, mass=0.9, skin_rate=50
    )
    run = simulate_forearm(rng, settings)
    frames = run.skin.channels[CELLS].reshape(len(run.skin.time), -1)
    wrench = _means(run.wrench.wrenches(), settings.wrench_rate // settings.skin_rate, len(frames))
    cells = [f"c{k}" for k in range(frames.shape[1])]
    readings = {"time": run.skin.time} | dict(zip(("fx", "fy", "fz", "tx", "ty", "tz"), wrench.T, strict=True))
    write_table(
        folder / "readings.csv", readings | dict(zip(cells, frames.T, strict=True)), integers=tuple(cells), digits=6
    )
    _write_sheet(folder, sheet)
    write_body(folder / "body.stl", *link_mesh(settings, 60))
    noise = settings.force_noise / np.sqrt(settings.wrench_rate // settings.skin_rate)
    torque = settings.torque_noise / np.sqrt(settings.wrench_rate // settings.skin_rate)
    write_model(folder / "intensity.toml", intensity_model())
    numbers = {"rows": sheet.rows, "columns": sheet.columns, "tare": QUIET - 0.5, "unequal": settings.unequal}
    pose = {"xyz": settings.mount.translation.tolist(), "quaternion_xyzw": settings.mount.quaternion().tolist()}
    placed = {"xyz": pose["xyz"], "quaternion": pose["quaternion_xyzw"]}
    rig = RIG.format(**numbers, **placed, cells=cells, force=noise, torque=torque)
    (folder / "rig.toml").write_text(rig, encoding="utf-8")
    truth = run.truth
    push = np.linalg.norm(truth.force, axis=1)
    light = np.unique(truth.frame[push < LEAST])
    judged = ~np.isin(truth.frame, light)
    quiet = np.setdiff1d(np.arange(len(frames)), truth.frame)
    quiet = quiet[~np.isin(quiet + 1, truth.frame) & ~np.isin(quiet - 1, truth.frame)]
    return MadeTask(
        "skin",
        f"a sheet of {sheet.rows} x {sheet.columns} taxels of 8 bits round a cylinder, pressed by up to three round "
        f"tips at once, some leaning or dragged; frames with a contact below {LEAST:g} N are not judged",
        "of the cylinder's mesh, whose axis is z; it sits at `pose` in the frame of the sensor below",
        len(frames),
        settings.touches,
        {
            "readings.csv": "time, wrench of the sensor below as means about each frame (in the sensor's frame; with "
            "its zero and the link's weight, which do not change), then counts of the cells; a row a sample. The first "
            f"{QUIET:g} s are untouched",
            "cells.csv": "where each cell sits: row, column, centre [m], outward normal, area [m^2]; row by row",
            "response.csv": "counts above rest of a usual cell, by its force [N]",
            "body.stl": "the cylinder, in metres",
            "rig.toml": "the same facts as a rig of Palpate; with it intensity.toml",
        },
        TaskTruth.of(truth.frame[judged], truth.point[judged], truth.force[judged], quiet),
        {
            "rest": QUIET,
            "noise": {"force": noise, "torque": torque, "counts": settings.cell_noise, "unequal": settings.unequal},
            "pose": pose,
            "friction": settings.friction,
        },
    )


def _means(wrenches: np.ndarray, width: int, frames: int) -> np.ndarray:
    """Return the mean wrench about the time of each skin sample, (frames, 6), over shorter windows at both ends."""
    total = np.concatenate([np.zeros((1, 6)), np.cumsum(wrenches, axis=0)])
    first = np.clip(width * np.arange(frames) - width // 2, 0, len(wrenches) - 1)
    last = np.clip(width * np.arange(frames) + width - width // 2, 1, len(wrenches))
    return (total[last] - total[first]) / (last - first)[:, None]


def _write_sheet(folder: Path, sheet: Rolled) -> None:
    place = sheet.layout()
    index = np.argwhere(np.ones((place.rows, place.columns)))
    numbers = np.column_stack([index, place.centres.reshape(-1, 3), place.normals.reshape(-1, 3), place.areas.ravel()])
    names = ("row", "column", "x", "y", "z", "nx", "ny", "nz", "area")
    write_table(folder / "cells.csv", dict(zip(names, numbers.T, strict=True)), integers=names[:2], digits=9)
    force = np.linspace(0.0, 19.0, 191)
    write_table(folder / "response.csv", {"force": force, "counts": PaperSheet.counts(force)}, digits=6)
