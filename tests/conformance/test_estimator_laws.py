"""The laws of an estimator, for every sensor, from Python, and as the only sensor of a robot."""

import copy
import itertools
import pickle
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation

import palpate
from palpate.contact.contacts import Contacts
from palpate.contact.wrench_estimator import WrenchEstimator
from palpate.errors import PalpateError
from palpate.signals.recording import ORIENTATION, POSITION, UNSTEADY, Recording
from tests.conformance.fields import Case, run, same
from tests.conformance.live import BESIDE, each_reading, readings_of, whole
from tests.conformance.sensors import SENSORS, Sensor
from tests.support.kernels import compilations
from tests.support.state import IN_BLOCKS, remembered

LENGTH = 400  # samples: the zero and the first touch
PLACED = ("px", "py", "pz", "nx", "ny", "nz", "torque", *(f"var_{k}" for k in ("xx", "xy", "xz", "yy", "yz", "zz")))
BAD = {"NaN": np.nan, "infinite": np.inf, "too large": 1e30}
SENSOR = pytest.mark.parametrize("sensor", SENSORS, ids=lambda sensor: sensor.name)
TABLED = pytest.mark.parametrize(  # those whose log is a table, which a test may write anew
    "sensor", [sensor for sensor in SENSORS if sensor.table != "marker_ring"], ids=lambda sensor: sensor.name
)


@dataclass(frozen=True)
class Set:
    """A sensor's rig, the beginning of its log, and a way to an estimator that has heard nothing yet."""

    case: Case
    rig: Any
    recording: Recording

    @cached_property
    def known(self) -> pl.DataFrame:
        """Its contacts by `stream`, made once for all tests."""
        return self.streamed()

    def estimator(self) -> Any:
        """Prepared for the log."""
        with palpate.open_log(str(self.case.files.log), self.rig) as opened:
            return self.rig.estimator(opened)

    def cut(self, size: int) -> Iterator[Recording]:
        """The log in blocks of a size."""
        for start in range(0, len(self.recording), size):
            yield self.recording.picked(slice(start, start + size))

    def streamed(self, ends: list[int] | None = None) -> pl.DataFrame:
        """Its contacts by `stream`, from blocks that end at these samples; from one block where none are given."""
        ends = ends or [len(self.recording)]
        blocks = (self.recording.picked(slice(*piece)) for piece in itertools.pairwise([0, *ends]))
        return palpate.Contacts.joined(list(self.estimator().stream(blocks))).to_polars()

    @cached_property
    def _prepared(self) -> tuple[Any, Recording]:
        from palpate.files.logs import join

        estimator = self.estimator()
        ready = [block for block, _ in estimator.pairs(self.cut(LENGTH))]
        return estimator, join(ready)

    def prepared(self) -> tuple[Any, Recording]:
        """An estimator after `stream`, reset (its zero stays), and the samples as it got them ready.

        One for all tests of a sensor: whatever a reset does not forget of one of them, the next would show.
        """
        estimator, ready = self._prepared
        estimator.reset()
        return estimator, ready

    @cached_property
    def raw(self) -> Any:
        """What an estimator that has heard nothing yet says of the samples as they are."""
        return self.estimator().run(self.recording)

    @cached_property
    def answers(self) -> pl.DataFrame:
        """What a prepared estimator's `run` says of those samples."""
        estimator, ready = self.prepared()
        return estimator.run(ready).to_polars()


_SETS: dict[str, Set] = {}  # a rig and a recording are frozen: one for all tests of a sensor


@pytest.fixture
def made(case_of: Callable[[Sensor], Case], sensor: Sensor) -> Set:
    case = case_of(sensor)
    if sensor.name not in _SETS:
        rig = palpate.load_rig(str(case.files.rig))
        _SETS[sensor.name] = Set(case, rig, whole(case.files.log, rig).picked(slice(0, LENGTH)))
    return _SETS[sensor.name]


@SENSOR
def test_blocks_of_any_size_are_answered_alike(made: Set) -> None:
    """Sevens, but one by one where the zero ends and the first touch begins; and all but the last sample."""
    assert made.known["status"].is_in(["contact", "ambiguous"]).any()
    touch, end = int(np.searchsorted(made.recording.time, made.case.files.truth.start[0])), len(made.recording)
    single = range(touch - 20, touch + 10)
    for ends in ([*range(7, single[0], 7), *single, *range(single[-1] + 7, end, 7), end], [end - 1, end]):
        same(made.streamed(ends), made.known)


