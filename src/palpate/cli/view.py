"""`palpate view`: a log or a file of contacts as a page in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from tyro.conf import arg

from palpate.cli.interrupts import import_mesh_reader
from palpate.cli.options import Log
from palpate.cli.pipeline import open_pipeline
from palpate.cli.console import counting, note, progress, title
from palpate.cli.setup import Setup
from palpate.cli.skin import skin_scene
from palpate.contact.estimate import ContactEstimate
from palpate.contact.frames import in_frame
from palpate.errors import InputError
from palpate.io.contacts import Contacts, contact_blocks, read_contacts
from palpate.io.models import read_provenance
from palpate.io.rig import Rig
from palpate.io.rig.skin import is_skin_rig
from palpate.sensors.load_cells import LoadCells
from palpate.viewer.scene import Scene, prepare
from palpate.viewer.server import require_viser, serve
from palpate.viewer.skin import serve_skin

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
        log: a log, which is estimated first, or what `palpate estimate` wrote, which is shown as it is; with a [skin]
            in the rig frames of the sheet, shown cell by cell.
        setup: what is touched and how it is located.
        port: to serve at; the next free one if it is taken.
        host: address to serve at; the default can be reached from this machine only.
    """
    require_viser(host, port)  # before the work, not after it
    if setup.rig is not None and is_skin_rig(setup.rig):
        sheet, notes = skin_scene(log, setup.rig)
        title(f"{log}: {len(sheet):,} frames")
        note(notes)
        serve_skin(sheet, host, port, up=_say)
        return
    rig = setup.load()
    contacts = _written(log)
    scene, notes = _estimated(log, rig) if contacts is None else (_shown(contacts, log, rig), contacts.notes)
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
    return read_contacts(path)


def _estimated(path: Path, rig: Rig) -> tuple[Scene, list[str]]:
    """A log on its way through the whole chain, and what is to be known of it."""
    pipeline = open_pipeline(path, rig)
    times, parts, done = list[np.ndarray](), list[ContactEstimate](), 0
    with counting():
        for block, found in pipeline.stream():
            times.append(block.time)
            parts.append(found)
            done += len(block)
            progress(done, pipeline.log.position / max(pipeline.log.size, 1))
    scene = prepare(pipeline.surface, np.concatenate(times), ContactEstimate.joined(parts), path.name, _cells(rig))
    torn = [pipeline.log.torn] if pipeline.log.torn else []
    return scene, [*torn, *pipeline.said, *pipeline.remarks(), *pipeline.notes()]


def _shown(contacts: Contacts, path: Path, rig: Rig) -> Scene:
    """Contacts as they were written."""
    if not len(contacts):
        raise InputError("there is nothing to show: it has no rows.", where=str(path))
    if rig.mesh_path() is not None:
        import_mesh_reader()
    shown = _in_surface(contacts, path, rig)
    return prepare(rig.surface.load(rig.folder), contacts.time, shown, path.name, _cells(rig))


def _cells(rig: Rig) -> LoadCells | None:
    """Of a rig with load cells that are calibrated."""
    return None if rig.cells_path() is None else rig.cells()


def _in_surface(contacts: Contacts, path: Path, rig: Rig) -> ContactEstimate:
    """Contacts in the frame that the body is drawn in; which one they are in stands beside the file."""
    frame = read_provenance(path).get("frame", "surface")
    if frame == "base":
        raise InputError(
            "these contacts are in the base frame, in which the body moves.",
            where=str(path),
            mend="Estimate without --frame base, or view the log itself.",
        )
    return in_frame(contacts.estimate, rig.surface.pose.pose().inverse()) if frame == "sensor" else contacts.estimate
