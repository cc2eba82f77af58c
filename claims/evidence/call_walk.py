"""Calls of every public callable with wrong arguments, and with right ones in other containers, in one process.

`python -m claims.evidence.call_walk COUNT SEED FIRST FOLDER` prints a line of JSON for each call, before it is made and
after, so that whoever started it knows which call ended the process.
"""

import copy
import dataclasses
import importlib
import inspect
import json
import pkgutil
import re
import signal
import sys
import time
import tomllib
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial, wraps
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import polars as pl

from claims.evidence.call_values import Seen
from palpate.errors import PalpateError

_NAMES = tomllib.loads(Path(__file__).with_name("call_names.toml").read_text(encoding="utf-8"))
UNCALLED = {name for names in _NAMES["uncalled"].values() for name in names}  # a class stands for its methods
LATER = set(_NAMES["later"]["names"])  # are reached only in full
ROOMS = (
    *(f"palpate.{room}" for room in ("spatial", "surfaces", "signals", "optical", "contact", "control", "evaluation")),
    *(f"palpate.{room}" for room in ("files", "viewer", "calibration", "setup", "sensors", "live")),
    *(f"palpate_lab.{room}" for room in ("benchmark", "papers", "peers", "viewer")),
)
ARRAYS = re.compile(r"\b(ArrayLike|ndarray|Vector|Image)\b")
# written into: a copy in another container would be of no use
WRITTEN = {"out", "out_covariance", "out_total", "counts", "rows", "memory", "state"}
LARGEST = 2_000_000  # bytes in the arguments of a call that is kept
SLOW = 0.5  # s: a callable that takes longer gets a few calls only
FEW = 4
LONGEST = 60  # s: a call that takes longer is killed, which is as bad as a crash
FEWEST = 2000  # calls, up to which those that annotations alone make are enough


@dataclasses.dataclass(frozen=True)
class Known:
    """A public callable: the name by which it is called, what is called, and the class that it is a method of."""

    name: str
    made: Callable[..., Any]
    owner: type | None = None
    attribute: str = ""

    @property
    def short(self) -> str:
        return self.name.removeprefix("palpate.")

    @property
    def called(self) -> Any:
        made = self.owner if self.attribute == "__init__" else self.made
        return getattr(made, "unwatched", made)

    def signature(self) -> inspect.Signature:
        return inspect.signature(self.called)


@dataclasses.dataclass
class Call:
    """One valid call of a callable, as it was made."""

    known: Known
    bound: inspect.BoundArguments
    seconds: float

    def arguments(self) -> dict[str, Any]:
        return {name: _copied(value) for name, value in self.bound.arguments.items()}

    def changeable(self) -> list[str]:
        kinds = self.bound.signature.parameters
        single = [name for name in self.bound.arguments if kinds[name].kind not in (2, 4)]  # no *args, no **kwargs
        return [name for name in single if name != "self" and _is_numbers(self.bound.arguments[name])]


def public(rooms: Iterable[str] = ROOMS) -> Iterator[Known]:
    """Every public function, class and method of some rooms, once."""
    seen = set[int]()
    for room in rooms:
        package = importlib.import_module(room)
        names = [room, *(each.name for each in pkgutil.walk_packages(package.__path__, f"{room}."))]
        for module in (importlib.import_module(name) for name in names if "._" not in name):
            for name in module.__all__ if hasattr(module, "__all__") else _defined(module):
                made = getattr(module, name)
                own = str(getattr(made, "__module__", "")).startswith("palpate")
                if callable(made) and own and id(made) not in seen:
                    seen.add(id(made))
                    yield from _with_methods(f"{made.__module__}.{name}", made)


def _defined(module: ModuleType) -> list[str]:
    """The names without an underscore of the functions and classes that a module defines."""
    own = (name for name, made in vars(module).items() if getattr(made, "__module__", "") == module.__name__)
    return [name for name in own if not name.startswith("_")]


