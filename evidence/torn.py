"""Torn files: an MCAP cut anywhere, and a writer that is killed.

The mcap library writes the log, rosbags its messages, and the library's own index says where each chunk begins and
ends.
"""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from time import sleep

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType

from evidence.long_logs import write_log
from evidence.row import Row
from evidence.same import run, written
from palpate import InputError
from palpate.io.contacts import Contacts, read_contacts
from palpate.io.contacts.rows import to_frame
from palpate.io.logs import open_log
from palpate.simulation import simulate_session
from tests.logs_written import Session, write_mcap

__all__ = ["rows"]

COMMAND = "python -m evidence --only torn"
NAME = "torn files"
PACKED = {"none": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}
CHUNK = 4_000  # bytes: many chunks, and most cuts within one
WRITING = """
import sys
from palpate.cli import main
from palpate.io.contacts import ContactsWriter

whole, answered = ContactsWriter.write, 0

def write(self, time, estimate, **options):
    global answered
    answered += len(time)
    print("answered", answered, file=sys.__stdout__, flush=True)
    whole(self, time, estimate, **options)

ContactsWriter.write = write
sys.exit(main(sys.argv[1:]))
"""


def rows(small: bool) -> Iterator[Row]:
    """Cuts through the reader, some of them through the command; kills."""
    with TemporaryDirectory() as scratch:
        folder = Path(scratch)
        log = written(folder, touches=2, facets=320)
        log = Session(*(values[:300] for values in vars(log).values()))
        for packed in PACKED:
            yield from _cuts(folder, log, packed, *((12, 1) if small else (1_000, 30)))
        yield from _kills(folder, 20_000 if small else 400_000, (".mcap",) if small else (".csv", ".parquet", ".mcap"))


def _cuts(folder: Path, log: Session, packed: str, count: int, commands: int) -> Iterator[Row]:
    """Least and most are the wrenches that end before the cut; packed, those in chunks that end, or begin, there."""
    path, part, rng = folder / "log.mcap", folder / "part.mcap", np.random.default_rng(71)
    write_mcap(path, log.messages(), compression=PACKED[packed], chunk_size=CHUNK)
    whole = path.read_bytes()
    bounds = _ends(whole, log) if packed == "none" else _bounds(path, log)
    lost = invented = silent = torn = 0
    cuts = rng.choice(np.arange(8, len(whole)), min(count, len(whole) - 8), replace=False).tolist()
    some, failures = [], []
    for kept in cuts:
        part.write_bytes(whole[:kept])
        wrenches, said = _read(part)
        least, most = (int(np.count_nonzero(bound <= kept)) for bound in bounds)
        lost += max(0, least - len(wrenches))
        invented += len(wrenches) > most or not np.array_equal(wrenches, log.wrench[: len(wrenches)])
        torn += max(0, len(wrenches) - least)
        silent += "torn at byte" not in said
        if len(some) < commands and len(wrenches):
            some.append(kept)
            failures += _commanded(folder, whole[:kept], len(wrenches))
    got = f"{lost} of them lost, {invented} cuts with any that was not there, {silent} not said"
    if packed != "none":
        got += f"; besides, {torn:,} out of chunks that were cut"
    what = f"MCAP ({packed}) of {len(log.stamp)} wrenches and poses cut at {len(cuts):,} random bytes"
    met = not (lost or invented or silent)
    yield Row(NAME, f"{what}: whole messages before the cut", "0, 0, 0", got, met, COMMAND)
    got = f"{len(failures)} of {len(some)} otherwise" + "".join(f"; {failure}" for failure in failures[:3])
    target = "exit code 3, the sentence, a row for each whole wrench"
    yield Row(NAME, f"MCAP ({packed}), cut, through `palpate estimate`", target, got, not failures, COMMAND)


def _ends(whole: bytes, log: Session) -> tuple[np.ndarray, np.ndarray]:
    """(n,) bytes of the file with which a wrench, whose numbers end its message, is there: one bound for both."""
    ends = np.array([whole.find(row.tobytes()) + 48 for row in log.wrench])
    return ends, ends


