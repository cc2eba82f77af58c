"""Start: what commands and the first answer take, and that nothing compiles inside a loop."""

import json
import os
import pty
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from claims.process import python
from claims.row import ROOT, Row
from palpate_lab.simulation import simulate_session, write_session

LOADED = "import palpate; palpate.Mesh.load('probe.stl', 'mm')"
CPU = [  # what, target [s], arguments of Python
    ("`palpate --version`", 0.15, ["-m", "palpate", "--version"]),
    ("`palpate --help`", 0.3, ["-m", "palpate", "--help"]),
    ("`palpate inspect` of a CSV", 0.5, ["-m", "palpate", "inspect", "touches.csv"]),
    ("importing palpate", 0.25, ["-c", "import palpate"]),
    (
        "the first `palpate.locate` on an STL",
        1.0,
        ["-c", "import palpate; palpate.locate([0, 0, -5, 0.02, 0, 0], 'probe.stl', unit='mm', noise=(0.02, 0.001))"],
    ),
    ("`palpate demo --no-view`", 10.0, ["-m", "palpate", "demo", "--no-view", "--force"]),
]
LARGE = """
import time
import palpate
from palpate_lab.simulation.shapes import BumpySphere
palpate.Mesh.from_arrays(*BumpySphere(0.01).mesh(200)).prepared()
arrays = BumpySphere(0.01).mesh(FACETS)
begin = time.process_time()
palpate.Mesh.from_arrays(*arrays).prepared()
print(time.process_time() - begin)
"""
FIRST = """
import json, time
import numpy as np, palpate
from palpate_lab.simulation import EllipsoidBody

mesh = palpate.Mesh.from_arrays(*EllipsoidBody((0.010, 0.007, 0.005)).mesh(20_000))
begin = time.perf_counter()
locator = palpate.Locator(mesh, noise=[0.02] * 3 + [0.001] * 3)
took = {"ready": time.perf_counter() - begin}
wrench, out = np.array([0.5, 0.0, -5.0, 0.0, 0.001, 0.001]), locator.empty()
locked = wrench.copy()
locked.flags.writeable = False
column = np.zeros((6, 2))
column[:, 0] = wrench
many = np.tile(wrench, (10, 1))
calls = {
    "locator(wrench, out)": lambda: locator(wrench, out),
    "again": lambda: locator(wrench, out),
    "run": lambda: locator.run(many),
    "run with covariances": lambda: locator.run(many, np.tile(np.eye(6) * 1e-4, (10, 1, 1))),
    "candidates": lambda: locator.candidates(wrench),
    "a read-only wrench": lambda: locator(locked, out),
    "a column of a log": lambda: locator(column[:, 0], out),
}
for name, call in calls.items():
    begin = time.perf_counter()
    try:
        call()
        took[name] = time.perf_counter() - begin
    except Exception as refusal:
        took[name] = f"{type(refusal).__name__}: {refusal}"[:100]
print(json.dumps(took))
"""


def rows(small: bool) -> Iterator[Row]:
    """Import, then the first queries of a process; in full also with an empty cache of compiled code."""
    yield from _cpu(1 if small else 5)
    yield _large(20_000 if small else 1_000_000)
    yield _first("compiled before (cached)", None)
    if not small:
        with TemporaryDirectory() as empty:
            yield _first("no native code, never compiled before (empty cache)", empty)
            yield _said()


def _cpu(turns: int) -> Iterator[Row]:
    """CPU time of whole processes, user and system; the figures of another checkout beside them: PALPATE_BESIDE=DIR."""
    trees = {"": ROOT, " there": Path(os.environ.get("PALPATE_BESIDE", ROOT)).resolve()}
    surroundings = {name: {**os.environ, "PYTHONPATH": str(tree / "src")} for name, tree in trees.items()}
    with TemporaryDirectory() as folder:
        write_session(simulate_session(touches=2, facets=320), Path(folder))
        for what, least, arguments in CPU:
            took: dict[str, list[float]] = {name: [] for name in trees}
            for name in list(trees) * turns:
                took[name].append(python(*arguments, cwd=folder, env=surroundings[name]).cpu)
            figures = [f"{median(each):.2f} s{name}" for name, each in took.items()]
            got = f"{', '.join(figures[: 1 + (trees[' there'] != ROOT)])} (CPU, median of {turns})"
            yield Row(what, f"<= {least} s", got, None if turns == 1 else median(took[""]) <= least)


def _large(facets: int) -> Row:
    """A mesh from its arrays to its tree, in a process of its own; the peak is that of the whole process."""
    python("-c", LARGE.replace("FACETS", "2000"))  # compiles, which takes memory
    printed, _, _, peak = python("-c", LARGE.replace("FACETS", str(facets)))
    prepared = float(printed)
    met = None if facets < 1_000_000 else prepared <= 6.0 and peak <= 600.0
    got = f"{prepared:.1f} s (CPU), {peak:.0f} MiB (the whole process)"
    return Row(f"a mesh of {facets:,} facets prepared", "<= 6 s and <= 600 MiB", got, met)


def _first(what: str, cache: str | None) -> Row:
    surroundings = None if cache is None else _numba(cache)
    took = json.loads(python("-c", FIRST, env=surroundings).printed)
    ready = took.pop("ready")
    slow = {name: f"{value:.1f} s" for name, value in took.items() if isinstance(value, float) and value > 0.05}
    first, again = took["locator(wrench, out)"], took["again"]
    got = f"Locator ready in {ready:.1f} s; first query {1e6 * first:.0f} us, second {1e6 * again:.0f} us"
    got += "; nothing compiled later" if not slow else f"; compiled inside: {slow}"
    return Row(f"{what}: no compilation after Locator()", "no first call > 50 ms", got, not slow)


def _numba(cache: str) -> dict[str, str]:
    """Return the surroundings of a process that compiles by numba, into a folder."""
    return {**os.environ, "PALPATE_NATIVE": "0", "NUMBA_CACHE_DIR": cache}


def _said() -> Row:
    """Return the row of what a terminal shows while `palpate estimate` compiles."""
    with TemporaryDirectory() as folder:
        write_session(simulate_session(touches=2, facets=320), Path(folder))
        main, end = pty.openpty()
        command = [sys.executable, "-m", "palpate", "estimate", "touches.csv"]
        command += ["--mesh", "probe.stl", "--unit", "mm", "-o", "contacts.csv"]
        surroundings = _numba(f"{folder}/compiled")
        done = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=end, env=surroundings)
        os.close(end)
        heard = b""
        while True:
            try:
                piece = os.read(main, 4096)
            except OSError:  # the other end is closed
                break
            if not piece:
                break
            heard += piece
        done.wait()
        os.close(main)
    words = heard.decode(errors="replace").replace("\r", "\n")
    lines = [line.strip() for line in words.splitlines() if "palpate:" in line]
    what = "`palpate estimate` on a terminal says what it does while it compiles"
    return Row(what, "a word", "".join(lines[:1]), bool(lines))