def _with_methods(name: str, made: Any) -> Iterator[Known]:
    if not inspect.isclass(made):
        yield Known(name, made)
        return
    abstract = getattr(made, "_is_protocol", False)
    if not abstract:
        yield Known(name, made, made, "__init__")
    for attribute, value in vars(made).items():
        plain = value.__func__ if isinstance(value, classmethod | staticmethod) else value
        stated = abstract and not plain.__code__.co_names if inspect.isfunction(plain) else True  # a body of dots
        if not stated and (attribute == "__call__" or not attribute.startswith("_")):
            yield Known(f"{name}.{attribute}", plain, made, attribute)


def watch(known: Iterable[Known], seen: Seen) -> dict[str, Call]:
    """The first valid call of each, filled as they are made from now on, wherever that is; and what they were given."""
    calls, functions = dict[str, Call](), dict[int, Callable[..., Any]]()
    for each in known:
        if each.owner is None:
            functions[id(each.made)] = _watched(each, each.made, calls, seen)
        elif each.attribute == "__init__":
            if "__init__" in vars(each.owner):
                each.owner.__init__ = _watched(each, each.owner.__init__, calls, seen)
        else:
            value = vars(each.owner)[each.attribute]
            made = _watched(each, each.made, calls, seen)
            setattr(each.owner, each.attribute, type(value)(made) if not inspect.isfunction(value) else made)
    for module in [module for name, module in sys.modules.items() if name.startswith("palpate")]:
        for key, value in list(vars(module).items()):
            if id(value) in functions:
                setattr(module, key, functions[id(value)])
    return calls


def _watched(known: Known, made: Callable[..., Any], calls: dict[str, Call], seen: Seen) -> Callable[..., Any]:
    @wraps(made)
    def call(*args: Any, **kwargs: Any) -> Any:
        if known.name in calls or _size((args, kwargs)) > LARGEST:
            return made(*args, **kwargs)
        first = args[1:] if known.attribute == "__init__" else args
        kept = [_copied(value) for value in first], {name: _copied(value) for name, value in kwargs.items()}
        begun = time.perf_counter()
        answer = made(*args, **kwargs)
        try:
            bound = known.signature().bind(*kept[0], **kept[1])
        except (TypeError, ValueError):
            return answer
        calls.setdefault(known.name, Call(known, bound, time.perf_counter() - begun))
        seen.call(bound)
        seen.value(answer)
        if known.owner is not None and args:
            seen.value(args[0])
        return answer

    vars(call)["unwatched"] = made
    return call


def _size(value: Any) -> int:
    if isinstance(value, np.ndarray):
        return value.nbytes
    if isinstance(value, tuple | list):
        return sum(map(_size, value))
    return sum(map(_size, value.values())) if isinstance(value, Mapping) else 0


def _copied(value: Any) -> Any:
    """A copy that calls cannot spoil, where there can be one."""
    if isinstance(value, np.ndarray):
        return value.copy() if value.flags.writeable else value
    try:
        return copy.deepcopy(value)
    except Exception:  # a file, a process, a thread
        return value


def _is_numbers(value: Any) -> bool:
    if isinstance(value, np.ndarray):
        return value.dtype.kind in "biuf"
    if isinstance(value, list | tuple):
        return bool(value) and all(isinstance(each, float | int) and not isinstance(each, bool) for each in value)
    return isinstance(value, float | int) and not isinstance(value, bool)


def wrong(value: Any) -> dict[str, Any]:
    """Wrong arguments in place of a valid one, by what is wrong."""
    made: dict[str, Any] = {"a word": "abc", "none": None, "an object": object(), "too large": 10**400}
    if not isinstance(value, np.ndarray | list | tuple):
        numbers = {"nan": np.nan, "inf": np.inf, "negative": -1, "zero": 0, "huge": 1e300}
        return made | numbers | {"a list": [value, value], "complex": 1j}
    array = np.asarray(value)
    made |= {"one axis more": array[None], "an axis behind": array[..., None], "complex": array * 1j, "one number": 1.0}
    made |= {"objects": array.astype(object) if array.size < 1000 else np.array([None]), "words": array.astype(str)}
    made |= {"ragged": [[1.0, 2.0], [3.0]], "empty": array[:0] if array.ndim else np.zeros(0)}
    if array.ndim:
        made |= {"one row less": array[:-1], "a row more": np.concatenate([array, array[-1:]]), "one row": array[:1]}
        made |= {"a column less": array[..., :-1], "flat": array.ravel(), "turned": array.T}
        made |= {"a column more": np.concatenate([array, array[..., -1:]], axis=-1)}
    if array.dtype.kind == "f":
        for name, number in (("nan", np.nan), ("inf", np.inf), ("huge", 1e300)):
            spoilt = np.array(array)
            spoilt.flat[:1] = number
            made |= {f"a {name}": spoilt, f"all {name}": np.full_like(array, number)}
        made["zeros"] = np.zeros_like(array)
    else:
        made |= {"beyond": np.full(array.shape, 2**62), "negative": np.full(array.shape, -1), "halves": array + 0.5}
    return made


