"""Compiled functions that Python calls: wrong arguments are refused with a sentence before machine code sees them."""

from collections.abc import Iterator
from importlib import import_module
from typing import Any

import numpy as np

from claims.row import Row
from palpate.errors import InputError
from palpate.surfaces import _jit
from palpate.surfaces._arguments import Array, Number, Several


def rows(small: bool) -> Iterator[Row]:
    """Every entry with wrong arguments, 20 each (200)."""
    count = 20 if small else 200
    entries, sentences, others = refused(count)
    what = f"{entries} compiled functions with {count} wrong arguments each: type, shape, layout, number of arguments"
    got = f"{sentences:,} sentences, {len(others)} others{': ' + '; '.join(others[:3]) if others else ''}"
    yield Row(what, "a sentence each; no answer, no crash", got, not others)


def refused(count: int, seed: int = 0) -> tuple[int, int, list[str]]:
    """Return how many entries there are, how many calls ended in a sentence, and what happened to the others."""
    for file in _jit.kernel_files():
        import_module(".".join(file.relative_to(_jit.PACKAGE.parent).with_suffix("").parts))
    random, sentences, others = np.random.default_rng(seed), 0, list[str]()
    for entry in _jit.ENTRIES.values():
        for _ in range(count):
            given = _mistaken(random, entry.ways[random.integers(len(entry.ways))])
            try:
                entry(*given)
            except InputError as problem:
                known = entry.py_func.__name__ in str(problem)
                sentences += known
                others += [] if known else [f"{entry.name}: {problem}"]
            except Exception as problem:
                others.append(f"{entry.name}: {type(problem).__name__}: {problem}")
            else:
                others.append(f"{entry.name}: an answer")
    return len(_jit.ENTRIES), sentences, others


def _mistaken(random: np.random.Generator, arguments: tuple[Any, ...]) -> tuple[Any, ...]:
    sizes = {letter: int(random.integers(2, 9)) for letter in "abcdefghijklmnopqrstuvwxyz"}
    given = [_right(argument, sizes) for argument in arguments]
    if random.integers(12) == 0:  # one too few, or one too many
        return tuple(given[:-1] if random.integers(2) else [*given, 0.0])
    spread = [place for place, argument in enumerate(arguments) if not isinstance(argument, Several)]
    place = int(random.choice(spread))
    given[place] = _wrong(random, arguments, place, given[place])
    return tuple(given)


def _right(argument: Any, sizes: dict[str, int]) -> Any:
    if isinstance(argument, Several):
        return tuple(_right(part, sizes) for part in argument.parts)
    if isinstance(argument, Number):
        return {"float": 0.5, "int": 1, "bool": True}[argument.kind]
    if isinstance(argument, Array):
        lengths = [size.times * sizes.get(size.name, 0) + size.more for size in argument.shape]
        return np.zeros(lengths, argument.dtype)
    return _equation  # a compiled function: any other is refused


def _equation() -> None:
    """Stand for a compiled function, which it is not."""


def _wrong(random: np.random.Generator, arguments: tuple[Any, ...], place: int, right: Any) -> Any:
    argument = arguments[place]
    common = [None, "text", [1.0, 2.0], {}, b"bytes", object()]
    if isinstance(argument, Number):
        numbers = {"float": [1, True, np.float32(1.0)], "int": [1.0, True, np.float64(1)], "bool": [1, 0.0]}
        return random.choice(np.array([*common, *numbers[argument.kind], np.zeros(1)], dtype=object))
    if not isinstance(argument, Array):
        return right
    others = [right.tolist(), right.astype(np.complex128), right[None], right.astype(object), right.astype(">f8")]
    other = np.float32 if right.dtype == np.float64 else np.float64
    others += [right.astype(other), right.astype(np.int16), right.view(np.recarray)]
    known = [axis for axis, size in enumerate(argument.shape) if not size.name]
    others += [np.zeros([n + 1 + (k == axis) for k, n in enumerate(right.shape)], right.dtype) for axis in known]
    if right.size > 1 and not argument.strided:
        others.append(np.zeros((*right.shape[:-1], 2 * right.shape[-1]), right.dtype)[..., ::2])
    if argument.written:
        locked = right.copy()
        locked.flags.writeable = False
        others.append(locked)
    return [*common, *others][int(random.integers(len(common) + len(others)))]
