"""Write calibrated values into a rig that a person wrote, and keep comments and order."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
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

__all__ = ["update_drift", "update_offset", "update_pose"]

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
) -> None:
    """Copy a rig with the surface's pose and its covariance set; comments, order and all other values stay.

    A surface in dotted keys or an inline table is rewritten as a [surface] at the end, without its comments.

    Relative paths of the mesh and of sensors' files are rewritten if `target` is in another folder.

    Args:
        source: the rig to read.
        target: the rig to write; it may be the same file.
        pose: T_sensor_surface.
        covariance: (6, 6) of (rotation vector [rad], translation [m]), perturbed on the left.
        placement: [m] standard deviation of a touch's place beyond what its wrench explains; None: it stays as it is.
        comment: comment on the pose's line; "": none.

    Raises:
        InputError: `source` cannot be read, has no surface or cannot be edited in its form, or `target` cannot be
            written.
    """
    wanted = load_toml(source)
    if not isinstance(wanted.get("surface"), dict):
        raise InputError("a rig needs a [surface].", where=str(source))
    wanted["surface"]["pose"] = {"xyz": pose.translation.tolist(), "quaternion_xyzw": pose.quaternion().tolist()}
    wanted["surface"]["pose_covariance"] = np.asarray(covariance).tolist()
    if placement is not None:
        wanted["surface"]["placement"] = float(placement)
    _write(source, target, wanted, (_in_place, _surface_anew), comment, "surface")


def update_offset(source: Path, target: Path, offset: float, *, comment: str = "") -> None:
    """Copy a rig with the offset of the poses' clock set; comments, order and all other values stay.

    Relative paths are rewritten if `target` is in another folder.

    Args:
        source: the rig to read.
        target: the rig to write; it may be the same file.
        offset: [s] added to the stamps of the poses.
        comment: comment on the offset's line; "": none.

    Raises:
        InputError: `source` cannot be read or edited in its form, or `target` cannot be written.
    """
    wanted = load_toml(source)
    if not isinstance(wanted.setdefault("orientation", {}), dict):
        raise InputError("[orientation] must be a table.", where=str(source))
    wanted["orientation"]["offset"] = offset
    _write(source, target, wanted, (_offset_in_place,), comment, "orientation")


def update_drift(source: Path, target: Path, drift: Mapping[str, Any], comments: Mapping[str, str]) -> None:
    """Copy a rig with its [drift] set; comments, order and all other values stay.

    Relative paths are rewritten if `target` is in another folder.

    Args:
        source: the rig to read.
        target: the rig to write; it may be the same file.
        drift: key of the table -> value; other keys of the rig's [drift] stay, except those that a fit determines.
        comments: key -> comment on its line.

    Raises:
        InputError: `source` cannot be read or edited in its form, or `target` cannot be written.
    """
    wanted = load_toml(source)
    if not isinstance(wanted.setdefault("drift", {}), dict):
        raise InputError("[drift] must be a table.", where=str(source))
    kept = {key: value for key, value in wanted["drift"].items() if key not in _FOUND}
    wanted["drift"] = {**kept, **drift}

    def in_place(text: str, wanted: Mapping[str, Any], comment: str) -> str | None:
        return _drift_in_place(text, wanted, {key: printable(said) for key, said in comments.items()})

    _write(source, target, wanted, (in_place, _drift_anew), "", "drift")


_Edit = Callable[[str, Mapping[str, Any], str], str | None]


def _write(
    source: Path, target: Path, wanted: dict[str, Any], edits: Sequence[_Edit], comment: str, table: str
) -> None:
    """Write the first edit of the text that parses as `wanted`, with relative paths moved; raise InputError if none."""
    if source.resolve().parent != target.resolve().parent:
        for name, key in _paths(wanted):
            _rebase(wanted.get(name, {}), key, source, target)
    before = source.read_text(encoding="utf-8-sig")
    for edit in edits:
        try:
            text = edit(before, wanted, printable(comment))
        except TOMLKitError:  # a form of TOML that this edit cannot handle
            continue
        if text is not None and _reads_as(text, wanted):
            return write_text(target, text)
    raise InputError(
        f"the result cannot be written into [{table}] in the form that it has.",
        where=str(source),
        hint=f"Write [{table}] as one table.",
    )


def _offset_in_place(text: str, wanted: Mapping[str, Any], comment: str) -> str:
    document: Any = tomlkit.parse(text)
    if "orientation" not in document:
        document["orientation"] = tomlkit.table()
    table = document["orientation"]
    _replace(
        table,
        "offset",
        tomlkit.float_(repr(wanted["orientation"]["offset"])),
        comment if isinstance(table, Table) else "",
    )
    _move_paths(document, wanted)
    return tomlkit.dumps(document)


def _drift_in_place(text: str, wanted: Mapping[str, Any], comments: Mapping[str, str]) -> str | None:
    document: Any = tomlkit.parse(text)
    if "drift" not in document:
        document["drift"] = tomlkit.table()
    table, stated = document["drift"], wanted["drift"]
    if not isinstance(table, Table | InlineTable):  # dotted keys among others
        return None
    for key in [key for key in table if key not in stated]:
        table.remove(key)
    for key, value in stated.items():
        if key not in table or table[key] != value:
            _replace(table, key, _item(value), comments.get(key, "") if isinstance(table, Table) else "")
    _move_paths(document, wanted)
    return tomlkit.dumps(document)


def _drift_anew(text: str, wanted: Mapping[str, Any], comment: str) -> str:
    """Return the text with the [drift] moved to its end, for a drift in dotted keys."""
    document: Any = tomlkit.parse(text)
    document.remove("drift")
    _move_paths(document, wanted)
    table = tomlkit.table()
    for key, value in wanted["drift"].items():
        table.add(key, _item(value))
    fresh = tomlkit.document()
    fresh.add("drift", table)
    return f"{tomlkit.dumps(document).strip()}\n\n{tomlkit.dumps(fresh)}".lstrip()


def _item(value: object) -> Item:
    if isinstance(value, dict):
        return _inline(cast("dict[str, Any]", value))
    return tomlkit.float_(repr(value)) if isinstance(value, float) else tomlkit.item(value)


def _in_place(text: str, wanted: Mapping[str, Any], comment: str) -> str | None:
    """Return the text with the surface's old values replaced; None if [surface] is not one plain table."""
    document: Any = tomlkit.parse(text)
    surface = document["surface"]
    if not isinstance(surface, Table):
        return None
    _replace(surface, "pose", _inline(wanted["surface"]["pose"]), comment)
    _replace(surface, "pose_covariance", toml_array(wanted["surface"]["pose_covariance"]), _COVARIANCE)
    if "placement" in wanted["surface"]:
        _replace(surface, "placement", tomlkit.float_(repr(wanted["surface"]["placement"])), _PLACEMENT)
    _move_paths(document, wanted)
    return tomlkit.dumps(document)


def _surface_anew(text: str, wanted: Mapping[str, Any], comment: str) -> str:
    """Return the text with the surface as a [surface] at its end, for a surface in dotted keys or an inline table."""
    document: Any = tomlkit.parse(text)
    document.remove("surface")
    surface = tomlkit.table()
    for key, value in wanted["surface"].items():
        if key not in ("pose", "pose_covariance"):
            surface.add(key, _inline(cast("dict[str, Any]", value)) if isinstance(value, dict) else value)
    pose = _inline(wanted["surface"]["pose"])
    surface.add("pose", pose.comment(comment) if comment else pose)
    surface.add("pose_covariance", toml_array(wanted["surface"]["pose_covariance"]).comment(_COVARIANCE))
    _move_paths(document, wanted)
    rest = tomlkit.dumps(document).strip()
    fresh = tomlkit.document()
    fresh.add("surface", surface)
    return f"{rest}\n\n{tomlkit.dumps(fresh)}".lstrip()


def _inline(table: Mapping[str, Any]) -> Item:
    item = tomlkit.inline_table()
    item.update(table)
    return item


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