class _Own:
    """Of a class that is none of NumPy's, as those of pandas."""

    def __init__(self, array: np.ndarray) -> None:
        self._array = array

    def __array__(self, dtype: Any = None, copy: Any = None) -> np.ndarray:
        return np.array(self._array, dtype=dtype)


def containers(value: np.ndarray) -> dict[str, Callable[[], tuple[Any, np.ndarray]]]:
    """Ways to put the same numbers, each with the float64 (int64, bool) array that it must be as good as."""
    plain = value.astype(np.float64) if value.dtype.kind == "f" else value
    made: dict[str, Callable[[], Any]] = {
        "read-only": lambda: _locked(plain),
        "strided": lambda: np.repeat(plain, 2, axis=-1)[..., ::2] if plain.ndim else plain,
        "by columns": lambda: np.asarray(plain, order="F"),
        "of another class": lambda: _Own(plain),
    }
    if plain.size or plain.ndim == 1:  # a list of nothing has no other axes
        made["a list"] = plain.tolist
    if plain.ndim and "a list" in made:
        made["a tuple"] = lambda: tuple(plain.tolist())
    if plain.ndim in (1, 2) and plain.size:
        name, kind = ("a Series", pl.Series) if plain.ndim == 1 else ("a DataFrame", pl.DataFrame)
        made[name] = lambda: kind(plain)
    found = {name: partial(_as_good, make, plain) for name, make in made.items()}
    if plain.dtype.kind == "f":
        found["float32"] = partial(_as_good, lambda: plain.astype(np.float32))
        if np.isfinite(plain).all() and np.abs(plain).max(initial=0.0) < 1e6:
            found["int"] = partial(_as_good, lambda: np.round(plain).astype(np.int64))
    return found


def _as_good(make: Callable[[], Any], plain: np.ndarray | None = None) -> tuple[Any, np.ndarray]:
    with np.errstate(all="ignore"):
        made = make()
    return made, made.astype(np.float64) if plain is None else plain


def _locked(array: np.ndarray) -> np.ndarray:
    made = array.copy()
    made.flags.writeable = False
    return made


def answer(call: Call, changed: Mapping[str, Any]) -> tuple[str, Any]:
    """How it ended, "answered", "refused" or the name of a raw error; with the answer, or what was said."""
    known, arguments = call.known, call.arguments() | dict(changed)
    given = inspect.BoundArguments(call.bound.signature, {name: arguments[name] for name in call.bound.arguments})
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            signal.alarm(LONGEST)
            found = known.called(*given.args, **given.kwargs)
            if isinstance(found, Iterator):
                found = [each for each, _ in zip(found, range(3), strict=False)]
    except PalpateError as problem:
        return "refused", str(problem)
    except Exception as problem:
        where = _where(problem)
        return type(problem).__name__, f"{where}: {str(problem)[:160]}"
    finally:
        signal.alarm(0)
    return "answered", found if found is not None else arguments.get("self")


def _where(problem: BaseException) -> str:
    place, step = "", problem.__traceback__
    while step is not None:
        file = step.tb_frame.f_code.co_filename
        place = f"{file.split('/palpate/')[-1]}:{step.tb_lineno}" if "/palpate/" in file else place
        step = step.tb_next
    return place


