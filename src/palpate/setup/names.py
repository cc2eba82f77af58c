"""Find the columns of a log (wrench, time, pose, ...) by their names; units in the names do not matter."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from palpate.files.logs.layout import ACCELERATION_COLUMNS, ORIENTATION_COLUMNS, POSITION_COLUMNS, WRENCH_COLUMNS
from palpate.files.units import TIME_UNITS, known_unit, split_unit


def _axes(words: str, axes: str = "[xyz]") -> re.Pattern[str]:
    return re.compile(rf"^(?P<head>.*?)(?:{words})[\W_]*(?P<axis>{axes})(?P<tail>(?:[^a-z].*)?)$", re.IGNORECASE)


def _axes_first(words: str) -> re.Pattern[str]:
    return re.compile(rf"^(?P<head>(?:.*[\W_])?)(?P<axis>[xyz])[\W_]*(?:{words})(?P<tail>\W*)$", re.IGNORECASE)


_FORCE = (_axes("force|kraft|f"), _axes_first("force|kraft"), _axes("force", "[0-3]"))
_TORQUE = (
    _axes("torque|drehmoment|moment|tau|t|m"),
    _axes_first("torque|drehmoment|moment"),
    _axes("torque|moment", "[0-3]"),
)
_SIX = re.compile(
    r"^(?P<head>.*?(?:wrench|f_ext_hat_k|force_torque|tcp_force|fActualETT|fts?)(?:_?data|_?raw)?)[\W_]*(?P<axis>\d)\W*$",
    re.I,
)
_QUATERNION = (_axes("orientation|rotation|quaternion|quat|rot|q", "[xyzw]"),)
_POSITION = (_axes("position|translation|pose|pos|p"),)
_ACCELERATION = (_axes("linear[\\W_]*acceleration|acceleration|accel|acc|beschleunigung|(?<![a-z])a"),)
_TIME = (
    *("time", "timestamp", "t", "stamp", "time_s", "seconds", "sec", "s", "zeit", "x_value", "duration"),
    *("elapsed", "millis", "ms", "micros", "us"),
)
_DERIVED = re.compile(  # words of wrenches that were not measured: these come last
    r"(?:^|[\W_])(?:desired|des|command\w*|cmd|target|set_?point|ref|reference|bias|offset|std|sigma|error|noise)(?=[\W_]|$)",
    re.IGNORECASE,
)
_BASED = re.compile(
    "O_F_ext_hat_K|actual_TCP_force|external_tcp_force|fActualETT", re.IGNORECASE
)  # along the axes of a base
_COUNTER = re.compile(
    r"^(?:.*[\W_])?(?:samples?|seq|sequence|index|idx|counter|count|frame|packet|no|nr|n|#)\.?$", re.I
)
_NAMELESS = 19  # columns without names: three wrenches and a time; more are frames of a skin
_PARTS = re.compile(r"^(?P<head>.*?)(?P<part>secs?|seconds?|nsecs?|nanosecs?|nanoseconds?)$", re.IGNORECASE)


def wrenches(names: Sequence[str]) -> list[tuple[str, ...]]:
    """Return a list of wrenches, six columns each, force first; measured ones, and those in no base, come first."""
    found: list[tuple[str, ...]] = []
    if set(WRENCH_COLUMNS) <= set(names):
        found.append(WRENCH_COLUMNS)
    for tails in (True, False):  # Fx_left, Fx_right; but also Fx 1, Fy 2, and units that are not known
        forces, torques = _groups(names, _FORCE, "xyz", tails=tails), _groups(names, _TORQUE, "xyz", tails=tails)
        pairs = [(*force, *torques[head]) for head, force in forces.items() if head in torques]
        if pairs:
            found += pairs
            break
    found += _groups(names, (_SIX,), "012345").values()
    if made_up(names) and len(names) % 6 < 2 and len(names) <= _NAMELESS:
        first = len(names) % 6
        found += [tuple(names[k : k + 6]) for k in range(first, len(names), 6)]
    return sorted(dict.fromkeys(found), key=lambda six: (bool(_BASED.search(six[0])), bool(_DERIVED.search(six[0]))))


def wrench_columns(names: Sequence[str]) -> tuple[str, ...] | None:
    """Return the names of the six columns, force first, of the first complete wrench, or None if there is none."""
    return next(iter(wrenches(names)), None)


def time_column(names: Sequence[str]) -> str | None:
    """Return the name of the time column; None if no name looks like one, except those of split seconds."""
    split = split_stamp(names)
    whole = [name for name in names if name not in split]
    lower: dict[str, str] = {}
    for name in reversed(whole):
        bare, unit = split_unit(name)
        if not unit or len(bare) > 1 or known_unit(unit, TIME_UNITS):  # T [degC] is a temperature
            lower |= {bare.lower(): name, name.lower(): name}
    for usual in _TIME:
        if usual in lower:
            return lower[usual]
    return next((name for name in whole if any(word in name.lower() for word in ("time", "stamp", "zeit"))), None)


def split_stamp(names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the two columns of one stamp, seconds and nanoseconds, or () if there are none."""
    parts = [
        (match["head"].lower(), match["part"].lower()[0] == "n", name)
        for name in names
        if (match := _PARTS.match(name))
    ]
    for head, nano, name in parts:
        for other, more, beside in parts:
            if head == other and not nano and more:
                return name, beside
    return ()


