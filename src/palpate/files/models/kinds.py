"""Read and write the files of all kinds of models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from math import isnan
from pathlib import Path
from typing import Any, TypeVar, cast, overload

from palpate.errors import InputError
from palpate.files.atomic import write_text
from palpate.files.inputs import load_toml
from palpate.files.models.model import Model
from palpate.files.models.toml import toml_lines
from palpate.files.schema import Key, TableForm, parse
from palpate.registry import Registry

Value = TypeVar("Value")


# Kind of a model, as in its file -> its description; other packages add theirs by an entry point `palpate.models`.
MODELS = Registry(
    {
        "payload": "palpate.sensors.force_torque.files.PAYLOAD",
        "load_cells": "palpate.sensors.load_cells.files.LOAD_CELLS",
        "intensity": "palpate.sensors.taxels.files.INTENSITY",
        "response": "palpate.sensors.taxels.files.RESPONSE",
        "servo": "palpate.files.models.servo.SERVO",
        "skin map": "palpate.sensors.taxels.skin_map.model_file.SKIN_MAP",
        "taxels": "palpate.sensors.taxels.files.TAXELS",
        "marker ring": "palpate.sensors.marker_ring.files.MARKER_RING",
        "camera": "palpate.sensors.marker_ring.files.CAMERA",
    },
    Model,
    "palpate.models",
)


@overload
def read_model(path: str | Path) -> Any: ...
@overload
def read_model(path: str | Path, holds: type[Value]) -> Value: ...
def read_model(path: str | Path, holds: type[Any] | None = None) -> Any:
    """Read a model from its file; numbers equal those written, to the last bit.

    Args:
        path: of the file.
        holds: class of the model that is wanted; None: any.

    Raises:
        InputError: the file cannot be read, is no model, or not one of that class; a key is unknown or missing, or a
            value has the wrong type, shape or range.
        TypeError: `holds` is no class of models.
    """
    try:
        table = load_toml(path)
    except InputError as problem:
        if holds is None or Path(path).exists():
            raise
        _, model = _model(holds)
        hint = f"`{model.command}` writes {model.called}. {problem.hint}".strip()
        raise InputError(problem.what, where=problem.where, hint=hint) from None
    kind = table.pop("kind", None)
    found = MODELS[kind] if isinstance(kind, str) and kind in MODELS else None  # no other kind is imported
    if holds is not None and (found is None or found.holds is not holds):
        wanted, model = _model(holds)
        hint = f"`{model.command}` writes one (kind = {wanted!r})."
        raise InputError(f"is not {model.called}.", where=str(path), hint=hint)
    if found is None:
        known = ", ".join(repr(name) for name in MODELS)
        raise InputError("is not a model.", where=str(path), hint=f"Write its kind, one of {known}.")
    return parse(table, found.holds, file=str(path), forms=found.forms)


def write_model(path: str | Path, value: Any) -> None:
    """Write a model to a file, with a comment and the unit next to each key.

    Raises:
        TypeError: the value is not a model.
        InputError: the file cannot be written.
    """
    kind, model = _model(cast("type[Any]", type(value)))
    head = [f"# {model.description} As `{model.command}` writes it.", *toml_lines("kind", kind), ""]
    write_text(Path(path), "\n".join([*head, *_table(value, model.forms, ""), ""]))


def _model(holds: type[Any]) -> tuple[str, Model]:
    """Return name and description of the kind of a class, or raise a TypeError."""
    for kind, model in MODELS.items():
        if model.holds is holds:
            return kind, model
    raise TypeError(f"{holds.__name__} is not a model")


def _table(value: Any, forms: Mapping[type, TableForm], place: str, *, commented: bool = True) -> list[str]:
    """Return the lines of a value's keys, then of its tables."""
    form = forms[type(value)]
    named = {form.called.get(each.name, each.name): each.name for each in fields(value)}
    own = {key: getattr(value, name) for key, name in named.items() if form.build is None or key in form.keys}
    spelled: Mapping[str, Any] = own | dict(form.spell(value) if form.spell else {})
    keys = [*form.keys, *(name for name in spelled if name not in form.keys)]
    lines, tables = list[str](), list[str]()
    for name in keys:
        stated = spelled.get(name)
        if stated is None or _unknown(stated):
            continue
        if is_dataclass(stated):
            tables += ["", f"[{place}{name}]", *_table(stated, forms, f"{place}{name}.")]
        elif isinstance(stated, Mapping):
            pairs = cast("Mapping[str, object]", stated).items()
            tables += ["", f"[{place}{name}]", *(line for pair in pairs for line in toml_lines(*pair))]
        elif isinstance(stated, tuple) and any(map(is_dataclass, cast("tuple[Any, ...]", stated))):
            for k, each in enumerate(cast("tuple[Any, ...]", stated)):
                tables += ["", f"[[{place}{name}]]", *_table(each, forms, f"{place}{name}.", commented=k == 0)]
        else:
            lines += toml_lines(name, stated, form.keys.get(name, Key()).comment if commented else "")
    return lines + tables


def _unknown(value: Any) -> bool:
    """Check whether a number, or all of a tuple, is NaN."""
    values = cast("tuple[Any, ...]", value if isinstance(value, tuple) else (value,))
    return bool(values) and all(isinstance(each, float) and isnan(each) for each in values)
