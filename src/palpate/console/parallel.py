"""Run many jobs on processes (joblib), Dask or Ray, and keep results line by line so that a command can continue."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager, suppress
from dataclasses import fields
from importlib import import_module
from itertools import islice
from math import isfinite, nan
from pathlib import Path
from typing import Any, TypeVar, cast

from palpate.console.console import counting
from palpate.errors import InputError
from palpate.files.atomic import write_text, writing
from palpate.files.inputs import open_input
from palpate.processes import KEEPING
from palpate.setup.prefetch import deaf

BACKENDS = ("processes", "dask", "ray")
_NEEDED = {  # module, and what pip installs
    "processes": ("joblib", "palpate[batch]"),
    "dask": ("distributed", "dask[distributed]"),
    "ray": ("ray", "ray"),
}
AHEAD = 2  # jobs that are handed out at a time, a worker: one is done, one waits

Job = TypeVar("Job")
Result = TypeVar("Result")
Made = TypeVar("Made")


def require_backend(backend: str, workers: int | None, option: str) -> int:
    """Check the backend before any work, and return the number of workers; 0: all of an existing cluster.

    Args:
        backend: one of `BACKENDS`.
        workers: requested number; None: one per core, or all of a cluster that Dask's or Ray's settings name.
        option: name of the option that sets `workers`, for messages.

    Raises:
        InputError: `backend` is unknown or not installed, or `workers` is less than 1.
    """
    if workers is not None and workers < 1:
        raise InputError(f"must be at least 1, not {workers}.", where=option)
    if backend not in BACKENDS:
        hint = f"Use one of {', '.join(BACKENDS)}."
        raise InputError(f"there is no backend {backend!r}.", where="--backend", hint=hint)
    count = (os.cpu_count() or 1) if workers is None else workers
    if count == 1 and backend == "processes":
        return count
    _require_installed(backend, option)
    joined = {"processes": bool, "dask": _dask_address, "ray": lambda: os.environ.get("RAY_ADDRESS")}[backend]()
    return 0 if workers is None and joined else count


def each_done(
    one: Callable[[Job], Result],
    jobs: Sequence[Job],
    workers: int,
    backend: str,
    option: str,
    lost: Callable[[Job], Result] | None = None,
) -> Generator[Result]:
    """Yield the result of each job, in the order in which they finish.

    Args:
        one: function of a job; it and the jobs can be pickled. Its errors are raised here.
        jobs: arguments of `one`.
        workers: number from `require_backend`; 1 of "processes" is this process.
        backend: one of `BACKENDS`.
        option: name of the option that sets `workers`, for messages.
        lost: result of a job whose worker was ended from outside (memory, a crash in a library).

    Raises:
        InputError: the backend is not installed, its cluster does not answer, or, without `lost`, a worker was ended.
    """
    if not jobs:
        return
    if workers == 1 and backend == "processes":
        yield from map(one, jobs)
        return
    engine = {"processes": _on_processes, "dask": _on_dask, "ray": _on_ray}[backend]
    _require_installed(backend, option)

    def missed(job: Job) -> Result:
        if lost is None:
            hint = f"If memory was short, use fewer workers ({option})."
            raise InputError("a worker ended before its job was done.", where=f"--backend {backend}", hint=hint)
        return lost(job)

    with closing(engine(one, jobs, workers, missed)) as results:
        yield from results


def _on_processes(
    one: Callable[[Job], Result], jobs: Sequence[Job], workers: int, missed: Callable[[Job], Result]
) -> Generator[Result]:
    """Run by joblib; after a worker was ended, the first remaining jobs are tried one by one."""
    joblib = import_module("joblib")
    remaining, single = dict(enumerate(jobs)), 0  # `single`: jobs to be tried one by one
    while remaining:
        some = list(remaining.items())[: 1 if single else None]
        work = [joblib.delayed(_numbered)(one, number, job) for number, job in some]
        try:
            with joblib.parallel_config(backend="loky", inner_max_num_threads=1):
                parallel = joblib.Parallel(n_jobs=workers, return_as="generator_unordered", batch_size=1)
                with closing(parallel(work)) as made:
                    for number, result in made:
                        del remaining[number]
                        yield result
        except BrokenProcessPool:
            if len(some) == 1:
                yield missed(remaining.pop(some[0][0]))
            single = single or AHEAD * workers + 1
        single = max(single - 1, 0)


def _numbered(one: Callable[[Job], Result], number: int, job: Job) -> tuple[int, Result]:
    return number, one(job)


def _on_dask(
    one: Callable[[Job], Result], jobs: Sequence[Job], workers: int, missed: Callable[[Job], Result]
) -> Generator[Result]:
    """Run by Dask's scheduler; through joblib it would not notice an ended worker."""
    distributed = import_module("distributed")
    address = _dask_address()
    own = {"n_workers": workers, "threads_per_worker": 1, "dashboard_address": ":0", "silence_logs": logging.CRITICAL}
    settings = {f"distributed.nanny.pre-spawn-environ.{name}": value for name, value in KEEPING.items()}
    settings["distributed.worker.profile.enabled"] = False  # it stops the work a hundred times a second
    with _joining("dask", address), deaf(), import_module("dask").config.set(settings):
        client = distributed.Client(**(own if address is None else {"address": address}))
    with client:
        waiting = dict(zip(client.map(one, jobs, pure=False), jobs, strict=True))
        suspected = list[Job]()  # jobs on a worker that was ended: one of them ended it
        for future in distributed.as_completed(list(waiting)):
            job = waiting.pop(future)
            try:
                yield future.result()
            except distributed.scheduler.KilledWorker:
                suspected.append(job)
        for job in suspected:
            try:
                result = client.submit(one, job, pure=False).result()
            except distributed.scheduler.KilledWorker:
                result = missed(job)
            yield result


