"""Describe a kind of model and its file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from palpate.files.schema import TableForm

__all__ = ["Lines", "Model", "span"]

Lines = list[tuple[str, str]]


@dataclass(frozen=True)
class Model:
    """A kind of model.

    Args:
        holds: class of its values.
        called: name of the model in a sentence.
        description: first line of its files.
        command: command that writes one.
        summary: function that returns a value's main figures, each with its name.
        forms: class -> form, for `holds` and the classes in it: comments and bounds of keys, and keys that differ from
            the fields.
    """

    holds: type[Any]
    called: str
    description: str
    command: str
    summary: Callable[[Any], Lines]
    forms: Mapping[type, TableForm]


def span(values: Float[np.ndarray, " n"]) -> str:
    """Return the least and the largest of some values, as text "0.1 to 2", or one number if they are equal."""
    low, high = f"{values.min():.3g}", f"{values.max():.3g}"
    return low if low == high else f"{low} to {high}"
