"""Describe a kind of model and its file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.schema import TableForm
from palpate.spatial.arguments import takes_arrays

Lines = list[tuple[str, str]]


@dataclass(frozen=True)
class Model:
    """A kind of model.

    Args:
        holds: class of its values.
        called: its name in a sentence.
        description: first line of its files.
        command: that writes one.
        summary: returns a value's main figures, each with its name.
        forms: class -> form in the file, for `holds` and the classes in it.
    """

    holds: type[Any]
    called: str
    description: str
    command: str
    summary: Callable[[Any], Lines]
    forms: Mapping[type, TableForm]


@takes_arrays
def span(values: Float[np.ndarray, " n"]) -> str:
    """Return the least and the largest of some values as text, "0.1 to 2", or "2" if they are equal.

    Raises:
        InputError: there are no values, or they have another shape.
    """
    if not len(values):
        raise InputError("there are no values to summarise.")
    low, high = f"{values.min():.3g}", f"{values.max():.3g}"
    return low if low == high else f"{low} to {high}"
