"""Load the physics engine, MuJoCo, where it is installed, and write numbers of its models."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from typing import Any

from palpate.errors import importing_extra


def engine(what: str) -> Any:
    """Import MuJoCo, and return its module.

    Args:
        what: subject of the simulation, for the message: "moving phantom".

    Raises:
        InputError: MuJoCo is not installed.
    """
    with importing_extra("the simulation needs MuJoCo", "simulation", where=what):
        return import_module("mujoco")


def words(values: Iterable[float]) -> str:
    """Return numbers as an attribute of XML, exact to the last bit."""
    return " ".join(repr(float(value)) for value in values)
