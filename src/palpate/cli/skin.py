"""What `estimate`, `view` and `evaluate` do with a rig that has a [skin]."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from time import perf_counter

import numpy as np
from jaxtyping import Float, Float32

from palpate.cli.interrupts import import_mesh_reader, uninterrupted
from palpate.cli.screen import counting, lines, note, percent, progress, title, wait
from palpate.contact.contacts import Contacts
from palpate.contact.estimate import Status
from palpate.contact.several import Skin, SkinTouches
from palpate.errors import InputError
from palpate.io.atomic import keep_inputs
from palpate.io.contacts import ContactsWriter, open_contacts, require_format
from palpate.io.logs.frames import FrameLog, open_frames
from palpate.io.models import provenance, write_provenance
from palpate.io.rig.skin import SkinRig, build_skin, load_skin_rig
from palpate.sensors.skin import Frames, examine
from palpate.sensors.skin_map import SkinMap
from palpate.viewer.scene import Scene, prepare
from palpate.viewer.taxels import TaxelLayer

__all__ = ["SkinPipeline", "estimate_skin", "open_skin", "skin_scene", "taxel_layer"]

HEAD = 2048  # frames from which rest, noise and faults are taken
TORN, INTERRUPTED = 3, 130


@dataclass
class SkinPipeline:
    """A log of frames on its way to touches, once.

    Attributes:
        log, rig, skin: what it is made of.
        seconds: spent on preparing, reading and finding.
    """

    log: FrameLog
    rig: SkinRig
    skin: Skin
    _blocks: Iterator[Frames]
    seconds: dict[str, float] = field(default_factory=lambda: {"prepare": 0.0, "read": 0.0, "find": 0.0})

    def stream(
        self, forces: Callable[[Float[np.ndarray, "n rows columns"]], None] | None = None
    ) -> Iterator[tuple[Frames, SkinTouches]]:
        """Blocks of the log with their touches; `forces` is given the force [N] of each cell of each block."""
        first = 0
        while True:
            begin = perf_counter()
            block = next(self._blocks, None)
            self.seconds["read"] += perf_counter() - begin
            if block is None:
                return
            begin = perf_counter()
            cells = None if forces is None else np.empty(block.cells.shape)
            found = self.skin.run(block, first, cells)
            if forces is not None and cells is not None:
                forces(cells)
            self.seconds["find"] += perf_counter() - begin
            first += len(block)
            yield block, found

    def notes(self) -> list[str]:
        """What was met on the way, so far."""
        said = list(dict.fromkeys((*self.skin.place.notes, *self.skin.notes(), *self.log.notes())))
        if self.rig.skin.intensity is None:
            said.append("no intensity model: a count is taken for a newton (palpate calibrate intensity makes one)")
        if self.rig.skin.tare is None:
            said.append("cells at rest are found in the log itself; tare = seconds in [skin] says when nothing touches")
        return said


def open_skin(path: Path, rig_path: Path) -> SkinPipeline:
    """Open a log of frames and prepare all that they go through.

    Raises:
        InputError: the log, the map or the curves cannot be used, or every cell is stuck.
    """
    rig = load_skin_rig(rig_path)
    wait("preparing the sheet and compiling kernels (compiling happens once)")
    begin = perf_counter()
    place = rig.place()
    log = open_frames(path, rig.layout(place))
    blocks, first, count = log.blocks(), list[Frames](), 0
    for block in blocks:
        first.append(block)
        count += len(block)
        if count >= HEAD:
            break
    if not count:
        raise InputError("holds no frames.", where=str(path))
    head = Frames(
        np.concatenate([block.time for block in first]), np.concatenate([block.cells for block in first]), path.name
    )
    sheet = rig.sheet(place)
    falling = rig.intensity().curves[0].falling
    health = examine(head.turned() if falling else head, sheet, seconds=rig.skin.tare)
    skin = build_skin(rig, place, health.turned() if falling else health)
    pipeline = SkinPipeline(log, rig, skin, chain(first, blocks))
    pipeline.seconds["prepare"] = perf_counter() - begin
    return pipeline


def estimate_skin(log: Path, output: Path, rig_path: Path) -> None:
    """Frames to contacts: `palpate estimate` for a rig with a [skin]."""
    rig = load_skin_rig(rig_path)
    beside = output.with_name(f"{output.name}.toml") if output.name else output
    keep_inputs(output, (log, rig_path, rig.map_path(), rig.intensity_path()), beside=(beside,))
    require_format(output)
    pipeline = open_skin(log, rig_path)
    counts = np.zeros(len(Status), dtype=np.int64)
    with open_contacts(output, frame_id="surface", skin=True) as writer, counting():
        interrupted, frames, most = _write(pipeline, writer, counts)
    ended = "interrupted" if interrupted else "torn" if pipeline.log.torn else "whole"
    inputs = {"log": log, "rig": rig_path, "map": rig.map_path(), "intensity": rig.intensity_path()}
    options = {**vars(rig.contacts), "frame": "surface", "sensor": "skin", "ended": ended}
    write_provenance(beside, provenance(inputs, options))
    title(f"{log} -> {output}")
    lines([("frames", f"{frames:,} in, {writer.rows:,} rows out; up to {most} touches at once")])
    lines((Status(k).label, f"{percent(n / writer.rows):>7}  {n:>9,}") for k, n in enumerate(counts.tolist()) if n)
    spent = pipeline.seconds
    parts = ", ".join(f"{name} {seconds:.2f} s" for name, seconds in spent.items())
    lines([("time", f"{parts}; {frames / max(spent['find'], 1e-9):,.0f} frames/s found")])
    note(pipeline.notes())
    short = [f"interrupted: {output.name} holds the {frames:,} frames done until then"] if interrupted else []
    short += [pipeline.log.torn] if pipeline.log.torn else []
    note(short, kind="warning")
    if short:
        raise SystemExit(INTERRUPTED if interrupted else TORN)


def _write(pipeline: SkinPipeline, writer: ContactsWriter, counts: np.ndarray) -> tuple[bool, int, int]:
    """Every frame of the log; whether Ctrl-C ended it, how many frames, and the most touches of one."""
    done = most = 0
    try:
        for block, found in pipeline.stream():
            cell = np.column_stack([found.row, found.column, found.area])
            with uninterrupted():  # a block is written and counted, or neither
                writer.write(found.time, found.estimate, sample=found.sample, contact=found.contact, cell=cell)
                done += len(block)
                counts += np.bincount(found.estimate.status, minlength=len(counts))
            if found.found.any():
                most = max(most, int(np.bincount(found.sample[found.found] - found.sample[0]).max()))
            progress(done, pipeline.log.position / max(pipeline.log.size, 1))
    except KeyboardInterrupt:
        if not writer.rows:
            raise
        return True, done, most
    return False, done, most


def skin_scene(log: Path, rig_path: Path) -> tuple[Scene, list[str]]:
    """A log of frames to look at, and what is to be known of it: `palpate view` for a rig with a [skin]."""
    pipeline = open_skin(log, rig_path)
    forces, parts, done = list[np.ndarray](), list[Contacts](), 0
    with counting():
        for block, found in pipeline.stream(lambda cells: forces.append(cells.astype(np.float32))):
            features = {name: getattr(found, name) for name in ("row", "column", "area", "pressure")}
            parts.append(Contacts(found.sample, found.time, found.contact, found.estimate, features))
            done += len(block)
            progress(done, pipeline.log.position / max(pipeline.log.size, 1))
    rig = pipeline.rig
    if rig.surface is not None and rig.surface.mesh is not None:
        import_mesh_reader()
    body = None if rig.surface is None else rig.surface.load(rig.folder)
    layer = taxel_layer(pipeline.skin.place, np.concatenate(forces).reshape(done, -1))
    torn = [pipeline.log.torn] if pipeline.log.torn else []
    return prepare(body, Contacts.joined(parts), log.name, [layer]), [*torn, *pipeline.notes()]


def taxel_layer(place: SkinMap, forces: Float32[np.ndarray, "n k"] | None = None) -> TaxelLayer:
    """Of the cells of a map, with the force [N] of each in every frame where it is known."""
    shape = (place.rows, place.columns)
    return TaxelLayer(place.centres.reshape(-1, 3), place.normals.reshape(-1, 3), place.areas.ravel(), shape, forces)
