"""A skin session of the bench as files: logs, a map, a wand's mesh and a rig."""

from pathlib import Path

import numpy as np
import polars as pl

from palpate.cli import main
from palpate.signals.recording import CELLS
from palpate_lab.simulation.shapes import icosphere
from palpate_lab.simulation.skin_bench import Wand
from palpate_lab.simulation.skin_session import SkinSession, load_cell_presses, simulate_protocol


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


def estimated_skin_session(folder: Path) -> SkinSession:
    """Six touches, two cells wide, calibrated and estimated."""
    rng = np.random.default_rng(7)
    made = simulate_protocol(rng, touches=6, width=2.0)
    write_skin_session(made, folder, rng, presses=20)
    assert main(["calibrate", "intensity", f"{folder}/load_cell_log.csv", "-o", f"{folder}/intensity.toml"]) == 0
    estimate = ["estimate", f"{folder}/skin_log.csv", "--rig", f"{folder}/rig.toml", "-o", f"{folder}/contacts.csv"]
    assert main(estimate) == 0
    return made