def same(one: Any, other: Any, depth: int = 0) -> bool:
    """Whether two answers have the same bits, as far as they are made of arrays, numbers and values."""
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        if one.dtype.kind == "O":
            return one.shape == other.shape
        return one.shape == other.shape and np.array_equal(one, other, {one.dtype.kind, other.dtype.kind} == {"f"})
    if type(one) is not type(other):
        return False
    if isinstance(one, float):
        return one == other or (one != one and other != other)
    if isinstance(one, int | str | bool | None):
        return one == other
    if depth > 4:
        return True
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(same(a, b, depth + 1) for a, b in zip(one, other, strict=True))
    if isinstance(one, Mapping):
        return one.keys() == other.keys() and all(same(one[key], other[key], depth + 1) for key in one)
    if dataclasses.is_dataclass(one):
        return all(same(value, getattr(other, name, None), depth + 1) for name, value in vars(one).items())
    return True


def _tried(
    calls: list[Call], count: int, rng: np.random.Generator
) -> Iterator[tuple[Call, str, str, str, dict[str, Any]]]:
    """So many calls, spread over all callables: kind, argument, what it is, and the argument itself."""
    offers = list[list[tuple[Call, str, str, str]]]()
    for call in calls:
        each = list[tuple[Call, str, str, str]]()
        for name in call.changeable():
            value = call.bound.arguments[name]
            each += [(call, "wrong", name, what) for what in wrong(value)]
            if isinstance(value, np.ndarray) and name not in WRITTEN:
                each += [(call, "container", name, what) for what in containers(value)]
        order = rng.permutation(len(each))
        offers.append([each[k] for k in order][: FEW if call.seconds > SLOW else None])
    left = count
    while left > 0 and any(offers):
        for offer in offers:
            if offer and left > 0:
                call, kind, name, what = offer.pop()
                value = call.bound.arguments[name]
                given = wrong(value)[what] if kind == "wrong" else containers(value)[what]()
                yield call, kind, name, what, {name: given}
                left -= 1


def main(count: int, seed: int, first: int, folder: Path) -> None:
    """Make the calls from `first` on."""
    out, sys.stdout = sys.stdout, sys.stderr  # what a call prints is no line of this
    from claims.evidence.call_scenes import made_calls

    known, small = [each for each in public(ROOMS) if takes_numbers(each)], count < FEWEST
    left = uncalled(each.short for each in known) | (LATER if small else set())
    calls = made_calls([each for each in known if each.short not in left], folder, small=small)
    names = [each.name for each in known]
    missing = [name for name in names if name not in calls]
    print(json.dumps({"callables": names, "missing": missing}), flush=True, file=out)
    listed = [calls[name] for name in sorted(calls)]
    for number, (call, kind, name, what, given) in enumerate(_tried(listed, count, np.random.default_rng(seed))):
        if number < first:
            continue
        row = {"number": number, "call": call.known.name, "kind": kind, "argument": name, "what": what}
        print(json.dumps(row), flush=True, file=out)
        if kind == "wrong":
            how, said = answer(call, given)
            said = said if how not in ("answered", "refused") else ""
            print(json.dumps({"how": how, "said": said}), flush=True, file=out)
            continue
        other, plain = given[name]
        due, found = answer(call, {name: plain}), answer(call, {name: other})
        agrees = due[0] == found[0] and (due[0] != "answered" or same(due[1], found[1]))
        said = "" if agrees else f"{due[0]} {str(due[1])[:80]} / {found[0]} {str(found[1])[:160]}"
        raw = found[0] if found[0] not in ("answered", "refused") else ""
        print(json.dumps({"how": "same" if agrees else raw or "differs", "said": said}), flush=True, file=out)


def uncalled(names: Iterable[str]) -> set[str]:
    """Return those of the names that are listed in `UNCALLED`, by themselves or by their class."""
    return {name for name in names if name in UNCALLED or name.rpartition(".")[0] in UNCALLED}


def takes_numbers(known: Known) -> bool:
    return any(ARRAYS.search(str(each.annotation)) for each in known.signature().parameters.values())


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]))
