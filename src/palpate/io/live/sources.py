"""Which sources of live samples there are, by the kind that the [source] of a rig states."""

from __future__ import annotations

from palpate.calls import by_name
from palpate.io.live.source import Source
from palpate.io.rig.kind import SensorKind
from palpate.io.rig.rig import Rig

__all__ = ["SOURCES", "source_of"]

SOURCES = {
    "netft": "palpate.io.live.netft.NetFt",
    "serial": "palpate.io.live.serial.SerialPort",
    "ros2": "palpate.io.live.ros2.RosTopics",
    "camera": "palpate.io.live.camera.Camera",
    "replay": "palpate.io.live.replay.Replay",
}
"""Kind of [source] in a rig -> the class, which `of` makes of a rig. Add a row, and every command takes it."""


def source_of(rig: Rig, kind: SensorKind | None = None) -> Source:
    """Return the source that the [source] of a rig states, not opened yet.

    Args:
        rig: with a [source].
        kind: of its sensors; one that is made of two gets the samples of both.

    Raises:
        InputError: the rig has no [source], or what it says cannot be.
    """
    stated = rig.stream().kind
    if kind is not None and kind.parts and stated != "replay":
        return by_name("palpate.io.live.pair.Pair").of(rig, kind)
    return by_name(SOURCES[stated]).of(rig)
