"""Mutated files given to the commands: each must end in time, with a sentence or with a row for every sample.

A case is a kind and a number, from which everything follows: `python -m evidence.mutated KIND NUMBER` repeats one.
"""

from __future__ import annotations

import contextlib
import io
import os
import resource
import shutil
import signal
import sqlite3
import sys
import time
import traceback
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile

import numpy as np
import polars as pl

from evidence.good_files import SAMPLES, write_good
from evidence.mcap_records import MAGIC, counted
from evidence.mutation import Random, mutate
from palpate.cli import main
from palpate.simulation.session_files import WRENCH_TOPIC

__all__ = ["KINDS", "Kind", "Outcome", "bench", "try_one"]

LIMIT = 10  # s
MEMORY = 400  # MB more than before, for files of some 50 kB
SUFFIXES = ("csv", "parquet", "mcap")
CONTACT = "/palpate/contact/estimate", ("palpate_msgs/Contact",)
WRENCHES = ("geometry_msgs/WrenchStamped", "geometry_msgs/Wrench")


@dataclass(frozen=True)
class Kind:
    """Files that are spoilt in some way, and the commands that are given them: {bad} and {out} are paths.

    Attributes:
        count: cases of the full run.
        files: name of a good file and the ways of spoiling it.
        commands: one is drawn for each case.
    """

    count: int
    files: tuple[tuple[str, str], ...]
    commands: tuple[str, ...]


@dataclass(frozen=True)
class Outcome:
    """What a command did with a file; `fault` is empty where it did well."""

    kind: str
    number: int
    command: str
    code: int
    seconds: float
    said: str
    fault: str


ESTIMATE = ("estimate {bad} --rig rig.toml -o {out}",) * 3 + (
    "estimate {bad} --rig rig_full.toml -o {out}",
    "estimate {bad} --rig rig_imu.toml -o {out}",
    "estimate {bad} --rig rig_plane.toml -o {out}",
    "estimate {bad} --rig rig.toml -o {out} --filter zero_phase --cutoff 12 --frame base",
    "estimate {bad} --mesh probe.stl --unit mm -o {out}",
)
LOG = (
    "inspect {bad}",
    "inspect {bad} --rig rig.toml",
    "calibrate payload {bad} -o {made}",
    "rig new {bad} probe.stl -o {made} --force",
)
RIG = (
    *(f"estimate touches.{suffix} --rig {{bad}} -o {{out}}" for suffix in ("csv", "csv", "mcap")),
    "inspect {bad}",
    "inspect touches.csv --rig {bad}",
)
PAYLOAD = ("estimate touches.csv --rig rig.toml --payload {bad} -o {out}", "inspect {bad}")
MESH = (
    "estimate touches.csv --rig rig.toml --mesh {bad} --unit mm -o {out}",
    "estimate touches.csv --mesh {bad} --unit m -o {out} --crease 0",
    "inspect {bad}",
)
CONTACTS = ("inspect {bad}", "events {bad} -o {made}", "evaluate {bad} truth.csv")
TRUTH = ("evaluate contacts.csv {bad}", "inspect {bad}", "estimate touches.csv --rig rig.toml -o {out} --truth {bad}")
MOUNTING = "calibrate mounting touches.csv --rig rig.toml --marks {bad} -o {made}"

KINDS = {
    "CSV": Kind(2600, (("touches.csv", "table"),), (*ESTIMATE, *ESTIMATE, *LOG)),
    "free motion, CSV": Kind(200, (("free_motion.csv", "table"),), LOG),
    "Parquet": Kind(400, (("touches.parquet", "binary"),), (*ESTIMATE, *LOG)),
    "MCAP": Kind(
        2600,
        tuple((f"{name}.mcap", "mcap") for name in ("plain", "stored", "lz4", "zstd", "touches")),
        (*ESTIMATE, *ESTIMATE, *LOG),
    ),
    "bag": Kind(300, (("touches.bag", "binary"), ("bag/bag.db3", "binary"), ("bag/metadata.yaml", "ascii")), ESTIMATE),
    "rig, TOML": Kind(
        1500, tuple((f"{name}.toml", "toml") for name in ("rig", "rig_full", "rig_imu", "rig_plane")), RIG
    ),
    "payload, TOML": Kind(500, (("payload.toml", "toml"),), PAYLOAD),
    "STL": Kind(1000, (("probe.stl", "stl"), ("probe.stl", "stl"), ("ascii.stl", "ascii")), MESH),
    "OBJ and PLY": Kind(100, (("probe.obj", "ascii"), ("probe.ply", "binary")), MESH),
    "contacts": Kind(
        600, (("contacts.csv", "table"), ("contacts.parquet", "binary"), ("contacts.mcap", "mcap")), CONTACTS
    ),
    "truth, CSV": Kind(200, (("truth.csv", "table"), ("marks.csv", "table")), (*TRUTH, MOUNTING)),
}


class _HangError(BaseException):
    """Not an Exception, which might be caught."""


@contextlib.contextmanager
def bench() -> Iterator[Path]:
    """The good files in a folder that is the current one meanwhile."""
    before = Path.cwd()
    with TemporaryDirectory() as scratch:
        write_good(Path(scratch))
        os.chdir(scratch)
        try:
            yield Path(scratch)
        finally:
            os.chdir(before)