def counter_column(names: Sequence[str]) -> str | None:
    """Return the name of the first column that by its name counts the samples, or None."""
    return next((name for name in names if _COUNTER.match(split_unit(name)[0])), None)


def orientation_columns(names: Sequence[str]) -> tuple[str, ...] | None:
    """Return the names of the four columns of a quaternion x, y, z, w, or None."""
    if set(ORIENTATION_COLUMNS) <= set(names):
        return ORIENTATION_COLUMNS
    return next(iter(_groups(names, _QUATERNION, "xyzw").values()), None)


def position_columns(names: Sequence[str]) -> tuple[str, ...] | None:
    """Return the names of the three columns of a position x, y, z, or None."""
    if set(POSITION_COLUMNS) <= set(names):
        return POSITION_COLUMNS
    return next(iter(_groups(names, _POSITION, "xyz").values()), None)


def acceleration_columns(names: Sequence[str]) -> tuple[str, ...] | None:
    """Return the names of the three columns of an acceleration x, y, z, or None."""
    if set(ACCELERATION_COLUMNS) <= set(names):
        return ACCELERATION_COLUMNS
    return next(iter(_groups(names, _ACCELERATION, "xyz").values()), None)


def made_up(names: Iterable[str]) -> bool:
    """Return whether there are names, and all are made up (column_1, ...), because the file has none."""
    return bool(there := list(names)) and all(re.fullmatch(r"column_\d+", name) for name in there)


def _groups(
    names: Iterable[str], patterns: Sequence[re.Pattern[str]], axes: str, *, tails: bool = False
) -> dict[tuple[str, str], tuple[str, ...]]:
    """Return (text before the word, text after it if `tails`) -> columns in the order of `axes`, if all are there."""
    found: dict[tuple[str, str], dict[str, str]] = {}
    for name in names:
        bare = split_unit(name)[0]
        for pattern in patterns:
            if match := pattern.match(bare):
                tail = (match.groupdict().get("tail") or "").lower() if tails else ""
                found.setdefault((match["head"].lower(), tail), {}).setdefault(match["axis"].lower(), name)
                break
    counted = {head: _from_zero(group) for head, group in found.items()}
    if axes == "xyz":
        counted = {
            head: {"xyz"[int(key)] if key in "012" else key: name for key, name in group.items()}
            for head, group in counted.items()
        }
    return {head: tuple(group[axis] for axis in axes) for head, group in counted.items() if set(axes) <= set(group)}


def _from_zero(group: dict[str, str]) -> dict[str, str]:
    """Return a group whose axes are numbered from 1 with numbers from 0; any other group as it is."""
    if not all(key.isdigit() for key in group) or "0" in group:
        return group
    return {str(int(key) - 1): name for key, name in group.items()}
