"""Many runs in the arena: in parallel over processes, kept line by line so that they can go on, judged as a page."""

from __future__ import annotations

import json
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, fields
from functools import partial
from importlib import import_module
from math import isfinite, nan
from os import cpu_count
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO, cast

from palpate.cli.arena_run import ArenaResult
from palpate.cli.arena_setup import Asked, command
from palpate.cli.console import Figure, announce, counting, lines, note, overwrite, title
from palpate.errors import InputError
from palpate.io.atomic import keep_inputs, write_text, writing
from palpate.viewer.arena_summary import Judged, compose, figures
from palpate.viewer.report import render, require_report

if TYPE_CHECKING:
    from types import ModuleType

__all__ = ["BACKENDS", "read_results", "run_batch"]

BACKENDS = ("loky", "dask", "ray")
MOST = 100_000  # runs


def run_batch(asked: Asked, seeds: Sequence[int], output: Path, jobs: int | None, backend: str) -> None:
    """Run the seeds that are not done yet, and write the page of all of them.

    Args:
        asked: of every run.
        seeds: which.
        output: the page; results are beside it, its name ending in .jsonl.
        jobs: how many processes; None: one a core.
        backend: one of `BACKENDS`.

    Raises:
        InputError: a wrong option, results of other settings, joblib or what its backend needs is not installed.
    """
    _require(output, len(seeds), jobs, backend)
    asked.check()
    require_report()
    kept = output.with_suffix(".jsonl")
    keep_inputs(output, [None if asked.rig is None else Path(asked.rig)], beside=[kept])
    done = _begin(kept, asked.key())
    if known := [seed for seed in seeds if seed in done]:
        announce(f"{len(known)} of {len(seeds)} seeds are in {kept} already; the others follow")
    wanted = [seed for seed in seeds if seed not in done]
    jobs = (cpu_count() or 1) if jobs is None else jobs
    try:
        with writing(kept), kept.open("a", encoding="utf-8") as file, counting():
            for result in _results(partial(_one, asked), wanted, jobs, backend):
                _keep(file, result)
                done[result.seed] = result
                overwrite(_so_far([done[seed] for seed in seeds if seed in done], len(seeds)))
    except KeyboardInterrupt:
        announce(f"{sum(seed in done for seed in seeds)} of {len(seeds)} seeds are in {kept}: the same command goes on")
        raise
    _report(asked, [done[seed] for seed in seeds], output)


def _require(output: Path, seeds: int, jobs: int | None, backend: str) -> None:
    if not 1 <= seeds <= MOST:
        raise InputError(f"must be from 1 to {MOST:,}, not {seeds}.", where="--seeds")
    if jobs is not None and jobs < 1:
        raise InputError(f"must be 1 at least, not {jobs}.", where="--jobs")
    if backend not in BACKENDS:
        hint = f"joblib's own are {', '.join(BACKENDS)}."
        raise InputError(f"there is no backend {backend!r}.", where="--backend", hint=hint)
    if output.suffix != ".html":
        hint = "With --seeds it is a page: name it SUMMARY.html."
        raise InputError("is not the name of a page.", where=str(output), hint=hint)


def read_results(path: Path) -> tuple[dict[str, object], dict[int, ArenaResult]]:
    """What a file of results holds: the settings, and the result of each seed.

    A last line that is cut, as a killed process leaves it, is no result.

    Raises:
        InputError: it is no such file.
    """
    rows = path.read_text(encoding="utf-8", errors="replace").splitlines()
    found = dict[int, ArenaResult]()
    try:
        settings = json.loads(rows[0])["settings"]
        for number, row in enumerate(rows[1:], start=2):
            try:
                result = _result(json.loads(row))
            except json.JSONDecodeError:
                if number == len(rows):
                    break
                raise
            found[result.seed] = result
    except (ValueError, KeyError, TypeError, IndexError) as problem:
        hint = "Name another output."
        raise InputError("does not hold results of runs in the arena.", where=str(path), hint=hint) from problem
    return settings, found


def _result(row: dict[str, Any]) -> ArenaResult:
    """Of one line; null is NaN, and a list a tuple."""
    values: dict[str, Any] = {each.name: row[each.name] for each in fields(ArenaResult)}
    for name, value in values.items():
        if isinstance(value, list):
            values[name] = tuple(nan if each is None else each for each in cast("list[Any]", value))
    return ArenaResult(**values)


def _keep(file: TextIO, result: ArenaResult) -> None:
    """Add a line, whole or not at all as far as the system can."""
    row = {name: _listed(value) for name, value in asdict(result).items()}
    file.write(f"{json.dumps(row, allow_nan=False)}\n")
    file.flush()


def _listed(value: object) -> object:
    if isinstance(value, tuple):
        return [_listed(each) for each in cast("tuple[object, ...]", value)]
    return None if isinstance(value, float) and not isfinite(value) else value


