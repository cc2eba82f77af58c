"""Run `palpate replay`: play a log as a simulated device, to try a set-up without one."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from tyro.conf import FlagCreatePairsOff, arg

from palpate.console.console import announce, lines, title
from palpate.console.keys import pressed, signals
from palpate.console.options import FileOption, Log, NameOption, Scalar, require_port, require_positive
from palpate.errors import InputError
from palpate.files.logs.layout import LogLayout
from palpate.live.replay import Replay
from palpate.live.source import Batch, Device
from palpate.setup import load_rig
from palpate.setup.new import guess_sensor

BLOCK = 512  # samples sent at once, at most


def replay(
    log: Log,
    /,
    *,
    device: Annotated[Literal["netft", "serial", "ros2"], arg(name="as")],
    rig: FileOption = None,
    sensor: NameOption = None,
    port: int = 49152,
    web: int = 8081,
    framing: Literal["cobs", "lines"] = "cobs",
    topic: str = "/wrench",
    domain: int = 0,
    speed: float = 1.0,
    seconds: Scalar = None,
    loop: Annotated[bool, FlagCreatePairsOff] = False,
) -> None:
    """Play a log as a device, to try a set-up without one.

    Play a log as a device, on this machine alone, until Ctrl-C; it says the [source] of a rig that reaches it.

    Args:
        log: log of any sensor; with --rig, where its layout cannot be guessed.
        device: an ATI Net F/T, a serial port (a pseudo-terminal), or ROS 2.
        rig: rig with the layout of the log.
        sensor: name of the sensor, where the rig has several.
        port: port of the Net F/T's samples.
        web: port of the Net F/T's page.
        framing: format of the serial port: frames with COBS and CRC-32, or lines of numbers.
        topic: ROS 2 topic.
        domain: ROS 2 domain.
        speed: 2 is twice as fast as it was recorded.
        seconds: duration; without it to the end of the log.
        loop: begin again at the end.

    Raises:
        InputError: an option, the log or the rig cannot be used, or the device cannot be opened.
    """
    require_positive(speed, "--speed")
    require_positive(seconds, "--seconds")
    require_port(port, "--port")
    require_port(web, "--web")
    if not 0 <= domain <= 232:
        raise InputError("must be from 0 to 232.", where="--domain")
    source = Replay(log, _layout(log, rig, sensor), speed, loop)
    made = _device(device, source, port=port, web=web, framing=framing, topic=topic, domain=domain)
    title(f"{log} as {device}")
    try:
        for line in made.open().splitlines():
            announce(line)
        sent = _played(source, made, seconds)
    finally:
        made.close()
    lines([("sent", f"{sent:,} samples")])


def _layout(log: Path, rig: Path | None, sensor: str | None) -> LogLayout:
    """Return the layout of the log, along the axes that it was recorded in."""
    if rig is not None:
        return load_rig(rig, sensor).layout(sensor).as_recorded()
    if (guessed := guess_sensor(log)) is None:
        raise InputError("is not recognised as a log.", where=str(log), hint="Add --rig, to state how it is read.")
    return guessed[1].layout


def _device(kind: str, source: Replay, *, port: int, web: int, framing: str, topic: str, domain: int) -> Device:
    if kind == "netft":
        if source.shape != (6,):
            raise InputError("has no wrenches, and a Net F/T sends nothing else.", where=str(source.path))
        from palpate.live.netft_device import NetFtDevice

        return NetFtDevice(port=port, web=web)
    if kind == "serial":
        from palpate.live.serial_device import SerialDevice

        return SerialDevice(framing=framing)
    from palpate.live.ros_device import RosDevice

    return RosDevice(topic, source.shape, domain=domain, images=np.dtype(source.dtype) == np.uint8)


def _played(source: Replay, device: Device, seconds: float | None) -> int:
    """Send every sample at its time; return their number."""
    batch, sent = Batch(source.shape, BLOCK, source.dtype), 0
    end = time.monotonic() + (seconds or float("inf"))
    source.open()
    with signals() as came, pressed() as _:
        while not (came.stop or source.ended) and time.monotonic() < end:
            if count := source.receive(batch, 0.1):
                sent += device.send(batch.stamp[:count], batch.values[:count].reshape(count, -1))
    return sent
