"""Write calibrated values into a rig that a person wrote, and keep comments and order."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
import tomlkit
from jaxtyping import Float
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import InlineTable, Item, Key, Table, Whitespace

from palpate.errors import InputError
from palpate.files.atomic import write_text
from palpate.files.models import load_toml, printable, toml_array
from palpate.setup.kinds import KINDS
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import Pose

_PLACEMENT = "m: the error of touches in addition to what their wrenches explain"
_FOUND = {"walk", "warm_up", "settle", "thermal", "thermal_deviation"}  # keys of a fit: removed if it lacks them
_COVARIANCE = "of rotation [rad] and translation [m] in the sensor's frame"


@takes_arrays
def update_pose(
    source: Path,
    target: Path,
    pose: Pose,
    covariance: Float[np.ndarray, "6 6"],
    *,
    placement: float | None = None,
    comment: str = "",
    sensor: str = "",
) -> None:
    """Copy a rig with the surface's pose and its covariance set; comments, order and all other values stay.

    A surface in dotted keys or an inline table becomes a [surface] at the end, without its comments. Relative paths
    lead to the same files.

    Args:
        source: the rig.
        target: the copy; it may be the same file.
        pose: T_sensor_surface.
        covariance: (6, 6) of (rotation vector [rad], translation [m]), perturbed on the left.
        placement: [m] standard deviation of a touch's place beyond what its wrench explains; None: it stays as it is.
        comment: comment on the pose's line.
        sensor: name of the sensor of a robot whose surface it is; "": the rig is of one sensor.

    Raises:
        InputError: `source` cannot be read, has no surface or cannot be edited, or `target` cannot be written; or
            arrays of other shapes.
    """
    wanted, pair = load_toml(source), ("pose", "pose_covariance")
    tables = _tables(wanted, sensor)
    if sensor:  # whose link may be the surface
        tables.setdefault("surface", {})
    if not isinstance(tables.get("surface"), dict):
        raise InputError("the rig needs a [surface].", where=str(source), hint='Add one, with mesh = "FILE".')
    surface = {key: value for key, value in tables["surface"].items() if key not in pair}
    surface["pose"] = {"xyz": pose.translation.tolist(), "quaternion_xyzw": pose.quaternion().tolist()}
    surface["pose_covariance"] = np.asarray(covariance).tolist()
    comments = {"pose": comment, "pose_covariance": _COVARIANCE}
    if placement is not None:
        surface["placement"], comments["placement"] = float(placement), _PLACEMENT
    tables["surface"] = surface
    _write(source, target, wanted, "surface", comments, sensor)


def update_offset(source: Path, target: Path, offset: float, *, comment: str = "", sensor: str = "") -> None:
    """Copy a rig with the offset of the poses' clock set; comments, order and all other values stay.

    Relative paths lead to the same files. A table in dotted keys moves to the end, without its comments.

    Args:
        source: the rig.
        target: the copy; it may be the same file.
        offset: [s] added to the stamps of the poses.
        comment: comment on the offset's line.
        sensor: name of the sensor of a robot whose poses they are; "": the rig is of one sensor.

    Raises:
        InputError: `source` cannot be read or edited, or `target` cannot be written.
    """
    wanted = load_toml(source)
    _table(_tables(wanted, sensor), "orientation", source)["offset"] = offset
    _write(source, target, wanted, "orientation", {"offset": comment}, sensor)


def update_drift(
    source: Path, target: Path, drift: Mapping[str, Any], comments: Mapping[str, str], sensor: str = ""
) -> None:
    """Copy a rig with its [drift] set; comments, order and all other values stay.

    Relative paths lead to the same files. A table in dotted keys moves to the end, without its comments.

    Args:
        source: the rig.
        target: the copy; it may be the same file.
        drift: key of the table -> value; keys that no fit determines stay without one.
        comments: key -> comment on its line.
        sensor: name of the sensor of a robot; "": the rig is of one sensor.

    Raises:
        InputError: `source` cannot be read or edited, or `target` cannot be written.
    """
    wanted = load_toml(source)
    tables = _tables(wanted, sensor)
    kept = {key: value for key, value in _table(tables, "drift", source).items() if key not in _FOUND}
    tables["drift"] = {**kept, **drift}
    _write(source, target, wanted, "drift", comments, sensor)


def _tables(rig: Any, sensor: str) -> Any:
    """Return the tables of one sensor: those of a robot's sensor, or the rig itself for ""."""
    return rig["sensors"][sensor] if sensor else rig


def _table(rig: dict[str, Any], name: str, source: Path) -> dict[str, Any]:
    """Return a table of a rig, added if it is missing; raise InputError if it is no table."""
    if not isinstance(table := rig.setdefault(name, {}), dict):
        raise InputError(f"[{name}] must be a table.", where=str(source))
    return cast("dict[str, Any]", table)


