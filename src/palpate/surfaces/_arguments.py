"""Types and shapes of a compiled function's arguments, and their check."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from palpate.errors import InputError

__all__ = ["Argument", "Array", "Function", "Number", "Several", "forms", "require"]

_ARRAY = re.compile(r"(?P<out>out )?(?P<strided>strided )?(?P<dtype>(?:bool|u?int\d+|float\d+) )?(?P<sizes>[^ ].*)")
_SIZE = re.compile(r"(?P<times>\d+)?(?P<name>[a-z])(?:\+(?P<more>\d+))?(?:\|(?P<other>\d+))?")
_NUMBERS = {"float": float, "int": (int, np.integer), "bool": (bool, np.bool_)}  # np.float64 is a float


@dataclass(frozen=True)
class Number:
    """A number: "float", "int" or "bool"."""

    kind: str

    def fits(self, value: Any, sizes: dict[str, int]) -> bool:
        """Return whether a value is one."""
        return isinstance(value, _NUMBERS[self.kind]) and (self.kind == "bool" or not isinstance(value, bool))

    def __str__(self) -> str:
        return f"a number of type {self.kind}"


@dataclass(frozen=True)
class Size:
    """The length of an axis: `times * name + more`, or `other`; without a name it is `more`.

    The first array that has a name in its shape fixes the value of the name.
    """

    times: int = 1
    name: str = ""
    more: int = 0
    other: int | None = None

    def fits(self, length: int, sizes: dict[str, int]) -> bool:
        """Return whether an axis has this length; note the value of its name."""
        if not self.name:
            return length == self.more
        if length == self.other and self.name in sizes:
            return True
        count, rest = divmod(length - self.more, self.times)
        return rest == 0 and count == sizes.setdefault(self.name, count)

    def __str__(self) -> str:
        many = f"{self.times if self.times > 1 else ''}{self.name}{f'+{self.more}' if self.name and self.more else ''}"
        return f"{many or self.more}{'' if self.other is None else f' or {self.other}'}"


@dataclass(frozen=True)
class Array:
    """An array of one type; `written`: the function writes into it, `strided`: it need not be contiguous."""

    dtype: np.dtype[Any]
    shape: tuple[Size, ...]
    written: bool
    strided: bool

    def fits(self, value: Any, sizes: dict[str, int]) -> bool:
        """Return whether a value is such an array, given the sizes known so far."""
        if type(value) is not np.ndarray or value.dtype != self.dtype or value.ndim != len(self.shape):
            return False
        flags = value.flags
        if not (flags.aligned and (flags.writeable or not self.written) and (flags.c_contiguous or self.strided)):
            return False
        return all(size.fits(length, sizes) for size, length in zip(self.shape, value.shape, strict=True))

    def __str__(self) -> str:
        shape = ", ".join(map(str, self.shape)) + ("," if len(self.shape) == 1 else "")
        kind = ", ".join(["writable"] * self.written + ["contiguous"] * (not self.strided) or ["aligned"])
        return f"a {kind} array of {self.dtype} and shape ({shape})"


@dataclass(frozen=True)
class Several:
    """A tuple of arguments."""

    parts: tuple[Any, ...]

    def fits(self, value: Any, sizes: dict[str, int]) -> bool:
        """Return whether a value is a tuple of the right length whose parts all fit."""
        if type(value) is not tuple or len(cast("tuple[Any, ...]", value)) != len(self.parts):
            return False
        given = cast("tuple[Any, ...]", value)
        return all(part.fits(one, sizes) for part, one in zip(self.parts, given, strict=True))

    def __str__(self) -> str:
        return f"a tuple of {'; '.join(map(str, self.parts))}"


@dataclass(frozen=True)
class Function:
    """A compiled function of a point (3,) that writes into (10,): the equation of a user's surface."""

    def fits(self, value: Any, sizes: dict[str, int]) -> bool:
        """Return whether a value is one."""
        return type(value).__module__ == "numba.core.ccallback"

    def __str__(self) -> str:
        return "a compiled function"


