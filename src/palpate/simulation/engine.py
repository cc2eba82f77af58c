"""The physics engine, MuJoCo, where it is installed."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from palpate.errors import InputError

__all__ = ["engine"]


def engine(what: str) -> Any:
    """MuJoCo.

    Args:
        what: is simulated by it, for the message: "moving phantom".

    Raises:
        InputError: it is not installed.
    """
    try:
        return import_module("mujoco")
    except ImportError as problem:
        raise InputError(
            f"MuJoCo is not installed, and the {what} runs on it",
            where=what,
            hint="pip install 'palpate[simulation]'",
        ) from problem
