"""`palpate view`: a log or a file of contacts as a page in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from jaxtyping import Float
from tyro.conf import arg

from palpate.cli.interrupts import import_mesh_reader
from palpate.cli.options import Log, RigFile
from palpate.cli.screen import note, progress, title, wait
from palpate.contact.estimate import ContactEstimate
from palpate.contact.frames import in_frame
from palpate.errors import InputError
from palpate.io.contacts import Contacts, read_contacts
from palpate.io.contacts_read import contact_blocks
from palpate.io.logs import read_recording
from palpate.io.models import load_toml
from palpate.io.rig import Rig, build, load_rig
from palpate.sensors.noise import estimate_noise
from palpate.surfaces.mesh import Mesh

__all__ = ["view"]

BLOCK = 5_000  # samples between two chances of hearing Ctrl-C


def view(
    log: Log,
    /,
    rig: RigFile,
    port: Annotated[int, arg(metavar="N")] = 8080,
    host: Annotated[str, arg(metavar="ADDRESS")] = "127.0.0.1",
) -> None:
    """Show contacts on the body, with a timeline to scrub and play, in a browser; Ctrl-C ends it.

    Args:
        log: a log, which is estimated first, or what `palpate estimate` wrote, which is shown as it is.
        rig: TOML of the set-up.
        port: to serve at; the next free one if it is taken.
        host: address to serve at; the default can be reached from this machine only.
    """
    from palpate.viewer.scene import prepare
    from palpate.viewer.server import require_viser, serve

    require_viser()  # before the work, not after it
    setup = load_rig(rig)
    if setup.mesh_path() is not None:
        import_mesh_reader()
    surface = setup.surface.load(setup.folder)
    contacts = _written(log)
    if contacts is None:
        time, estimate, notes = _estimated(log, setup, surface)
    else:
        time, estimate, notes = contacts.time, _in_surface(contacts, log, setup), contacts.notes
    if not len(time):
        raise InputError("there is nothing to show: it has no samples.", where=str(log))
    scene = prepare(surface, time, estimate, log.name)
    title(f"{log}: {len(time):,} samples")
    note([*surface.notes, *notes])
    serve(scene, host, port, up=lambda address: print(f"  open {address} in a browser; Ctrl-C ends it", flush=True))


def _written(path: Path) -> Contacts | None:
    """What a file of contacts holds; None where it is a log."""
    try:
        next(contact_blocks(path))
    except InputError:  # the reader of logs will say what it is instead
        return None
    return read_contacts(path)


def _in_surface(contacts: Contacts, path: Path, rig: Rig) -> ContactEstimate:
    """Contacts in the frame that the body is drawn in; which one they are in stands beside the file."""
    beside = path.with_name(f"{path.name}.toml")
    frame = load_toml(beside).get("frame", "surface") if beside.exists() else "surface"
    if frame == "base":
        raise InputError(
            "these contacts are in the base frame, in which the body moves.",
            where=str(path),
            mend="Estimate without --frame base, or view the log itself.",
        )
    return in_frame(contacts.estimate, rig.surface.pose.pose().inverse()) if frame == "sensor" else contacts.estimate


def _estimated(path: Path, rig: Rig, surface: Mesh) -> tuple[Float[np.ndarray, " n"], ContactEstimate, tuple[str, ...]]:
    recording = read_recording(path, rig.layout())
    noise = None if rig.force_torque.noise is not None else estimate_noise(recording.wrenches())
    wait("preparing the surface and compiling kernels (compiling happens once)")
    estimator = build(rig, surface=surface, noise=noise)
    parts: list[ContactEstimate] = []
    for start in range(0, len(recording), BLOCK):
        parts.append(estimator.run(recording.picked(slice(start, start + BLOCK))))
        progress(min(start + BLOCK, len(recording)), len(recording))
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])}
    return recording.time, ContactEstimate(**joined), recording.notes
