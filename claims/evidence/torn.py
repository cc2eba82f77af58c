"""Torn files: an MCAP cut anywhere, and a writer that is killed.

The mcap library writes the log, rosbags its messages, and the library's own index says where each chunk begins and
ends.
"""

import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from time import sleep

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType

from claims.command import cli
from claims.evidence.logs_written import Session, write_mcap
from claims.evidence.long_logs import write_log
from claims.evidence.same import written
from claims.row import Row, scratch
from palpate import InputError
from palpate.contact import Contacts
from palpate.contact.table import to_frame
from palpate.files.contacts import read_contacts
from palpate.files.logs import open_log
from palpate_lab.simulation import simulate_session

CHUNK = 4_000  # bytes: many chunks, and most cuts within one
PACKED: dict[str, dict[str, object]] = {
    "none": {"compression": CompressionType.NONE, "chunk_size": CHUNK},
    "lz4": {"compression": CompressionType.LZ4, "chunk_size": CHUNK},
    "zstd": {"compression": CompressionType.ZSTD, "chunk_size": CHUNK},
    "no chunks": {"use_chunking": False},
}
WRITING = """
import sys
from time import sleep
from palpate.cli import main
from palpate.files.contacts import ContactsWriter

whole, answered, last = ContactsWriter.write, 0, int(sys.argv[1])

def write(self, contacts):
    global answered
    answered += len(contacts)
    print("answered", answered, file=sys.__stdout__, flush=True)
    whole(self, contacts)
    if answered >= last:
        sleep(600)  # the kill is late on a busy machine: it finds the file unfinished all the same

ContactsWriter.write = write
sys.exit(main(sys.argv[2:]))
"""


def rows(small: bool) -> Iterator[Row]:
    """Cuts through the reader, some of them through the command; kills."""
    with scratch() as folder:
        log = written(folder, touches=2, facets=320)
        log = Session(*(values[:300] for values in vars(log).values()))
        for packed in list(PACKED)[:3]:
            yield from _cuts(folder, log, packed, *((12, 1) if small else (1_000, 30)))
        yield from _kills(folder, 20_000 if small else 400_000, (".mcap",) if small else (".csv", ".parquet", ".mcap"))


@dataclass
class Cuts:
    """Of a log cut at many places: where, and what of its wrenches was found.

    Attributes:
        kept: bytes of each.
        found: wrenches found in each.
        lost: whole wrenches before the cuts that were not found.
        invented: cuts with wrenches that were not there.
        silent: cuts that were not said.
        torn: wrenches out of chunks that were cut.
    """

    kept: list[int]
    found: list[int] = field(default_factory=list)
    lost: int = 0
    invented: int = 0
    silent: int = 0
    torn: int = 0


def cut(folder: Path, log: Session, packed: str, count: int) -> Cuts:
    """Write the log, cut it at `count` random bytes, and read what is left.

    Least and most are the wrenches that end before the cut; packed, those in chunks that end, or begin, there.
    """
    path, part, rng = folder / "log.mcap", folder / "part.mcap", np.random.default_rng(71)
    write_mcap(path, log.messages(), **PACKED[packed])
    whole = path.read_bytes()
    bounds = _bounds(path, log) if packed in ("lz4", "zstd") else _ends(whole, log)
    cuts = Cuts(rng.choice(np.arange(8, len(whole)), min(count, len(whole) - 8), replace=False).tolist())
    for kept in cuts.kept:
        part.write_bytes(whole[:kept])
        wrenches, said = read(part)
        least, most = (int(np.count_nonzero(bound <= kept)) for bound in bounds)
        cuts.found.append(len(wrenches))
        cuts.lost += max(0, least - len(wrenches))
        cuts.invented += len(wrenches) > most or not np.array_equal(wrenches, log.wrench[: len(wrenches)])
        cuts.torn += max(0, len(wrenches) - least)
        cuts.silent += "torn at byte" not in said
    return cuts


