"""Which sources of live samples there are, by the kind that the [source] of a rig states."""

from __future__ import annotations

from palpate.calls import by_name
from palpate.live.source import Source
from palpate.setup.setup import Setup
from palpate.setup.source import RigSource

__all__ = ["SOURCES", "source_of"]

SOURCES = {
    "netft": "palpate.live.netft.NetFt",
    "serial": "palpate.live.serial.SerialPort",
    "ros2": "palpate.live.ros2.RosTopics",
    "camera": "palpate.live.camera.Camera",
    "replay": "palpate.live.replay.Replay",
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
        return by_name("palpate.live.paired_source.Pair").of(stated, setup)
    return by_name(SOURCES[stated.kind]).of(stated, setup)
