"""The paper's validation as a session on the bench: touches by a wand, a sensor below, cameras around, as files.

Protocol [skin map, 3.5 and 4.3]: 19 touches at places drawn at random, of 1 to 16 N with a mean near 3.6 N, pressed
along the normal. Each is a ramp, a hold and a release, and between touches the sheet is at rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float, Int

from palpate.sensors.recording import CELLS, Recording
from palpate.simulation.shapes import icosphere
from palpate.simulation.skin_bench import PaperSheet, Patch, Rolled, Wand, paper_sheet, press, read_out, wand_poses

__all__ = ["SkinSession", "load_cell_presses", "simulate_protocol", "write_skin_session"]

RATE = 50.0  # Hz
HOLD, PAUSE, RAMP = 0.8, 0.4, 0.1  # s
FORCE_NOISE, TORQUE_NOISE = 0.05, 0.001  # N, N m, of the sensor below


@dataclass(frozen=True, eq=False)
class SkinSession:
    """What is recorded, and what is true.

    Attributes:
        sheet, model: of the bench.
        frames: cells at 50 Hz; the first second is untouched.
        wrench: (n, 6) [N, N m] of the sensor below, at the frames' times, in the link's frame.
        wand: (n, 7) pose of the wand in the link's frame; NaN where it was lost or away.
        start, end: (k,) [s] of each touch.
        point, normal, force: (k, 3) of each, from geometry.
    """

    sheet: Rolled
    model: PaperSheet
    frames: Recording
    wrench: Float[np.ndarray, "n 6"]
    wand: Float[np.ndarray, "n 7"]
    start: Float[np.ndarray, " k"]
    end: Float[np.ndarray, " k"]
    point: Float[np.ndarray, "k 3"]
    normal: Float[np.ndarray, "k 3"]
    force: Float[np.ndarray, "k 3"]


def simulate_protocol(
    rng: np.random.Generator,
    *,
    sheet: Rolled | None = None,
    model: PaperSheet | None = None,
    touches: int = 19,
    width: float = 0.3,
    wand: Wand | None = None,
) -> SkinSession:
    """One session.

    Args:
        rng: of everything drawn.
        sheet: None: the paper's.
        model: None: the paper's, drawn.
        touches: how many.
        width: of a touch, in cells; small ones lie in one cell or two.
        wand: the wand and its cameras.
    """
    sheet, wand = sheet or Rolled(), wand or Wand()
    model = model or paper_sheet(sheet, rng)
    half = min(max(width / 2 - 0.5, -0.5), (sheet.rows - 1) / 2)
    places = np.stack(
        [rng.uniform(half, sheet.rows - 1 - half, touches), rng.uniform(half, sheet.columns - 1 - half, touches)],
        axis=1,
    )
    newtons = np.clip(rng.exponential(2.6, touches) + 1.0, 1.0, 16.0) * max(1.0, width**2 / 2)
    patches = [
        Patch(row, column, width / 2, force)
        for (row, column), force in zip(places.tolist(), newtons.tolist(), strict=True)
    ]
    pressed = [press(sheet, [patch]) for patch in patches]
    begin = 1.0 + (HOLD + PAUSE) * np.arange(touches)
    time = np.arange(int((begin[-1] + HOLD + PAUSE) * RATE)) / RATE
    share = np.stack([np.clip(np.minimum((time - at) / RAMP, (at + HOLD - time) / RAMP), 0.0, 1.0) for at in begin])
    loads = np.einsum("kn,krc->nrc", share, np.stack([each.loads for each in pressed]))
    exact = share.T @ np.stack([np.concatenate([each.force[0], each.torque[0]]) for each in pressed])
    noise = np.repeat([FORCE_NOISE, TORQUE_NOISE], 3)
    point, normal = np.stack([each.point[0] for each in pressed]), np.stack([each.normal[0] for each in pressed])
    tracked = np.full((len(time), 7), np.nan)
    touched: Int[np.ndarray, " m"] = np.flatnonzero(share.max(axis=0) >= 1.0)
    which = share.argmax(axis=0)[touched]
    tracked[touched] = wand_poses(wand, point[which], normal[which], rng)
    return SkinSession(
        sheet,
        model,
        read_out(model, loads, rng, rate=RATE),
        exact + noise * rng.standard_normal(exact.shape),
        tracked,
        begin + RAMP,
        begin + HOLD - RAMP,
        point,
        normal,
        np.stack([each.force[0] for each in pressed]),
    )


def load_cell_presses(
    sheet: Rolled, model: PaperSheet, rng: np.random.Generator, *, presses: int = 60
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"], Int[np.ndarray, "n 2"]]:
    """Force [N], reading and cell of presses on each cell in turn: up, and down again."""
    ramp = np.linspace(0.0, 1.0, presses // 2) ** 2
    force = np.concatenate([ramp, ramp[::-1]]) * 18.0
    cell = np.argwhere(np.ones((sheet.rows, sheet.columns)))
    exact = model.rest.reshape(-1, 1) + model.gain.reshape(-1, 1) * model.counts(force)[None]
    counts = np.clip(np.rint(exact + model.noise * rng.standard_normal(exact.shape)), 0.0, model.top)
    return np.tile(force, len(cell)), counts.ravel(), np.repeat(cell, len(force), axis=0)


def write_skin_session(
    session: SkinSession, folder: Path, rng: np.random.Generator, *, wand: Wand | None = None, presses: int = 60
) -> None:
    """Write load_cell_log.csv, skin_log.csv, map.csv, wrench.csv, wand.csv, wand.stl, truth.csv and rig.toml.

    Args:
        session: what was simulated.
        folder: made where it is not there.
        rng: of the load cell's presses.
        wand: as of the session.
        presses: of each cell in the load cell's log.
    """
    folder.mkdir(parents=True, exist_ok=True)
    force, counts, cell = load_cell_presses(session.sheet, session.model, rng, presses=presses)
    pressed = {"force": force, "intensity": counts, "row": cell[:, 0], "column": cell[:, 1]}
    _table(folder / "load_cell_log.csv", pressed)
    frames = session.frames
    flat = frames.channels[CELLS].reshape(len(frames), -1)
    _table(folder / "skin_log.csv", {"time": frames.time} | {f"c{k}": flat[:, k] for k in range(flat.shape[1])})
    place = session.sheet.layout()
    index = np.argwhere(np.ones((place.rows, place.columns)))
    numbers = np.column_stack([place.centres.reshape(-1, 3), place.normals.reshape(-1, 3), place.areas.ravel()])
    names = ("x", "y", "z", "nx", "ny", "nz", "area")
    _table(folder / "map.csv", {"row": index[:, 0], "column": index[:, 1]} | dict(zip(names, numbers.T, strict=True)))
    wrench = dict(zip(("fx", "fy", "fz", "tx", "ty", "tz"), session.wrench.T, strict=True))
    _table(folder / "wrench.csv", {"time": frames.time} | wrench)
    known = np.isfinite(session.wand).all(axis=1)
    pose = dict(zip(("x", "y", "z", "qx", "qy", "qz", "qw"), session.wand[known].T, strict=True))
    _table(folder / "wand.csv", {"time": frames.time[known]} | pose)
    point = dict(zip(("px", "py", "pz"), session.point.T, strict=True))
    _table(folder / "truth.csv", {"start": session.start, "end": session.end} | point)
    _wand_mesh(folder / "wand.stl", (wand or Wand()).radius)
    (folder / "rig.toml").write_text(_RIG, encoding="utf-8")


def _table(path: Path, columns: dict[str, np.ndarray]) -> None:
    pl.DataFrame(columns).write_csv(path)


def _wand_mesh(path: Path, radius: float) -> None:
    """The round tip, in millimetres, about its centre."""
    import trimesh

    vertices, faces = icosphere(16)
    trimesh.Trimesh(1e3 * radius * vertices, faces, process=False).export(path)


_RIG = """[skin]
map = "map.csv"              # where the cells sit: palpate map skin
intensity = "intensity.toml" # what their readings mean: palpate calibrate intensity
bits = 8
tare = 0.8                   # s at the start in which nothing touches
"""
