"""Mutated files given to the commands: each must end in time, with a sentence or with a row for every sample.

A case is a kind and a number: `python -m claims.evidence.mutated KIND NUMBER` repeats one.
"""

import contextlib
import faulthandler
import multiprocessing
import os
import shutil
import sys
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from claims.evidence.good_files import write_good
from claims.evidence.mutation_bytes import ANY, Mutation, Random, corners, count, double
from claims.evidence.mutation_mcap import MCAP
from claims.evidence.mutation_text import ASCII, PAYLOAD, TABLE, TOML
from claims.evidence.row_for_row import unanswered
from claims.evidence.watched import LIMIT, PATIENCE, watched
from claims.row import Row

TARGET = f"a sentence, or a row for every sample; no traceback, no warning, none over {LIMIT} s"
PIECE = 100  # cases that a process does at a time
SUFFIXES = ("csv", "parquet", "mcap")
WAYS: dict[str, tuple[Mutation, ...]] = {
    "table": TABLE,
    "toml": TOML,
    "payload": PAYLOAD,
    "stl": (corners, corners, partial(count, first=80, last=80), partial(double, kind="<f"), count),
    "ascii": ASCII,
    "binary": (count, double, partial(count, size=8), partial(count, size=2)),
    "mcap": MCAP,
}


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
LOAD = ("estimate touches.csv --rig rig.toml --payload {bad} -o {out}", "inspect {bad}")
MESH = (
    "estimate touches.csv --rig rig.toml --mesh {bad} --unit mm -o {out}",
    "estimate touches.csv --mesh {bad} --unit m -o {out} --crease 0",
    "inspect {bad}",
)
CONTACTS = ("inspect {bad}", "events {bad} -o {made}", "evaluate {bad} truth.csv")
TRUTH = ("evaluate contacts.csv {bad}", "inspect {bad}", "estimate touches.csv --rig rig.toml -o {out} --truth {bad}")
STORED, RIGS = ("plain", "stored", "lz4", "zstd", "touches"), ("rig", "rig_full", "rig_imu", "rig_plane")
FOUND = ("contacts.csv", "contacts.parquet", "contacts.mcap")
MOUNTING = "calibrate mounting touches.csv --rig rig.toml --marks {bad} -o {made}"

KINDS = {
    "CSV": Kind(2600, (("touches.csv", "table"),), (*ESTIMATE, *ESTIMATE, *LOG)),
    "free motion, CSV": Kind(200, (("free_motion.csv", "table"),), LOG),
    "Parquet": Kind(400, (("touches.parquet", "binary"),), (*ESTIMATE, *LOG)),
    "MCAP": Kind(2600, tuple((f"{name}.mcap", "mcap") for name in STORED), (*ESTIMATE, *ESTIMATE, *LOG)),
    "bag": Kind(300, (("touches.bag", "binary"), ("bag/bag.db3", "binary"), ("bag/metadata.yaml", "ascii")), ESTIMATE),
    "rig, TOML": Kind(1500, tuple((f"{name}.toml", "toml") for name in RIGS), RIG),
    "payload, TOML": Kind(500, (("payload.toml", "payload"),), LOAD),
    "STL": Kind(1000, (("probe.stl", "stl"), ("probe.stl", "stl"), ("ascii.stl", "ascii")), MESH),
    "OBJ and PLY": Kind(100, (("probe.obj", "ascii"), ("probe.ply", "binary")), MESH),
    "contacts": Kind(600, tuple(zip(FOUND, ("table", "binary", "mcap"), strict=True)), CONTACTS),
    "truth, CSV": Kind(200, (("truth.csv", "table"), ("marks.csv", "table")), (*TRUTH, MOUNTING)),
}


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


def spoil(name: str, number: int) -> tuple[str, Path, Path]:
    """Spoil a file of the current folder, and return the command that is given it, the file, and what is written."""
    kind = KINDS[name]
    random = np.random.default_rng([number, *name.encode()])
    file, ways = kind.files[int(random.integers(len(kind.files)))]
    bad = _spoilt(Path(file), ways, random)
    out = Path(f"out.{SUFFIXES[number % len(SUFFIXES)]}")
    command = kind.commands[int(random.integers(len(kind.commands)))].format(bad=bad, out=out, made="made.toml")
    return command, bad, out


def try_one(name: str, number: int) -> Outcome:
    command, bad, out = spoil(name, number)
    for left in Path().glob("out.*"):
        shutil.rmtree(left) if left.is_dir() else left.unlink()
    heard = watched(command.split())
    fault = heard.fault or (unanswered(command, bad, out) if command.startswith("estimate") and heard.code != 1 else "")
    return Outcome(name, number, command, heard.code, heard.seconds, heard.said.strip() or heard.out, fault)


def mutate(data: bytes, ways: str, random: Random) -> bytes:
    """One to four mutations, three in four of them in one of the `WAYS`."""
    for _ in range(int(random.choice([1, 1, 1, 2, 4]))):
        some = WAYS[ways] if random.random() < 0.75 else ANY
        data = some[int(random.integers(len(some)))](data, random)
    return data


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


def rows(small: bool) -> Iterator[Row]:
    """One for each kind; 10,000 cases in all; small takes one, the tests try six."""
    if small:
        with bench():
            for name in KINDS:
                yield _row(name, [try_one(name, number) for number in range(1)])
        return
    pieces = [
        (name, range(kind.count)[first : first + PIECE])
        for name, kind in KINDS.items()
        for first in range(0, kind.count, PIECE)
    ]
    os.environ.setdefault("POLARS_MAX_THREADS", "1")  # of the processes below, which fill the machine as they are
    spawned = multiprocessing.get_context("spawn")
    with TemporaryDirectory() as scratch, ProcessPoolExecutor(mp_context=spawned) as pool:
        write_good(Path(scratch) / "good")
        found: dict[str, list[Outcome]] = {name: [] for name in KINDS}
        for outcomes in pool.map(partial(_piece, Path(scratch)), pieces):
            name = outcomes[0].kind
            found[name] += outcomes
            if len(found[name]) == KINDS[name].count:
                yield _row(name, found[name])


def _piece(scratch: Path, piece: tuple[str, range]) -> list[Outcome]:
    """Some cases in a process of its own, which ends where even the alarm is not heard, and says where it was."""
    here = scratch / str(os.getpid())
    if not here.exists():
        shutil.copytree(scratch / "good", here)
    os.chdir(here)
    outcomes: list[Outcome] = []
    for number in piece[1]:
        faulthandler.dump_traceback_later(2 * PATIENCE, exit=True)
        outcomes.append(try_one(piece[0], number))
    faulthandler.cancel_dump_traceback_later()
    return outcomes


def _row(name: str, outcomes: list[Outcome]) -> Row:
    codes = Counter(outcome.code for outcome in outcomes)
    faults = [outcome for outcome in outcomes if outcome.fault]
    said = ", ".join(f"{count} exit {code}" for code, count in sorted(codes.items()))
    got = f"{said}; slowest {max(outcome.seconds for outcome in outcomes):.1f} s"
    for fault in faults[:3]:
        got += f"; number {fault.number}, {fault.command}: {fault.fault}"
    return Row(f"{len(outcomes):,} of {name}", TARGET, got, not faults)


if __name__ == "__main__":
    with bench():
        outcome = try_one(sys.argv[1], int(sys.argv[2]))
    print(outcome)
