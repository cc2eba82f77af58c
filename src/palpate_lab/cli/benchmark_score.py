"""`palpate benchmark score`: score Palpate, its peers and any other estimator on the same tasks."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

from tyro.conf import FlagCreatePairsOff, Positional, arg

from palpate.console.console import counting, note, overwrite, part, step, table, title
from palpate.console.options import FileOption, NameOption
from palpate.errors import InputError
from palpate.files.atomic import keep_inputs, write_text
from palpate.viewer.report import require_report
from palpate_lab.benchmark.files import Task, read_answers, read_benchmark, read_truth
from palpate_lab.benchmark.scoring import score
from palpate_lab.cli.benchmark_entrants import Entrant, EntrantResult, users
from palpate_lab.cli.benchmark_table import LEGEND, Row, as_markdown, as_page, cells, header

PAGES, TEXTS = (".html", ".htm"), (".md",)


def benchmark_score(
    folder: Annotated[Positional[Path], arg(metavar="FOLDER")],
    /,
    answers: FileOption = None,
    estimator: Annotated[NameOption, arg(metavar="MODULE:FUNCTION")] = None,
    name: Annotated[str, arg(metavar="TEXT", help_behavior_hint="")] = "",
    alone: Annotated[bool, FlagCreatePairsOff] = False,
    output: Annotated[FileOption, arg(aliases=["-o"])] = None,
) -> None:
    """Score estimators and their peers on benchmark tasks.

    Score estimators on a folder of `palpate benchmark make`: yours, Palpate, and the usual ways as peers.

    A contact without an answer is a miss: it counts as infinitely far off in the median, the 95 % and the share within
    2 mm.

    Args:
        folder: folder of the tasks.
        answers: CSV of answers, task,sample,px,py,pz[,fx,fy,fz][,cxx,cxy,cxz,cyy,cyz,czz], a row per contact;
            tasks without a row are not entered.
        estimator: a function of yours, imported by its name from the current folder; README.txt in FOLDER says what it
            is given.
        name: name of the answers or the function in the table.
        alone: score without Palpate and the peers.
        output: page (.html) or text (.md) to write in addition.
    """
    _require(folder, answers, estimator, alone, output)
    tasks = read_benchmark(folder)
    entrants = [*_given(answers, estimator, name, tasks)]
    if not alone:
        from palpate_lab.cli.benchmark_palpate import palpate_entrants  # here: with them comes scipy
        from palpate_lab.cli.benchmark_peers import peers

        entrants += [*palpate_entrants(), *peers()]
    results = {task.name: rows for task in tasks.values() if (rows := list(_scored(task, entrants)))}
    title(f"{folder}: {len(results)} of {len(tasks)} tasks")
    for task, rows in results.items():
        part(task)
        step(f"\n{task}: {rows[0].score.contacts:,} contacts in {tasks[task].samples:,} samples")
        table(header(), [cells(row) for row in rows])
    note(LEGEND)
    if output is not None:
        write_text(output, (as_page if output.suffix.lower() in PAGES else as_markdown)(tasks, results))


def _require(folder: Path, answers: Path | None, estimator: str | None, alone: bool, output: Path | None) -> None:
    """Check the options before any work."""
    if not folder.is_dir():
        raise InputError("is not a folder.", where=str(folder), hint="Make one with palpate benchmark make -o FOLDER.")
    if alone and answers is None and estimator is None:
        raise InputError("leaves no estimator to score.", where="--alone", hint="Add --answers or --estimator.")
    if output is not None:
        if output.suffix.lower() not in (*PAGES, *TEXTS):
            raise InputError("is not the name of a page or a text.", where=str(output), hint="Name it .html or .md.")
        keep_inputs(output, (answers,))
        if output.suffix.lower() in PAGES:
            require_report()


def _given(answers: Path | None, estimator: str | None, name: str, tasks: dict[str, Task]) -> Iterator[Entrant]:
    """Yield the entrants that a user names."""
    if answers is not None:
        found = read_answers(answers, tasks)

        def enter(task: Task) -> EntrantResult | None:
            return EntrantResult(found[task.name], float("nan")) if task.name in found else None

        yield Entrant(name if name and estimator is None else answers.name, enter)
    if estimator is not None:
        entrant = users(estimator)
        yield Entrant(name or entrant.name, entrant.enter)


def _scored(task: Task, entrants: list[Entrant]) -> Iterator[Row]:
    truth, quiet = read_truth(task)
    for entrant in entrants:
        with counting():
            overwrite(f"{task.name}: {entrant.name}")
            found = entrant.enter(task)
        if found is not None:
            yield Row(entrant.name, score(found.contacts, truth, quiet), found.seconds)
