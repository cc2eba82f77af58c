"""Palpate as an entrant of its benchmark: a `Locator` for single wrenches, and a user's commands for logs."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np

from palpate.cli import main
from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ROW, Status
from palpate.contact.locate import Locator
from palpate.errors import InputError
from palpate.setup.estimate import estimate
from palpate_lab.benchmark.files import Task, as_contacts
from palpate_lab.cli.benchmark_entrants import Entrant, EntrantResult, live_entrant

SLACK = 1.1  # of the stated bounds: the mesh's normals are not quite the surface's
_SIX = (0, 1, 2, 4, 5, 8)  # of the nine of a covariance
CALIBRATE = {  # in the folder of the task
    "log": "calibrate payload free_motion.csv --rig rig.toml -o payload.toml",
    "load_cells": "calibrate load-cells bench.csv --rig plain.toml -o tip.toml",
    "marker_ring": "calibrate marker-ring calibration --rig calibration/rig.toml -o ring.toml",
}


def palpate_entrants() -> tuple[Entrant, ...]:
    """Return Palpate as a tuple with one `Entrant`.

    It answers single wrenches one by one, and logs by `palpate estimate`, which uses the complete log. Its `enter`
    raises InputError if a calibration or the estimate fails.
    """
    single = live_entrant(_single, "Palpate")

    def enter(task: Task) -> EntrantResult | None:
        return single.enter(task) if task.kind == "wrench" else _estimated(task)

    return (Entrant("Palpate", enter),)


def _single(task: Task) -> Callable[[np.ndarray], Any]:
    noise = task.facts["noise"]
    six = np.repeat([noise["force"], noise["torque"]], 3)
    locator = Locator(
        task.mesh(),
        friction=SLACK * task.facts["friction"],
        torsion=SLACK * task.facts["torsion"],
        noise=six if six.all() else None,
    )
    out = locator.empty()
    locator(np.ones(6), out)  # compiles

    def answer(wrench: np.ndarray) -> np.ndarray | None:
        locator.reset()
        locator(wrench, out)
        if out[ROW.status] > Status.AMBIGUOUS:
            return None
        return np.concatenate([out[ROW.point], out[ROW.force], out[ROW.covariance][list(_SIX)]])

    return answer


def _estimated(task: Task) -> EntrantResult:
    """Estimate in a copy of the folder without its truth, because calibration writes files into it."""
    with TemporaryDirectory() as scratch:
        folder = Path(scratch) / task.name
        shutil.copytree(task.folder, folder, ignore=lambda at, names: _truth(Path(at) == task.folder, names))
        if command := CALIBRATE.get(task.kind):
            words = [str(folder / word) if (folder / word.split("/")[0]).exists() else word for word in command.split()]
            words[-1] = str(folder / words[-1])
            if main([*words, "--quiet"]):
                raise InputError(f"`palpate {command}` failed, with the error above.", where=task.name)
        log = folder / ("frames" if task.kind == "marker_ring" else "readings.csv")
        begin = perf_counter()
        found = estimate(log, folder / "rig.toml")
        return EntrantResult(_as_answers(found), (perf_counter() - begin) / max(task.samples, 1))


def _truth(top: bool, names: list[str]) -> set[str]:
    return {"truth.csv"} & set(names) if top else set()


def _as_answers(found: Contacts) -> Contacts:
    kept = found[found.answered]
    covariance = kept.covariance.reshape(-1, 9)[:, list(_SIX)]
    return as_contacts(kept.sample, np.hstack([kept.point, kept.force, covariance]))
