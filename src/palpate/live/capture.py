"""Record a few seconds of a device as a log, from which a rig can be guessed."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import polars as pl

from palpate.errors import InputError
from palpate.files.logs.layout import WRENCH_COLUMNS
from palpate.files.schema import parse
from palpate.live.source import Batch, source_of
from palpate.setup.rig import Rig
from palpate.setup.source import RigSource

SECONDS = 3.0  # of listening


def stated_source(stated: str) -> RigSource:
    """Return the `RigSource` for a text KIND:ADDRESS, such as netft:192.168.1.1, or ros2.

    Raises:
        InputError: the kind is unknown, or the address is missing.
    """
    kind, _, address = stated.partition(":")
    return parse({"kind": kind, **({"address": address} if address else {})}, RigSource, file="--source")


def listen(source: RigSource, folder: Path) -> Path:
    """Write the wrenches of 3 s of a source to a CSV file in a folder, and return its path.

    Raises:
        InputError: the source cannot be opened, does not give wrenches, or gives fewer than two samples.
        OSError: the file cannot be written, or the source cannot be read.
    """
    device = source_of(source, Rig(folder=Path.cwd()).resolve())
    if device.shape != (6,):
        hint = "Record a log from it, and give that file instead of --source."
        raise InputError("does not send wrenches, and nothing else can be used here.", where="--source", hint=hint)
    batch, times, values = Batch(device.shape), list[np.ndarray](), list[np.ndarray]()
    try:
        device.open()
        end = time.monotonic() + SECONDS
        while time.monotonic() < end:
            count = device.receive(batch, 0.1)
            times.append(batch.stamp[:count] / 1e9)
            values.append(batch.values[:count].copy())
    finally:
        device.close()
    time_, wrench = np.concatenate(times), np.concatenate(values)
    if len(time_) < 2:
        hint = "Check that the device is on and its address right."
        raise InputError(f"sent fewer than two samples within {SECONDS:g} s.", where="--source", hint=hint)
    file = folder / f"{source.kind}.csv"
    columns = {"time": time_ - time_[0], **dict(zip(WRENCH_COLUMNS, wrench.T, strict=True))}
    pl.DataFrame(columns).write_csv(file)
    return file