def _write(
    source: Path, target: Path, wanted: dict[str, Any], name: str, comments: Mapping[str, str], sensor: str
) -> None:
    """Write the rig with the table `name` of `wanted` and with relative paths moved.

    Raises:
        InputError: no edit of the text of `source` reads as `wanted`.
    """
    apart = source.resolve().parent != target.resolve().parent
    if apart and sensor:
        what = "the rig of a robot can be copied only within its folder, from which its files are named."
        raise InputError(what, where=str(target), hint=f"Write into {source.parent}.")
    if apart:
        for table, key in _paths(wanted):
            _rebase(wanted.get(table, {}), key, source, target)
    before, said = source.read_text(encoding="utf-8-sig"), {key: printable(text) for key, text in comments.items()}
    for edit in (_in_place, _anew):
        try:
            text = edit(before, wanted, name, said, sensor)
        except TOMLKitError:  # a form of TOML that this edit cannot handle
            continue
        if _reads_as(text, wanted):
            return write_text(target, text)
    what = f"the result cannot be written into [{name}] in the form that it has."
    hint = f"Write it in one place: a header [{name}] with its keys below it."
    raise InputError(what, where=str(source), hint=hint)


def _in_place(text: str, wanted: Mapping[str, Any], name: str, comments: Mapping[str, str], sensor: str) -> str:
    """Return the text with the table's changed values replaced; "" if its form does not allow that."""
    document: Any = tomlkit.parse(text)
    tables = _tables(document, sensor)
    if name not in tables:
        tables[name] = tomlkit.table()
    table, stated = tables[name], _tables(wanted, sensor)[name]
    plain = isinstance(table, Table)
    if not plain and ((name == "surface" and not sensor) or not isinstance(table, InlineTable)):  # dotted keys, too
        return ""
    for key in [key for key in table if key not in stated]:
        table.remove(key)
    for key, value in stated.items():
        if key in comments or key not in table or table[key] != value:
            _replace(table, key, _item(value), comments.get(key, "") if plain else "")
    if not sensor:
        _move_paths(document, wanted)
    return tomlkit.dumps(document)


def _anew(text: str, wanted: Mapping[str, Any], name: str, comments: Mapping[str, str], sensor: str) -> str:
    """Return the text with the table moved to its end, whatever its form; "" for a robot's."""
    if sensor:
        return ""
    document: Any = tomlkit.parse(text)
    document.remove(name)
    _move_paths(document, wanted)
    fresh, table = tomlkit.document(), tomlkit.table()
    for key, value in wanted[name].items():
        item = _item(value)
        table.add(key, item.comment(comments[key]) if comments.get(key) else item)
    fresh.add(name, table)
    return f"{tomlkit.dumps(document).strip()}\n\n{tomlkit.dumps(fresh)}".lstrip()


def _item(value: Any) -> Item:
    """Return a value as TOML: a table inline, a matrix with one row per line."""
    if isinstance(value, dict):
        item = tomlkit.inline_table()
        item.update(cast("dict[str, Any]", value))
        return item
    return toml_array(value) if np.ndim(value) == 2 else cast("Item", tomlkit.item(value))


def _reads_as(text: str, wanted: Mapping[str, Any]) -> bool:
    try:
        return tomllib.loads(text) == wanted
    except tomllib.TOMLDecodeError:
        return False


def _paths(document: Any) -> Iterator[tuple[str, str]]:
    """Yield (table, key) of each value of the rig that names a file."""
    yield "surface", "mesh"
    yield from ((table, "urdf") for table in ("surface", "orientation", "pokes"))
    yield "pokes", "start"
    if Path(str(document.get("pokes", {}).get("layout", ""))).suffix:  # else the name of a known layout
        yield "pokes", "layout"
    for kind in KINDS.among(document):
        for key in kind.paths:
            yield kind.name, key


def _move_paths(document: Any, wanted: Mapping[str, Any]) -> None:
    for name, key in _paths(document):
        table: Any = document.get(name, {})
        if key in table and table[key] != wanted[name][key]:
            _replace(table, key, tomlkit.string(wanted[name][key]), "")


def _replace(table: Any, key: str, value: Item, comment: str) -> None:
    if key not in table:
        _append(table, key, value.comment(comment) if comment else value)
        return
    old = getattr(table[key], "trivia", None)
    table[key] = value
    if comment:
        table[key].comment(comment)
    elif old is not None:
        table[key].trivia.comment, table[key].trivia.comment_ws = old.comment, old.comment_ws


def _append(table: Any, key: str, value: Item) -> None:
    """Append a key to a table, before the blank lines that separate it from the next table."""
    body: list[tuple[Key | None, Item]] = table.value.body
    blank: list[Item] = []
    while body and isinstance(body[-1][1], Whitespace):
        blank.append(body.pop()[1])
    table.append(key, value)
    for item in reversed(blank):
        table.add(item)


def _rebase(table: dict[str, Any], key: str, source: Path, target: Path) -> None:
    if key in table and not Path(table[key]).is_absolute():
        moved = os.path.relpath(source.resolve().parent / table[key], target.resolve().parent)
        table[key] = Path(moved).as_posix()
