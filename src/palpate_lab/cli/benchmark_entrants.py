"""Entrants of the benchmark: functions that are called reading by reading, and a user's functions by name."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from time import perf_counter_ns
from typing import Any, cast

import numpy as np
from jaxtyping import Float

from palpate.contact.contacts import Contacts
from palpate.errors import InputError
from palpate_lab.benchmark.files import WIDTHS, Task, as_contacts

Prepare = Callable[
    [Task], Callable[[np.ndarray], Any] | None
]  # of a task: what answers its readings; None: not entered


@dataclass(frozen=True, eq=False)
class EntrantResult:
    """The contacts that an entrant found in one task, and its time per sample [s]; NaN if it was not measured."""

    contacts: Contacts
    seconds: float


@dataclass(frozen=True)
class Entrant:
    """A named entrant of the benchmark; `enter` returns its result of a task, or None if it does not take part."""

    name: str
    enter: Callable[[Task], EntrantResult | None]


def live_entrant(prepare: Prepare, name: str) -> Entrant:
    """Return an `Entrant` that is called with each reading in turn; its time is the median of the calls.

    Its `enter` raises InputError for an answer that is no contact, or has more contacts than the task's `most`.
    """

    def enter(task: Task) -> EntrantResult | None:
        answer = prepare(task)
        if answer is None:
            return None
        samples: list[int] = []
        rows: list[np.ndarray] = []
        times: list[int] = []
        for sample, reading in enumerate(task.readings()):
            begin = perf_counter_ns()
            said = answer(reading)
            times.append(perf_counter_ns() - begin)
            found = _rows(said, task, sample, name)
            samples += [sample] * len(found)
            rows += list(found)
        full = np.stack(rows) if rows else np.empty((0, WIDTHS[-1]))
        contacts = as_contacts(np.array(samples, dtype=np.int64), full)
        return EntrantResult(
            contacts, 1e-9 * float(np.median(times[min(1, len(times) - 1) :]))
        )  # the first may compile

    return Entrant(name, enter)


def _rows(said: object, task: Task, sample: int, name: str) -> Float[np.ndarray, "k 12"]:
    """Convert one answer to contacts (k, 12), without those whose point is NaN.

    An answer is None, or an array of one or several contacts of 3, 6 or 12 numbers.
    """
    full = np.empty((0, WIDTHS[-1]))
    if said is None:
        return full
    where = f"{name}, task {task.name}, sample {sample}"
    try:
        given = np.atleast_2d(np.asarray(said, dtype=np.float64))
    except (TypeError, ValueError) as problem:
        raise InputError(
            f"answered with {type(said).__name__}, which is not an array of numbers.", where=where
        ) from problem
    if given.ndim != 2 or (given.size and given.shape[1] not in WIDTHS):
        shape = "x".join(map(str, np.shape(cast("Any", said))))
        what = (
            f"answered with shape {shape}, but a contact has 3 numbers (place), 6 (and force) or 12 (and covariance)."
        )
        raise InputError(what, where=where)
    given = given[np.isfinite(given[:, :3]).all(axis=1)] if given.size else full
    if len(given) > task.most:
        raise InputError(f"answered with {len(given)} contacts, but at most {task.most} are possible.", where=where)
    full = np.full((len(given), WIDTHS[-1]), np.nan)
    full[:, : given.shape[1]] = given
    return full


def users(name: str) -> Entrant:
    """Return the `Entrant` of a user's function, `module:function`.

    The current folder is searched first for the module.

    Raises:
        InputError: there is no such module or function, or it cannot be imported; from `enter`: the function
            raises, or its answer is no contact.
    """
    module, _, function = name.partition(":")
    where = f"--estimator {name}"
    if not module or not function or not all(part.isidentifier() for part in (*module.split("."), function)):
        raise InputError(
            "is not of the form module:function.", where=where, hint="Write, for example, --estimator mine:locate."
        )
    sys.path.insert(0, str(Path.cwd()))
    try:
        found = getattr(import_module(module), function, None)
    except ModuleNotFoundError as problem:
        if problem.name != module:
            raise InputError(f"cannot be imported: {problem}.", where=where) from problem
        raise InputError(
            f"the module {module!r} is neither in the current folder nor installed.", where=where
        ) from problem
    except Exception as problem:
        raise InputError(f"cannot be imported: {_said(problem)}.", where=where) from problem
    finally:
        sys.path.pop(0)
    if not callable(found):
        raise InputError(f"the module has no function {function!r}.", where=where)
    return live_entrant(_guarded(cast("Prepare", found), name), name)


def _guarded(prepare: Prepare, name: str) -> Prepare:
    """Wrap a user's function so that its errors become one sentence with the line in the user's file."""

    def guarded(task: Task) -> Callable[[np.ndarray], Any] | None:
        def called(function: Callable[[Any], Any], given: Any) -> Any:
            try:
                return function(given)
            except Exception as problem:
                raise InputError(f"raised {_said(problem)}.", where=f"{name}, task {task.name}") from problem

        answer = called(prepare, task)
        if answer is not None and not callable(answer):
            what = "must return a function that answers readings, or None"
            raise InputError(f"{what}, not {type(answer).__name__}.", where=f"{name}, task {task.name}")
        return None if answer is None else lambda reading: called(answer, reading)

    return guarded


def _said(problem: Exception) -> str:
    last = traceback.extract_tb(problem.__traceback__)[-1]
    return f"{type(problem).__name__} ({problem}) in {Path(last.filename).name}, line {last.lineno}"
