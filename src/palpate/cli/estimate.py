"""`palpate estimate`: a log and a surface go in, contacts come out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from pathlib import Path
from time import perf_counter
from typing import Annotated, Literal, TypeVar

import numpy as np
from tyro.conf import arg

from palpate.cli.interrupts import import_mesh_reader
from palpate.cli.options import FileOption, Log, Output, Pair, Scalar
from palpate.cli.screen import lines, note, percent, progress, title, wait
from palpate.contact.estimate import ContactEstimate, Status
from palpate.contact.estimator import Estimator
from palpate.contact.frames import in_base, in_frame
from palpate.contact.plausibility import lines_of_action, never_at_rest, unexplained
from palpate.errors import InputError
from palpate.io.atomic import keep_inputs
from palpate.io.contacts import write_contacts
from palpate.io.csv import read_recording
from palpate.io.models import provenance, write_provenance
from palpate.io.rig import Rig, build, load_rig
from palpate.io.rig_tables import RigEstimate, RigForceTorque, RigPair, RigSurface, RigThresholds
from palpate.sensors.noise import estimate_noise
from palpate.sensors.recording import ORIENTATION, POSITION, Recording

__all__ = ["estimate"]

Made = TypeVar("Made")
BLOCK = 5_000  # samples at a time: a long log need not be in memory at once, and Ctrl-C is heard in between


def estimate(
    log: Log,
    /,
    output: Output,
    rig: FileOption = None,
    mesh: FileOption = None,
    unit: Annotated[Literal["m", "cm", "mm", "um", "in"] | None, arg(metavar="UNIT", help_behavior_hint="")] = None,
    crease: Scalar = None,
    payload: FileOption = None,
    noise: Pair = None,
    method: Annotated[Literal["soft_finger", "wrench_axis"] | None, arg(metavar="NAME", help_behavior_hint="")] = None,
    friction: Scalar = None,
    torsion: Scalar = None,
    contact: Pair = None,
    frame: Literal["surface", "sensor", "base"] = "surface",
) -> None:
    """Locate contacts in a log of wrenches, with a rig file, or with a mesh alone.

    Options given here win over the rig. Beside OUTPUT stands OUTPUT.toml: versions, input hashes, options.

    Args:
        log: CSV with time,fx,fy,fz,tx,ty,tz and, where orientation matters, qx,qy,qz,qw (or as the rig says).
        output: contacts.csv to write.
        rig: TOML of the set-up.
        mesh: surface, when there is no rig: in the sensor's frame, unless a rig says more.
        unit: of the mesh file: m, cm, mm, um or in.
        crease: degrees; facets that meet by less are smooth across their edge; 0 is faceted (default 30).
        payload: model written by `palpate calibrate payload`.
        noise: standard deviation of one reading, force [N] and torque [N m]. Estimated from the log when not given.
        method: soft_finger (default) or wrench_axis.
        friction: bound on the tangent of the angle between force and normal (default 1).
        torsion: bound on torque about the normal over normal force [m] (default 0.005).
        contact: force [N] at which a contact begins, and below which it ends (default: 10 and 5 times the noise).
        frame: of the result; base needs the sensor's orientation and position in the log.
    """
    setup = _setup(rig, mesh, unit)
    setup = _overridden(setup, crease, payload, noise, method, friction, torsion, contact)
    beside = output.with_name(f"{output.name}.toml") if output.name else output
    keep_inputs(output, (log, rig, setup.mesh_path(), setup.payload_path()), beside=(beside,))
    recording = read_recording(log, setup.layout())
    if frame == "base":
        _require_pose(recording)
    if setup.mesh_path() is not None:
        import_mesh_reader()
    surface = setup.surface.load(setup.folder)
    from_log = None if setup.force_torque.noise is not None else estimate_noise(recording.wrenches())
    wait("preparing the surface and compiling kernels (compiling happens once)")
    begin = perf_counter()
    estimator = build(setup, surface=surface, noise=from_log)
    ready = perf_counter()
    contacts = _joined([estimator.run(block) for block in _blocks(recording)])
    done = perf_counter()
    write_contacts(output, recording.time, _in_frame(contacts, recording, setup, frame))
    record = provenance(
        {"log": log, "rig": rig, "mesh": setup.mesh_path(), "payload": setup.payload_path()},
        {
            **vars(setup.estimate),
            "contact": f"on {estimator.locator.on:g} N, off {estimator.locator.off:g} N",
            "crease": setup.surface.crease,
            "frame": frame,
            "noise": estimator.sensor.noise is not None and np.sqrt(np.diag(estimator.sensor.noise)).tolist(),
            "noise_source": _noise_source(setup, from_log),
        },
    )
    write_provenance(beside, record)
    title(f"{log} -> {output}")
    lines([("samples", f"{len(recording):,} in, {len(contacts.status):,} rows out")])
    lines(_shares(contacts))
    rate = len(recording) / max(done - ready, 1e-9)
    lines([("time", f"{done - ready:.2f} s, {rate:,.0f} samples/s (prepared in {ready - begin:.1f} s)")])
    note(_remarks(setup, estimator, from_log))
    note([*surface.notes, *recording.notes])
    note([*_doubts(recording, estimator), *unexplained(contacts.status)], kind="warning")


def _setup(rig: Path | None, mesh: Path | None, unit: str | None) -> Rig:
    """The rig, its mesh replaced where one is given; or the least rig that a mesh makes."""
    known = None if rig is None else load_rig(rig)
    if mesh is None:
        if known is None:
            raise InputError("nothing says what is touched.", mend="Give --rig RIG, or --mesh MESH --unit UNIT.")
        return known
    if unit is None:
        raise InputError(
            "a mesh file does not say its unit.", where=str(mesh), mend="Add --unit mm (or m, cm, um, in)."
        )
    if known is None:
        return _made("--mesh", lambda: Rig(RigSurface(mesh=str(mesh), unit=unit)))
    return replace(known, surface=replace(known.surface, kind="mesh", mesh=str(mesh.resolve()), unit=unit))


def _overridden(
    rig: Rig,
    crease: float | None,
    payload: Path | None,
    noise: tuple[float, float] | None,
    method: str | None,
    friction: float | None,
    torsion: float | None,
    contact: tuple[float, float] | None,
) -> Rig:
    """The rig with what the command line says."""
    stated = rig.estimate
    settings: RigEstimate = replace(stated, method=method or stated.method)
    if friction is not None:
        settings = _made("--friction", lambda: replace(settings, friction=friction))
    if torsion is not None:
        settings = _made("--torsion", lambda: replace(settings, torsion=torsion))
    if contact is not None:
        settings = _made("--contact", lambda: replace(settings, contact=RigThresholds(*contact)))
    surface = rig.surface if crease is None else _made("--crease", lambda: replace(rig.surface, crease=crease))
    sensor: RigForceTorque = rig.force_torque
    if payload is not None:
        sensor = replace(sensor, payload=str(payload.resolve()))
    if noise is not None:
        sensor = _made("--noise", lambda: replace(sensor, noise=RigPair(*noise)))
    return replace(rig, estimate=settings, surface=surface, force_torque=sensor)


def _made(option: str, make: Callable[[], Made]) -> Made:
    """What an option sets, checked as the rig's tables check theirs."""
    try:
        return make()
    except ValueError as problem:
        raise InputError(f"{problem}.", where=option) from problem


