"""Make all tasks of the benchmark as folders, from one seed."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Protocol

import numpy as np

from palpate.errors import InputError
from palpate_lab.benchmark.log_tasks import fingertip, payload_log
from palpate_lab.benchmark.ring_task import marker_ring
from palpate_lab.benchmark.skin_task import skin
from palpate_lab.benchmark.task import MadeTask, write_task
from palpate_lab.benchmark.wrench_tasks import WRENCH_TASKS

PUBLIC_SEED = 1
README = """A benchmark of contact sensing: where, how hard and in which direction is a body touched?
Made by `palpate benchmark make`, by forward simulation: no estimator had a hand in the truth.

Each folder is a task. Its task.toml says what was simulated, units, frame, noise, seed, and what each file holds.
truth.csv is for scoring only: an estimator that reads it scores nothing worth knowing.

Answer with one CSV for as many of the tasks as you like, a row a contact:

  task,sample,px,py,pz[,fx,fy,fz][,cxx,cxy,cxz,cyy,cyz,czz]

sample   number of the reading, from 0 (row of readings.csv below the header, image of frames/)
p        the point [m], in the frame that task.toml names
f        the force on the body [N]; may be left out
c        covariance of the point [m^2]; may be left out

Several rows of one sample are contacts at once. Where you find none there is no row: where something touches this
is a miss. Then

  palpate benchmark score FOLDER --answers answers.csv -o table.html

or let it call a function of yours, found by its name from the current folder:

  palpate benchmark score FOLDER --estimator my_module:my_function -o table.html

my_function(task) is called once a task, and returns None, or a function that is called with one reading after the
other (a row of readings.csv, an image) and returns None or an array of 3, 6 or 12 numbers a contact, in the order of
the columns above. task has: name, kind, folder, facts (task.toml), columns (of a reading), table(file).
"""


class Maker(Protocol):
    """A function that makes a task in an existing folder and writes its readings."""

    def __call__(self, folder: Path, rng: np.random.Generator, *, small: bool) -> MadeTask:
        """Make the task in `folder` with random numbers of `rng`, and return its `MadeTask`.

        A `small` task has a few samples.
        """
        ...


TASKS: dict[str, Maker] = {
    **WRENCH_TASKS,
    "payload-log": payload_log,
    "fingertip": fingertip,
    "skin": skin,
    "marker-ring": marker_ring,
}


def _nothing(_: str) -> None:
    """Ignore the name of a task."""


def make_benchmark(
    folder: Path,
    seed: int = PUBLIC_SEED,
    *,
    small: bool = False,
    only: Iterable[str] = (),
    watch: Callable[[str], None] = _nothing,
) -> tuple[str, ...]:
    """Make tasks, each in a folder; a task does not depend on which others are made.

    Args:
        folder: created if it does not exist.
        seed: seed of everything random; the public one is 1.
        small: make a few samples of each, to try things out.
        only: names of the tasks to make; empty for all.
        watch: function called with the name of each task before it is made.

    Returns:
        Names of the tasks made, a tuple.

    Raises:
        InputError: a name is no task, or the task's simulator is not installed.
    """
    wanted = tuple(only) or tuple(TASKS)
    for name in wanted:
        if name not in TASKS:
            raise InputError(
                f"the task {name!r} is unknown.", where="benchmark", hint=f"Use one of {', '.join(TASKS)}."
            )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "README.txt").write_text(README, encoding="utf-8")
    for number, (name, maker) in enumerate(TASKS.items()):
        if name in wanted:
            watch(name)
            (folder / name).mkdir(exist_ok=True)
            made = maker(folder / name, np.random.default_rng([seed, number]), small=small)
            write_task(made, folder / name, seed, small=small)
    return wanted