def _begin(path: Path, key: dict[str, object]) -> dict[int, ArenaResult]:
    """What is done already; the file is made, or cleared of what is cut, so that lines can be added.

    Raises:
        InputError: it is of other settings.
    """
    done = dict[int, ArenaResult]()
    if path.exists():
        there, done = read_results(path)
        other = [name for name in key if there.get(name) != key[name]]
        if other:
            said = ", ".join(f"{name} {there.get(name)!r} instead of {key[name]!r}" for name in other)
            hint = "Name another output, or remove it."
            raise InputError(f"holds runs of other settings: {said}.", where=str(path), hint=hint)
    rows = [json.dumps({"settings": key})]
    rows += [json.dumps({name: _listed(value) for name, value in asdict(each).items()}) for each in done.values()]
    write_text(path, "\n".join([*rows, ""]))
    return done


def _one(asked: Asked, seed: int) -> ArenaResult:
    """One run, in whatever process."""
    return asked.run(seed).play()


def _results(one: Callable[[int], ArenaResult], seeds: Sequence[int], jobs: int, backend: str) -> Iterator[ArenaResult]:
    """Of each seed, in the order in which they are done."""
    if jobs == 1 and backend == "loky":
        yield from map(one, seeds)
        return
    joblib = _joblib(backend)
    work = [joblib.delayed(one)(seed) for seed in seeds]
    with _cluster(joblib, backend, jobs):
        if backend == "ray":  # its backend answers when all are done: some at a time, so that little is lost
            for at in range(0, len(work), jobs):
                yield from joblib.Parallel(n_jobs=jobs)(work[at : at + jobs])
            return
        with closing(joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")(work)) as made:
            yield from made


def _joblib(backend: str) -> ModuleType:
    """With what the backend needs.

    Raises:
        InputError: it is not installed.
    """
    try:
        joblib = import_module("joblib")
    except ImportError as problem:
        hint = "pip install 'palpate[simulation]', or --jobs 1 for one run after the other."
        raise InputError("runs in parallel need joblib.", where="--jobs", hint=hint) from problem
    needed = {"dask": "distributed", "ray": "ray.util.joblib"}.get(backend)
    if needed is not None:
        try:
            import_module(needed)
        except ImportError as problem:
            name = needed.partition(".")[0]
            raise InputError(f"needs {name}.", where=f"--backend {backend}", hint=f"pip install {name}") from problem
    return joblib


@contextmanager
def _cluster(joblib: Any, backend: str, jobs: int) -> Generator[None]:
    """Joblib runs on the backend meanwhile; a cluster is joined where its own variables say which, or made here."""
    if backend == "dask":
        with import_module("distributed").Client(**_local(jobs)), joblib.parallel_config(backend="dask"):
            yield
    elif backend == "ray":
        import_module("ray.util.joblib").register_ray()
        with joblib.parallel_config(backend="ray"):
            yield
    else:
        with joblib.parallel_config(backend="loky", inner_max_num_threads=1):
            yield


def _local(jobs: int) -> dict[str, Any]:
    """Of dask: the scheduler that DASK_SCHEDULER_ADDRESS names, or processes of its own."""
    config = import_module("dask").config
    address = config.get("scheduler-address", None)
    if address is not None:
        return {"address": address}
    return {"n_workers": jobs, "threads_per_worker": 1, "dashboard_address": None}


def _judged(asked: Asked, results: Iterable[ArenaResult]) -> list[Judged]:
    return [
        Judged(
            seed=each.seed,
            arrived=each.arrived,
            path=each.path,
            force=each.force,
            greatest=max(each.greatest, default=0.0),
            pushes=sum(each.pushes),
            deadlocks=sum(each.deadlocks),
            states=each.state,
            command=command(asked, each.seed),
        )
        for each in results
    ]


def _so_far(results: list[ArenaResult], total: int) -> str:
    times = [time for each in results for time in each.arrived]
    share = sum(map(isfinite, times)) / max(len(times), 1)
    return f"{len(results)} of {total} seeds, {share:.1%} of the robots arrive"


def _report(asked: Asked, results: list[ArenaResult], output: Path) -> None:
    judged = _judged(asked, results)
    settings = tuple((name, str(value)) for name, value in asked.key().items() if value not in (None, ""))
    write_text(output, render(compose(judged, settings)))
    title(f"{len(judged)} runs of seeds {judged[0].seed} to {judged[-1].seed} -> {output}")
    lines((name, Figure(text, value)) for name, text, value in figures(judged))
    lost = [each for each in judged if not each.whole]
    note(f"not all arrive: {each.command}" for each in lost[:5])
    note([f"and {len(lost) - 5} more, see {output}"] if len(lost) > 5 else [])
