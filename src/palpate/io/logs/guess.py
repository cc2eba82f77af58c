"""Which columns of a log are the force, the torque, the time: a guess from their names."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from palpate.io.logs.layout import ORIENTATION_COLUMNS, POSITION_COLUMNS, WRENCH_COLUMNS

__all__ = ["guess_orientation", "guess_position", "guess_time", "guess_wrench"]

_FORCE = re.compile(r"^(?P<head>.*?)(?:force|f)[\W_]*(?P<axis>[xyz])(?P<tail>(?:[^a-z].*)?)$", re.IGNORECASE)
_TORQUE = re.compile(
    r"^(?P<head>.*?)(?:torque|moment|tau|t|m)[\W_]*(?P<axis>[xyz])(?P<tail>(?:[^a-z].*)?)$", re.IGNORECASE
)
_QUATERNION = re.compile(
    r"^(?P<head>.*?)(?:orientation|rotation|quaternion|quat|rot|q)[\W_]*(?P<axis>[xyzw])(?P<tail>(?:[^a-z].*)?)$",
    re.IGNORECASE,
)
_POSITION = re.compile(
    r"^(?P<head>.*?)(?:position|translation|pos|p)[\W_]*(?P<axis>[xyz])(?P<tail>(?:[^a-z].*)?)$", re.IGNORECASE
)
_TIME = ("time", "timestamp", "t", "stamp", "time_s", "seconds", "sec", "s")


def guess_wrench(names: Sequence[str]) -> tuple[str, ...] | None:
    """Six columns, force first, of the first sensor that has all six; None where there is none."""
    if set(WRENCH_COLUMNS) <= set(names):
        return WRENCH_COLUMNS
    forces, torques = _groups(names, _FORCE, "xyz"), _groups(names, _TORQUE, "xyz")
    for head, force in forces.items():
        if head in torques:
            return (*force, *torques[head])
    return None


def guess_time(names: Sequence[str]) -> str | None:
    """The column of the time, None where no name says so."""
    lower = {name.lower(): name for name in reversed(names)}
    for usual in _TIME:
        if usual in lower:
            return lower[usual]
    return next((name for name in names if "time" in name.lower() or "stamp" in name.lower()), None)


def guess_orientation(names: Sequence[str]) -> tuple[str, ...] | None:
    """Four columns x, y, z, w of a quaternion."""
    if set(ORIENTATION_COLUMNS) <= set(names):
        return ORIENTATION_COLUMNS
    return next(iter(_groups(names, _QUATERNION, "xyzw").values()), None)


def guess_position(names: Sequence[str]) -> tuple[str, ...] | None:
    """Three columns of a position."""
    if set(POSITION_COLUMNS) <= set(names):
        return POSITION_COLUMNS
    return next(iter(_groups(names, _POSITION, "xyz").values()), None)


def _groups(names: Iterable[str], pattern: re.Pattern[str], axes: str) -> dict[str, tuple[str, ...]]:
    """What comes before the word -> its columns in the order of the axes, where all axes are there."""
    found: dict[str, dict[str, str]] = {}
    for name in names:
        if match := pattern.match(name):
            found.setdefault(match["head"].lower(), {}).setdefault(match["axis"].lower(), name)
    return {head: tuple(group[axis] for axis in axes) for head, group in found.items() if set(axes) <= set(group)}
