"""Processes among others: forks, two commands with one output, inputs that are no files, Ctrl-C twice, a full disk.

Every command is a process of its own, as a user starts it.
"""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from random import Random

import polars as pl

from claims.process import Running
from claims.row import Row, scratch
from palpate.cli import main
from palpate_lab.simulation import simulate_session, write_session
from palpate_lab.simulation.session_mcap import write_session_mcap

PATIENCE = 120.0  # s after which a process hangs
CPU, MEMORY = 2.0, 500  # s more than the command with a file that is not there; MB
FORMATS = (".csv", ".parquet", ".mcap")
SECOND = """
import hashlib, multiprocessing, sys, threading, time
import palpate

def answer():
    found = palpate.estimate(sys.argv[1], sys.argv[2])
    bits = b"".join(getattr(found.estimate, name).tobytes() for name in ("point", "force", "covariance", "status"))
    return hashlib.sha256(bits).hexdigest()

def child(queue):
    try:
        queue.put(answer())
    except palpate.InputError as problem:
        queue.put(f"sentence: {problem}")

def of_process(method):
    context = multiprocessing.get_context(method)
    queue = context.SimpleQueue()
    process = context.Process(target=child, args=(queue,))
    process.start()
    process.join(60)
    if process.exitcode is None:
        process.kill()
        return "hangs"
    return "ended without a word" if queue.empty() else queue.get()

def of_threads():
    found = []
    threads = [threading.Thread(target=lambda: found.append(answer())) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return " and ".join(sorted(set(found)))

if __name__ == "__main__":
    first = answer()
    for way in sys.argv[3:]:
        later = of_threads() if way == "threads" else of_process(way)
        print(way, "the same bits" if later == first else later)
"""


def rows(small: bool) -> Iterator[Row]:
    """Small: a pair of commands, one fork, few special files."""
    with scratch() as folder:
        session = simulate_session(touches=3, facets=320)
        write_session(session, folder)
        write_session_mcap(session, folder)
        log = pl.read_csv(folder / "touches.csv")
        log.write_parquet(folder / "touches.parquet")
        span = log["time"][-1] - log["time"][0] + 0.001
        pl.concat([log.with_columns(pl.col("time") + k * span) for k in range(40)]).write_csv(folder / "long.csv")
        main(["--quiet", "calibrate", "payload", str(folder / "free_motion.csv"), "-o", str(folder / "payload.toml")])
        yield from _forks(folder, small)
        yield from _pairs(folder, *((1, FORMATS[1:2]) if small else (20, FORMATS)))
        yield _special(folder, small)
        yield _full_disk(folder)
        if not small:
            yield _twice_interrupted(folder, 20)


def _begun(folder: Path, call: str) -> Running:
    return Running("-m", "palpate", *call.split(), cwd=folder)


def _forks(folder: Path, small: bool) -> Iterator[Row]:
    """A second estimate, in a process or threads of the first."""
    program = folder / "second.py"
    program.write_text(SECOND)
    for log in ("touches.csv",) if small else ("touches.csv", "touches.parquet", "touches.mcap"):
        ways = ("fork",) if small else ("fork", "forkserver", "spawn", "threads")
        call = [sys.executable, "-W", "ignore", str(program), str(folder / log), str(folder / "rig.toml"), *ways]
        done = subprocess.run(call, capture_output=True, text=True, timeout=600, check=False)
        lines = [line[:90] for line in done.stdout.splitlines()]
        good = [line for line in lines if "the same bits" in line or "sentence: " in line]
        what = f"`estimate` of {log} after `estimate`, in {', '.join(ways)}"
        got = "; ".join(lines) or done.stderr[-200:]
        yield Row(what, "the same bits, or a sentence", got, len(good) == len(ways))


def _pairs(folder: Path, count: int, formats: Sequence[str]) -> Iterator[Row]:
    """Two commands at once with one output, spelt in two ways."""
    (folder / "link").symlink_to(folder)
    for suffix in formats:
        won, refused, others = 0, 0, list[str]()
        for k in range(count):
            outputs = f"pair{k}{suffix}", f"link/pair{k}{suffix}"
            calls = [_begun(folder, f"estimate long.csv --rig rig.toml -o {output}") for output in outputs]
            both = [each.ended(PATIENCE)[:2] for each in calls]
            codes = sorted(code in (0, 4) for code, _ in both)
            won += codes == [False, True] and (folder / outputs[0]).exists()
            if any(code == 1 and "is already being written" in said for code, said in both):
                refused += 1
            else:
                others.append(f"{[(code, said[-60:]) for code, said in both]}")
        litter = [file.name for file in folder.iterdir() if file.suffix in (".lock", ".part")]
        got = f"{won} with one that wins, {refused} with one that says so, {len(litter)} files left over"
        got += f"; {others[0]}" if others else ""
        what = f"{count} pairs of `estimate` at once with one output ({suffix})"
        yield Row(what, f"{count}, {count}, 0", got, (won, refused, len(litter)) == (count, count, 0))


