"""What an object remembers: all that two objects differ in, to the last bit, wherever it lies."""

import re
import types
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Executor, Future
from enum import Enum
from pathlib import PurePath
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher

from palpate.contact.live_loop import LiveLoop
from palpate.surfaces._jit import FixedEntry, Kernel

_PLAIN = (str, bytes, int, float, complex, bool, type(None), Enum, np.generic, PurePath, range, slice)
_FIXED = (type, types.FunctionType, types.MethodType, types.BuiltinFunctionType, types.ModuleType, Executor, Future)
_FIXED += (FixedEntry, Kernel, Dispatcher, LiveLoop)  # its arrays are those of others, where they are seen

FOLLOW = ("FusedLocator.", "Cylinder.")  # from settings alone, as do
CACHES = (  # and what numbers of earlier blocks mean, and inputs that are all written
    *(f"Compensation.{name}" for name in ("_means", "_placement", "_constant", "_vibration", "revision")),
    *("LoadCellArray._placement", "LoadCellArray._turned", "LoadCellArray.revision"),
    *("Vibration.covariances", "Vibration._first", "Compensation.live_inputs", "LoadCellArray.live_inputs"),
)
ROOM = (  # to work in: what it holds is not read before it is written, or it would be noticed when it is spoilt
    *("TaxelFrames._unfiltered", "TaxelEstimator._one", "FusedEstimator._rows", "RingEstimator._scratch"),
    *("MarkerTracker._out", "MarkerTracker._sample", "MotionBank._rate", "MotionBank._value"),
    *(f"AlignController.{name}" for name in ("_feedback", "_felt", "_foremost", "_motion", "_moved", "_spent")),
    *("AlignController._stance", "AlignController._upright"),
    *(f"Follow.{name}" for name in ("_axes", "_origin", "_readings", "_right", "_sums", "_variances")),
    *(f"Sensed.{name}" for name in ("force", "place", "rotation", "time", "tip", "variance")),
    *(f"ServoModel.{name}" for name in ("_gain", "_sent", "_slopes", "_targets", "_trial")),
)
IN_BLOCKS = "DriftTracker._parts", "DriftTracker._times", "LoadCellArray._held", "LoadCellArray._kept"  # as they came
IN_BLOCKS += "LoadCellArray._seen", "TaxelEstimator._samples", "TaxelWatch."  # and what a skin knows of whole frames


def _fields(value: Any) -> dict[str, Any]:
    """What an object has, by name: attributes, slots, items, or the state of a generator of random numbers."""
    if isinstance(value, np.random.Generator):
        return dict(value.bit_generator.state)
    if isinstance(value, Mapping):
        return {f"[{key!r}]": each for key, each in value.items()} | {"order": list(map(repr, value))}
    if isinstance(value, Iterable) and not hasattr(value, "__dict__") and not isinstance(value, Iterator):
        return {"length": len(items := list(value))} | {f"[{k}]": each for k, each in enumerate(items)}
    slots = [name for kind in type(value).__mro__ for name in getattr(kind, "__slots__", ())]
    return {name: getattr(value, name) for name in slots if hasattr(value, name)} | getattr(value, "__dict__", {})


def differences(one: Any, two: Any, at: str = "") -> Iterator[str]:
    """Yield where one object differs from another of its class, such as "Forward._clock"."""
    yield from _differences(one, two, at or type(one).__name__, set())


def _differences(one: Any, two: Any, at: str, seen: set[tuple[int, int]]) -> Iterator[str]:
    if one is two or isinstance(one, _FIXED) or (id(one), id(two)) in seen:
        return
    if type(one) is not type(two):
        yield at
    elif isinstance(one, np.ndarray):
        seen.add((id(one), id(two)))
        if one.dtype != two.dtype or one.shape != two.shape or one.tobytes() != two.tobytes():
            yield at
    elif isinstance(one, _PLAIN):
        if repr(one) != repr(two):
            yield at
    else:
        seen.add((id(one), id(two)))  # both live on: as long as this runs, no other object has their ids
        first, second = _fields(one), _fields(two)
        owner = f"{type(one).__name__}." if hasattr(one, "__dict__") else at
        for name in first.keys() | second.keys():
            if name in first and name in second:
                yield from _differences(first[name], second[name], f"{owner}{name}", seen)
            else:
                yield f"{owner}{name}"


def remembered(one: Any, two: Any, *but: str) -> list[str]:
    """Where one object differs from another, but for caches, room to work in, and what begins so."""
    found = {re.sub(r"(?<=\w)(\[|order|length).*", "", each) for each in differences(one, two)}
    return sorted(each for each in found if each not in (*CACHES, *ROOM) and not each.startswith((*FOLLOW, *but)))


def parts(value: Any, seen: set[int] | None = None) -> Iterator[Any]:
    """Yield an object, and every object of palpate that it has, each once."""
    seen = set() if seen is None else seen
    if isinstance(value, (*_PLAIN, *_FIXED, np.ndarray)) or id(value) in seen:
        return
    seen.add(id(value))
    if type(value).__module__.startswith("palpate."):
        yield value
    for each in _fields(value).values():
        yield from parts(each, seen)
