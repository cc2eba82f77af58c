"""A task of the benchmark once it is made, and its files: task.toml, which all may read, and truth.csv, for scoring."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from palpate.files.models.toml import toml_lines

UNITS = "m, N, N m, s, rad; a wrench is force, then torque about the frame's origin, of the environment on the body"
TRUTH = ("sample", "px", "py", "pz", "fx", "fy", "fz")


@dataclass(frozen=True, eq=False)
class TaskTruth:
    """The true contacts of a task, a row each; a sample in which nothing touches has one row of NaN.

    Samples without a row are not judged, because a contact begins or ends in them.

    Attributes:
        sample: (n,) number of the reading, from 0, rising.
        point: (n, 3) [m] in the body's frame, NaN where nothing touches.
        force: (n, 3) [N] on the body, NaN where nothing touches.
    """

    sample: Int[np.ndarray, " n"]
    point: Float[np.ndarray, "n 3"]
    force: Float[np.ndarray, "n 3"]

    @classmethod
    def of(cls, sample: np.ndarray, point: np.ndarray, force: np.ndarray, quiet: np.ndarray) -> TaskTruth:
        """Create a `TaskTruth` from contacts and from samples in which nothing touches (q,), sorted by sample."""
        every = np.concatenate([sample, quiet]).astype(np.int64)
        nothing = np.full((len(quiet), 3), np.nan)
        order = np.argsort(every, kind="stable")
        return cls(every[order], *(np.concatenate([known, nothing])[order] for known in (point, force)))


@dataclass(frozen=True, eq=False)
class MadeTask:
    """A task without its readings, which its maker has written.

    Attributes:
        kind: kind of the readings: wrench, log, load_cells, skin or marker_ring.
        about: description of what was simulated, in a sentence or two.
        frame: frame of the requested points and forces.
        samples: number of readings.
        most: largest number of contacts at once.
        files: name of each file -> its content.
        truth: true contacts.
        facts: further keys of task.toml: noise, friction, ...
    """

    kind: str
    about: str
    frame: str
    samples: int
    most: int
    files: Mapping[str, str]
    truth: TaskTruth
    facts: Mapping[str, object] = field(default_factory=dict[str, object])


def write_task(task: MadeTask, folder: Path, seed: int, *, small: bool) -> None:
    """Write task.toml and truth.csv into a folder; the task has the folder's name."""
    several = f", {task.most} at most" if task.most > 1 else ""
    keys: dict[str, object] = {
        "name": folder.name,
        "kind": task.kind,
        "about": task.about,
        "asked": f"for each sample the contacts{several}: point, and force if known, in the frame below",
        "units": UNITS,
        "frame": task.frame,
        "seed": seed,
        "size": "small" if small else "full",
        "samples": task.samples,
        "most": task.most,
        **task.facts,
    }
    lines = [line for key, value in keys.items() for line in toml_lines(key, value)]
    lines += ["", "[files]", *(line for name, text in task.files.items() for line in toml_lines(name, text)), ""]
    (folder / "task.toml").write_text("\n".join(lines), encoding="utf-8")
    truth = task.truth
    rows = np.column_stack([truth.sample, truth.point, truth.force])
    write_table(folder / "truth.csv", dict(zip(TRUTH, rows.T, strict=True)), integers=("sample",), digits=9)


def write_table(path: Path, columns: Mapping[str, np.ndarray], *, integers: tuple[str, ...] = (), digits: int) -> None:
    """Write columns as CSV with `digits` decimals, those in `integers` as integers, and NaN as an empty field."""
    import polars as pl

    frame = pl.DataFrame({name: np.asarray(values, dtype=np.float64) for name, values in columns.items()})
    frame = frame.fill_nan(None).with_columns(pl.col(name).cast(pl.Int64) for name in integers)
    frame.write_csv(path, float_precision=digits)


def write_body(path: Path, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> None:
    """Write a mesh as binary STL in metres."""
    import trimesh

    trimesh.Trimesh(vertices, faces, process=False).export(path)