def _special(folder: Path, small: bool) -> Row:
    """Each input of the commands as a pipe, a device, a socket and a folder."""
    os.mkfifo(folder / "pipe.csv")
    with socket.socket(socket.AF_UNIX) as bound:
        before = Path.cwd()
        os.chdir(folder)  # the name of a socket is short
        bound.bind("socket.csv")
        os.chdir(before)
        kinds = ("pipe.csv",) if small else ("pipe.csv", "/dev/zero", "/dev/urandom", "/dev/null", "socket.csv")
        calls = CALLS[1:2] if small else CALLS
        wrong = list[str]()
        slowest = largest = 0.0
        for call in calls:
            usual = _begun(folder, call.format("none.csv")).ended(PATIENCE)[2].cpu
            for kind in kinds:
                code, said, took = _begun(folder, call.format(kind)).ended(PATIENCE)
                slowest, largest = max(slowest, took.cpu - usual), max(largest, took.peak)
                if code == 5:  # a batch lists the logs that it cannot use
                    continue
                if code not in (1, 2) or not said.startswith("palpate: ") or "\n" in said:
                    wrong.append(f"{call.format(kind)}: exit {code}, {said[-100:]}")
    what = f"{len(calls)} inputs of commands as {', '.join(kinds)}: otherwise than by a sentence"
    got = f"{len(wrong)}; {slowest:.1f} s of CPU more than without a file, {largest:.0f} MB at most"
    got += "".join(f"; {each}" for each in wrong[:3])
    passed = not wrong and slowest <= CPU and largest <= MEMORY
    return Row(what, f"0; <= {CPU:g} s, <= {MEMORY} MB", got, passed)


def _full_disk(folder: Path) -> Row:
    """Files may not grow beyond 16 kB, which the system reports just as a full disk."""
    words = f"{sys.executable} -m palpate estimate touches.csv --rig rig.toml -o full.parquet"
    done = subprocess.run(
        ["bash", "-c", f"ulimit -f 16; exec {words}"], cwd=folder, capture_output=True, text=True, check=False
    )
    reason = os.strerror(27)
    passed = done.returncode == 1 and reason in done.stderr and not (folder / "full.parquet").exists()
    return Row("Parquet where files may not grow: exit 1 with the system's reason", reason, done.stderr.strip(), passed)


def _twice_interrupted(folder: Path, count: int) -> Row:
    """Ctrl-C while contacts are found, and again while the parts of Parquet are joined."""
    log = pl.read_csv(folder / "touches.csv")
    span = log["time"][-1] - log["time"][0] + 0.01
    pl.concat([log.with_columns(pl.col("time") + k * span) for k in range(120)]).write_csv(folder / "long.csv")
    rng, alone, hung, nowhere = Random(5), 0, 0, subprocess.DEVNULL
    for k in range(count):
        output = folder / f"twice{k}.parquet"
        words = ["-m", "palpate", "estimate", "long.csv", "--rig", "rig.toml", "-o", output.name]
        process = subprocess.Popen([sys.executable, *words], cwd=folder, stdout=nowhere, stderr=nowhere)
        growing = folder / f"{output.name}.part"
        while process.poll() is None and not (growing.is_dir() and len(list(growing.glob("*.parquet"))) > 5):
            time.sleep(0.002)
        process.send_signal(signal.SIGINT)
        while process.poll() is None and growing.exists() and not (growing / "joined.part").exists():
            time.sleep(0.0005)
        time.sleep(rng.uniform(0.0, 0.05))
        process.send_signal(signal.SIGINT)
        try:
            process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            hung += 1
        alone += output.exists() != (folder / f"{output.name}.toml").exists()
    got = f"{alone} of {count}, {hung} hang"
    return Row("Ctrl-C, and again while Parquet is joined: a file without its record", "0, 0", got, not alone + hung)


CALLS = (  # {} is what is no file
    "inspect {}",
    "estimate {} --rig rig.toml -o o.csv",
    "inspect touches.csv --rig {} --spectrum o.html",
    "estimate touches.csv --rig {} -o o.csv",
    "estimate touches.csv --mesh {} --unit mm -o o.csv",
    "estimate touches.csv --rig rig.toml --payload {} -o o.csv",
    "estimate touches.csv --rig rig.toml -o o.csv --report o.html --truth {}",
    "estimate touches.csv --rig rig.toml -o o.csv --report o.html --compare {}",
    "events {}",
    "evaluate {} marks.csv",
    "view {}",
    "view touches.csv --rig {}",
    "rig new {} probe.stl -o o.toml",
    "rig new touches.csv {} -o o.toml",
    "calibrate payload {} -o o.toml",
    "calibrate payload free_motion.csv --rig {} -o o.toml",
    "calibrate clock {} --rig rig.toml -o o.toml",
    "calibrate clock free_motion.csv --rig {} -o o.toml",
    "calibrate mounting {} --rig rig.toml -o o.toml",
    "calibrate mounting touches.csv --rig {} -o o.toml",
    "calibrate mounting touches.csv --rig rig.toml --marks {} -o o.toml",
    "calibrate drift {} --rig rig.toml -o o.toml",
    "calibrate drift free_motion.csv --rig {} -o o.toml",
    "calibrate load-cells {} --rig rig.toml -o o.toml",
    "calibrate intensity {} -o o.toml",
    "calibrate marker-ring {} --rig rig.toml -o o.toml",
    "calibrate camera {} -o o.toml",
    "calibrate taxels {} --rig rig.toml -o o.toml",
    "batch {} --rig rig.toml -o many --workers 1",
    "batch touches.csv --rig {} -o many --workers 1",
    "replay {} --as netft",
    "live --rig {}",
    "benchmark score {}",
)
