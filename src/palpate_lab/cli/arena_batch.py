"""Run many arenas in parallel, keep each result as a line so that a batch can resume, and write a page about them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict
from functools import partial
from math import isfinite
from pathlib import Path

from palpate.console.console import Quantity, announce, lines, note, overwrite, title
from palpate.console.parallel import begin_results, from_row, read_rows, require_backend, run_kept
from palpate.errors import InputError
from palpate.files.atomic import keep_inputs, write_text
from palpate.viewer.report import render, require_report
from palpate_lab.cli.arena_setup import ArenaRequest, command
from palpate_lab.simulation.arena.moment import ArenaResult
from palpate_lab.viewer.arena_summary import compose, figures

MOST = 100_000  # runs
JOBS, RESULTS = "--jobs", "results of runs in the arena"


def run_batch(request: ArenaRequest, seeds: Sequence[int], output: Path, jobs: int | None, backend: str) -> None:
    """Run the seeds that are not done yet, and write the page about all of them.

    Args:
        request: settings of every run.
        seeds: seeds to run.
        output: the page; the results are next to it, in a file of the same stem that ends in .jsonl.
        jobs: number of processes; None for one per core.
        backend: one of `palpate.console.parallel.BACKENDS`.

    Raises:
        InputError: a wrong option, results of other settings, or joblib or its backend's package is not installed.
    """
    workers = _require(output, len(seeds), jobs, backend)
    request.check()
    require_report()
    kept = output.with_suffix(".jsonl")
    keep_inputs(output, [None if request.rig is None else Path(request.rig)], siblings=[kept])
    done = _begin(kept, request.key())
    if known := [seed for seed in seeds if seed in done]:
        announce(f"{len(known)} of {len(seeds)} seeds are in {kept} already; the others follow")
    wanted = [seed for seed in seeds if seed not in done]
    try:
        with closing(run_kept(partial(_one, request), wanted, kept, (workers, backend, JOBS), asdict)) as results:
            for result in results:
                done[result.seed] = result
                overwrite(_so_far([done[seed] for seed in seeds if seed in done], len(seeds)))
    except KeyboardInterrupt:
        announce(f"{sum(seed in done for seed in seeds)} of {len(seeds)} seeds are in {kept}: the same command goes on")
        raise
    _report(request, [done[seed] for seed in seeds], output)


def _require(output: Path, seeds: int, jobs: int | None, backend: str) -> int:
    """Check the options, and return the number of processes."""
    if not 1 <= seeds <= MOST:
        raise InputError(f"must be from 1 to {MOST:,}, not {seeds}.", where="--seeds")
    if output.suffix != ".html":
        hint = "With --seeds the output is a page: name it SUMMARY.html."
        raise InputError("is not the name of a page.", where=str(output), hint=hint)
    return require_backend(backend, jobs, JOBS)


def read_results(path: Path) -> tuple[dict[str, object], dict[int, ArenaResult]]:
    """Read a file of results: a dict of the settings, and a dict of seed -> `ArenaResult`.

    An incomplete last line, as a killed process leaves it, is ignored.

    Raises:
        InputError: it is no file of results.
    """
    settings, rows = read_rows(path, RESULTS)
    try:
        found = [from_row(ArenaResult, row) for row in rows]
    except (KeyError, TypeError) as problem:
        what = f"exists and does not contain {RESULTS}."
        raise InputError(what, where=str(path), hint="Name another output.") from problem
    return settings, {result.seed: result for result in found}


def _begin(path: Path, key: dict[str, object]) -> dict[int, ArenaResult]:
    """Return the results that a file has; create it, or remove an incomplete last line, so that lines can be added.

    Raises:
        InputError: the file is of other settings.
    """
    done = dict[int, ArenaResult]()
    if path.exists():
        there, done = read_results(path)
        other = [name for name in key if there.get(name) != key[name]]
        if other:
            said = ", ".join(f"{name} {there.get(name)!r} instead of {key[name]!r}" for name in other)
            hint = "Name another output, or remove it."
            raise InputError(f"contains runs with other settings: {said}.", where=str(path), hint=hint)
    begin_results(path, key, map(asdict, done.values()))
    return done


def _one(asked: ArenaRequest, seed: int) -> ArenaResult:
    """Run one seed, in any process."""
    return asked.run(seed).play()


def _so_far(results: list[ArenaResult], total: int) -> str:
    times = [time for each in results for time in each.arrived]
    share = sum(map(isfinite, times)) / max(len(times), 1)
    return f"{len(results)} of {total} seeds, {share:.1%} of the robots arrive"


def _report(asked: ArenaRequest, results: list[ArenaResult], output: Path) -> None:
    settings = tuple((name, str(value)) for name, value in asked.key().items() if value not in (None, ""))
    write_text(output, render(compose(results, settings, partial(command, asked))))
    title(f"{len(results)} runs of seeds {results[0].seed} to {results[-1].seed} -> {output}")
    lines((name, Quantity(text, value)) for name, text, value in figures(results))
    lost = [each for each in results if not each.complete]
    note(f"not all arrive: {command(asked, each.seed)}" for each in lost[:5])
    note([f"and {len(lost) - 5} more, see {output}"] if len(lost) > 5 else [])
