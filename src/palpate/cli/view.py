"""`palpate view`: a log or a file of contacts as a page in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from palpate.cli.interrupts import import_mesh_reader
from palpate.cli.options import Log
from palpate.cli.pipeline import open_pipeline
from palpate.cli.screen import counting, note, progress, title
from palpate.cli.setup import Setup
from palpate.cli.skin import skin_scene, taxel_layer
from palpate.contact.contacts import Contacts
from palpate.contact.frames import in_frame
from palpate.errors import InputError
from palpate.io.contacts import contact_blocks, read_contacts
from palpate.io.models import read_provenance
from palpate.io.rig import Rig
from palpate.io.rig.skin import is_skin_rig, load_skin_rig
from palpate.spatial.pose import Pose
from palpate.viewer.load_cells import LoadCellLayer
from palpate.viewer.scene import Scene, prepare
from palpate.viewer.server import require_viser, serve

__all__ = ["view"]


def view(
    log: Log,
    /,
    setup: Annotated[Setup, arg(name="")],
    port: Annotated[int, arg(metavar="N")] = 8080,
    host: Annotated[str, arg(metavar="ADDRESS")] = "127.0.0.1",
) -> None:
    """Show contacts on the body, with a timeline to scrub and play, in a browser; Ctrl-C ends it.

    Args:
        log: a log, which is estimated first, or what `palpate estimate` wrote, which is shown as it is.
        setup: what is touched and how it is located.
        port: to serve at; the next free one if it is taken.
        host: address to serve at; the default can be reached from this machine only.
    """
    require_viser(host, port)  # before the work, not after it
    contacts = _written(log)
    if setup.rig is not None and is_skin_rig(setup.rig):
        scene, notes = skin_scene(log, setup.rig) if contacts is None else _shown_skin(contacts, log, setup.rig)
    else:
        rig = setup.load()
        scene, notes = _estimated(log, rig) if contacts is None else _shown(contacts, log, rig)
    title(f"{log}: {len(scene):,} samples")
    note(notes)
    serve(scene, host, port, up=_say)


def _say(address: str) -> None:
    print(f"  open {address} in a browser; Ctrl-C ends it", flush=True)


def _written(path: Path) -> Contacts | None:
    """What a file of contacts holds; None where it is a log."""
    try:
        next(contact_blocks(path))
    except InputError:  # the reader of logs will say what it is instead
        return None
    found = read_contacts(path)
    cell = () if found.cell is None else found.cell.T
    features = {name: values for name, values in zip(("row", "column", "area"), cell, strict=False)}
    return Contacts(found.sample, found.time, found.contact, found.estimate, features, found.notes)


def _estimated(path: Path, rig: Rig) -> tuple[Scene, list[str]]:
    """A log on its way through the whole chain, and what is to be known of it."""
    pipeline = open_pipeline(path, rig)
    parts, done = list[Contacts](), 0
    with counting():
        for block, found in pipeline.stream():
            parts.append(Contacts.single(block.time, found, done))
            done += len(block)
            progress(done, pipeline.log.position / max(pipeline.log.size, 1))
    scene = prepare(pipeline.surface, Contacts.joined(parts), path.name, _layers(rig))
    torn = [pipeline.log.torn] if pipeline.log.torn else []
    return scene, [*torn, *pipeline.said, *pipeline.remarks(), *pipeline.notes()]


def _shown(contacts: Contacts, path: Path, rig: Rig) -> tuple[Scene, tuple[str, ...]]:
    """Contacts as they were written."""
    shown = _in_surface(contacts, path, rig.surface.pose.pose())
    if rig.mesh_path() is not None:
        import_mesh_reader()
    return prepare(rig.surface.load(rig.folder), shown, path.name, _layers(rig)), contacts.notes


def _shown_skin(contacts: Contacts, path: Path, rig_path: Path) -> tuple[Scene, tuple[str, ...]]:
    """Contacts of a sheet as they were written, without the forces of its cells."""
    rig = load_skin_rig(rig_path)
    mount = Pose.identity() if rig.surface is None else rig.surface.pose.pose()
    shown = _in_surface(contacts, path, mount)
    if rig.surface is not None and rig.surface.mesh is not None:
        import_mesh_reader()
    body = None if rig.surface is None else rig.surface.load(rig.folder)
    return prepare(body, shown, path.name, [taxel_layer(rig.place())]), contacts.notes


def _layers(rig: Rig) -> list[LoadCellLayer]:
    """Of a rig with load cells that are calibrated."""
    return [] if rig.cells_path() is None else [LoadCellLayer(rig.cells())]


def _in_surface(contacts: Contacts, path: Path, mount: Pose) -> Contacts:
    """Contacts in the frame that the body is drawn in; which one they are in stands beside the file."""
    frame = read_provenance(path).get("frame", "surface")
    if frame == "base":
        raise InputError(
            "these contacts are in the base frame, in which the body moves.",
            where=str(path),
            mend="Estimate without --frame base, or view the log itself.",
        )
    return contacts.with_estimate(in_frame(contacts.estimate, mount.inverse())) if frame == "sensor" else contacts
