"""A log as a live loop would meet it: one reading after the other."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import palpate
from palpate.signals.recording import ACCELERATION, ORIENTATION, POSITION, UNSTEADY, Recording
from palpate.spatial.pose import rotation_from_quaternion

SPLIT = 1e9  # bytes
BESIDE = (ORIENTATION, POSITION, ACCELERATION, UNSTEADY)  # channels that are no reading of the sensor


def whole(log: Path, rig: Any) -> Recording:
    """All of a log, as its rig reads it."""
    from palpate.files.logs import join

    with palpate.open_log(str(log), rig) as opened:
        return join(list(opened))


def readings_of(estimator: Any, recording: Recording) -> np.ndarray:
    """What `update` takes of each sample, a row each: a sensor's one channel, or all of them side by side."""
    columns = [recording.channels[name] for name in estimator.channels if name not in BESIDE]
    flat = [values.reshape(len(values), -1) for values in columns]
    return columns[0] if len(columns) == 1 else np.concatenate(flat, axis=1)


def each_reading(estimator: Any, recording: Recording) -> Iterator[tuple[Any, ...]]:
    """Time, reading, rotation and acceleration of each sample, as `update` takes them."""
    readings = readings_of(estimator, recording)
    turns = recording.channels.get(ORIENTATION)
    rotations = [None] * len(recording) if turns is None else rotation_from_quaternion(turns)
    pushes = recording.channels.get(ACCELERATION, [None] * len(recording))
    yield from zip(recording.time.tolist(), readings, rotations, pushes, strict=True)


def replayed(log: Path, rig: Path) -> Any:
    """Return a `Live` of a log that is replayed as fast as it goes."""
    from palpate.live.live import Live
    from palpate.live.replay import Replay, bare
    from palpate.setup.source import RigSource

    sourced = replace(palpate.load_rig(str(rig)), source=RigSource("replay", str(log), speed=0.0))
    return Live(sourced, source=Replay(log, bare(sourced.layout()), speed=0.0))


def recorded(log: Path, rig: Path) -> Path:
    """What `palpate live --record` makes of a log that its rig replays as fast as it goes.

    By what its receiver and its recorder run, in turns in this process: they would take seconds to start, and know
    nothing of a sensor that is none of Palpate's.
    """
    from palpate.live.live import Live
    from palpate.live.receiver import IMAGES
    from palpate.live.record import Recorder, require_record
    from palpate.live.stream_buffer import SIZE, StreamBuffer
    from palpate.setup.source import RigSource

    output = log.parent / "live.mcap"
    require_record(output)
    live = Live(replace(palpate.load_rig(str(rig)), source=RigSource("replay", str(log.resolve()), speed=0.0)))
    form = live.form(rig=str(rig))
    ring = StreamBuffer.make(log.parent / "live.ring", form, IMAGES if form.images else SIZE)
    ring["recording"] = 1
    live.into(ring)
    recorder = Recorder(ring, output, SPLIT)
    with live:
        while not live.ended:
            live.step(0.0)
            recorder.step()
        live.finish()
    recorder.finish()
    ring.close()
    ring.path.unlink()
    return output