def _cuts(folder: Path, log: Session, packed: str, count: int, commands: int) -> Iterator[Row]:
    """Through the reader, and the first with wrenches through the command."""
    cuts = cut(folder, log, packed, count)
    whole = (folder / "log.mcap").read_bytes()
    some = [(kept, found) for kept, found in zip(cuts.kept, cuts.found, strict=True) if found][:commands]
    failures = [failure for kept, found in some for failure in _commanded(folder, whole[:kept], found)]
    got = f"{cuts.lost} of them lost, {cuts.invented} cuts with any that was not there, {cuts.silent} not said"
    if packed != "none":
        got += f"; besides, {cuts.torn:,} out of chunks that were cut"
    what = f"MCAP ({packed}) of {len(log.stamp)} wrenches and poses cut at {len(cuts.kept):,} random bytes"
    yield Row(f"{what}: whole messages before the cut", "0, 0, 0", got, not (cuts.lost or cuts.invented or cuts.silent))
    got = f"{len(failures)} of {len(some)} otherwise" + "".join(f"; {failure}" for failure in failures[:3])
    target = "exit code 3, the sentence, a row for each whole wrench"
    yield Row(f"MCAP ({packed}), cut, through `palpate estimate`", target, got, not failures)


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


def read(path: Path) -> tuple[np.ndarray, str]:
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
    code, _, _, said = cli("estimate", path, "--rig", folder / "rig.toml", "-o", result)
    found = len(read_contacts(result)) if result.exists() else 0
    good = code == 3 and "torn at byte" in said and found == count
    return [] if good else [f"cut to {len(data)} bytes: exit code {code}, {found} rows of {count}"]


# --- kill


def _kills(folder: Path, samples: int, suffixes: tuple[str, ...]) -> Iterator[Row]:
    """Three kills a format, each a random time into the writing; blocks are as the reader gives them."""
    rng, log = np.random.default_rng(73), folder / "long.parquet"
    write_log(log, simulate_session(touches=2, facets=320), samples)
    words = ("estimate", str(log), "--rig", str(folder / "rig.toml"), "-o")
    cli(*words, folder / "right.parquet")
    right = read_contacts(folder / "right.parquet")
    for suffix in suffixes:
        told, failures = [], []
        for number in range(3 if len(suffixes) > 1 else 1):
            result = folder / f"killed{number}{suffix}"
            share, later = rng.uniform(0.1, 0.7), rng.uniform(0.0, 0.05)
            answered = _killed([*words, str(result)], samples, share, later)
            found, failure = _found(folder, result, right)
            failures += failure
            told.append(f"{answered - found:,} behind {answered:,} answered")
        got = "; ".join((*told, *failures))
        what = f"kill -9 while a file of contacts ({suffix}) of {samples:,} samples is written"
        yield Row(what, "`inspect` reads it, its rows a prefix of the right answer", got, not failures)


def _killed(words: list[str], samples: int, share: float, later: float) -> int:
    """Kill the command a moment [s] after a share of its samples; how many had been answered by then."""
    command = [sys.executable, "-c", WRITING, str(samples), *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    answered = blocks = 0
    with process:
        for line in process.stdout or ():
            if line.startswith("answered"):
                answered, blocks = int(line.split()[1]), blocks + 1
                if blocks > 1 and answered >= share * samples and process.poll() is None:
                    sleep(later)
                    process.send_signal(signal.SIGKILL)
    if process.returncode != -signal.SIGKILL:
        raise RuntimeError(f"it ended by itself, with {process.returncode}")
    return answered


def _found(folder: Path, result: Path, right: Contacts) -> tuple[int, list[str]]:
    """Rows that the unfinished file holds, and what is wrong with it."""
    code = cli("inspect", result).returncode
    found = read_contacts(result.with_name(f"{result.name}.part"))
    prefix = to_frame(right).head(len(found)).equals(to_frame(found))
    failures = [] if code == 0 else [f"inspect ends with {code}"]
    failures += [] if prefix and len(found) else ["its rows are not the right ones"]
    failures += ["OUTPUT is there"] if result.exists() else []
    return len(found), failures