def _blocks(recording: Recording) -> Iterator[Recording]:
    """Pieces of a recording, counted for whoever watches."""
    for start in range(0, len(recording), BLOCK):
        yield _picked(recording, slice(start, start + BLOCK))
        progress(min(start + BLOCK, len(recording)), len(recording))


def _picked(recording: Recording, rows: slice) -> Recording:
    channels = {name: values[rows] for name, values in recording.channels.items()}
    return replace(recording, time=recording.time[rows], channels=channels)


def _joined(parts: list[ContactEstimate]) -> ContactEstimate:
    names = [field.name for field in fields(ContactEstimate)]
    return ContactEstimate(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def _in_frame(contacts: ContactEstimate, recording: Recording, rig: Rig, frame: str) -> ContactEstimate:
    mount = rig.surface.pose.pose()
    if frame == "base":
        return in_base(contacts, recording.channels[ORIENTATION], recording.channels[POSITION], mount)
    return contacts if frame == "surface" else in_frame(contacts, mount)


def _require_pose(recording: Recording) -> None:
    """Before the work, not after it."""
    for channel in (ORIENTATION, POSITION):
        if channel not in recording.channels:
            raise InputError(
                f"the base frame needs the sensor's {channel} in the base, which this log does not have.",
                where=recording.source,
                mend="Add columns qx,qy,qz,qw and x,y,z, or name them in the rig's [orientation] columns and position.",
            )


def _shares(contacts: ContactEstimate) -> list[tuple[str, str]]:
    counts = np.bincount(contacts.status, minlength=len(Status))
    total = len(contacts.status)
    return [(Status(k).label, f"{percent(n / total):>7}  {n:>9,}") for k, n in enumerate(counts.tolist()) if n]


def _noise_source(rig: Rig, from_log: np.ndarray | None) -> str:
    if rig.force_torque.noise is not None:
        return "given"
    return "unknown" if from_log is None else "steps of the log"


def _remarks(rig: Rig, estimator: Estimator, from_log: np.ndarray | None) -> list[str]:
    """What was assumed for want of being told."""
    said: list[str] = []
    if from_log is not None:
        force, torque = from_log[:3].max(), from_log[3:].max()
        said.append(
            f"noise taken from the log's steps: {force:.3g} N, {torque:.3g} N m (a filtered log looks too quiet)"
        )
    elif rig.force_torque.noise is None:
        said.append("the noise is not known and the log too short to tell it: no covariances")
    if estimator.payload is None:
        said.append("no payload model: wrenches are taken as they are, so they must be tared")
    if rig.surface.pose_covariance is None and estimator.sensor.noise is not None:
        said.append(
            "ellipses hold noise and payload only: where the surface sits is taken as exact (calibrate mounting)"
        )
    if rig.estimate.contact is None:
        locator = estimator.locator
        said.append(f"a contact begins at {locator.on:.3g} N and ends at {locator.off:.3g} N (from the noise)")
    return said


def _doubts(recording: Recording, estimator: Estimator) -> list[str]:
    """Units that do not fit; judged in the sensor's frame, whose origin a wrong unit draws the lines to."""
    surface = estimator.locator.surface
    thinned = _picked(recording, slice(None, None, 1 + len(recording) // BLOCK))
    wrenches, _, _ = estimator.contact_wrenches(thinned)
    sensed = wrenches @ estimator.mount.wrench_matrix().T  # saturated ones too: a wrong unit saturates a sensor
    said = [
        lines_of_action(sensed, estimator.mount.apply(surface.centre), surface.size).doubt,
        never_at_rest(sensed, estimator.locator.on),
    ]
    return [doubt for doubt in said if doubt]
