"""Models as TOML, the same to the last bit when read back, with where they came from."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from jaxtyping import Float
from tomlkit.items import Array

from palpate.errors import InputError
from palpate.io.atomic import write_text
from palpate.io.strict import covariance_matrix, parse
from palpate.io.units import near
from palpate.sensors.force_torque import STANDARD_GRAVITY, Payload

__all__ = [
    "load_model",
    "load_toml",
    "printable",
    "provenance",
    "read_payload",
    "read_provenance",
    "toml_array",
    "write_payload",
    "write_provenance",
]

_FIELDS = {  # name -> comment
    "weight": "N, in the base frame",
    "force_bias": "N, in the sensor's frame, as all that follows",
    "center_of_mass": "m",
    "torque_bias": "N m",
    "magnitude": "m/s^2, of gravity: mass is |weight| over it",
    "residual": "N, N m: rms of the fit",
    "samples": "that were used",
}
Three = tuple[float, float, float]


@dataclass(frozen=True)
class _PayloadFile:
    """A payload model as its file spells it."""

    kind: str
    weight: Three
    force_bias: Three
    center_of_mass: Three
    torque_bias: Three
    covariance: tuple[tuple[float, ...], ...]
    residual: tuple[float, float]
    magnitude: float = STANDARD_GRAVITY
    samples: int = 0
    notes: tuple[str, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=lambda: {})

    def __post_init__(self) -> None:
        covariance_matrix(self.covariance, 12, "covariance")
        if not self.magnitude > 0:
            raise ValueError(f"magnitude must be positive, not {self.magnitude:g}")
        if min(self.residual) < 0 or self.samples < 0:
            raise ValueError("residual and samples must not be negative")

    def payload(self) -> Payload:
        """As a value."""
        return Payload(
            *map(np.asarray, (self.weight, self.force_bias, self.center_of_mass, self.torque_bias)),
            covariance=np.asarray(self.covariance),
            magnitude=self.magnitude,
            residual=np.asarray(self.residual),
            samples=self.samples,
            provenance={name: str(said) for name, said in self.provenance.items()},
            notes=self.notes,
        )


def provenance(inputs: Mapping[str, Path | None], options: Mapping[str, object]) -> dict[str, str]:
    """What a result was made from: version, each input's name and SHA-256, each option that was set."""
    record = {"palpate": version("palpate")}
    for name, path in inputs.items():
        if path is not None:
            record[name] = f"{printable(path.name)} {_sha256(path)}"
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
    table = load_model(path, "payload", "a payload model", "palpate calibrate payload")
    stated = parse(table, _PayloadFile, file=str(path))
    try:
        return stated.payload()
    except InputError as problem:  # it does not know its file
        raise InputError(problem.what, where=str(path)) from problem


def write_provenance(path: Path, record: Mapping[str, object]) -> None:
    """Write beside a result where it came from, as TOML."""
    write_text(path, tomlkit.dumps(dict(record)))


def read_provenance(path: Path) -> dict[str, Any]:
    """What stands beside a result, in its .toml; nothing where there is none."""
    beside = path.with_name(f"{path.name}.toml")
    return load_toml(beside) if beside.exists() else {}


def load_model(path: Path, kind: str, called: str, command: str) -> dict[str, Any]:
    """The table of a model's file.

    Args:
        path: of the file.
        kind: that it must state.
        called: what the model is called in a sentence.
        command: what writes one.

    Raises:
        InputError: not there, not TOML, or of another kind.
    """
    table = load_toml(path)
    if table.get("kind") != kind:
        raise InputError(f"is not {called}.", where=str(path), mend=f"`{command}` writes one (kind = {kind!r}).")
    return table


def load_toml(path: Path) -> dict[str, Any]:
    """A TOML file as a dictionary.

    Raises:
        InputError: not there, or not TOML; says the line.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        siblings = [other.name for other in path.parent.glob("*.toml")] if path.parent.is_dir() else []
        raise InputError("there is no such file.", where=str(path), mend=near(path.name, siblings)) from None
    except (OSError, UnicodeDecodeError) as problem:
        raise InputError(f"cannot be read ({problem}).", where=str(path)) from problem
    except (ValueError, RecursionError) as problem:  # tomllib's own, an integer too long, lists in lists in lists
        raise InputError(f"is not TOML: {problem}.", where=str(path)) from problem


def toml_array(rows: Float[np.ndarray, "n k"] | Sequence[Sequence[float]]) -> Array:
    """A matrix, one row a line."""
    array = tomlkit.array()
    for row in np.asarray(rows).tolist():
        array.append(row)
    return array.multiline(multiline=True)


def printable(name: str) -> str:
    """A file name as it may stand in a line of UTF-8 text."""
    return "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in name)


def _sha256(path: Path) -> str:
    if not path.is_file():  # a pipe gives its bytes once
        return "(a pipe, no hash)"
    with path.open("rb") as file:
        return f"sha256:{hashlib.file_digest(file, 'sha256').hexdigest()}"
