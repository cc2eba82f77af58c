"""Models as TOML, the same to the last bit when read back, with where they came from."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from jaxtyping import Float
from tomlkit.items import Array

from palpate.errors import InputError
from palpate.io.atomic import write_text
from palpate.io.units import near
from palpate.sensors.force_torque import Payload

__all__ = ["load_toml", "provenance", "read_payload", "toml_array", "write_payload", "write_provenance"]

_FIELDS = {  # name -> comment
    "weight": "N, in the base frame",
    "force_bias": "N, in the sensor's frame, as all that follows",
    "center_of_mass": "m",
    "torque_bias": "N m",
    "magnitude": "m/s^2, of gravity: mass is |weight| over it",
    "residual": "N, N m: rms of the fit",
    "samples": "that were used",
}
_SHAPES = {
    "weight": (3,),
    "force_bias": (3,),
    "center_of_mass": (3,),
    "torque_bias": (3,),
    "covariance": (12, 12),
    "residual": (2,),
}
_NOT_SHOWN = ("covariance", "provenance", "notes")


def provenance(inputs: Mapping[str, Path | None], options: Mapping[str, object]) -> dict[str, str]:
    """What a result was made from: version, each input's name and SHA-256, each option that was set."""
    record = {"palpate": version("palpate")}
    for name, path in inputs.items():
        if path is not None:
            record[name] = f"{path.name} sha256:{_sha256(path)}"
    return record | {name: str(value) for name, value in options.items() if value is not None}


def write_payload(path: Path, payload: Payload) -> None:
    """Write a payload model."""
    document = tomlkit.document()
    document.add(
        tomlkit.comment("What hangs on the sensor, and the sensor's zero. Written by `palpate calibrate payload`.")
    )
    document.add("kind", tomlkit.item("payload"))
    document.add(tomlkit.nl())
    for name, comment in _FIELDS.items():
        document.add(name, tomlkit.item(np.asarray(getattr(payload, name)).tolist()).comment(comment))
    document.add(tomlkit.nl())
    document.add(tomlkit.comment("of weight, force_bias, center_of_mass, torque_bias, in this order"))
    document.add("covariance", toml_array(payload.covariance))
    document.add("notes", tomlkit.item(list(payload.notes)))
    document.add("provenance", tomlkit.item(dict(payload.provenance)))
    write_text(path, tomlkit.dumps(document))


def read_payload(path: Path) -> Payload:
    """Read a payload model back.

    Raises:
        InputError: not a payload model, a key misspelt or missing, a value of the wrong kind.
    """
    table = load_toml(path)
    if table.pop("kind", None) != "payload":
        raise InputError(
            "is not a payload model.",
            where=str(path),
            mend="`palpate calibrate payload` writes one (kind = 'payload').",
        )
    known = (*_FIELDS, *_NOT_SHOWN)
    for name in table:
        if name not in known:
            raise InputError(f"unknown key {name!r}.", where=str(path), mend=near(name, known))
    arrays = {name: _array(table, name, shape, path) for name, shape in _SHAPES.items()}
    rest = {name: table[name] for name in ("magnitude", "samples", "provenance") if name in table}
    try:
        return Payload(**arrays, **rest, notes=tuple(table.get("notes", ())))
    except (TypeError, ValueError) as problem:
        raise InputError(f"{problem}.", where=str(path)) from problem


def _array(table: Mapping[str, Any], name: str, shape: tuple[int, ...], path: Path) -> Float[np.ndarray, "..."]:
    try:
        array = np.asarray(table[name], dtype=np.float64)
    except KeyError:
        raise InputError(f"there is no {name!r}.", where=str(path)) from None
    except (TypeError, ValueError):
        array = np.zeros(0)
    if array.shape != shape:
        raise InputError(f"{name} must be {' x '.join(map(str, shape))} numbers.", where=str(path))
    return array


def write_provenance(path: Path, record: Mapping[str, object]) -> None:
    """Write beside a result where it came from, as TOML."""
    write_text(path, tomlkit.dumps(dict(record)))


def load_toml(path: Path) -> dict[str, Any]:
    """A TOML file as a dictionary.

    Raises:
        InputError: not there, or not TOML; says the line.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        siblings = [other.name for other in path.parent.glob("*.toml")] if path.parent.is_dir() else []
        raise InputError("there is no such file.", where=str(path), mend=near(path.name, siblings)) from None
    except (OSError, UnicodeDecodeError) as problem:
        raise InputError(f"cannot be read ({problem}).", where=str(path)) from problem
    except tomllib.TOMLDecodeError as problem:
        raise InputError(f"is not TOML: {problem}.", where=str(path)) from problem


def toml_array(rows: Float[np.ndarray, "n k"] | Sequence[Sequence[float]]) -> Array:
    """A matrix, one row a line."""
    array = tomlkit.array()
    for row in np.asarray(rows).tolist():
        array.append(row)
    return array.multiline(multiline=True)


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
