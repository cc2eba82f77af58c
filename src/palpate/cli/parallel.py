"""Many jobs: over processes, Dask or Ray through joblib, and kept line by line so that the same command goes on."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import fields
from importlib import import_module
from math import isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

from palpate.cli.console import counting
from palpate.errors import InputError
from palpate.io.atomic import write_text, writing

if TYPE_CHECKING:
    from types import ModuleType

__all__ = ["BACKENDS", "begin_results", "each_done", "from_row", "read_rows", "require_backend", "run_kept"]

BACKENDS = ("processes", "dask", "ray")
_NEEDED = {"dask": ("distributed", "dask[distributed]"), "ray": ("ray.util.joblib", "ray")}  # module, and pip's name
ADDRESSES = {"dask": "DASK_SCHEDULER_ADDRESS", "ray": "RAY_ADDRESS"}  # variables, of the engines' own
ROUND = 8  # jobs a worker of Ray between two looks
DOUBTED = 2  # jobs that joblib hands out at most, a worker

Job = TypeVar("Job")
Result = TypeVar("Result")
Made = TypeVar("Made")


def require_backend(backend: str, workers: int | None, option: str) -> int:
    """How many workers there will be, 0: as many as the cluster has that is joined; before any work is done.

    Args:
        backend: one of `BACKENDS`.
        workers: asked for; None: one a core.
        option: that asks for them.

    Raises:
        InputError: there is no such backend, fewer than one worker, or what the backend needs is not installed.
    """
    if workers is not None and workers < 1:
        raise InputError(f"must be 1 at least, not {workers}.", where=option)
    if backend not in BACKENDS:
        hint = f"There are {', '.join(BACKENDS)}."
        raise InputError(f"there is no backend {backend!r}.", where="--backend", hint=hint)
    count = (os.cpu_count() or 1) if workers is None else workers
    if count == 1 and backend == "processes":
        return count
    _joblib(backend, option)
    return 0 if workers is None and _address(backend) else count


def each_done(
    one: Callable[[Job], Result],
    jobs: Sequence[Job],
    workers: int,
    backend: str,
    option: str,
    lost: Callable[[Job], Result] | None = None,
) -> Generator[Result]:
    """What comes of each job, in the order in which they are done.

    Where a worker is ended from outside (memory, a crash in a library), nobody knows by which of its jobs: the first
    of those that are left are tried one by one, and the others go on together.

    Args:
        one: what is done; it and its job can be pickled.
        jobs: all of them.
        workers: at a time, see `require_backend`. One of "processes" is this process.
        backend: one of `BACKENDS`.
        option: that asks for workers, for sentences.
        lost: what comes of a job that ends its worker; None: an error.

    Raises:
        InputError: what the backend needs is not installed, its cluster does not answer, or a worker was ended.
    """
    if workers == 1 and backend == "processes":
        yield from map(one, jobs)
        return
    joblib, left, doubted = _joblib(backend, option), dict(enumerate(jobs)), 0
    while left:
        some = dict(list(left.items())[: 1 if doubted else None])
        try:
            with _cluster(joblib, backend, workers) as count, closing(_made(joblib, one, some, backend, count)) as made:
                for number, result in made:
                    del left[number]
                    yield result
        except _ended(backend) as problem:
            if lost is None:
                hint = f"Was there too little memory? Ask for fewer, {option}."
                raise InputError("a worker was ended before it was done.", where=backend, hint=hint) from problem
            if len(some) == 1:
                yield lost(left.pop(*some))
            doubted = doubted if doubted else DOUBTED * max(workers, 1) + 1
        doubted = max(doubted - 1, 0)


def _made(
    joblib: Any, one: Callable[[Job], Result], jobs: Mapping[int, Job], backend: str, workers: int
) -> Generator[tuple[int, Result]]:
    """Numbers of jobs and what comes of them."""
    work = [joblib.delayed(_numbered)(one, number, job) for number, job in jobs.items()]
    if backend == "ray":  # its backend answers when all are done: some at a time, so that little is lost
        with joblib.Parallel(n_jobs=workers, batch_size=1) as parallel:
            for at in range(0, len(work), ROUND * workers):
                yield from parallel(work[at : at + ROUND * workers])
        return
    parallel = joblib.Parallel(n_jobs=workers, return_as="generator_unordered", batch_size=1)
    with closing(parallel(work)) as made:
        yield from made


def _numbered(one: Callable[[Job], Result], number: int, job: Job) -> tuple[int, Result]:
    return number, one(job)


def run_kept(
    one: Callable[[Job], Result],
    jobs: Sequence[Job],
    kept: Path,
    how: tuple[int, str, str],
    row: Callable[[Result], Mapping[str, object]],
    lost: Callable[[Job], Result] | None = None,
) -> Generator[Result]:
    """As `each_done`; each result is a line of a file before it is given.

    Args:
        one: what is done.
        jobs: all of them.
        kept: the file, see `begin_results`.
        how: workers, backend and option of `each_done`.
        row: what stands in a result's line.
        lost: of `each_done`.
    """
    with counting(), closing(each_done(one, jobs, *how, lost)) as results:
        for result in results:
            with writing(kept), kept.open("a", encoding="utf-8") as file:
                file.write(_line(row(result)))
            yield result


def read_rows(path: Path, what: str) -> tuple[dict[str, object], list[dict[str, Any]]]:
    """The settings in the first line of a file of results, and each result's line; see `from_row`.

    A last line that is cut, as a killed process leaves it, is no result.

    Args:
        path: of the file.
        what: it should hold, for the sentence.

    Raises:
        InputError: it is no such file.
    """
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    rows = list[dict[str, Any]]()
    try:
        settings = json.loads(lines[0])["settings"]
        for number, line in enumerate(lines[1:], start=2):
            try:
                rows.append(dict(json.loads(line)))
            except json.JSONDecodeError:
                if number == len(lines):
                    break
                raise
    except (ValueError, KeyError, TypeError, IndexError) as problem:
        hint = "Name another output."
        raise InputError(f"does not hold {what}.", where=str(path), hint=hint) from problem
    return settings, rows


def from_row(kind: type[Made], row: Mapping[str, Any]) -> Made:
    """A dataclass of strings, numbers and tuples of them, as its line holds it: null is NaN, and a list a tuple.

    Raises:
        KeyError: of a field that is not there.
    """
    names = [each.name for each in fields(cast("Any", kind))]
    return kind(**{name: _told(row[name]) for name in names})


def begin_results(path: Path, settings: Mapping[str, object], rows: Iterable[Mapping[str, object]]) -> None:
    """Write a file of results whole, without what is cut, so that lines can be added."""
    write_text(path, "".join([_line({"settings": settings}), *map(_line, rows)]))


def _line(row: Mapping[str, object]) -> str:
    return f"{json.dumps(_listed(row), allow_nan=False)}\n"


def _listed(value: object) -> object:
    if isinstance(value, Mapping):
        return {str(name): _listed(each) for name, each in cast("Mapping[object, object]", value).items()}
    if isinstance(value, tuple | list):
        return [_listed(each) for each in cast("Sequence[object]", value)]
    return None if isinstance(value, float) and not isfinite(value) else value


def _told(value: object) -> object:
    if isinstance(value, list):
        return tuple(map(_told, cast("list[object]", value)))
    return nan if value is None else value


def _joblib(backend: str, option: str) -> ModuleType:
    """With what the backend needs.

    Raises:
        InputError: it is not installed.
    """
    try:
        joblib = import_module("joblib")
    except ImportError as problem:
        hint = f"pip install 'palpate[batch]', or {option} 1 for one after the other."
        raise InputError("jobs in parallel need joblib.", where=option, hint=hint) from problem
    if backend in _NEEDED:
        module, package = _NEEDED[backend]
        try:
            import_module(module)
        except ImportError as problem:
            name = module.partition(".")[0]
            hint = f"pip install '{package}'"
            raise InputError(f"needs {name}.", where=f"--backend {backend}", hint=hint) from problem
    return joblib


def _ended(backend: str) -> tuple[type[Exception], ...]:
    """What is raised where a worker is gone."""
    if backend == "dask":
        return (import_module("distributed").scheduler.KilledWorker,)
    if backend == "ray":
        return (import_module("ray").exceptions.RayActorError,)
    return (import_module("concurrent.futures.process").BrokenProcessPool,)


@contextmanager
def _cluster(joblib: Any, backend: str, workers: int) -> Generator[int]:
    """Joblib runs on the backend meanwhile; a cluster is joined where its own variables say which, or made here.

    Gives how many workers there are.

    Raises:
        InputError: there is no cluster where the variable says.
    """
    if backend == "processes":
        with joblib.parallel_config(backend="loky", inner_max_num_threads=1):
            yield workers
        return
    with ExitStack() as stack:
        try:
            count = stack.enter_context((_dask if backend == "dask" else _ray)(workers))
        except (OSError, ValueError, RuntimeError) as problem:  # whatever each of them calls it
            there = f"{ADDRESSES[backend]}={address}" if (address := _address(backend)) else f"--backend {backend}"
            raise InputError(f"the cluster does not answer ({_first_line(problem)}).", where=there) from problem
        stack.enter_context(joblib.parallel_config(backend=backend))
        yield count


def _first_line(problem: Exception) -> str:
    return next(iter(str(problem).splitlines()), type(problem).__name__).rstrip(".")


def _address(backend: str) -> str | None:
    """Of the cluster that is to be joined; None: one is made."""
    if backend == "dask":
        return import_module("dask").config.get("scheduler-address", None)
    return os.environ.get(ADDRESSES["ray"]) if backend == "ray" else None


@contextmanager
def _dask(workers: int) -> Generator[int]:
    address = _address("dask")
    own = {"n_workers": workers, "threads_per_worker": 1, "dashboard_address": None, "silence_logs": logging.ERROR}
    with import_module("distributed").Client(**(own if address is None else {"address": address})):
        yield workers or -1  # joblib asks the cluster how many it has


@contextmanager
def _ray(workers: int) -> Generator[int]:
    ray = import_module("ray")
    import_module("ray.util.joblib").register_ray()
    own = {} if _address("ray") else {"num_cpus": workers, "include_dashboard": False}
    there = ray.is_initialized()
    if not there:
        ray.init(**own, logging_level=logging.ERROR, log_to_driver=False)
    try:
        yield workers or max(int(ray.cluster_resources().get("CPU", 1)), 1)
    finally:
        if not there:
            ray.shutdown()