def try_one(name: str, number: int) -> Outcome:
    """One case, among the good files."""
    kind = KINDS[name]
    random = np.random.default_rng([number, *name.encode()])
    file, ways = kind.files[int(random.integers(len(kind.files)))]
    bad = _spoilt(Path(file), ways, random)
    out = Path(f"out.{SUFFIXES[number % len(SUFFIXES)]}")
    command = kind.commands[int(random.integers(len(kind.commands)))].format(bad=bad, out=out, made="made.toml")
    for left in Path().glob("out.*"):
        shutil.rmtree(left) if left.is_dir() else left.unlink()
    peak, begin = _peak(), time.perf_counter()
    code, out_text, said, fault = _watched(command.split())
    seconds = time.perf_counter() - begin
    if _peak() - peak > MEMORY:
        fault = fault or f"took {_peak() - peak} MB"
    fault = fault or _unfit(code, out_text, said) or (_unanswered(command, bad, out) if code in (0, 3) else "")
    return Outcome(name, number, command, code, seconds, said.strip() or out_text, fault)


def _spoilt(file: Path, ways: str, random: Random) -> Path:
    """The path of the spoilt file; a bag's folder where the file is in one."""
    folder = file.parent
    if folder != Path():
        shutil.rmtree("bad_bag", ignore_errors=True)
        shutil.copytree(folder, "bad_bag")
        bad = Path("bad_bag") / file.name
    else:
        bad = Path(f"bad{file.suffix}")
    bad.write_bytes(mutate(file.read_bytes(), ways, random))
    return bad if folder == Path() else Path("bad_bag")


def _watched(arguments: list[str]) -> tuple[int, str, str, str]:
    """Exit code, stdout, stderr (also of what writes to the file itself), and what no command may do."""
    heard, said, fault, code = io.StringIO(), io.StringIO(), "", -1
    with TemporaryFile() as below, warnings.catch_warnings(record=True) as warned, _below(below.fileno()):
        warnings.simplefilter("always")
        old = signal.signal(signal.SIGALRM, _ring)
        signal.setitimer(signal.ITIMER_REAL, LIMIT)
        try:
            with contextlib.redirect_stdout(heard), contextlib.redirect_stderr(said):
                code = main(arguments)
        except BaseException as problem:
            place = traceback.extract_tb(problem.__traceback__)[-12:]
            way = " < ".join(f"{Path(at.filename).name}:{at.lineno}" for at in reversed(place))
            fault = f"{type(problem).__name__}: {problem} ({way})"
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, old)
        below.seek(0)
        text = said.getvalue() + below.read().decode(errors="replace")
    if warned:
        fault = fault or f"{warned[0].category.__name__}: {warned[0].message} ({warned[0].filename}:{warned[0].lineno})"
    return code, heard.getvalue(), text, fault


def _ring(*_: object) -> None:
    raise _HangError


@contextlib.contextmanager
def _below(file: int) -> Iterator[None]:
    """What compiled code says of itself goes to the file."""
    sys.stderr.flush()
    kept = os.dup(2)
    os.dup2(file, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _unfit(code: int, heard: str, said: str) -> str:
    """What is wrong with an exit code and what was said."""
    if code not in (0, 1, 3):
        return f"exit {code}: {said}"
    sentence, _, rest = said.partition("\n")
    if code == 1 and (not sentence.startswith("palpate: ") or rest and "panicked at crates/polars" not in rest):
        return f"no sentence, but {said!r}"  # polars' own readers of damaged Parquet talk beside it
    if code != 1 and said:
        return f"exit {code}, and on stderr {said!r}"
    return "Traceback" if "Traceback" in heard + said else ""


def _unanswered(command: str, bad: Path, out: Path) -> str:
    """What is wrong with the rows of the contacts."""
    words = command.split()
    if words[0] != "estimate":
        return ""
    log = Path(words[1])
    topic = WRENCH_TOPIC if "--rig" in words else None
    least, most = _samples(log, topic) if log == bad else (SAMPLES, SAMPLES)
    rows, numbered = _rows(out)
    if not least <= rows <= most:
        return f"{rows} rows out of {least} to {most} samples"
    return "" if numbered else "samples are not numbered from 0 in order"


def _rows(out: Path) -> tuple[int, bool]:
    if out.suffix == ".mcap":
        return counted(out.read_bytes(), *CONTACT)[0], True
    table = pl.read_csv(out, infer_schema=False) if out.suffix == ".csv" else pl.read_parquet(out)
    return table.height, table["sample"].cast(pl.Int64).to_list() == list(range(table.height))


def _samples(log: Path, topic: str | None) -> tuple[int, int]:
    """The least and the most that a log has, counted without palpate."""
    if log.is_dir():
        return _of_database(next(log.glob("*.db3")))
    data = log.read_bytes()
    if data.startswith(MAGIC):
        return counted(data, topic, WRENCHES)
    if data.startswith(b"#ROSBAG"):
        return _of_bag(log)
    if data.startswith(b"PAR1"):
        return (int(pl.scan_parquet(log, glob=False).select(pl.len()).collect().item()),) * 2
    lines = data.removeprefix(b"\xef\xbb\xbf").split(b"\n" if b"\n" in data else b"\r")
    count = sum(bool(line.strip()) for line in lines) - 1
    return count, count


def _of_database(file: Path) -> tuple[int, int]:
    query = "select count(*) from messages, topics where topics.id = topic_id and name = ?"
    with contextlib.closing(sqlite3.connect(file)) as database:
        database.text_factory = bytes
        return (int(database.execute(query, [WRENCH_TOPIC]).fetchone()[0]),) * 2


def _of_bag(file: Path) -> tuple[int, int]:
    from rosbags.rosbag1 import Reader

    with Reader(file) as bag:
        count = sum(1 for connection, *_ in bag.messages() if connection.topic == WRENCH_TOPIC)
    return count, count


def _peak() -> int:
    """MB that this process has held at most."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024


if __name__ == "__main__":
    with bench():
        outcome = try_one(sys.argv[1], int(sys.argv[2]))
    print(outcome)
