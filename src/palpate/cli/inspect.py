"""Run `palpate inspect`: summarise a log, mesh, rig, model or result in one screen."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from tyro.conf import arg

from palpate.cli.inspect_log import inspect_contacts, inspect_log, say_contents
from palpate.cli.spectrum import KINDS, draw_spectrum, located
from palpate.console.console import Quantity, in_full, lines, note, span, title
from palpate.console.options import FileOption, SomeFile
from palpate.contact.ground_truth import TrueTouches
from palpate.contact.table import COLUMNS
from palpate.errors import InputError
from palpate.files.atomic import PART, keep_inputs
from palpate.files.contacts import unfinished
from palpate.files.contacts.mcap import KIND
from palpate.files.ground_truth import read_ground_truth
from palpate.files.logs import LogContents, contents
from palpate.files.logs.topics import LIVE
from palpate.files.models import MODELS, load_toml, read_model
from palpate.files.urdf import Urdf
from palpate.live.record import RING
from palpate.live.recover import cut_short
from palpate.sensors.taxels.files import of_taxels
from palpate.sensors.taxels.place_formats import holds_taxels, read_taxel_places
from palpate.setup import Rig, load_rig
from palpate.setup.kinds import KINDS as SENSORS
from palpate.signals.recording import CELLS
from palpate.surfaces.mesh import UNITS, Mesh

__all__ = ["inspect"]

TORN = 3  # what was requested is done, but the log was torn
_TAXELS = (".txt", ".csv", ".urdf")
_MESHES = (".stl", ".obj", ".ply", ".dae")


def inspect(
    file: SomeFile,
    /,
    rig: FileOption = None,
    sensor: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="")] = None,
    topic: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="")] = None,
    spectrum: Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")] = None,
) -> None:
    """Show what is in a log, mesh, rig, model or result.

    Say what is in a log, a mesh, a rig, a model, a result or a truth; draw the spectrum of a log or a result.

    Args:
        file: a log or contacts (CSV, Parquet, MCAP, bag), a video, a folder of frames, STL, OBJ, PLY or DAE, a URDF,
            TOML, places of taxels, a truth.
        rig: TOML with the layout of the log; with it, spectra are those of the contact: force without the payload, and
            contact point.
        sensor: name of the sensor's table in the rig, where there are several that the log could be of.
        topic: topic of the sensor's readings, where the log has several; without it, all that have wrenches.
        spectrum: .html, .svg or .png to draw spectra into; the filter cut-off that they propose is printed.
    """
    suffix, whole = file.suffix.lower(), unfinished(file)
    cut = cut_short(file)
    if (not file.exists() and whole is None) or suffix == RING:
        raise InputError(cut or "the file does not exist.", where=str(file))
    note([cut] if cut else [], kind="warning")
    if spectrum is not None:  # before the work, not after it
        if spectrum.suffix.lower() not in KINDS:
            ends = f"a picture cannot end in {spectrum.suffix!r}."
            raise InputError(ends, where=str(spectrum), hint=f"Use {', '.join(KINDS)}.")
        keep_inputs(spectrum, (file, rig))
    if spectrum is None and rig is None and whole is None and suffix in _TAXELS and holds_taxels(file):
        _taxels(file)
    elif suffix in (*_MESHES, ".toml", ".urdf", ".xacro"):
        if spectrum is not None:
            what = "has no spectrum, because it is neither a log nor a result."
            raise InputError(what, where=str(file), hint="Give a log, or contacts of `palpate estimate`.")
        (_toml if suffix == ".toml" else _mesh if suffix in _MESHES else _urdf)(file)
    else:
        _data(whole or file, None if rig is None else load_rig(rig), sensor, topic, spectrum)


def _data(file: Path, rig: Rig | None, sensor: str | None, topic: str | None, output: Path | None) -> None:
    """Inspect a log, contacts, or a truth."""
    there = None if file.suffix == PART else contents(file)  # a folder of any other name is a bag
    torn = False
    live = there is not None and any(each.name.startswith(LIVE) for each in there.topics)
    asked = live and (rig is not None or sensor is not None or topic is not None)  # for what contacts were made of
    if there is None or (_holds_contacts(there) and not asked):
        recording = inspect_contacts(file)
        if there is not None and live:
            say_contents(there)
    elif {"px", "py", "pz"} <= set(there.names) and set(there.names) & {"time", "start"}:
        _ground_truth(file)
        recording = None
    else:
        recording, torn = inspect_log(file, rig, sensor, topic)
        if output is not None and recording is not None and rig is not None:
            recording = located(recording, rig.resolve(rig.kind(sensor)))
    if output is not None:
        if recording is None or not len(recording):
            raise InputError("has no spectrum, because it contains no wrenches over time.", where=str(file))
        draw_spectrum(recording, output, file.name)
    if torn:
        raise SystemExit(TORN)


def _holds_contacts(there: LogContents) -> bool:
    ours = KIND.replace("/msg/", "/")
    return set(COLUMNS) <= set(there.names) or any(topic.kind.replace("/msg/", "/") == ours for topic in there.topics)


def _mesh(file: Path) -> None:
    mesh = Mesh.load(file, unit="m")
    extent = mesh.bounds[1] - mesh.bounds[0]
    title(f"{file}: a mesh")
    lines(
        [
            ("facets", Quantity(f"{len(mesh.faces):,}, of {len(mesh.vertices):,} vertices", len(mesh.faces))),
            ("bodies", Quantity(f"{mesh.bodies:,}, {_closed(mesh)}", mesh.bodies)),
            *([("open edges", mesh.open_edges)] if in_full() else []),
            ("covered", mesh.coverage or "none: every facet can be reached from outside"),
            ("extent", Quantity(f"{_numbers(extent)} in the file's unit", extent)),
            ("middle", Quantity(_numbers(mesh.centre), mesh.centre)),
            ("mean edge", f"{mesh.edge:.4g}"),
            *(
                (f"as {unit}", Quantity(f"{1e3 * scale * mesh.size:.4g} mm across", scale * mesh.size))
                for unit, scale in UNITS.items()
                if unit != "um"
            ),
        ]
    )
    note(text for text in mesh.notes if " as m" not in text)
    if mesh.coverage:
        note(["covered facets cannot have contacts, unless the rig's [surface] has `covered = true`"])


def _closed(mesh: Mesh) -> str:
    return f"{mesh.open_edges:,} open edges" if mesh.open_edges else "watertight"


def _taxels(file: Path) -> None:
    places = read_taxel_places(file)
    title(f"{file}: places of taxels")
    lines(of_taxels(places))
    note(places.notes)


def _urdf(file: Path) -> None:
    urdf = Urdf(file)
    moving = [joint.name for joint in urdf.joints if joint.kind != "fixed" and not joint.mimics]
    title(f"{file}: a robot")
    lines(
        [
            ("links", f"{len(urdf.links)}, with a geometry: {', '.join(urdf.shaped()) or 'none'}"),
            ("joints", f"{len(urdf.joints)}, moving: {', '.join(moving) or 'none'}"),
        ]
    )


def _toml(file: Path) -> None:
    content = load_toml(file)
    model = MODELS.get(str(content.get("kind")))
    if model is not None:
        value: Any = read_model(file)
        title(f"{file}: {model.called}")
        lines(model.summary(value))
        lines(getattr(value, "provenance", {}).items())
        note(getattr(value, "notes", ()))
    elif set(content) & {"surface", *SENSORS}:
        rig = load_rig(file)
        title(f"{file}: a rig")
        lines([("sensors", ", ".join(f"{kind.called} [{kind.name}]" for kind in rig.kinds))])
        lines(_settings(rig, ""))
        note([f"{path} does not exist yet" for path in rig.files().values() if not path.exists()], kind="warning")
    else:
        title(f"{file}: TOML")
        lines((name, value) for name, value in content.items())


_IDLE = {  # keys of a table that mean nothing to what its kind is
    "mesh": ("point", "normal", "half_width"),
    "plane": ("crease", "covered"),
    "none": ("q", "r", "cutoff", "order"),
    "kalman": ("cutoff", "order"),
    "butterworth": ("q", "r"),
    "zero_phase": ("q", "r"),
}


def _settings(values: Any, prefix: str) -> list[tuple[str, object]]:
    """Return every setting in force, defaults included, by its dotted key."""
    found: list[tuple[str, object]] = []
    hidden = ("folder", "pose_covariance", *_IDLE.get(getattr(values, "kind", ""), ()))
    for field in fields(values):
        value: object = getattr(values, field.name)
        if (
            field.name == "contacts"
            and isinstance(values, Rig)
            and not any(CELLS in each.channels for each in values.kinds)
        ):
            continue  # a rig's are of taxels
        if field.name == "sensors":
            for name, table in values.sensors.items():
                found += _settings(table, f"{name}.")
        elif is_dataclass(value):
            found += _settings(value, f"{prefix}{field.name}.")
        elif value is not None and field.name not in hidden:
            found.append((f"{prefix}{field.name}", _listed(value)))
    return found


def _listed(value: object) -> Quantity:
    """Return a value as text, a tuple as a rig would write it."""
    text = str(value)
    return Quantity(text.replace("(", "[").replace(")", "]") if text.startswith("(") else text, value)


def _ground_truth(file: Path) -> None:
    from palpate.cli.evaluate import truth_times  # here: a log needs nothing of it

    truth = read_ground_truth(file)
    title(f"{file}: {'touches at known points' if isinstance(truth, TrueTouches) else 'the truth at single times'}")
    lines([("rows", f"{len(truth.point):,}"), ("time", span(truth_times(truth)))])


def _numbers(values: np.ndarray) -> str:
    return " x ".join(f"{value:.4g}" for value in values)
