"""Which sources of live samples there are, by the kind that the [source] of a rig states."""

from __future__ import annotations

from palpate.calls import by_name
from palpate.io.live.source import Source
from palpate.io.rig.setup import Setup
from palpate.io.rig.source import RigSource

__all__ = ["SOURCES", "source_of"]

SOURCES = {
    "netft": "palpate.io.live.netft.NetFt",
    "serial": "palpate.io.live.serial.SerialPort",
    "ros2": "palpate.io.live.ros2.RosTopics",
    "camera": "palpate.io.live.camera.Camera",
    "replay": "palpate.io.live.replay.Replay",
}
"""Kind of [source] in a rig -> the class, whose `of` makes one. Add a row, and every command takes it."""


def source_of(stated: RigSource, setup: Setup) -> Source:
    """Return the source that a [source] states, not opened yet.

    Args:
        stated: the table.
        setup: of the sensor; one that is made of two gets the samples of both.

    Raises:
        InputError: what the table says cannot be.
    """
    if setup.kind.parts and stated.kind != "replay":
        return by_name("palpate.io.live.pair.Pair").of(stated, setup)
    return by_name(SOURCES[stated.kind]).of(stated, setup)
