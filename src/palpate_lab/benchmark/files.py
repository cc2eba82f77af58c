"""Read the benchmark's folders: a task and its readings, its truth, and the CSV of answers."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ROW, Status
from palpate.contact.ground_truth import TrueSamples
from palpate.errors import InputError
from palpate.files.inputs import load_toml
from palpate.files.tables.table import TextTable, read_table
from palpate.files.units import near
from palpate.opencv import opencv
from palpate.spatial.arguments import takes_arrays
from palpate.surfaces.mesh import Mesh

POINT, FORCE = ("px", "py", "pz"), ("fx", "fy", "fz")
COVARIANCE = ("cxx", "cxy", "cxz", "cyy", "cyz", "czz")
ANSWER = (*POINT, *FORCE, *COVARIANCE)  # of a contact, SI
WIDTHS = (3, 6, 12)  # of an answer: how many of them it states
_SQUARE = (0, 1, 2, 1, 3, 4, 2, 4, 5)  # where the nine of a symmetric matrix are among its six
_ROUNDING = 1e-9  # of the largest variance
_KEYS: Mapping[str, type] = {"name": str, "kind": str, "samples": int, "most": int}


@dataclass(frozen=True, eq=False)
class Task:
    """A task of the benchmark, without its truth.

    Attributes:
        name: name of the task, and of its folder.
        kind: kind of its readings: wrench, log, load_cells, skin or marker_ring.
        folder: folder with its files.
        samples: number of readings.
        most: largest number of contacts at once.
        facts: all keys of task.toml.
    """

    name: str
    kind: str
    folder: Path
    samples: int
    most: int
    facts: Mapping[str, Any]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of readings.csv, a tuple; () where a reading is an image.

        Raises:
            InputError: readings.csv cannot be read.
        """
        return () if self.kind == "marker_ring" else self._readings[0]

    def readings(self) -> Iterator[np.ndarray]:
        """Iterate over the readings: rows of readings.csv (m,), or images (h, w, 3) in blue, green and red.

        Raises:
            InputError: the file cannot be read, or its number of rows is not that in task.toml.
        """
        if self.kind == "marker_ring":
            return self.images("frames")
        table = self._readings[1]
        if len(table) != self.samples:
            where = str(self.folder / "readings.csv")
            raise InputError(f"has {len(table)} rows, but task.toml states {self.samples} samples.", where=where)
        return iter(table)

    def images(self, folder: str) -> Iterator[UInt8[np.ndarray, "h w 3"]]:
        """Yield the images (h, w, 3) of a folder in the task, sorted by name, in blue, green and red.

        Raises:
            InputError: an image cannot be read, or OpenCV is not installed.
        """
        cv2 = opencv()
        for path in sorted((self.folder / folder).glob("*.jpg")):
            image = cv2.imread(str(path))
            if image is None:
                raise InputError("cannot be read as an image.", where=str(path))
            yield image

    def table(self, file: str) -> dict[str, Float[np.ndarray, " n"]]:
        """Read a CSV of the task; return its columns (n,) by name.

        Raises:
            InputError: the file cannot be read.
        """
        read = read_table(self.folder / file)
        return dict(zip(read.names, read.numbers(read.names)[0].T, strict=True))

    def mesh(self) -> Mesh:
        """Load the body, body.stl, as a `Mesh` [m].

        Raises:
            InputError: there is no such file, or it cannot be read.
        """
        return Mesh.load(self.folder / "body.stl", unit="m")

    @functools.cached_property
    def _readings(self) -> tuple[tuple[str, ...], Float[np.ndarray, "n m"]]:
        read = read_table(self.folder / "readings.csv")
        return read.names, read.numbers(read.names, strict=True)[0]


def read_benchmark(folder: Path) -> dict[str, Task]:
    """Read the tasks in a folder into a dict of name -> `Task`.

    Raises:
        InputError: there is no task, or a task.toml is incomplete.
    """
    files = sorted(folder.glob("*/task.toml"), key=lambda path: path.parent.name)
    if not files:
        hint = "Make one with palpate benchmark make -o FOLDER."
        raise InputError("has no task: none of its folders has a task.toml.", where=str(folder), hint=hint)
    return {file.parent.name: _task(file) for file in files}


def _task(file: Path) -> Task:
    facts = load_toml(file)
    for key, kind in _KEYS.items():
        if not isinstance(facts.get(key), kind):
            what = "text" if kind is str else "a whole number"
            raise InputError(f"{key} is missing, or is not {what}.", where=str(file))
    if facts["name"] != file.parent.name:
        raise InputError(f"has the name {facts['name']!r}, but is in the folder {file.parent.name!r}.", where=str(file))
    return Task(facts["name"], facts["kind"], file.parent, facts["samples"], facts["most"], facts)


def read_truth(task: Task) -> tuple[TrueSamples, Int[np.ndarray, " q"]]:
    """Read the contacts to find, as `TrueSamples`, and the samples without contact (q,).

    The time of a contact is the number of its sample.

    Raises:
        InputError: truth.csv cannot be read, or has no contact.
    """
    table = read_table(task.folder / "truth.csv")
    rows, _ = table.numbers(("sample", *POINT, *FORCE), strict=True)
    touched = np.isfinite(rows[:, 1])
    if not touched.any():
        hint = "Make the task again with `palpate benchmark make`."
        raise InputError(f"has no row with a contact: {POINT[0]} is always empty.", where=str(table.path), hint=hint)
    known = rows[touched]
    return TrueSamples(known[:, 0], known[:, 1:4], force=known[:, 4:7]), rows[~touched, 0].astype(np.int64)


