"""A log as a live loop would meet it: one reading after the other."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import palpate
from palpate.sensors.recording import ACCELERATION, ORIENTATION, POSITION, UNSTEADY, Recording
from palpate.spatial.pose import rotation_from_quaternion

__all__ = ["each_reading", "whole"]

BESIDE = (ORIENTATION, POSITION, ACCELERATION, UNSTEADY)  # channels that are no reading of the sensor


def whole(log: Path, rig: Any) -> Recording:
    """All of a log, as its rig reads it."""
    from palpate.io.logs import join

    with palpate.open_log(str(log), rig) as opened:
        return join(list(opened))


def each_reading(estimator: Any, recording: Recording) -> Iterator[tuple[Any, ...]]:
    """Time, reading, rotation and acceleration of each sample, as `update` takes them."""
    names = [name for name in estimator.channels if name not in BESIDE]
    columns = [recording.channels[name] for name in names]
    readings = columns[0] if len(columns) == 1 else np.concatenate(columns, axis=1)
    turns = recording.channels.get(ORIENTATION)
    rotations = [None] * len(recording) if turns is None else rotation_from_quaternion(turns)
    pushes = recording.channels.get(ACCELERATION, [None] * len(recording))
    yield from zip(recording.time.tolist(), readings, rotations, pushes, strict=True)