Argument = Number | Array | Several | Function


def forms(stated: str, parameters: Sequence[str]) -> tuple[tuple[Argument, ...], ...]:
    """Return the arguments of each way in which a function can be called, from the text in its decorator.

    Arguments are separated by commas, each a name and its form. A number is "float", "int" or "bool". An array is
    "[out] [strided] [type] sizes": `out` if the function writes into it, `strided` if it need not be contiguous,
    float64 unless a type is named, and a size for each axis: a number, a letter (the same wherever it stands), or
    "20n", "n+1", "n|1" (n or 1). A tuple is in parentheses, "13*float" is one of 13 numbers. Alternative forms of an
    argument, one for each way, are separated by " | ".
    """
    arguments = [argument.partition(" ")[::2] for argument in _parted(" ".join(stated.split()))]
    if [name for name, _ in arguments] != list(parameters):
        raise TypeError(f"{[name for name, _ in arguments]} are stated for a function of {parameters}")
    ways = [form.split(" | ") if not form.startswith("(") else [form] for _, form in arguments]
    most = max(map(len, ways))
    return tuple(tuple(_argument(way[k % len(way)]) for way in ways) for k in range(most))


def _parted(text: str) -> list[str]:
    """Split at commas outside parentheses."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter == "(") - (letter == ")")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


def _argument(form: str) -> Argument:
    if form.startswith("("):
        return Several(tuple(map(_argument, _parted(form[1:-1]))))
    count, _, kind = form.rpartition("*")
    if kind in _NUMBERS:
        return Several((Number(kind),) * int(count)) if count else Number(kind)
    if form == "function":
        return Function()
    found = _ARRAY.fullmatch(form)
    if found is None:
        raise TypeError(f"no argument: {form!r}")
    shape = tuple(map(_size, found["sizes"].split(" ")))
    dtype = np.dtype((found["dtype"] or "float64").strip())
    return Array(dtype, shape, bool(found["out"]), bool(found["strided"]))


def _size(text: str) -> Size:
    if text.isdecimal():
        return Size(more=int(text))
    found = _SIZE.fullmatch(text)
    if found is None:
        raise TypeError(f"no size of an array: {text!r}")
    other = None if found["other"] is None else int(found["other"])
    return Size(int(found["times"] or 1), found["name"], int(found["more"] or 0), other)


def require(function: Callable[..., Any], ways: tuple[tuple[Argument, ...], ...], given: tuple[Any, ...]) -> int:
    """Return the index of the first way of calling a compiled function that the arguments fit.

    Raises:
        InputError: none fits; compiled code would read or write memory outside the arrays.
    """
    for way, arguments in enumerate(ways):
        if len(given) == len(arguments) and next(_wrong(arguments, given), None) is None:
            return way
    name, names = function.__name__, function.__code__.co_varnames
    if len(given) != len(ways[0]):
        raise InputError(f"{name} takes {len(ways[0])} arguments, not {len(given)}.")
    which, argument = max((next(_wrong(arguments, given)) for arguments in ways), key=lambda wrong: wrong[0])
    raise InputError(f"{names[which]} of {name} must be {argument}, not {_seen(given[which])}.")


def _wrong(arguments: tuple[Argument, ...], given: tuple[Any, ...]) -> Iterator[tuple[int, Argument]]:
    """Yield the arguments that do not fit, with their places."""
    sizes: dict[str, int] = {}
    for place, (argument, value) in enumerate(zip(arguments, given, strict=True)):
        if not argument.fits(value, sizes):
            yield place, argument


def _seen(value: Any) -> str:
    if isinstance(value, np.ndarray):
        order = "" if value.flags.c_contiguous else ", not contiguous"
        order += "" if value.flags.aligned else ", not aligned"
        return f"{value.dtype} of shape {value.shape}{order}{'' if value.flags.writeable else ', read-only'}"
    if isinstance(value, tuple):
        return f"({'; '.join(map(_seen, cast('tuple[Any, ...]', value)))})"
    return type(value).__name__
