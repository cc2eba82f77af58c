"""`palpate estimate` on logs as they come: torn, interrupted, not tared, late, filtered, without positions."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import fields
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import palpate
from claims.evidence import logs_written
from claims.evidence.logs_written import POSE, STAMPED, WRENCH, write_csv, write_mcap
from palpate.cli import main
from palpate.contact import Contacts
from palpate.contact.estimate import Status
from palpate.files.contacts import read_contacts
from palpate.files.models import load_toml
from palpate.setup.edit import update_offset
from palpate.setup.pipeline import OpenedLog, Pipeline
from palpate.signals.recording import ORIENTATION
from palpate.surfaces import _jit
from palpate_lab.simulation.session import NOISE, Session, simulate_session
from palpate_lab.simulation.session_files import POSE_TOPIC, WRENCH_TOPIC, write_session
from palpate_lab.simulation.session_mcap import CLOCK_OFFSET, POSITION, write_session_mcap

RATE = 200
STEP = 10**9 // RATE  # ns
LONG = 60_000  # samples


@pytest.fixture(scope="module")
def session() -> Session:
    return simulate_session(7, touches=4, facets=320)


@pytest.fixture(scope="module")
def made(session: Session, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its files, with the payload identified and the clock's offset known."""
    folder = tmp_path_factory.mktemp("session")
    write_session(session, folder)
    write_session_mcap(session, folder)
    assert main(["calibrate", "payload", str(folder / "free_motion.csv"), "-o", str(folder / "payload.toml")]) == 0
    mine = (folder / "rig.toml").read_text().replace(WRENCH_TOPIC, WRENCH).replace(POSE_TOPIC, POSE)
    (folder / "mine.toml").write_text(mine)
    update_offset(folder / "rig.toml", folder / "rig.toml", CLOCK_OFFSET, comment="s, as it was made")
    return folder


def estimate(log: Path, rig: Path, output: Path, *options: str) -> int:
    return main(["estimate", str(log), "--rig", str(rig), "-o", str(output), *options])


def messages(session: Session) -> logs_written.Session:
    """Wrenches and poses of the touches, both at every sample."""
    log = session.touches
    stamp = STEP * np.arange(1, len(log) + 1, dtype=np.int64)
    position = np.tile(np.array(POSITION), (len(stamp), 1))
    return logs_written.Session(stamp, log.wrenches(), log.channels[ORIENTATION], position)


def assert_same(found: Contacts, expected: Contacts) -> None:
    """To the last bit."""
    for field in fields(expected.estimate):
        left, right = getattr(found.estimate, field.name), getattr(expected.estimate, field.name)
        assert np.array_equal(left, right, equal_nan=True), field.name


# torn files


def _message_ends(raw: bytes, channel: int) -> np.ndarray:
    """Where each message of a channel ends in an MCAP file without chunks: records are a byte, a length, content."""
    ends, at = list[int](), 8
    while at + 9 <= len(raw):
        end = at + 9 + int.from_bytes(raw[at + 1 : at + 9], "little")
        if raw[at] == 5 and int.from_bytes(raw[at + 9 : at + 11], "little") == channel:
            ends.append(end)
        at = end
    return np.array(ends)


@pytest.mark.parametrize("row", [0, 1, 30, 700])
def test_a_torn_log_is_estimated_as_far_as_it_goes(
    made: Path, session: Session, tmp_path: Path, capsys: pytest.CaptureFixture[str], row: int
) -> None:
    """Cut within a wrench: those before it, be it one, are answered, and exit code 3 says that there were more."""
    write_mcap(tmp_path / "log.mcap", messages(session).messages(), use_chunking=False)
    raw = (tmp_path / "log.mcap").read_bytes()
    ends = _message_ends(raw, 1)  # the first channel
    assert len(ends) == len(session.touches)
    (tmp_path / "log.mcap").write_bytes(raw[: ends[row + 1] - 20])
    assert estimate(tmp_path / "log.mcap", made / "mine.toml", tmp_path / "contacts.parquet") == 3
    said = capsys.readouterr().out
    assert f"{row + 1:,} in, {row + 1:,} rows out" in said
    assert "warning: the file is torn at byte" in said
    assert read_contacts(tmp_path / "contacts.parquet").sample.tolist() == list(range(row + 1))
    assert (tmp_path / "contacts.parquet.toml").exists()


