"""Every key of every table of a rig changes what is found or read; a key that no scene changes fails."""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import NoneType
from typing import Any, get_type_hints

import pytest

from palpate.calls import options
from palpate.errors import InputError
from palpate.setup import load
from palpate.setup.kinds import KINDS
from palpate.setup.rig import Rig
from palpate.setup.robot import RobotTable
from tests.support.rig_files import write_files
from tests.support.rig_scenes import SCENES, TOLD, Table, merged, rig_of, same

TABLES = {"surface.packages", "robot.packages", "robot.joints", "source.wrench"}  # keys whose value is a table


def _keys(model: type[Any], place: str) -> Iterator[str]:
    """Yield each key of a table, with dots; a key that is a table or a number is both."""
    hints = get_type_hints(model)
    for each in fields(model):
        name, kinds = f"{place}.{each.name}", options(hints[each.name])
        nested = [kind for kind in kinds if is_dataclass(kind) and kind is not model]
        for kind in nested:
            yield from _keys(kind, name)
        if {*kinds} - {*nested, NoneType}:
            yield name


def _schema() -> set[str]:
    """All keys of a rig of one sensor and of [robot]."""
    hints = get_type_hints(Rig)
    shared = [(kind, name) for name, each in hints.items() for kind in options(each) if is_dataclass(kind)]
    tables = [*shared, *((KINDS[name].table, name) for name in KINDS), (RobotTable, "robot")]
    own = {f"sensors.wrist.{key}" for key in vars(load)["_OWN"] if key != "kind"}  # that chooses a table
    return own | {key for table, name in tables if table.__module__.startswith("palpate") for key in _keys(table, name)}


def _single(table: Table, place: str = "") -> Iterator[tuple[str, Table]]:
    """Yield each key of a change, with a table that has it alone."""
    for name, value in table.items():
        key = f"{place}{name}"
        if isinstance(value, dict) and key not in TABLES:
            yield from ((inner, {name: below}) for inner, below in _single(value, f"{key}."))
        else:
            yield key, {name: value}


GROUPS = [(scene, group) for scene, groups in TOLD.items() if scene != "rig" for group in groups]


def test_each_key_has_a_scene() -> None:
    known, stated = _schema(), {key for _, group in GROUPS for key, _ in _single(group["change"])}
    missing, strange = sorted(known - stated), sorted(stated - known)
    assert not missing, f"add to tests/laws/rig_keys.toml a scene in which each of these changes an answer: {missing}"
    assert not strange, f"tests/laws/rig_keys.toml changes keys that no table has: {strange}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_files(tmp_path_factory.mktemp("rigs"))


@pytest.mark.parametrize(("scene", "group"), GROUPS, ids=lambda each: each if isinstance(each, str) else "")
def test_each_changes_an_answer(scene: str, group: Table, folder: Path) -> None:
    """Or is refused by its name where it contradicts another."""
    before, unused = merged(rig_of(scene), group.get("given", {})), list[str]()
    known = SCENES[scene].of(before, folder)
    for key, alone in _single(group["change"]):
        try:
            used = not same(known, SCENES[scene].of(merged(before, alone), folder))
        except InputError as problem:
            used = key.rpartition(".")[2] in str(problem)
        unused += [] if used else [key]
    assert not unused, f"these keys change nothing: {unused}"
