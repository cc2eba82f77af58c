"""`palpate benchmark make`: make tasks of contact sensing with their truth, from a seed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import FlagCreatePairsOff, arg

from palpate.console.console import Quantity, lines, note, title, wait
from palpate.errors import InputError
from palpate_lab.benchmark.files import read_benchmark
from palpate_lab.cli.simulate import complete_session, require_new


def benchmark_make(
    *,
    output: Annotated[Path, arg(aliases=["-o"], metavar="FOLDER")],
    seed: Annotated[int, arg(metavar="N")] = 1,
    small: Annotated[bool, FlagCreatePairsOff] = False,
    only: Annotated[str, arg(metavar="NAME,NAME", help_behavior_hint="")] = "",
) -> None:
    """Make benchmark tasks: wrenches, logs, skin frames, images.

    Everything is simulated forwards, by closed forms, finite elements and a physics engine (MuJoCo): no estimator has a
    hand in the truth. README.txt in the folder says how to answer.

    Args:
        output: folder to make; in it one folder per task, with task.toml, its readings and truth.csv.
        seed: seed of everything random; compare figures of seed 1 only.
        small: make a few samples of each, to try things out.
        only: names of tasks, separated by commas; a task does not depend on which others are made.
    """
    from palpate_lab.benchmark import make_benchmark  # here: with it comes scipy

    require_new(output)
    if seed < 0:
        raise InputError("must not be negative.", where="--seed")
    names = tuple(name for name in only.split(",") if name)
    with complete_session(output) as part:
        make_benchmark(part, seed, small=small, only=names, watch=lambda name: wait(f"making {name}"))
    tasks = read_benchmark(output)
    size = sum(path.stat().st_size for path in output.rglob("*") if path.is_file())
    title(f"benchmark of {len(tasks)} tasks, seed {seed}{', small' if small else ''} -> {output}")
    lines((name, Quantity(f"{task.samples:,} samples of {task.kind}", task.samples)) for name, task in tasks.items())
    lines([("size", Quantity(f"{size / 1e6:.1f} MB", size))])
    note([f"how to answer: {output / 'README.txt'}; to score: palpate benchmark score {output}"])
