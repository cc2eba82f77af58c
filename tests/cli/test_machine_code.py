"""The first time, processes of their own compile: what a Locator uses, only where it is not there, once."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator

import pytest

from palpate.cli import machine_code
from palpate.contact import Locator, _kernel
from palpate.surfaces import _jit
from tests.support.bodies import BODIES

PARTS = ("_nearest", "_beside", "follow", "distance_to_bounds")


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[list[str]]]:
    """The commands of processes that would be started."""
    commands: list[list[str]] = []

    def start(command: list[str], **_: object) -> None:
        commands.append(command)

    monkeypatch.setattr(subprocess, "Popen", start)
    machine_code.compile_beside.cache_clear()
    yield commands
    machine_code.compile_beside.cache_clear()


def test_one_half_is_compiled_for_the_types_that_a_locator_has() -> None:
    """Otherwise the other process would wait for nothing, and compile it all the same."""
    Locator(BODIES["ellipsoid"].mesh)
    machine_code.main(machine_code.HALF)
    for name in PARTS:
        index = getattr(_kernel, name)._cache._cache_file._load_index()
        on_meshes = [key for key in map(str, index) if "float32, 3," in key or name == "follow"]
        assert len(on_meshes) == 1, name


def test_processes_start_once_where_nothing_is_compiled_yet(
    started: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    def nothing(_: object) -> bool:
        return False

    monkeypatch.setattr(_jit, "on_disk", nothing)
    machine_code.compile_beside()
    machine_code.compile_beside()
    assert [command[1:] for command in started] == [
        ["-m", "palpate.cli.machine_code", machine_code.HALF],
        ["-m", "palpate.cli.machine_code", machine_code.ALL],
    ]


def test_none_starts_where_the_machine_code_is_there(started: list[list[str]]) -> None:
    Locator(BODIES["ellipsoid"].mesh)
    assert _jit.on_disk(_kernel.estimate_many)
    machine_code.compile_beside()
    assert not started
