"""What is fuzzed: a function of bytes for each reader, which may raise nothing but a `PalpateError`."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

from palpate.errors import PalpateError
from palpate.files.contacts import read_contacts
from palpate.files.logs import contents, open_log
from palpate.files.models import read_model
from palpate.files.urdf import Urdf
from palpate.live.cobs import CobsFrames
from palpate.live.lines import LineFrames
from palpate.setup.load import load_rig, robot_of
from palpate.surfaces import Mesh
from palpate.viewer.guard import Widget, WidgetKind, judged

Target = Callable[[bytes], None]
_MEMORY = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
_FOLDER = Path(tempfile.mkdtemp(prefix="palpate-fuzz-", dir=_MEMORY))


def _file(suffix: str, *readers: Callable[[Path], object]) -> Target:
    """Return the target that writes the bytes to a file and reads it in all of these ways."""
    path = _FOLDER / f"input{suffix}"

    def target(data: bytes) -> None:
        path.write_bytes(data)
        for read in readers:
            with suppress(PalpateError):
                read(path)

    return target


def _log(path: Path) -> None:
    for _ in open_log(path).blocks():
        pass


def _urdf(path: Path) -> None:
    urdf = Urdf(path)
    for link in urdf.links[:8]:
        with suppress(PalpateError):
            urdf.root(link)
            urdf.body(link)


def _frames(make: Callable[[], CobsFrames | LineFrames]) -> Target:
    """Return the target that feeds a decoder of a serial port, in pieces whose sizes the first bytes give."""

    def target(data: bytes) -> None:
        decoder, at = make(), 4
        values, lost = np.empty((64, 6)), np.empty(64, dtype=np.int64)
        while at < len(data):
            size = 1 + data[at % 4] % 61
            decoder.feed(data[at : at + size])
            at += size
            while decoder.take(values, lost):
                pass
        decoder.faults()

    return target


def _page(data: bytes) -> None:
    widgets = [
        Widget(WidgetKind.PRESS),
        Widget(WidgetKind.CHOOSE, True, ("a", "b")),
        Widget(WidgetKind.SET, True, (), 0, 1),
    ]
    for widget in (None, *widgets):
        judged(data, lambda _, found=widget: found)


TARGETS: dict[str, Target] = {
    "csv": _file(".csv", contents, _log),
    "mcap": _file(".mcap", contents, _log),
    "bag": _file(".bag", contents, _log),
    "parquet": _file(".parquet", contents, _log),
    "npy": _file(".npy", contents, _log),
    "rig": _file(".toml", robot_of, load_rig),
    "model": _file(".toml", read_model),
    "contacts": _file(".csv", read_contacts),
    "contacts_mcap": _file(".mcap", read_contacts),
    "stl": _file(".stl", lambda path: Mesh.load(path, unit="mm")),
    "obj": _file(".obj", lambda path: Mesh.load(path, unit="mm")),
    "urdf": _file(".urdf", _urdf),
    "cobs": _frames(lambda: CobsFrames(6)),
    "lines": _frames(lambda: LineFrames(6)),
    "page": _page,
}
"""Name -> target."""
SEEDS = {
    "csv": ("touches.csv", "free_motion.csv"),
    "mcap": ("touches.mcap",),
    "bag": ("touches.bag",),
    "parquet": ("touches.parquet",),
    "rig": ("rig.toml", "rig_full.toml", "rig_imu.toml", "rig_plane.toml"),
    "model": ("payload.toml",),
    "contacts": ("contacts.csv",),
    "contacts_mcap": ("contacts.mcap",),
    "stl": ("probe.stl", "ascii.stl"),
    "urdf": ("wrist.urdf",),
}
"""Target -> good files of `claims.evidence.good_files.write_good` that it begins with."""