def test_processes_beside_give_the_same_bits(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One reads and tells accelerations, one locates, one writes; that the log is torn, and what was met, is said."""
    raw, said = (made / "touches.mcap").read_bytes(), list[list[str]]()
    (tmp_path / "log.mcap").write_bytes(raw[: len(raw) // 2])
    for workers in ("1", "2"):
        (tmp_path / workers).mkdir()
        output = tmp_path / workers / "contacts.csv"
        assert estimate(tmp_path / "log.mcap", made / "rig.toml", output, "--workers", workers) == 3
        said.append([line for line in capsys.readouterr().out.splitlines()[1:] if not line.startswith("  time ")])
    assert said[0] == said[1]
    assert "sensor moved in" in "".join(said[0])
    for name in ("contacts.csv", "contacts.csv.toml"):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes()


def test_what_goes_wrong_in_a_writing_process_is_the_same_sentence(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A folder where the file is to grow."""
    (tmp_path / "y.csv.part" / "mine").mkdir(parents=True)
    said = set[str]()
    for workers in ("1", "2"):
        assert estimate(made / "touches.csv", made / "rig.toml", tmp_path / "y.csv", "--workers", workers) == 1
        said.add(capsys.readouterr().err)
    (one,) = said
    assert "is a folder with a file that Palpate did not write, 'mine'" in one


# interrupted


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mcap"])
def test_ctrl_c_leaves_a_whole_file_of_what_was_done(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    pl.read_csv(made / "touches.csv").write_parquet(tmp_path / "log.parquet")
    assert estimate(tmp_path / "log.parquet", made / "rig.toml", tmp_path / f"whole{suffix}") == 0
    capsys.readouterr()
    monkeypatch.setattr("palpate.files.logs.columns.BLOCK", 500)
    monkeypatch.setattr("palpate.files.logs.stuck.FIRST", 1)
    monkeypatch.setattr("palpate.cli.estimate.progress", _interrupting(2))
    output = tmp_path / f"contacts{suffix}"
    report = ("--report", str(tmp_path / "report.html")) if suffix == ".csv" else ()
    assert estimate(tmp_path / "log.parquet", made / "rig.toml", output, *report) == 130
    warning = f"interrupted: {output.name} holds the 1,000 samples done until then"
    assert f"warning: {warning}" in capsys.readouterr().out
    assert not report or warning in (tmp_path / "report.html").read_text()
    assert not list(tmp_path.glob("*.part"))
    found, whole = read_contacts(output), read_contacts(tmp_path / f"whole{suffix}")
    assert found.sample.tolist() == list(range(1000))
    assert_same(found, whole[:1000])
    assert load_toml(tmp_path / f"contacts{suffix}.toml")["log"].startswith("log.parquet sha256:")


def test_ctrl_c_while_parquet_is_joined_loses_nothing(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def joining(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("palpate.files.contacts.writing.pl.scan_parquet", joining)
    output = tmp_path / "contacts.parquet"
    assert estimate(made / "touches.csv", made / "rig.toml", output) == 130
    assert not output.exists()
    monkeypatch.undo()
    assert main(["inspect", str(output)]) == 0
    assert "contacts.parquet.part" in capsys.readouterr().out
    assert len(read_contacts(tmp_path / "contacts.parquet.part")) == len(pl.read_csv(made / "touches.csv"))


def _interrupting(after: int) -> Callable[[int, float], None]:
    """Ctrl-C when so many blocks were counted."""
    left = iter(range(after - 1, -1, -1))

    def progress(done: int, share: float) -> None:
        if not next(left):
            raise KeyboardInterrupt

    return progress


@pytest.fixture(scope="module")
def long(session: Session, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Samples as text, of which a reader takes some 10,000 at a time."""
    log = messages(session)
    rows = np.arange(LONG) % len(log.stamp)
    path, stamp = tmp_path_factory.mktemp("long") / "log.csv", STEP * np.arange(len(rows), dtype=np.int64)
    write_csv(path, logs_written.Session(stamp, log.wrench[rows], log.quaternion[rows], log.position[rows]))
    return path


@pytest.fixture
def answering(made: Path, long: Path, tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A program in the middle of its work: its log is a pipe that holds back the end, and some rows are written."""
    os.mkfifo(tmp_path / "log.csv")
    call = ["estimate", "log.csv", "--rig", str(made / "mine.toml"), "-o", "contacts.csv"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen([sys.executable, "-m", "palpate", *call], cwd=tmp_path, text=True, **pipes)
    pipe = os.open(tmp_path / "log.csv", os.O_RDWR | os.O_NONBLOCK)  # both ends: it neither waits nor ends
    left = memoryview(long.read_bytes()[:-1000])
    while process.poll() is None and not _begun(tmp_path / "contacts.csv.part"):
        with suppress(BlockingIOError):
            left = left[os.write(pipe, left) :]
        time.sleep(0.002)
    yield process
    process.kill()
    process.communicate()
    os.close(pipe)


def _begun(part: Path) -> bool:
    return part.exists() and part.stat().st_size > 1000


@pytest.fixture(scope="module")
def answers(made: Path, long: Path, tmp_path_factory: pytest.TempPathFactory) -> Contacts:
    """Of the whole long log."""
    output = tmp_path_factory.mktemp("answers") / "contacts.parquet"
    assert estimate(long, made / "mine.toml", output) == 0
    return read_contacts(output)


def test_a_signal_in_the_middle_is_130_and_a_whole_file(
    answering: subprocess.Popen[str], answers: Contacts, tmp_path: Path
) -> None:
    answering.send_signal(signal.SIGINT)
    said, problem = answering.communicate(timeout=60)
    assert (answering.returncode, problem) == (130, "")
    found = read_contacts(tmp_path / "contacts.csv")
    assert f"{len(found):,} in, {len(found):,} rows out" in said
    assert f"contacts.csv holds the {len(found):,} samples done until then" in said
    assert found.notes == ()
    assert not (tmp_path / "contacts.csv.part").exists()
    assert 0 < len(found) < LONG
    assert_same(found, answers[: len(found)])


def test_a_kill_leaves_what_was_done_for_inspect(
    answering: subprocess.Popen[str], answers: Contacts, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answering.kill()
    answering.wait(timeout=60)
    assert not (tmp_path / "contacts.csv").exists()
    assert main(["inspect", str(tmp_path / "contacts.csv")]) == 0
    said = capsys.readouterr().out
    assert "contacts.csv.part" in said
    found = read_contacts(tmp_path / "contacts.csv.part")
    assert f"{len(found):,}" in said
    assert 0 < len(found) < LONG
    assert_same(found, answers[: len(found)])


# tare


BIAS = np.array([4.0, -3.0, 2.0, 0.1, -0.2, 0.05])


def _weightless(session: Session, path: Path, bias: np.ndarray = BIAS, start: int = 0) -> Path:
    """Wrenches of the contact and a bias alone, without orientations."""
    log = session.touches
    contact = log.wrenches() - session.load.wrenches(log.channels[ORIENTATION])
    table = np.column_stack([log.time, contact + bias])[start:]
    pl.DataFrame(table, schema=["time", "fx", "fy", "fz", "tx", "ty", "tz"]).write_parquet(path)
    return path


@pytest.fixture
def bare(made: Path, tmp_path: Path) -> Path:
    """The rig without payload and orientation."""
    mesh = (made / "probe.stl").as_posix()
    text = (made / "mine.toml").read_text().replace('payload = "payload.toml"', "").replace("probe.stl", mesh)
    (tmp_path / "rig.toml").write_text(text[: text.index("[orientation]")] + text[text.index("[filter]") :])
    return tmp_path / "rig.toml"


def test_a_tare_takes_the_bias_off(
    bare: Path, session: Session, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Against the log that has none: the force differs by the mean of 61 readings' noise, five times at most."""
    biased, clean = (_weightless(session, tmp_path / f"{k}.parquet", k * BIAS) for k in (1, 0))
    assert estimate(clean, bare, tmp_path / "clean.csv") == 0
    assert "so they must be tared" in capsys.readouterr().out
    assert estimate(biased, bare, tmp_path / "tared.csv", "--tare", "0.3", "--noise", "0.02", "0.001") == 0
    said = capsys.readouterr().out
    assert "5.39 N" in said  # (4, -3, 2)
    assert "the tare of the wrenches holds only while the sensor keeps its orientation" in said
    tared, right = (read_contacts(tmp_path / f"{name}.csv").estimate for name in ("tared", "clean"))
    assert np.abs(tared.force - right.force).max() < 5 * NOISE[0] / np.sqrt(61)
    both = tared.answered & right.answered
    assert both.sum() > 0.95 * right.answered.sum()
    assert load_toml(tmp_path / "tared.csv.toml")["tare"] == "0.3"


def test_a_start_that_is_not_at_rest_is_no_tare(
    bare: Path, session: Session, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The log begins in the middle of a press's rise."""
    log = _weightless(session, tmp_path / "log.parquet", start=90)
    assert estimate(log, bare, tmp_path / "contacts.csv", "--tare", "0.2") == 1
    said = capsys.readouterr().err
    assert "the sensor was not at rest during the tare: the wrench" in said
    assert said.count("\n") == 1
    assert not (tmp_path / "contacts.csv").exists()


def test_a_tare_on_a_steady_touch_is_warned_of(
    bare: Path, session: Session, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """5 N along the normal at the probe's tip, from the first sample on."""
    tip = session.nominal.apply(np.array([0.0, 0.0, session.vertices[:, 2].max()]))
    force = np.array([0.0, 0.0, -5.0])
    held = np.concatenate([force, np.cross(tip, force)])
    contact = _weightless(session, tmp_path / "log.parquet", held)
    assert estimate(contact, bare, tmp_path / "contacts.csv", "--tare", "0.3") == 0
    assert "make sure that nothing touched it" in capsys.readouterr().out


# filters


def test_a_filter_of_the_call_wins_over_the_rig(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, rig = made / "touches.mcap", made / "rig.toml"
    stated = made / "stated.toml"
    stated.write_text(rig.read_text().replace('"butterworth"', '"zero_phase"').replace("cutoff = 15", "cutoff = 30"))
    assert estimate(log, rig, tmp_path / "called.mcap", "--filter", "zero_phase", "--cutoff", "30") == 0
    assert "Butterworth, order 2, 30 Hz, forward and backward: at 200 Hz" in capsys.readouterr().out
    assert estimate(log, stated, tmp_path / "stated.mcap") == 0
    assert_same(read_contacts(tmp_path / "called.mcap"), read_contacts(tmp_path / "stated.mcap"))
    assert estimate(log, rig, tmp_path / "none.mcap", "--filter", "none") == 0
    records = [load_toml(tmp_path / f"{name}.mcap.toml")["filter"] for name in ("called", "stated", "none")]
    assert records == ["Butterworth(cutoff=30.0, order=2, zero_phase=True) at 200 Hz"] * 2 + ["none"]


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (("--cutoff", "150"), "a cut-off of 150 Hz is not below half the rate of the samples (200 Hz). Choose"),
        (("--cutoff", "0"), "cutoff: cutoff must be positive"),
        (("--filter", "kalman", "--cutoff", "10"), "the filter is 'kalman', which has no cut-off. Add"),
        (("--filter", "none", "--cutoff", "10"), "the filter is 'none', which has no cut-off. Add"),
        (("--tare", "-1"), "tare: tare must be a positive time"),
        (("--tare", "0.01"), "a tare needs at least 10 usable samples, and has 0. Let"),
        (("--workers", "0"), "--workers: must be at least 1"),
    ],
)
def test_an_option_that_cannot_be_is_a_sentence(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...], word: str
) -> None:
    assert estimate(made / "touches.mcap", made / "rig.toml", tmp_path / "contacts.csv", *options) == 1
    said = capsys.readouterr().err
    assert word in said
    assert said.count("\n") == 1
    assert not list(tmp_path.iterdir())


# report and truth


def test_the_report_holds_what_the_run_says(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report = tmp_path / "report.html"
    options = ("--report", str(report), "--truth", str(made / "truth.csv"))
    assert estimate(made / "touches.mcap", made / "rig.toml", tmp_path / "contacts.csv", *options) == 0
    assert main(["evaluate", str(tmp_path / "contacts.csv"), str(made / "truth.csv")]) == 0
    row = next(line for line in capsys.readouterr().out.splitlines() if "location of touches" in line)
    page = report.read_text()
    assert all(f">{figure}<" in page for figure in row.split()[-5:])  # mean, median, 95 %, worst and count
    force = np.linalg.norm(read_contacts(tmp_path / "contacts.csv").estimate.force, axis=1)
    assert f"{np.nanmax(force):.3g} N" in page
    assert all(word in page for word in ("touches.mcap", "1,760", "no pose", "Against the ground truth", "Butterworth"))
    assert page.count("<svg") + page.count("<img") > 2
    record = load_toml(tmp_path / "contacts.csv.toml")
    assert record["truth"].startswith("truth.csv sha256:")
    assert record["truth"].removeprefix("truth.csv sha256:") in page


@pytest.mark.parametrize(
    ("output", "options", "word"),
    [
        ("contacts.xlsx", "", "a file that ends in '.xlsx'. Use one of .csv, .parquet, .mcap"),
        ("contacts", "", "contacts cannot be written to a file that ends in ''. Use"),
        ("no/contacts.csv", "", "there is no folder"),
        ("contacts.csv", "--report no/report.html", "there is no folder"),
        ("contacts.csv", "--report report.txt", "must end in .html. Use"),
        ("contacts.csv", "--report report.html --truth no.csv", "the file does not exist. Available"),
        ("contacts.csv", "--report report.html --truth report.html", "would overwrite an input, report.html. Name"),
        ("contacts.csv", "--truth truth.csv", "is used only in the report, but --report is missing. Add"),
    ],
)
def test_what_cannot_be_written_or_compared_is_said_before_the_work(
    made: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    output: str,
    options: str,
    word: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("palpate.cli.estimate_log.Pipeline.of", lambda *_: pytest.fail("the work has begun"))
    (tmp_path / "truth.csv").write_bytes((made / "truth.csv").read_bytes())
    (tmp_path / "report.html").write_text("of yesterday")
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    assert estimate(made / "touches.mcap", made / "rig.toml", Path(output), *options.split()) == 1
    assert word in capsys.readouterr().err
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


# poses


def test_the_base_frame_without_poses_names_what_to_record(
    bare: Path, session: Session, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    alone = [each for each in messages(session).messages() if each[1] == WRENCH]
    write_mcap(tmp_path / "log.mcap", alone, {WRENCH: STAMPED[WRENCH]})
    assert estimate(tmp_path / "log.mcap", bare, tmp_path / "contacts.csv", "--frame", "base") == 1
    said = capsys.readouterr().err
    assert "the base frame needs the sensor's orientation in the base, which this log does not have. Add" in said
    assert "a topic of poses" in said
    assert not (tmp_path / "contacts.csv").exists()


def test_samples_in_a_gap_of_the_poses_have_none(made: Path, session: Session, tmp_path: Path) -> None:
    """Poses fall silent for half a second, and end half a second early; what lies on a pose is answered."""
    log = messages(session)
    last = len(log.stamp) - 1
    silent = np.zeros(len(log.stamp), dtype=bool)
    silent[501:600] = silent[last - 99 :] = True
    row = {stamp: k for k, stamp in enumerate(log.stamp.tolist())}
    kept = [each for each in log.messages() if each[1] == WRENCH or not silent[row[each[0]]]]
    write_mcap(tmp_path / "log.mcap", kept)
    assert estimate(tmp_path / "log.mcap", made / "mine.toml", tmp_path / "contacts.csv") == 0
    found = read_contacts(tmp_path / "contacts.csv").estimate
    assert np.array_equal(found.status == Status.NO_POSE, silent)
    assert np.isnan(found.force[silent]).all()


def test_poses_that_come_late_are_waited_for(made: Path, session: Session, tmp_path: Path) -> None:
    """Poses stand in the file 0.4 s behind the wrenches of their stamps: nothing changes."""
    log = messages(session)
    write_mcap(tmp_path / "log.mcap", log.messages())
    late = sorted(log.messages(), key=lambda each: each[0] + (4 * 10**8 if each[1] == POSE else 0))
    write_mcap(tmp_path / "late.mcap", late)
    for name in ("log", "late"):
        assert estimate(tmp_path / f"{name}.mcap", made / "mine.toml", tmp_path / f"{name}.csv") == 0
    found = read_contacts(tmp_path / "late.csv")
    assert_same(found, read_contacts(tmp_path / "log.csv"))
    assert not np.any(found.estimate.status == Status.NO_POSE)


def test_contacts_that_are_not_all_say_so(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    torn, output, page = tmp_path / "torn.mcap", tmp_path / "contacts.csv", tmp_path / "report.html"
    torn.write_bytes((made / "touches.mcap").read_bytes()[:200_000])
    assert estimate(torn, made / "rig.toml", output, "--report", str(page)) == 3
    assert "the file is torn" in page.read_text()
    assert load_toml(tmp_path / "contacts.csv.toml")["ended"] == "torn"
    capsys.readouterr()
    assert main(["inspect", str(output)]) == 0
    assert "not all contacts are in it" in capsys.readouterr().out


def test_the_version_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"palpate {palpate.__version__}\n"


def test_compiling_is_no_part_of_locating(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is spent is told apart: the parts are no more than the whole."""
    opened = palpate.open_log(made / "touches.csv", made / "mine.toml")
    pipeline = Pipeline.of(opened)
    pairs = pipeline.estimator.pairs

    def late(blocks: OpenedLog, watch: None) -> Iterator[object]:
        with _jit._COMPILING:
            time.sleep(0.3)
        yield from pairs(blocks, watch)

    monkeypatch.setattr(pipeline.estimator, "pairs", late)
    begin, read = time.perf_counter(), opened.seconds
    assert sum(len(block) for block, _, _ in pipeline.stream()) > 0
    whole, spent = time.perf_counter() - begin, pipeline.seconds
    assert spent["compile"] >= 0.29  # clocks differ a little
    assert spent["locate"] + spent["compile"] + opened.seconds - read <= whole + 0.01
