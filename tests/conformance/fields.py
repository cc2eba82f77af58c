"""The columns of the matrix: what a user does with a sensor's files, and what is a right answer to it.

Each takes a `Case`, and fails with what is wrong; a refusal is a sentence, which the table of sensors must know.
"""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from polars.testing import assert_frame_equal
from scipy.spatial.transform import Rotation

import palpate
from palpate.cli import main
from palpate.errors import PalpateError
from palpate.files.contacts import read_contacts
from palpate.setup.kinds import KINDS
from tests.conformance.sensors import Files, Sensor
from tests.support.blocks import unserved
from tests.support.simulated import POSE

SCREEN = (70, 1000)  # lines, and letters of one, that `inspect` may say: a screen, where names of 132 cells wrap
ANSWERED = 0.9  # of the samples of a touch


class Refused(Exception):
    """The sentence with which a command refused."""


def run(*words: str) -> str:
    """A command of Palpate, in this process.

    Returns:
        What it printed.

    Raises:
        Refused: it left with 1 or 2 and said why, in one sentence.
        AssertionError: it left in another way; whatever else it raises would be a traceback.
    """
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([str(word) for word in words])
    said = err.getvalue().strip()
    assert "Traceback" not in said
    if code == 1 and said.startswith("palpate: ") and "\n" not in said:
        raise Refused(said.removeprefix("palpate: "))
    assert code == 0, f"left with {code}: {_first(said) or 'without a word'}"
    return out.getvalue()


