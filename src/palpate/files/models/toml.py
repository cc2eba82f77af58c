"""Write TOML with comments, every number exact to the last bit."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
import tomlkit
from jaxtyping import Float
from tomlkit.items import Array

from palpate.spatial.arguments import takes_arrays


@takes_arrays
def toml_array(rows: Float[np.ndarray, "n k"]) -> Array:
    """Return a matrix (n, k) as a tomlkit `Array`, one row per line.

    Raises:
        InputError: rows has another shape.
    """
    array = tomlkit.array()
    for row in rows.tolist():
        array.append(row)
    return array.multiline(multiline=True)


def toml_lines(name: str, value: Any, comment: str = "") -> list[str]:
    """Return the lines of one key and its value; a matrix has one row per line and its comment above."""
    if not (isinstance(value, np.ndarray) and value.ndim == 2):
        return [f"{_key(name)} = {_literal(value)}{f'  # {comment}' if comment else ''}"]
    above = [f"# {comment}"] if comment else []
    return [*above, f"{_key(name)} = [", *(f"    {_literal(row)}," for row in cast("Any", value)), "]"]


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _literal(name)


def _literal(value: Any) -> str:
    """Return a value in TOML, with the fewest digits that read back to it."""
    if isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind == "f":  # of a large skin there are many
        return f"[{', '.join(map(repr, cast('Any', value).tolist()))}]"
    if isinstance(value, (np.ndarray, np.generic)):
        return _literal(cast("Any", value).tolist())
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(_literal(each) for each in cast('Sequence[Any]', value))}]"
    if isinstance(value, Mapping):
        pairs = cast("Mapping[str, Any]", value).items()
        return f"{{{', '.join(f'{_key(name)} = {_literal(each)}' for name, each in pairs)}}}"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (int, float)):
        return repr(value)
    return tomlkit.item(str(value)).as_string()
