"""Many jobs: over processes, Dask or Ray through joblib, and kept line by line so that the same command goes on."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import closing, contextmanager
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
ROUND = 4  # jobs a worker of Ray between two looks

Job = TypeVar("Job")
Result = TypeVar("Result")
Made = TypeVar("Made")


def require_backend(backend: str, workers: int | None, option: str) -> int:
    """How many workers there will be; before any work is done.

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
    if count > 1 or backend != "processes":
        _joblib(backend, option)
    return count


def each_done(
    one: Callable[[Job], Result], jobs: Sequence[Job], workers: int, backend: str, option: str
) -> Generator[Result]:
    """What comes of each job, in the order in which they are done.

    Args:
        one: what is done; it and its job can be pickled.
        jobs: all of them.
        workers: at a time. One of "processes" is this process.
        backend: one of `BACKENDS`.
        option: that asks for workers, for sentences.

    Raises:
        InputError: what the backend needs is not installed.
    """
    if not jobs:
        return
    if workers == 1 and backend == "processes":
        yield from map(one, jobs)
        return
    joblib = _joblib(backend, option)
    work = [joblib.delayed(one)(job) for job in jobs]
    with _cluster(joblib, backend, workers):
        if backend == "ray":  # its backend answers when all are done: some at a time, so that little is lost
            with joblib.Parallel(n_jobs=workers, batch_size=1) as parallel:
                for at in range(0, len(work), ROUND * workers):
                    yield from parallel(work[at : at + ROUND * workers])
            return
        parallel = joblib.Parallel(n_jobs=workers, return_as="generator_unordered", batch_size=1)
        with closing(parallel(work)) as made:
            yield from made


def run_kept(
    one: Callable[[Job], Result],
    jobs: Sequence[Job],
    kept: Path,
    how: tuple[int, str, str],
    row: Callable[[Result], Mapping[str, object]],
) -> Generator[Result]:
    """As `each_done`; each result is a line of a file before it is given.

    Args:
        one: what is done.
        jobs: all of them.
        kept: the file, see `begin_results`.
        how: workers, backend and option of `each_done`.
        row: what stands in a result's line.
    """
    made = each_done(one, jobs, *how)
    with writing(kept), kept.open("a", encoding="utf-8") as file, counting(), closing(made) as results:
        for result in results:
            file.write(_line(row(result)))
            file.flush()
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


@contextmanager
def _cluster(joblib: Any, backend: str, workers: int) -> Generator[None]:
    """Joblib runs on the backend meanwhile; a cluster is joined where its own variables say which, or made here."""
    if backend == "dask":
        with import_module("distributed").Client(**_local(workers)), joblib.parallel_config(backend="dask"):
            yield
    elif backend == "ray":
        with _ray(workers), joblib.parallel_config(backend="ray"):
            yield
    else:
        with joblib.parallel_config(backend="loky", inner_max_num_threads=1):
            yield


@contextmanager
def _ray(workers: int) -> Generator[None]:
    """The cluster that RAY_ADDRESS names, or processes of its own, ended with the block."""
    ray = import_module("ray")
    import_module("ray.util.joblib").register_ray()
    there = ray.is_initialized()
    if not there:
        own = {} if os.environ.get("RAY_ADDRESS") else {"num_cpus": workers, "include_dashboard": False}
        ray.init(**own, logging_level=logging.ERROR, log_to_driver=False)
    try:
        yield
    finally:
        if not there:
            ray.shutdown()


def _local(workers: int) -> dict[str, Any]:
    """Of dask: the scheduler that DASK_SCHEDULER_ADDRESS names, or processes of its own."""
    config = import_module("dask").config
    address = config.get("scheduler-address", None)
    if address is not None:
        return {"address": address}
    return {"n_workers": workers, "threads_per_worker": 1, "dashboard_address": None, "silence_logs": logging.ERROR}