@dataclass
class Case:
    """A sensor with its files, and what was made of them so far."""

    sensor: Sensor
    files: Files
    _made: dict[tuple[str, ...], Path | Exception] = field(default_factory=dict)

    @classmethod
    def of(cls, sensor: Sensor, folder: Path) -> Case:
        """Make the files."""
        folder.mkdir(parents=True, exist_ok=True)
        return cls(sensor, sensor.files(folder, run))

    def estimate(self, suffix: str = ".csv", *options: str) -> Path:
        """Contacts of the log, estimated once for each set of options; a failure comes again."""
        key = (suffix, *options)
        if key not in self._made:
            path = self.files.folder / f"contacts_{len(self._made)}{suffix}"
            try:
                run("estimate", self.files.log, "--rig", self.files.rig, "-o", path, *options)
                self._made[key] = path
            except (Exception, SystemExit) as problem:
                self._made[key] = problem if isinstance(problem, Exception) else AssertionError(repr(problem))
        made = self._made[key]
        if isinstance(made, Exception):
            raise made
        return made

    def right(self, time: np.ndarray, estimate: Any) -> None:
        """Every touch is answered, at its place and with its force, in the surface's frame."""
        truth, sensor = self.files.truth, self.sensor
        for k in range(len(truth)):
            rows = (time >= truth.start[k]) & (time <= truth.end[k])
            good = rows & np.asarray(estimate.answered)
            share = np.count_nonzero(good) / max(np.count_nonzero(rows), 1)
            assert share >= ANSWERED, f"touch {k}: {share:.0%} answered"
            off = np.linalg.norm(np.median(estimate.point[good], axis=0) - truth.point[k])
            assert off <= sensor.place, f"touch {k}: {1e3 * off:.2f} mm off"
            wrong = np.linalg.norm(estimate.force[good].mean(axis=0) - truth.force[k])
            bound = sensor.force * np.linalg.norm(truth.force[k])
            assert wrong <= bound, f"touch {k}: force {wrong:.3f} N off, of {np.linalg.norm(truth.force[k]):.2f}"

    def poses(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the base, as the log has them: rotations (n, 3, 3) and positions (n, 3)."""
        table = pl.read_csv(self.files.table, columns=list(POSE)).select(POSE).to_numpy()
        return Rotation.from_quat(table[:, :4]).as_matrix(), table[:, 4:]


def judged(case: Case, name: str) -> str:
    """Field `name` of the matrix: "works", or "refused: why".

    Raises:
        Exception: it does not work, or is refused without a reason that the table of sensors knows.
    """
    reason, said = case.sensor.refused.get(name), None
    try:
        FIELDS[name](case)
    except (Refused, PalpateError) as problem:
        said = str(problem)
    if said is None:
        assert reason is None, "works, though the table of sensors says that physics refuses it"
        return "works"
    assert reason is not None, f"refused: {said}"
    assert re.search(reason, said), f"refused, but not by {reason!r}: {said}"
    return f"refused: {said}"


def same(one: pl.DataFrame, other: pl.DataFrame) -> None:
    """Two tables of contacts, to the last bit."""
    assert_frame_equal(one, other, check_exact=True)


FIELDS: dict[str, Callable[[Case], None]] = {}


def _field(name: str) -> Callable[[Callable[[Case], None]], Callable[[Case], None]]:
    def named(check: Callable[[Case], None]) -> Callable[[Case], None]:
        FIELDS[name] = check
        return check

    return named


@_field("inspect log")
def _inspect_log(case: Case) -> None:
    rows = f"{len(pl.read_csv(case.files.table)):,}"
    for words in ((), ("--rig", str(case.files.rig))):
        assert rows in _screen("inspect", case.files.log, *words), "does not say how many samples there are"


@_field("inspect model")
def _inspect_model(case: Case) -> None:
    if not case.files.models:
        raise Refused("there is no model: it reads in newtons")
    for model in case.files.models:
        assert f"{model}: TOML" not in _screen("inspect", model), "is not told from other TOML"


@_field("inspect rig")
def _inspect_rig(case: Case) -> None:
    assert case.sensor.table in _screen("inspect", case.files.rig), "does not say which sensor it is of"


@_field("inspect contacts")
def _inspect_contacts(case: Case) -> None:
    count = f"{len(pl.read_csv(case.estimate())):,}"
    for suffix in (".csv", ".parquet", ".mcap"):
        said = _screen("inspect", case.estimate(suffix))
        assert ": contacts" in said, "does not say that they are contacts"
        assert count in said, "does not say how many rows there are"
        assert "contact " in said, "does not say what became of the samples"


@_field("rig new")
def _rig_new(case: Case) -> None:
    rig = case.files.folder / "new.toml"
    mesh = [] if case.files.mesh is None else [case.files.mesh]
    said = run("rig", "new", case.files.log, *mesh, "-o", rig, "--force")
    assert f"taken for {KINDS[case.sensor.table].called}: " in said, "does not say why it is this sensor's"
    assert f"[{case.sensor.table}]" in rig.read_text(), "took the log for another sensor's"
    _screen("inspect", rig)


@_field("calibrate")
def _calibrate(case: Case) -> None:
    if not case.files.calibrations:
        raise Refused("there is nothing to calibrate: it reads in newtons")
    for words in case.files.calibrations:
        if not Path(words[-1]).exists():  # or its files were made by it
            run("calibrate", *words)


@_field("estimate to CSV")
def _all_right(case: Case, *options: str) -> None:
    """The contacts of the log, row for row."""
    found = read_contacts(case.estimate(".csv", *options))
    time = pl.read_csv(case.files.table, columns=["time"])["time"].to_numpy()
    assert np.array_equal(np.unique(found.sample), np.arange(len(time))), "a sample has no row"
    assert np.array_equal(found.time, time[found.sample]), "times are not the log's"
    case.right(found.time, found.estimate)


@_field("estimate to Parquet")
def _to_parquet(case: Case) -> None:
    found = pl.read_parquet(case.estimate(".parquet"))
    same(found, pl.read_csv(case.estimate(), schema_overrides=found.schema))


@_field("estimate to MCAP")
def _to_mcap(case: Case) -> None:
    found, known = read_contacts(case.estimate(".mcap")), read_contacts(case.estimate())
    assert np.array_equal(found.sample, known.sample)
    for name in ("point", "force", "torque", "covariance", "status"):
        assert np.array_equal(getattr(found.estimate, name), getattr(known.estimate, name), equal_nan=True), name


@_field("--frame sensor")
def _frame_sensor(case: Case) -> None:
    mount = case.files.mount
    _moved(case, "sensor", mount.rotation, mount.translation)


@_field("--frame base")
def _frame_base(case: Case) -> None:
    case.estimate(".csv", "--frame", "base")
    turns, places = case.poses()
    mount, sample = case.files.mount, read_contacts(case.estimate()).sample
    where = turns[sample] @ mount.translation + places[sample]
    _moved(case, "base", turns[sample] @ mount.rotation, where)


def _filtered(case: Case, kind: str) -> None:
    options = ("--filter", kind, "--cutoff", "15")
    _all_right(case, *options)
    plain, smooth = case.estimate().read_text(), case.estimate(".csv", *options).read_text()
    assert plain != smooth, "the filter was ignored"


for _kind in ("butterworth", "zero_phase"):
    FIELDS[f"--filter {_kind}"] = partial(_filtered, kind=_kind)


@_field("--report")
def _report(case: Case) -> None:
    page = case.files.folder / "report.html"
    case.estimate(".csv", "--report", str(page))
    text = page.read_text()
    assert "<svg" in text, "has no picture"
    assert case.files.log.name in text, "does not name the log"


@_field("evaluate")
def _evaluate(case: Case) -> None:
    _near(case, case.estimate())


@_field("events")
def _events(case: Case) -> None:
    touches, truth = case.files.folder / "touches_found.csv", case.files.truth
    run("events", case.estimate(), "-o", touches)
    found = pl.read_csv(touches)
    assert len(found) == len(truth), f"{len(found)} touches of {len(truth)}"
    off = np.linalg.norm(found.select("px", "py", "pz").to_numpy() - truth.point, axis=1)
    assert off.max() <= 2 * case.sensor.place, f"{1e3 * off.max():.2f} mm off"


@_field("view")
def _view(case: Case) -> None:
    for file in (case.files.log, case.estimate()):
        with unserved() as scenes:
            run("view", file, "--rig", case.files.rig, "--port", "0")
        assert len(scenes) == 1, "nothing was served"


@_field("Python one line")
def _one_line(case: Case) -> None:
    found = palpate.estimate(str(case.files.log), palpate.load_rig(str(case.files.rig)))
    same(found.to_polars(), pl.read_parquet(case.estimate(".parquet")))


@_field("Python blocks")
def _blocks(case: Case) -> None:
    rig = palpate.load_rig(str(case.files.rig))
    with palpate.open_log(str(case.files.log), rig) as opened:
        parts = [found.to_polars() for found in rig.estimator(opened).stream(opened)]
    same(pl.concat(parts), pl.read_parquet(case.estimate(".parquet")))


@_field("Python live")
def _live(case: Case) -> None:
    from tests.conformance.live import each_reading, whole

    rig = palpate.load_rig(str(case.files.rig))
    recording, estimator = whole(case.files.log, rig), rig.estimator()
    estimator.tare(recording.picked(recording.time <= recording.time[0] + case.files.rest))
    parts = [estimator.update(*reading) for reading in each_reading(estimator, recording)]
    found = type(parts[0]).joined(parts)
    case.right(found.time, found.estimate)


@_field("live")
def _recorded(case: Case) -> None:
    from tests.conformance.live import recorded

    record = recorded(case.files.log, case.files.rig)
    found = read_contacts(record)
    known = np.rint(1e9 * pl.read_csv(case.files.table, columns=["time"])["time"].to_numpy())
    assert np.array_equal(np.unique(found.sample), np.arange(len(known))), "a sample has no row"
    assert np.array_equal(np.rint(1e9 * found.time), known[found.sample]), "times are not the log's"
    case.right(found.time, found.estimate)
    _near(case, record)


def _moved(case: Case, frame: str, turns: np.ndarray, places: np.ndarray) -> None:
    """Contacts in another frame are those of the surface, moved."""
    known = read_contacts(case.estimate()).estimate
    found = read_contacts(case.estimate(".csv", "--frame", frame)).estimate
    assert np.array_equal(found.status, known.status)
    turns = np.broadcast_to(turns, (len(known.status), 3, 3))
    np.testing.assert_allclose(found.point, np.einsum("nij,nj->ni", turns, known.point) + places, atol=1e-9)
    np.testing.assert_allclose(found.force, np.einsum("nij,nj->ni", turns, known.force), atol=1e-6)


def _near(case: Case, contacts: Path) -> None:
    """`evaluate` finds them where the touches were."""
    said = run("evaluate", contacts, _truth(case))
    line = re.search(r"location of touches \[mm\]\s+([\d.]+)", said)
    assert line is not None, "no errors of touches"
    assert float(line[1]) <= 1e3 * case.sensor.place, f"{line[1]} mm off"


def _truth(case: Case) -> Path:
    path = case.files.folder / "known.csv"
    case.files.truth.write(path)
    return path


def _screen(*words: object) -> str:
    """What `inspect` says, if it is one screen."""
    said = run(*map(str, words))
    rows = said.splitlines()
    wide = max(map(len, rows), default=0)
    assert len(rows) <= SCREEN[0], f"{len(rows)} lines are no screen"
    assert wide <= SCREEN[1], f"a line of {wide} letters is no screen"
    return said


def _first(text: str) -> str:
    """The first line that says something."""
    return next((line.strip(" |│") for line in text.splitlines() if re.search(r"[a-z]{3}", line)), "")
