"""The extension module: the same bits as numba and at each processor level, no compiler, other threads go on."""

import hashlib
import os
import platform
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import native_build
from claims.process import palpate, python
from claims.row import ROOT, Row
from palpate.cli import main
from palpate.contact import Locator
from palpate.files.contacts import read_contacts
from palpate.surfaces import Mesh, _jit
from palpate_lab.simulation import simulate_session, write_session
from palpate_lab.simulation.shapes import EllipsoidBody

MOST = {"six-axis": (2.0, 200.0)}  # s of CPU, MiB; 3 s and any memory for the other sensors
SESSIONS = {  # what `palpate simulate` makes, its log and its rig, and the calibration that the rig needs
    "load cells": ("load-cells", "log.csv", "rig.toml", "load-cells bench_log.csv --rig rig.toml -o fingertip.toml"),
    "skin and six-axis": ("forearm", "both.mcap", "both.toml", ""),
    "marker ring": ("marker-ring --small", "frames.avi", "rig.toml", "marker-ring . --rig rig.toml -o ring.toml"),
}
MODEL = {"marker ring": 'model = "ring.toml"\n'}  # a line for the rig, where it does not name its calibration
RUN = """
import os, sys
from pathlib import Path
import palpate.surfaces._jit as jit
if {plain}:
    jit.CPUINFO = Path(os.devnull)  # an older processor, as far as the loader can tell
from palpate.cli import main
main({words})
print("numba" in sys.modules)
"""


def rows(small: bool) -> Iterator[Row]:
    """Each sensor's `estimate`; threads. Small: one sensor, without numba and the plain level."""
    if not small and platform.machine() == "x86_64":
        native_build.main(native_build.LEVELS)
    with TemporaryDirectory() as scratch:
        for sensor, log, rig in _sessions(Path(scratch), small):
            yield from _estimated(sensor, log, rig, small)
    yield _threads(20_000 if small else 400_000)


def _sessions(folder: Path, small: bool) -> Iterator[tuple[str, Path, Path]]:
    write_session(simulate_session(touches=2 if small else 20, facets=320 if small else 20_000), folder)
    main(["--quiet", "calibrate", "payload", str(folder / "free_motion.csv"), "-o", str(folder / "payload.toml")])
    yield "six-axis", folder / "touches.csv", folder / "rig.toml"
    for sensor, (kind, log, rig, calibration) in {} if small else SESSIONS.items():
        made = folder / sensor.replace(" ", "_")
        palpate("simulate", *kind.split(), "-o", made.name, cwd=folder)
        if calibration:
            palpate("calibrate", *calibration.split(), cwd=made)
            with (made / rig).open("a") as file:
                file.write(MODEL.get(sensor, ""))
        yield sensor, made / log, made / rig


def _estimated(sensor: str, log: Path, rig: Path, small: bool) -> Iterator[Row]:
    """`palpate estimate` of a log: what it takes, and whether other machine code answers otherwise."""
    output = log.with_name("found.csv")
    words = ["estimate", str(log), "--rig", str(rig), "-o", str(output), "--workers", "1"]

    def run(plain: bool = False, native: str = "1") -> tuple[str, float, float, bool]:
        code = RUN.format(plain=plain, words=words)
        printed, _, cpu, memory = python("-c", code, cwd=ROOT, env={**os.environ, "PALPATE_NATIVE": native})
        return hashlib.sha256(output.read_bytes()).hexdigest(), cpu, memory, printed.endswith("True\n")

    found = sorted((run() for _ in range(1 if small else 5)), key=lambda one: one[1])
    digest, cpu, memory, numba = found[len(found) // 2]
    built = _jit.native_file(_jit.level(), "mesh").exists()
    most, most_memory = MOST.get(sensor, (3.0, inf))
    met = None if small or not built else cpu <= most and memory <= most_memory and not numba
    got = f"{cpu:.2f} s, {memory:.0f} MiB; numba {'imported' if numba else 'not imported'}"
    target = f"<= {most:g} s of CPU{'' if most_memory == inf else f', {most_memory:g} MiB'}, no numba"
    contacts = read_contacts(output)
    length = f"{contacts.sample[-1] + 1:,} samples, {np.ptp(contacts.time):.0f} s"
    yield Row(f"{sensor}: `palpate estimate` of {length}, first answer", target, got, met)
    if not small:
        others = {"numba": run(native="0"), "an older processor": run(plain=True)}
        got = ", ".join(f"{name}: {'same' if other[0] == digest else 'OTHER'}" for name, other in others.items())
        same = all(other[0] == digest for other in others.values())
        yield Row(f"{sensor}: the file that is written", "the same bytes", got, same)


def _threads(count: int) -> Row:
    """How many steps a thread of Python takes while another locates a batch, to those while another process works."""
    locator = Locator(
        Mesh.from_arrays(*EllipsoidBody((0.010, 0.007, 0.005)).mesh(2_000)), noise=[0.02] * 3 + [0.001] * 3
    )
    random = np.random.default_rng(0)
    wrenches = random.normal(size=(count, 6)) * [5, 5, 5, 0.02, 0.02, 0.02]
    locator.run(wrenches[:100])

    def rate(work: threading.Thread | None) -> float:
        steps, begin = 0, time.perf_counter()
        until = begin + 1.0
        while work.is_alive() if work is not None else time.perf_counter() < until:
            steps += 1
            time.sleep(1e-3)
        return steps / (time.perf_counter() - begin)

    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as busy:  # as busy a machine, without the GIL
        alone = rate(None)
        busy.kill()
    work = threading.Thread(target=locator.run, args=(wrenches,), kwargs={"sequential": False})
    work.start()
    beside = rate(work)
    work.join()
    met = None if (os.cpu_count() or 1) < 2 else beside >= 0.9 * alone
    got = f"{beside / alone:.0%} ({beside:.0f} of {alone:.0f} steps of 1 ms a second)"
    what = f"another thread while {count:,} wrenches are located in one call"
    return Row(what, ">= 90 % of its steps while another process works", got, met if count > 100_000 else None)
