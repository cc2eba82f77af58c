"""Record the provenance of a result: version, inputs by their content, options."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import tomlkit

from palpate.files.atomic import write_text
from palpate.files.inputs import load_toml


def provenance(inputs: Mapping[str, Path | None], options: Mapping[str, object]) -> dict[str, str]:
    """Return Palpate's version, each input's name and SHA-256, and each option that was set, as texts.

    Inputs and options that are None are left out.

    Raises:
        OSError: an input is a file that cannot be read.
    """
    read = {name: f"{printable(path.name)} {_sha256(path)}" for name, path in inputs.items() if path is not None}
    said = {name: str(value) for name, value in options.items() if value is not None}
    return {"palpate": version("palpate")} | read | said


def write_provenance(path: Path, record: Mapping[str, object]) -> None:
    """Write the provenance of a result as TOML.

    Raises:
        InputError: the file cannot be written.
    """
    write_text(path, tomlkit.dumps(dict(record)))


def read_provenance(path: Path) -> dict[str, Any]:
    """Return the provenance of a result from PATH.toml next to it; {} if that does not exist.

    Raises:
        InputError: the file cannot be read, or is not TOML.
    """
    beside = path.with_name(f"{path.name}.toml")
    return load_toml(beside) if beside.exists() else {}


def printable(name: str) -> str:
    """Return a file name with unprintable characters replaced."""
    return "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in name)


def _sha256(path: Path) -> str:
    if not path.is_file():  # a pipe gives its bytes once
        return "(a pipe, no hash)"
    with path.open("rb") as file:
        return f"sha256:{hashlib.file_digest(file, 'sha256').hexdigest()}"
