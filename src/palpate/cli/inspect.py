"""Run `palpate inspect`: summarise a log, mesh, rig, model or result in one screen."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from palpate.cli.estimate_log import TORN
from palpate.cli.inspect_log import inspect_contacts, inspect_log, say_contents
from palpate.cli.inspect_robot import inspect_robot, inspect_robot_log
from palpate.console.console import Quantity, in_full, lines, note, span, title
from palpate.console.options import FileOption, NameOption, SomeFile
from palpate.contact.table import COLUMNS
from palpate.errors import InputError
from palpate.files.atomic import PART, RING, keep_inputs
from palpate.files.contacts import unfinished
from palpate.files.contacts.mcap import KIND
from palpate.files.logs import LogContents, contents
from palpate.files.logs.topics import LIVE
from palpate.files.models import MODELS, load_toml, read_model
from palpate.setup import Rig, load_rig
from palpate.setup.kinds import KINDS as SENSORS
from palpate.setup.load import robot_of
from palpate.signals.recording import CELLS
from palpate.surfaces.collada import ColladaAsset
from palpate.surfaces.mesh import UNITS, Mesh, unit_named

_TAXELS = (".txt", ".csv", ".urdf")
_MESHES = (".stl", ".obj", ".ply", ".dae")


def inspect(
    file: SomeFile,
    /,
    rig: FileOption = None,
    sensor: NameOption = None,
    topic: NameOption = None,
    spectrum: FileOption = None,
) -> None:
    """Show what is in a log, mesh, rig, model or result.

    Say what is in a log, a mesh, a rig, a model, a result or a truth; draw the spectrum of a log or a result.

    Args:
        file: a log or contacts (CSV, Parquet, MCAP, bag), a video, a folder of frames, STL, OBJ, PLY or DAE, a URDF,
            TOML, places of taxels, a truth, a calibration of ATI (.cal).
        rig: TOML with the layout of the log; with it, spectra are those of the contact: force without the payload, and
            contact point.
        sensor: name of the sensor's table in the rig, where there are several that the log could be of; of a robot's
            sensors, with commas between.
        topic: topic of the sensor's readings, where the log has several; without it, all that have wrenches.
        spectrum: .html, .svg or .png to draw spectra into; the filter cut-off that they propose is printed.

    Raises:
        InputError: the file cannot be read, an option does not fit it, or it has no spectrum.
        OSError: the rest of a live record cannot be read.
        SystemExit: 3: the log was torn.
    """
    suffix, incomplete, cut = file.suffix.lower(), unfinished(file), _cut_short(file)
    if (not file.exists() and incomplete is None) or suffix == RING:
        raise InputError(cut or "the file does not exist.", where=str(file))
    note([cut] if cut else [], kind="warning")
    if spectrum is not None:  # before the work, not after it
        from palpate.cli.spectrum import KINDS

        if spectrum.suffix.lower() not in KINDS:
            hint = f"Use {', '.join(KINDS)}."
            raise InputError(f"a picture cannot end in {spectrum.suffix!r}.", where=str(spectrum), hint=hint)
        keep_inputs(spectrum, (file, rig))
    if spectrum is None and rig is None and incomplete is None and _holds_taxels(file):
        _taxels(file)
    elif suffix in (*_MESHES, ".toml", ".urdf", ".xacro", ".cal"):
        if spectrum is not None:
            what = "has no spectrum, because it is neither a log nor a result."
            raise InputError(what, where=str(file), hint="Give a log, or contacts of `palpate estimate`.")
        {".toml": _toml, ".cal": _ati, **dict.fromkeys(_MESHES, _mesh)}.get(suffix, _urdf)(file)
    else:
        robot = None if rig is None else robot_of(rig)
        if robot is not None and topic is None and spectrum is None and (sensor is None or "," in sensor):
            if inspect_robot_log(incomplete or file, robot, sensor):
                raise SystemExit(TORN)
            return
        _data(incomplete or file, None if rig is None else load_rig(rig, sensor), sensor, topic, spectrum)


def _cut_short(file: Path) -> str:
    """Return `palpate.live.recover.cut_short` of a file, without importing it where nothing is of a live record."""
    if ".mcap" not in file.name.lower():
        return ""
    from palpate.live.recover import cut_short

    return cut_short(file)


def _holds_taxels(file: Path) -> bool:
    if file.suffix.lower() not in _TAXELS:
        return False
    from palpate.sensors.taxels.place_formats import holds_taxels

    return holds_taxels(file)


def _data(file: Path, rig: Rig | None, sensor: str | None, topic: str | None, output: Path | None) -> None:
    """Inspect a log, contacts, or a truth."""
    there = None if file.suffix == PART else contents(file)  # a folder of any other name is a bag
    torn, recording = False, None
    live = there is not None and any(each.name.startswith(LIVE) for each in there.topics)
    readings = live and (rig, sensor, topic) != (None, None, None)  # what contacts were made of
    if there is None or (_holds_contacts(there) and not readings):
        recording = inspect_contacts(file)
        if there is not None and live:
            say_contents(there)
    elif {"px", "py", "pz"} <= set(there.names) and set(there.names) & {"time", "start"}:
        _ground_truth(file)
    else:
        recording, torn = inspect_log(file, rig, sensor, topic)
        if output is not None and recording is not None and rig is not None:
            from palpate.cli.spectrum import located

            recording = located(recording, rig.resolve(rig.kind(sensor)))
    if output is not None:
        if recording is None or not len(recording):
            raise InputError("has no spectrum, because it contains no wrenches over time.", where=str(file))
        from palpate.cli.spectrum import draw_spectrum

        draw_spectrum(recording, output, file.name)
    if torn:
        raise SystemExit(TORN)


def _holds_contacts(there: LogContents) -> bool:
    ours = KIND.replace("/msg/", "/")
    return set(COLUMNS) <= set(there.names) or any(topic.kind.replace("/msg/", "/") == ours for topic in there.topics)


def _mesh(file: Path) -> None:
    own = ColladaAsset.of(file).metres
    mesh = Mesh.load(file, unit="m" if own is None else None)
    extent, where = mesh.bounds[1] - mesh.bounds[0], "in the file's unit" if own is None else "m"
    closed = f"{mesh.open_edges:,} open edges" if mesh.open_edges else "watertight"
    title(f"{file}: a mesh")
    lines(
        [
            ("facets", Quantity(f"{len(mesh.faces):,}, of {len(mesh.vertices):,} vertices", len(mesh.faces))),
            ("bodies", Quantity(f"{mesh.bodies:,}, {closed}", mesh.bodies)),
            *([("open edges", mesh.open_edges)] if in_full() else []),
            ("covered", mesh.coverage or "none: every facet can be reached from outside"),
            *([] if own is None else [("unit", f"{unit_named(own)}, as the file states")]),
            ("extent", Quantity(f"{_numbers(extent)} {where}", extent)),
            ("middle", Quantity(_numbers(mesh.centre), mesh.centre)),
            ("mean edge", f"{mesh.edge:.4g}"),
            *(
                (f"as {unit}", Quantity(f"{1e3 * scale * mesh.size:.4g} mm across", scale * mesh.size))
                for unit, scale in UNITS.items()
                if unit != "um" and own is None
            ),
            *([] if own is None else [("size", Quantity(f"{1e3 * mesh.size:.4g} mm across", mesh.size))]),
        ]
    )
    note(text for text in mesh.notes if own is not None or "if its unit is m;" not in text)
    if mesh.coverage:
        note(["covered facets cannot have contacts, unless the rig's [surface] has `covered = true`"])


def _taxels(file: Path) -> None:
    from palpate.sensors.taxels.files import of_taxels
    from palpate.sensors.taxels.place_formats import read_taxel_places

    places = read_taxel_places(file)
    title(f"{file}: places of taxels")
    lines(of_taxels(places))
    note(places.notes)


def _urdf(file: Path) -> None:
    from palpate.files.urdf import Urdf

    urdf = Urdf(file)
    moving = [joint.name for joint in urdf.joints if joint.kind != "fixed" and not joint.mimics]
    title(f"{file}: a robot")
    lines(
        [
            ("links", f"{len(urdf.links)}, with a geometry: {', '.join(urdf.shaped()) or 'none'}"),
            ("joints", f"{len(urdf.joints)}, moving: {', '.join(moving) or 'none'}"),
        ]
    )


def _ati(file: Path) -> None:
    from palpate.files.ati import AtiCalibration

    found = AtiCalibration.of(file)
    rated = [f"{value:.6g}" for value in found.ranges]
    title(f"{file}: ATI's calibration of a force/torque sensor")
    lines(
        [
            ("sensor", " ".join(filter(None, (found.model, found.serial, found.part)))),
            ("calibrated", found.date or "no date"),
            ("units", ", ".join(found.units)),
            ("range", Quantity(f"{', '.join(rated[:3])} N; {', '.join(rated[3:])} N m", found.ranges)),
        ]
    )
    units = 'units = {{ force = "{}", torque = "{}" }}'.format(*found.units)
    limits = f"range = {{ force = [{', '.join(rated[:3])}], torque = [{', '.join(rated[3:])}] }}"
    note([f"in [force_torque] of a rig for a log of forces and torques in these units: {units} and {limits}"])


def _toml(file: Path) -> None:
    content = load_toml(file)
    model = MODELS.get(str(content.get("kind")))
    if model is not None:
        value: Any = read_model(file)
        title(f"{file}: {model.called}")
        lines(model.summary(value))
        lines(getattr(value, "provenance", {}).items())
        note(getattr(value, "notes", ()))
    elif (robot := robot_of(file)) is not None:
        inspect_robot(robot)
    elif set(content) & {"surface", *SENSORS}:
        rig = load_rig(file)
        title(f"{file}: a rig")
        lines([("sensors", ", ".join(f"{kind.called} [{kind.name}]" for kind in rig.kinds))])
        lines(_settings(rig, ""))
        note([f"{path} does not exist yet" for path in rig.files().values() if not path.exists()], kind="warning")
    else:
        title(f"{file}: TOML")
        lines((name, value) for name, value in content.items())


_USUAL = {"acts_on": "body", "reference": "sensor", "inverse": False, "form": "quaternion"}  # not worth a line
_IDLE = {  # keys of a table that mean nothing to what its kind is
    "mesh": ("point", "normal", "half_width"),
    "plane": ("crease", "covered"),
    "none": ("q", "r", "cutoff", "order"),
    "kalman": ("cutoff", "order"),
    "butterworth": ("q", "r"),
    "zero_phase": ("q", "r"),
}


def _settings(values: Any, prefix: str) -> list[tuple[str, object]]:
    """Return (dotted key, value) of every setting in force, with most defaults."""
    found: list[tuple[str, object]] = []
    hidden = {"folder", "pose_covariance", *_IDLE.get(getattr(values, "kind", ""), ())}
    if isinstance(values, Rig) and not any(CELLS in each.channels for each in values.kinds):
        hidden.add("contacts")  # a rig's are of taxels
    for field in sorted(fields(values), key=lambda field: field.name not in ("surface", "sensors")):
        value: object = getattr(values, field.name)
        if value is None or field.name in hidden or _USUAL.get(field.name) == value:
            continue
        if field.name == "sensors":
            for name, table in values.sensors.items():
                found += _settings(table, f"{name}.")
        elif is_dataclass(value):
            found += _settings(value, f"{prefix}{field.name}.")
        else:
            found.append((f"{prefix}{field.name}", _listed(value)))
    return found


def _listed(value: object) -> Quantity:
    """Return a value with its text, a tuple as in a rig."""
    text = str(value)
    return Quantity(text.replace("(", "[").replace(")", "]") if text.startswith("(") else text, value)


def _ground_truth(file: Path) -> None:
    from palpate.cli.evaluate import truth_times  # here: a log needs nothing of it
    from palpate.contact.ground_truth import TrueTouches
    from palpate.files.ground_truth import read_ground_truth

    truth = read_ground_truth(file)
    title(f"{file}: {'touches at known points' if isinstance(truth, TrueTouches) else 'the truth at single times'}")
    lines([("rows", f"{len(truth.point):,}"), ("time", span(truth_times(truth)))])


def _numbers(values: np.ndarray) -> str:
    return " x ".join(f"{value:.4g}" for value in values)
