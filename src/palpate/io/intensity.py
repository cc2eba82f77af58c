"""intensity.toml: what the cells' readings mean, the same to the last bit when read back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from math import nan
from pathlib import Path
from typing import Any, cast

import numpy as np
import tomlkit
from tomlkit.items import Table

from palpate.errors import InputError
from palpate.io.atomic import write_text
from palpate.io.models import load_model, toml_array
from palpate.io.strict import INFINITE, parse
from palpate.sensors.intensity import Curve, Intensity

__all__ = ["read_intensity", "write_intensity"]

_COMMENTS = {
    "parameters": "see docs/skin_contacts.md; N and counts",
    "largest": "N, up to which it was measured",
    "saturation": "reading at the end of the range",
    "falling": "the reading falls as the force grows",
    "joint": "N, where the two ranges meet",
    "knots": "N",
    "residual": "counts, rms of the fit",
    "hysteresis": "between loading and unloading, as a share of the span",
}


@dataclass(frozen=True)
class _CurveTable:
    """A curve as the file spells it; what is not known is left out."""

    kind: str
    parameters: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    largest: float
    saturation: float = field(default=nan, metadata=INFINITE)
    falling: bool = False
    joint: float = 0.0
    knots: tuple[float, ...] = ()
    reference: float = 0.0
    scale: float = 0.0
    residual: float = 0.0
    hysteresis: float = nan

    def curve(self) -> Curve:
        """As a value."""
        size = len(self.parameters)
        if not size or [len(row) for row in self.covariance] != [size] * size:
            raise ValueError(f"covariance must be {size} x {size}, as there are parameters")
        values: dict[str, Any] = dict(vars(self))
        values |= {name: np.array(values[name]) for name in ("parameters", "covariance", "knots")}
        return Curve(**values)


@dataclass(frozen=True)
class _IntensityFile:
    """The whole file."""

    kind: str
    curve: tuple[_CurveTable, ...]
    which: tuple[tuple[int, ...], ...] | None = None
    unit: str = "counts"
    notes: tuple[str, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=lambda: {})


def write_intensity(path: Path, intensity: Intensity) -> None:
    """Write the curves of a sheet."""
    document = tomlkit.document()
    document.add(tomlkit.comment("From readings of taxels to forces. Written by `palpate calibrate intensity`."))
    document.add("kind", tomlkit.item("intensity"))
    document.add("unit", tomlkit.item(intensity.unit))
    if intensity.which is not None:
        document.add(tomlkit.comment("the curve of each cell, row by row, counted from 0"))
        document.add("which", tomlkit.item(intensity.which.tolist()))
    document.add("notes", tomlkit.item(list(intensity.notes)))
    document.add("provenance", tomlkit.item(dict(intensity.provenance)))
    curves = tomlkit.aot()
    for number, curve in enumerate(intensity.curves):
        curves.append(_table(curve, commented=number == 0))
    document.add("curve", curves)
    write_text(path, tomlkit.dumps(document))


def _table(curve: Curve, *, commented: bool) -> Table:
    table = tomlkit.table()
    for each in fields(curve):
        value = getattr(curve, each.name)
        if each.name == "covariance":
            table.add(each.name, toml_array(value))
            continue
        plain = value.tolist() if isinstance(value, np.ndarray) else value
        if plain in ([], 0.0) or plain != plain:  # NaN: not known
            continue
        item = cast("Any", tomlkit.item(plain))
        table.add(each.name, item.comment(_COMMENTS[each.name]) if commented and each.name in _COMMENTS else item)
    return table


def read_intensity(path: Path) -> Intensity:
    """Read the curves of a sheet back.

    Raises:
        InputError: not such a file, a key misspelt or missing, a curve that does not rise.
    """
    table = load_model(path, "intensity", "an intensity model", "palpate calibrate intensity")
    listed: Any = table.get("curve")
    if not isinstance(listed, list):
        raise InputError("has no [[curve]].", where=str(path))
    curves = cast("list[dict[str, Any]]", listed)
    tables = tuple(parse(each, _CurveTable, file=str(path), key=f"curve[{k}]") for k, each in enumerate(curves))
    rest = parse(table | {"curve": []}, _IntensityFile, file=str(path))
    try:
        which = None if rest.which is None else np.array(rest.which, dtype=np.int64)
        return Intensity(
            tuple(each.curve() for each in tables),
            which,
            unit=rest.unit,
            provenance={name: str(said) for name, said in rest.provenance.items()},
            notes=rest.notes,
        )
    except InputError as problem:  # it does not know its file
        raise InputError(problem.what, where=str(path), mend=problem.mend) from problem
    except ValueError as problem:
        raise InputError(f"{problem}.", where=str(path)) from problem
