"""`palpate inspect`: what is in this log, mesh, rig, model or result, in one screen."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from palpate.cli.calibrate_payload import figures
from palpate.cli.interrupts import import_mesh_reader
from palpate.cli.options import SomeFile
from palpate.cli.screen import lines, note, percent, table, title
from palpate.contact.truth import Touches
from palpate.errors import InputError
from palpate.evaluation.evaluate import status_shares
from palpate.io.contacts import COLUMNS, read_contacts
from palpate.io.csv import read_recording
from palpate.io.guess import guess_orientation, guess_time, guess_wrench
from palpate.io.layout import Layout
from palpate.io.models import load_toml, read_payload
from palpate.io.rig import load_rig
from palpate.io.table import Table, read_table
from palpate.io.truth import read_truth
from palpate.sensors.noise import estimate_noise
from palpate.sensors.recording import ORIENTATION
from palpate.surfaces.mesh import UNITS, Mesh

__all__ = ["inspect"]

_MESHES = (".stl", ".obj", ".ply", ".dae")
_CHANNELS = ("fx [N]", "fy [N]", "fz [N]", "tx [N m]", "ty [N m]", "tz [N m]")


def inspect(file: SomeFile, /) -> None:
    """Say what is in a log, a mesh, a rig, a model, a result or a truth.

    Args:
        file: by its suffix: CSV or text, STL, OBJ, PLY or DAE, TOML.
    """
    if not file.exists():
        raise InputError("there is no such file.", where=str(file))
    suffix = file.suffix.lower()
    if suffix in _MESHES:
        _mesh(file)
    elif suffix == ".toml":
        _toml(file)
    else:
        _table(file)


def _mesh(file: Path) -> None:
    import_mesh_reader()
    mesh = Mesh.load(file, unit="m")
    extent = mesh.bounds[1] - mesh.bounds[0]
    title(f"{file}: a mesh")
    lines(
        [
            ("facets", f"{len(mesh.faces):,}, of {len(mesh.vertices):,} vertices"),
            ("extent", f"{_numbers(extent)} in the file's unit"),
            ("middle", _numbers(mesh.centre)),
            ("mean edge", f"{mesh.edge:.4g}"),
            *(
                (f"as {unit}", f"{1e3 * scale * mesh.size:.4g} mm across")
                for unit, scale in UNITS.items()
                if unit != "um"
            ),
        ]
    )
    note(text for text in mesh.notes if " as m" not in text)


def _toml(file: Path) -> None:
    content = load_toml(file)
    if content.get("kind") == "payload":
        payload = read_payload(file)
        title(f"{file}: a payload model")
        lines(figures(payload))
        lines(payload.provenance.items())
        note(payload.notes)
    elif "surface" in content or "force_torque" in content:
        rig = load_rig(file)
        title(f"{file}: a rig")
        lines(_settings(rig, ""))
        for path in (rig.mesh_path(), rig.payload_path()):
            if path is not None and not path.exists():
                note([f"{path} is not there yet"], kind="warning")
    else:
        title(f"{file}: TOML")
        lines((name, value) for name, value in content.items())


def _settings(values: Any, prefix: str) -> list[tuple[str, object]]:
    """Every setting that is in force, defaults included, by its dotted key."""
    found: list[tuple[str, object]] = []
    for field in fields(values):
        value: object = getattr(values, field.name)
        if is_dataclass(value):
            found += _settings(value, f"{prefix}{field.name}.")
        elif value is not None and field.name not in ("folder", "pose_covariance"):
            found.append((f"{prefix}{field.name}", _listed(value)))
    return found


def _listed(value: object) -> str:
    """A tuple as a rig would write it."""
    text = str(value)
    return text.replace("(", "[").replace(")", "]") if text.startswith("(") else text


def _table(file: Path) -> None:
    content = read_table(file)
    names = set(content.names)
    if set(COLUMNS) <= names:
        _contacts(file)
    elif {"px", "py", "pz"} <= names and names & {"time", "start"}:
        _truth(file)
    else:
        _log(file, content)


def _contacts(file: Path) -> None:
    contacts = read_contacts(file)
    title(f"{file}: contacts")
    lines([("rows", f"{len(contacts):,}"), ("time", _span(contacts.time))])
    lines((label, percent(share)) for label, share in status_shares(contacts.estimate.status).items())
    note(contacts.notes)


def _truth(file: Path) -> None:
    truth = read_truth(file)
    touches = isinstance(truth, Touches)
    title(f"{file}: {'touches at known points' if touches else 'the truth at instants'}")
    time = np.concatenate([truth.start, truth.end]) if isinstance(truth, Touches) else truth.time
    lines([("rows", f"{len(truth.point):,}"), ("time", _span(time))])


def _log(file: Path, content: Table) -> None:
    title(f"{file}: a log")
    shown = ", ".join(content.names[:20]) + (", ..." if len(content.names) > 20 else "")
    lines([("columns", f"{len(content.names)}: {shown}"), ("rows", f"{len(content):,}")])
    wrench, time = guess_wrench(content.names), guess_time(content.names)
    if wrench is None or time is None:
        note([*content.notes, "no columns look like a time with three forces and three torques"])
        return
    recording = read_recording(file, Layout(time=time, wrench=wrench))
    steps = np.diff(recording.time[np.isfinite(recording.time)])
    usual = float(np.median(steps)) if len(steps) else float("nan")
    lines(
        [
            ("taken as", f"{time}; {', '.join(wrench)}"),
            ("time", f"{_span(recording.time)}, a step of {usual:.4g} (rate {1 / usual if usual > 0 else 0:.4g})"),
            ("orientation", _orientation(content, ORIENTATION in recording.channels)),
        ]
    )
    _ranges(recording.wrenches())
    note(recording.notes)


def _orientation(content: Table, usual: bool) -> str:
    if usual:
        return "qx, qy, qz, qw"
    guess = guess_orientation(content.names)
    return "none" if guess is None else f"perhaps {', '.join(guess)}"


def _ranges(wrenches: np.ndarray) -> None:
    noise = estimate_noise(wrenches)
    rows: list[list[str]] = []
    for k, name in enumerate(_CHANNELS):
        known = wrenches[np.isfinite(wrenches[:, k]), k]
        figures = (known.min(), np.median(known), known.max()) if len(known) else (np.nan,) * 3
        step = "" if noise is None else f"{noise[k]:.3g}"
        rows.append([name, *(f"{value:.4g}" for value in figures), step, f"{len(wrenches) - len(known)}"])
    table(("as N and N m", "least", "median", "most", "noise", "missing"), rows)


def _span(time: np.ndarray) -> str:
    known = time[np.isfinite(time)]
    return f"{known.min():.3f} to {known.max():.3f}" if len(known) else "none"


def _numbers(values: np.ndarray) -> str:
    return " x ".join(f"{value:.4g}" for value in values)