@SENSOR
def test_update_run_and_stream_are_one(made: Set) -> None:
    """`update` is given no doubt about the acceleration, which looking ahead finds: without it, it is `run`.

    Of a touch that moved beyond its noise, `stream` knows the rest: a light sample may be where the others are.
    """
    moved = [k for k, rows in enumerate(zip(made.answers.rows(), made.known.rows(), strict=True)) if rows[0] != rows[1]]
    assert len(moved) <= (made.known.height // 200 if isinstance(made.prepared()[0], WrenchEstimator) else 0)
    rest = [k for k in range(made.known.height) if k not in moved]
    same(made.answers[rest], made.known[rest])
    same(made.answers.drop(PLACED, strict=False), made.known.drop(PLACED, strict=False))
    estimator, ready = made.prepared()
    known = {name: values for name, values in ready.channels.items() if name != UNSTEADY}
    live = replace(ready, channels=known)
    single = [estimator.update(*reading) for reading in each_reading(estimator, live)]
    fed = copy.deepcopy(estimator)
    estimator.reset()
    same(_numbered(single), estimator.run(live).to_polars())
    estimator.reset()
    readings, beside = readings_of(estimator, live), {name: known[name] for name in known if name in BESIDE}
    rows, counts = estimator.empty(len(live) * estimator.most), np.zeros(len(live), np.int64)
    estimator.run_into(live.time, readings, rows, counts, beside)
    assert not remembered(fed, estimator, *IN_BLOCKS)


HOLDERS: dict[str, Callable[[np.ndarray], Any]] = {
    "strided": lambda a: np.repeat(a, 2, axis=0)[::2],
    "by columns": np.asfortranarray,
    "read-only": lambda a: _locked(a.copy()),
    "single precision": lambda a: a.astype(np.float32),
    "whole numbers": lambda a: np.nan_to_num(np.round(a)).astype(np.int64),
    "true or false": lambda a: np.nan_to_num(a) > 0,
    "a list": lambda a: a.tolist(),
    "a tuple": lambda a: tuple(a.tolist()),
}


def _locked(values: np.ndarray) -> np.ndarray:
    values.flags.writeable = False
    return values


@SENSOR
@pytest.mark.parametrize("holder", HOLDERS)
def test_whatever_holds_times_and_readings_gives_the_same_bits_and_compiles_nothing(made: Set, holder: str) -> None:
    estimator, ready = made.prepared()
    hold, readings = HOLDERS[holder], readings_of(estimator, ready)
    piece = slice(len(ready) // 2, len(ready) // 2 + (2 if readings.dtype == np.uint8 else 12))  # images are large
    readings = readings[piece]
    beside = {name: values[piece] for name, values in ready.channels.items() if name in BESIDE}
    image = readings.dtype == np.uint8
    held = readings if image and holder in ("single precision", "whole numbers", "true or false") else hold(readings)
    when, count = hold(ready.time[piece]), len(readings)

    def answered(time: Any, readings: Any, beside: Any) -> tuple[np.ndarray, np.ndarray]:
        estimator.reset()
        rows, counts = estimator.empty(count * estimator.most), np.zeros(count, np.int64)
        assert estimator.run_into(time, readings, rows, counts, beside) == count
        return rows[: counts.sum()], counts

    plain = np.array(when, dtype=np.float64), np.array(held, dtype=readings.dtype)
    expected, before = answered(*plain, beside), compilations()
    found = answered(when, held, {name: np.repeat(values, 2, axis=0)[::2] for name, values in beside.items()})
    for one, two in zip(found, expected, strict=True):
        assert np.array_equal(one, two, equal_nan=True)
    if not isinstance(held, list | tuple):  # a sample alone: a number of any type, and a row
        for k, (time, reading, *rest) in enumerate(each_reading(estimator, ready.picked(piece))):
            alone = np.asarray(reading) if image else hold(np.asarray(reading))
            estimator.update_into(when[k], alone, estimator.empty(estimator.most), *rest)
            estimator.update(np.asarray(time), alone, *rest)
    assert compilations() == before


@SENSOR
@pytest.mark.parametrize("bad", BAD)
def test_bad_samples_get_a_status_and_spoil_no_other(made: Set, bad: str) -> None:
    """All readings of every fortieth sample after the start: neither answered nor dropped; the touch is still found."""
    rows = np.arange(len(made.recording) // 4, len(made.recording), 40)
    channels = dict(made.recording.channels)
    for name in channels.keys() - set(BESIDE):
        values = np.array(channels[name])
        values[rows] = BAD[bad] if values.dtype == np.float64 else 0  # a black image
        channels[name] = values
    spoiled = Recording(made.recording.time, channels)
    found = palpate.Contacts.joined(list(made.estimator().stream([spoiled])))
    hit = np.isin(found.sample, rows)
    labels = {palpate.Status(code).label for code in found.status[hit].tolist()}
    assert labels <= {"invalid", "saturated"}
    assert np.isnan(found.point[hit]).all()
    before = made.case.files.truth
    rest = (found.time >= before.start[0]) & (found.time <= before.end[0]) & ~hit
    off = np.median(found.point[rest & found.answered], axis=0) - before.point[0]
    assert np.linalg.norm(off) <= made.case.sensor.place


@TABLED
def test_one_rigid_motion_of_the_base_moves_the_contacts_by_it(made: Set) -> None:
    """About the vertical, so that a payload weighs the same."""
    files = made.case.files
    turn, slide = Rotation.from_rotvec([0.0, 0.0, 2.1]), np.array([0.3, -0.7, 0.2])
    log = pl.read_csv(files.log)
    turned = (turn * Rotation.from_quat(log.select("qx", "qy", "qz", "qw").to_numpy())).as_quat()
    moved = turn.apply(log.select("x", "y", "z").to_numpy()) + slide
    columns = dict(zip(("qx", "qy", "qz", "qw", "x", "y", "z"), np.c_[turned, moved].T, strict=True))
    log.with_columns(**{name: pl.Series(values) for name, values in columns.items()}).write_csv(
        files.folder / "moved.csv"
    )
    out = files.folder / "moved_contacts.parquet"
    run("estimate", str(files.folder / "moved.csv"), "--rig", str(files.rig), "--frame", "base", "-o", str(out))
    found, known = pl.read_parquet(out), pl.read_parquet(made.case.estimate(".parquet", "--frame", "base"))
    assert found["status"].equals(known["status"])
    for names, shift in ((("px", "py", "pz"), slide), (("fx", "fy", "fz"), 0.0), (("nx", "ny", "nz"), 0.0)):
        there = turn.apply(known.select(names).fill_null(np.nan).to_numpy()) + shift
        np.testing.assert_allclose(found.select(names).fill_null(np.nan).to_numpy(), there, atol=1e-7)


@SENSOR
def test_frames_of_python_are_those_of_the_command(made: Set) -> None:
    files = made.case.files
    for frame in ("sensor", "base")[: 1 if "--frame base" in made.case.sensor.refused else 2]:
        found = palpate.estimate(str(files.log), made.rig, frame=frame)
        same(found.to_polars(), pl.read_parquet(made.case.estimate(".parquet", "--frame", frame)))


@SENSOR
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_copies_share_nothing(made: Set, copied: Callable[[Any], Any]) -> None:
    """In the middle of a touch, both go on from there, and neither disturbs the other."""
    estimator, ready = made.prepared()
    first, second = ready.picked(slice(0, 200)), ready.picked(slice(200, LENGTH))
    estimator.run(first)
    twin = copied(estimator)
    known = estimator.run(second).to_polars()
    estimator.reset()
    same(twin.run(second).to_polars(), known)


@SENSOR
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_values_come_back_as_they_were(made: Set, copied: Callable[[Any], Any]) -> None:
    found = made.raw
    same(copied(found).to_polars(), found.to_polars())
    back = copied(made.recording)
    for name, values in made.recording.channels.items():
        assert np.array_equal(back.channels[name], values, equal_nan=True)
        assert not back.channels[name].flags.writeable


@SENSOR
def test_a_recording_without_what_the_sensor_reads_is_refused(made: Set) -> None:
    estimator = made.estimator()
    kept = {name: values for name, values in made.recording.channels.items() if name in (ORIENTATION, POSITION)}
    with pytest.raises(PalpateError, match=rf"{estimator.channels[0]}|readings|voltages|wrench"):
        estimator.run(Recording(made.recording.time, kept))


@SENSOR
@pytest.mark.parametrize("change", [-1, 1])
def test_a_reading_of_another_length_is_refused_before_a_kernel_sees_it(made: Set, change: int) -> None:
    estimator, ready = made.prepared()
    time, reading, *beside = next(each_reading(estimator, ready))
    wrong = np.resize(np.ravel(reading), np.size(reading) + change)
    said = ""
    try:
        found = estimator.update(time, wrong, *beside)
    except PalpateError as problem:
        said = str(problem)
    else:
        assert [palpate.Status(code).label for code in found.status.tolist()] == ["invalid"]
    assert not said or re.search(rf"\b{np.size(reading)}\b", said)


@SENSOR
def test_a_tare_where_something_presses_is_doubted_or_refused(made: Set) -> None:
    estimator, files = made.estimator(), made.case.files
    recording = whole(files.log, made.rig)
    quiet = estimator.tare(recording.picked(recording.time <= recording.time[0] + files.rest))
    assert quiet.note
    assert not quiet.warning
    touched = recording.picked((recording.time > files.truth.start[0]) & (recording.time < files.truth.end[0]))
    try:
        doubt = estimator.tare(touched).warning
    except PalpateError as problem:  # not steady: a touch trembles
        doubt = str(problem)
    assert doubt


@SENSOR
def test_what_an_estimator_says_of_itself(made: Set) -> None:
    estimator, ready = made.prepared()
    found = estimator.run(ready)
    assert set(estimator.channels) <= set(ready.channels)
    assert tuple(found.features) == tuple(estimator.features)
    for said in (*estimator.notes(), *estimator.warnings()):
        assert isinstance(said, str)
        assert said
    np.testing.assert_allclose(estimator.mount.translation, made.case.files.mount.translation, atol=1e-12)
    for name, values in found.features.items():
        assert np.isfinite(values[found.answered]).all(), name


@TABLED
def test_a_log_is_the_same_in_every_format(made: Set) -> None:
    """Contacts of the CSV and of the same table as Parquet, to the last bit."""
    files = made.case.files
    pl.read_csv(files.log).write_parquet(files.folder / "log.parquet")
    found = palpate.estimate(str(files.folder / "log.parquet"), made.rig)
    same(found.to_polars(), pl.read_parquet(made.case.estimate(".parquet")))


def _numbered(single: list[Any]) -> pl.DataFrame:
    """Contacts of one sample each, counted from 0."""
    numbered = [replace(found, sample=np.full(len(found), k)) for k, found in enumerate(single)]
    return palpate.Contacts.joined(numbered).to_polars()


def as_robot(rig: Path, name: str) -> Path:
    """Write the tables of a rig as those of a robot's sensor, next to it."""
    text = re.sub(r"(?m)^(\s*)\[(?=[a-z])", rf"\1[sensors.{name}.", rig.read_text())
    robot = rig.with_name(f"robot_{rig.name}")
    robot.write_text(text)
    return robot


def assert_same(found: Contacts, alone: Contacts, count: int = 1, place: int = 0) -> None:
    """Assert equal rows; identities are those of sensor number `place` of `count`."""
    np.testing.assert_array_equal(found.identity, alone.identity * count + place)
    np.testing.assert_array_equal(found.rows()[:, :-1], alone.rows()[:, :-1])
    np.testing.assert_array_equal(found.time, alone.time)
    np.testing.assert_array_equal(found.sample, alone.sample)


@pytest.mark.parametrize("sensor", SENSORS, ids=lambda sensor: sensor.name)
def test_a_robot_of_one_sensor_answers_as_its_rig(sensor: Sensor, case_of: Callable[[Sensor], Case]) -> None:
    files = case_of(sensor).files
    alone = palpate.estimate(files.log, files.rig)
    found = palpate.estimate(files.log, as_robot(files.rig, "finger"))
    assert_same(found, alone)
    assert set(found.sensor) == {"finger"}
    touches, known = found.touches(), alone.touches()
    np.testing.assert_array_equal(touches.point, known.point)
    assert list(touches.sensor) == ["finger"] * len(known)
