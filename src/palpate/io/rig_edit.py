"""Write a calibrated pose into a rig that a person wrote, leaving their words alone."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from jaxtyping import Float
from tomlkit.items import Item, Key, Whitespace

from palpate.errors import InputError
from palpate.io.atomic import write_text
from palpate.io.models import load_toml, toml_array
from palpate.spatial.pose import Pose

__all__ = ["update_pose"]


def update_pose(
    source: Path, target: Path, pose: Pose, covariance: Float[np.ndarray, "6 6"], *, comment: str = ""
) -> None:
    """Copy a rig with the surface's pose and its covariance set; comments, order and all else stay.

    Relative paths are rewritten when `target` lies in another folder.

    Args:
        source: the rig to read.
        target: the rig to write; it may be the same file.
        pose: T_sensor_surface.
        covariance: (6, 6) of (rotation vector [rad], translation [m]), perturbed on the left.
        comment: said beside the pose.
    """
    load_toml(source)  # its sentences are better than tomlkit's
    document: Any = tomlkit.parse(source.read_text(encoding="utf-8"))
    if "surface" not in document:
        raise InputError("a rig needs a [surface].", where=str(source))
    surface = document["surface"]
    table = tomlkit.inline_table()
    table.update({"xyz": pose.translation.tolist(), "quaternion_xyzw": pose.quaternion().tolist()})
    _replace(surface, "pose", table, comment)
    matrix = toml_array(np.asarray(covariance))
    _replace(surface, "pose_covariance", matrix, "of rotation [rad] and translation [m] in the sensor's frame")
    if source.resolve().parent != target.resolve().parent:
        _rebase(surface, "mesh", source, target)
        if "force_torque" in document:
            _rebase(document["force_torque"], "payload", source, target)
    write_text(target, tomlkit.dumps(document))


def _replace(table: Any, key: str, value: Item, comment: str) -> None:
    if key in table:
        kept = table[key].trivia if hasattr(table[key], "trivia") else None
        table[key] = value
        if comment:
            table[key].comment(comment)
        elif kept is not None:
            table[key].trivia.comment, table[key].trivia.comment_ws = kept.comment, kept.comment_ws
        return
    _append(table, key, value.comment(comment) if comment else value)


def _append(table: Any, key: str, value: Item) -> None:
    """After the table's last words, before the blank lines that part it from the next table."""
    body: list[tuple[Key | None, Item]] = table.value.body
    blank: list[Item] = []
    while body and isinstance(body[-1][1], Whitespace):
        blank.append(body.pop()[1])
    table.append(key, value)
    for item in reversed(blank):
        table.add(item)


def _rebase(table: Any, key: str, source: Path, target: Path) -> None:
    if key in table and not Path(str(table[key])).is_absolute():
        moved = os.path.relpath(source.resolve().parent / str(table[key]), target.resolve().parent)
        _replace(table, key, tomlkit.item(Path(moved).as_posix()), "")