@takes_arrays
def as_contacts(sample: Int[np.ndarray, " n"], rows: Float[np.ndarray, "n width"]) -> Contacts:
    """Convert answers to `Contacts` whose time is the number of their sample.

    Args:
        sample: (n,) sample of each answer, from 0.
        rows: (n, 3), (n, 6) or (n, 12): the first columns of `ANSWER`.

    Raises:
        InputError: arrays of other shapes.
    """
    order = np.argsort(sample, kind="stable")
    sample, rows = sample[order], rows[order]
    full = np.full((len(rows), ROW.length), np.nan)
    full[:, ROW.point] = rows[:, :3]
    if rows.shape[1] > 3:
        full[:, ROW.force] = rows[:, 3:6]
    if rows.shape[1] > 6:
        full[:, ROW.covariance] = rows[:, 6:][:, _SQUARE]
    full[:, ROW.candidates], full[:, ROW.status] = 1, Status.CONTACT
    return Contacts.of_rows(sample, sample.astype(np.float64), full, ())


def read_answers(path: Path, tasks: Mapping[str, Task]) -> dict[str, Contacts]:
    """Read answers from a CSV with a row per contact into a dict of task -> `Contacts`.

    Tasks without a row are omitted.

    The columns are `task,sample,px,py,pz[,fx,fy,fz][,cxx,cxy,cxz,cyy,cyz,czz]`. Nothing in the file is executed.

    Raises:
        InputError: a column is missing, repeated or unknown; a row is ragged, of no task, of no sample, without a
            point, with an incomplete force or covariance, or one more than `most`. It names the line.
    """
    table = read_table(path)
    names = _stated(table)
    task = table.strings("task")
    numbers, _ = table.numbers(("sample", *names), strict=True)
    for row, name in enumerate(task.to_list()):
        if name not in tasks:
            table.refuse(row, f"the task {name!r} is unknown", near(str(name), tasks))
    _check_samples(table, numbers[:, 0], np.array([tasks[name].samples for name in task.to_list()]))
    _check_values(table, names, numbers[:, 1:])
    whose, found = task.to_numpy(), dict[str, Contacts]()
    full = np.full((len(numbers), len(ANSWER)), np.nan)
    full[:, [ANSWER.index(name) for name in names]] = numbers[:, 1:]
    for name, known in tasks.items():
        rows: Int[np.ndarray, " k"] = np.flatnonzero(whose == name)
        if len(rows):
            sample = numbers[rows, 0].astype(np.int64)
            _check_most(table, rows, sample, known)
            found[name] = as_contacts(sample, full[rows])
    return found


def _stated(table: TextTable) -> tuple[str, ...]:
    """Return the columns of a contact that the file has, in complete groups."""
    known = ("task", "sample", *ANSWER)
    for name in table.names:
        if name not in known:
            raise InputError(
                f"a file of answers to the benchmark has no column {name!r}.",
                where=str(table.path),
                hint=near(name, known),
            )
    groups = [group for group in (POINT, FORCE, COVARIANCE) if group is POINT or set(group) & set(table.names)]
    names = tuple(name for group in groups for name in group)
    table.require(("task", "sample", *names))
    return names


def _check_samples(table: TextTable, sample: Float[np.ndarray, " n"], count: Int[np.ndarray, " n"]) -> None:
    wrong = np.flatnonzero(~((sample >= 0) & (sample < count) & (sample == np.round(sample))))  # NaN too
    if len(wrong):
        row = int(wrong[0])
        said = "nothing" if np.isnan(sample[row]) else f"{sample[row]:g}"
        table.refuse(row, f"sample must be a whole number from 0 to {count[row] - 1}, not {said}")


def _check_values(table: TextTable, names: Sequence[str], values: Float[np.ndarray, "n k"]) -> None:
    """Refuse points that are not finite, incomplete forces and covariances, and negative variances."""
    for first, group, what in ((0, POINT, "point"), (3, FORCE, "force"), (6, COVARIANCE, "covariance")):
        which = [k for k, name in enumerate(names) if name in group]
        if not which:
            continue
        known = np.isfinite(values[:, which])
        bad = np.flatnonzero(~known.all(axis=1) if first == 0 else known.any(axis=1) & ~known.all(axis=1))
        if not len(bad) and first:
            bad = np.flatnonzero(np.isinf(values[:, which]).any(axis=1))
        if len(bad):
            row = int(bad[0])
            field = names[which[int(np.argmin(known[row]))]]
            rest = "leave out the row if there is no answer" if first == 0 else f"state all numbers of a {what} or none"
            table.refuse(row, f"{field} is not a finite number: {rest}")
    if set(COVARIANCE) <= set(names):
        _check_variances(table, values[:, [names.index(name) for name in COVARIANCE]])


def _check_variances(table: TextTable, six: Float[np.ndarray, "n 6"]) -> None:
    rows = np.flatnonzero(np.isfinite(six).all(axis=1))
    values = np.linalg.eigvalsh(six[rows][:, _SQUARE].reshape(-1, 3, 3))
    bad = np.flatnonzero(values[:, 0] < -_ROUNDING * np.abs(values).max(axis=1, initial=0.0))
    if len(bad):
        table.refuse(
            int(rows[bad[0]]), "cxx to czz are not a covariance: along some direction the variance is negative"
        )


def _check_most(table: TextTable, rows: Int[np.ndarray, " k"], sample: Int[np.ndarray, " k"], task: Task) -> None:
    _, which, counts = np.unique(sample, return_inverse=True, return_counts=True)
    over = np.flatnonzero(counts[which] > task.most)
    if len(over):
        row = rows[over[task.most]]
        what = "1 contact" if task.most == 1 else f"{task.most} contacts"
        table.refuse(
            int(row),
            f"sample {sample[over[0]]} of {task.name} has more than {what}, the most that are possible at once",
        )
