"""What a kind of model is to its files."""

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
        holds: the class of its values.
        called: in a sentence.
        description: first line of its files.
        command: what writes one.
        summary: a value's main figures, each with its name.
        forms: of the class and of those in it: comments and bounds of keys, and what is spelled otherwise than field by
            field.
    """

    holds: type[Any]
    called: str
    description: str
    command: str
    summary: Callable[[Any], Lines]
    forms: Mapping[type, TableForm]


def span(values: Float[np.ndarray, " n"]) -> str:
    """Return the least and the largest of some values, as text."""
    low, high = f"{values.min():.3g}", f"{values.max():.3g}"
    return low if low == high else f"{low} to {high}"