def _on_ray(
    one: Callable[[Job], Result], jobs: Sequence[Job], workers: int, missed: Callable[[Job], Result]
) -> Generator[Result]:
    """Run by Ray's scheduler; through joblib it would not notice an ended worker either."""
    ray = import_module("ray")
    gone = (ray.exceptions.WorkerCrashedError, ray.exceptions.OutOfMemoryError)
    with _ray(workers) as count:
        task, remaining = ray.remote(num_cpus=1, max_retries=0)(_numbered), enumerate(jobs)
        waiting = dict[Any, Job]()
        while True:
            some = islice(remaining, AHEAD * count - len(waiting))
            waiting |= {task.remote(one, number, job): job for number, job in some}
            if not waiting:
                return
            (ready,), _ = ray.wait(list(waiting), num_returns=1)
            job = waiting.pop(ready)
            try:
                _, result = ray.get(ready)
            except gone:
                result = missed(job)
            yield result


def run_kept(
    one: Callable[[Job], Result],
    jobs: Sequence[Job],
    kept: Path,
    how: tuple[int, str, str],
    row: Callable[[Result], Mapping[str, object]],
    lost: Callable[[Job], Result] | None = None,
) -> Generator[Result]:
    """Yield the results of `each_done`; each is first appended to a file as a line.

    Args:
        one: see `each_done`.
        jobs: see `each_done`.
        kept: file from `begin_results`.
        how: workers, backend and option of `each_done`.
        row: converts a result to the contents of its line.
        lost: see `each_done`.

    Raises:
        InputError: as `each_done`, or the file cannot be written.
    """
    with counting(), closing(each_done(one, jobs, *how, lost)) as results:
        for result in results:
            with writing(kept), kept.open("a", encoding="utf-8") as file:
                file.write(_line(row(result)))
            yield result


