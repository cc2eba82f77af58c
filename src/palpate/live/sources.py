"""List the sources of live samples by the kind that a rig's [source] states."""

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
    "camera": "palpate.live.camera.CameraSource",
    "replay": "palpate.live.replay.Replay",
}
"""Kind of [source] in a rig -> the class, whose `of` makes a source. A new row serves every command."""


def source_of(stated: RigSource, setup: Setup) -> Source:
    """Return the source that a rig's [source] states, not opened yet.

    Args:
        stated: the [source].
        setup: the link and its sensors; a combined sensor gets a source that pairs the samples of its parts.

    Raises:
        InputError: the source does not fit the sensor, or cannot be made as the table states.
    """
    if setup.kind.parts and stated.kind != "replay":
        return by_name("palpate.live.paired_source.PairedSource").of(stated, setup)
    return by_name(SOURCES[stated.kind]).of(stated, setup)
