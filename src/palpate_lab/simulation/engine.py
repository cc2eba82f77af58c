"""Load the physics engine, MuJoCo, where it is installed."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from palpate.errors import not_loaded

__all__ = ["engine"]


def engine(what: str) -> Any:
    """Import MuJoCo, and return its module.

    Args:
        what: subject of the simulation, for the message: "moving phantom".

    Raises:
        InputError: MuJoCo is not installed.
    """
    try:
        return import_module("mujoco")
    except ImportError as problem:
        raise not_loaded(problem, "the simulation needs MuJoCo", "simulation", where=what) from problem