def read_rows(path: Path, what: str) -> tuple[dict[str, object], list[dict[str, Any]]]:
    """Return (settings, rows) of a file of results, rows for `from_row`; an incomplete last line is ignored.

    Args:
        path: file from `begin_results`.
        what: name of its content, for the message.

    Raises:
        InputError: the file cannot be read, or holds something else.
    """
    with open_input(path) as file:
        lines = file.read().decode(errors="replace").splitlines()
    try:
        settings = json.loads(lines[0])["settings"]
        rows = [dict(json.loads(line)) for line in lines[1:-1]]
        with suppress(json.JSONDecodeError):  # of a process that was killed while it wrote
            rows += [dict(json.loads(line)) for line in lines[1:][-1:]]
    except (ValueError, KeyError, TypeError, IndexError) as problem:
        raise InputError(f"does not hold {what}.", where=str(path), hint="Name another output.") from problem
    return settings, rows


def from_row(kind: type[Made], row: Mapping[str, Any]) -> Made:
    """Return a dataclass from a row of `read_rows`: None becomes NaN, a list a tuple; keys of no field are ignored.

    Raises:
        KeyError: a field is missing.
    """
    return kind(**{each.name: _read(row[each.name]) for each in fields(cast("Any", kind))})


def begin_results(path: Path, settings: Mapping[str, object], rows: Iterable[Mapping[str, object]]) -> None:
    """Write a new file of results: a line of settings, and a line per row, to which `run_kept` adds.

    Raises:
        InputError: the file cannot be written.
    """
    write_text(path, "".join([_line({"settings": settings}), *map(_line, rows)]))


def _line(row: Mapping[str, object]) -> str:
    return f"{json.dumps(_finite(row), allow_nan=False)}\n"


def _finite(value: object) -> object:
    if isinstance(value, Mapping):
        return {str(name): _finite(each) for name, each in cast("Mapping[object, object]", value).items()}
    if isinstance(value, tuple | list):
        return [_finite(each) for each in cast("Sequence[object]", value)]
    return None if isinstance(value, float) and not isfinite(value) else value


def _read(value: object) -> object:
    if isinstance(value, list):
        return tuple(map(_read, cast("list[object]", value)))
    return nan if value is None else value


def _require_installed(backend: str, option: str) -> None:
    """Raise an InputError if the backend is not installed."""
    module, package = _NEEDED[backend]
    try:
        import_module(module)
    except ImportError as problem:
        one = f", or {option} 1 to run one after the other" if backend == "processes" else ""
        where = option if backend == "processes" else f"--backend {backend}"
        hint = f"pip install '{package}'{one}."
        raise InputError(f"jobs in parallel need {module}.", where=where, hint=hint) from problem


def _dask_address() -> str | None:
    """Return the address of an existing Dask scheduler."""
    return import_module("dask").config.get("scheduler-address", None)


@contextmanager
def _ray(workers: int) -> Generator[int]:
    """Join the cluster of RAY_ADDRESS, or start local processes; yield the number of workers."""
    ray, address = import_module("ray"), os.environ.get("RAY_ADDRESS")
    if ray.is_initialized():
        yield workers or 1
        return
    own = {} if address else {"address": "local", "num_cpus": workers, "include_dashboard": False}
    with _joining("ray", address), _environment({name: str(value) for name, value in KEEPING.items()}):
        ray.init(**own, logging_level=logging.CRITICAL, log_to_driver=False)
    try:
        yield workers or max(int(ray.cluster_resources().get("CPU", 1)), 1)
    finally:
        ray.shutdown()


@contextmanager
def _environment(more: Mapping[str, str]) -> Generator[None]:
    """Set environment variables within the block."""
    before = {name: os.environ[name] for name in more if name in os.environ}
    os.environ.update(more)
    try:
        yield
    finally:
        for name in more:
            del os.environ[name]
        os.environ.update(before)


@contextmanager
def _joining(backend: str, address: str | None) -> Generator[None]:
    """Raise an InputError where the cluster does not answer."""
    try:
        yield
    except (OSError, ValueError, RuntimeError) as problem:  # whatever each of them calls it
        why = next(iter(str(problem).splitlines()), type(problem).__name__).rstrip(".")
        there = f"--backend {backend}" if address is None else f"--backend {backend} at {address}"
        raise InputError(f"the cluster does not answer ({why}).", where=there) from problem