def _bounds(path: Path, log: Session) -> tuple[np.ndarray, np.ndarray]:
    """(n,) bytes of the file with which a wrench must be there, and with which it can be."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    if summary is None:
        raise RuntimeError("the mcap library wrote no index")
    chunks = sorted(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset)
    of = np.searchsorted([chunk.message_end_time for chunk in chunks], log.stamp)
    begins = np.array([chunk.chunk_start_offset for chunk in chunks])
    return begins[of] + np.array([chunk.chunk_length for chunk in chunks])[of], begins[of]


def _read(path: Path) -> tuple[np.ndarray, str]:
    """Wrenches, and what is said of the cut."""
    try:
        log = open_log(path)
        return np.concatenate([block.wrenches() for block in log.blocks()]), log.torn
    except InputError as problem:
        return np.empty((0, 6)), str(problem)


def _commanded(folder: Path, data: bytes, count: int) -> list[str]:
    """What is wrong with what the command does with a cut file."""
    path, result = folder / "commanded.mcap", folder / "contacts.parquet"
    path.write_bytes(data)
    result.unlink(missing_ok=True)
    code, said = run("estimate", str(path), "--rig", str(folder / "rig.toml"), "-o", str(result))
    found = len(read_contacts(result)) if result.exists() else 0
    good = code == 3 and "torn at byte" in said and found == count
    return [] if good else [f"cut to {len(data)} bytes: exit code {code}, {found} rows of {count}"]


# --- kill


def _kills(folder: Path, samples: int, suffixes: tuple[str, ...]) -> Iterator[Row]:
    """Three kills a format, each a random time into the writing; blocks are as the reader gives them."""
    rng, log = np.random.default_rng(73), folder / "long.parquet"
    write_log(log, simulate_session(touches=2, facets=320), samples)
    words = ("estimate", str(log), "--rig", str(folder / "rig.toml"), "-o")
    run(*words, str(folder / "right.parquet"))
    right = read_contacts(folder / "right.parquet")
    for suffix in suffixes:
        told, failures = [], []
        for number in range(3 if len(suffixes) > 1 else 1):
            result = folder / f"killed{number}{suffix}"
            answered = _killed([*words, str(result)], rng.uniform(0.1, 0.7) * samples, rng.uniform(0.0, 0.05))
            found, failure = _found(folder, result, right)
            failures += failure
            told.append(f"{answered - found:,} behind {answered:,} answered")
        got = "; ".join((*told, *failures))
        what = f"kill -9 while a file of contacts ({suffix}) of {samples:,} samples is written"
        target = "`inspect` reads it, its rows a prefix of the right answer"
        yield Row(NAME, what, target, got, not failures, COMMAND)


def _killed(words: list[str], samples: float, later: float) -> int:
    """Kill the command a moment [s] after so many samples; how many had been answered by then."""
    command = [sys.executable, "-c", WRITING, *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    answered = blocks = 0
    with process:
        for line in process.stdout or ():
            if line.startswith("answered"):
                answered, blocks = int(line.split()[1]), blocks + 1
                if blocks > 1 and answered >= samples and process.poll() is None:
                    sleep(later)
                    process.send_signal(signal.SIGKILL)
    if process.returncode != -signal.SIGKILL:
        raise RuntimeError(f"it ended by itself, with {process.returncode}")
    return answered


def _found(folder: Path, result: Path, right: Contacts) -> tuple[int, list[str]]:
    """Rows that the unfinished file holds, and what is wrong with it."""
    code, _ = run("inspect", str(result))
    found = read_contacts(result.with_name(f"{result.name}.part"))
    prefix = to_frame(right).head(len(found)).equals(to_frame(found))
    failures = [] if code == 0 else [f"inspect ends with {code}"]
    failures += [] if prefix and len(found) else ["its rows are not the right ones"]
    failures += ["OUTPUT is there"] if result.exists() else []
    return len(found), failures
