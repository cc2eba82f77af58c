"""Run the page of `palpate live --view`: a process that reads the rings and feeds a page in the browser."""

from __future__ import annotations

import gc
import signal
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from palpate.cli.live_page_robot import RobotStream
from palpate.cli.live_page_stream import Stream
from palpate.errors import PalpateError
from palpate.live.receiver import orphaned
from palpate.live.stream_buffer import StreamBuffer
from palpate.setup import load_rig
from palpate.setup.load import load_robot
from palpate.setup.view import layers_of, view_of
from palpate.surfaces import Surface
from palpate.viewer.live import LivePage
from palpate.viewer.scene import Layer

TICK = 1 / 30  # s between two pictures
IDLE = 0.25  # s between two looks at the ring while nobody watches
SHARE = 0.1  # of a core, at most
SAVED = 0.05  # s of a core that may be taken at once
REPORTED = 0.25  # s between two figures


def show(rings: tuple[Path, ...], rig: Path, sensor: str | None, host: str, port: int, token: str, parent: int) -> None:
    """Serve the page, in a separate process, until the first ring requests the stop or the parent is gone.

    An error of the rig or the page is written into that ring as a sentence; then the process waits for the end.

    Args:
        rings: file of the stream; of several sensors of a robot those of all, and of the joint states.
        rig: rig of the streams.
        sensor: name of the sensor, if the rig is of a robot.
        host: address to serve at.
        port: the first to try; if it is taken, the next free one is used.
        token: secret that opens the page; it is not written into the ring.
        parent: id of the parent process.

    Raises:
        InputError: a ring cannot be opened.
        GeometryError: the mesh has no usable surface, or an implicit surface cannot be drawn.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's, which says stop
    read = [StreamBuffer(ring) for ring in rings]
    try:
        shown = _of_robot(read, rig) if read[0].form.origin[0] else _of_sensor(read[0], rig, sensor)
        with LivePage(shown.body, shown.layers, rig.stem, shown.stream.tare, host, port, token) as page:
            gc.collect()
            gc.freeze()  # or it looks through all that is here to stay, again and again
            taken = "" if port in (0, page.port) else f" (port {port} is taken)"
            read[0].say(f"the page is at {page.address.partition('/?')[0]}{taken}")
            _serve(page, shown.stream, parent)
    except PalpateError as problem:
        read[0].say(f"the page cannot be shown: {problem}")
        _wait(read[0], parent)
    finally:
        for ring in read:
            ring.close()


class _Shown(NamedTuple):
    body: Surface | None
    layers: tuple[Layer, ...]
    stream: Stream | RobotStream


def _of_sensor(ring: StreamBuffer, rig: Path, sensor: str | None) -> _Shown:
    setup = load_rig(rig, sensor).resolve(ring.form.sensor)
    view, layers = view_of(setup.kind), layers_of(setup, live=ring.form.shape)
    return _Shown(view.body(setup), layers, Stream(ring, view.feed(setup, lambda: ring["done"], layers)))


def _of_robot(rings: list[StreamBuffer], rig: Path) -> _Shown:
    stream = RobotStream(rings, load_robot(rig))
    return _Shown(None, (stream.layer,), stream)


def _wait(ring: StreamBuffer, parent: int) -> None:
    """Wait until the end, as a new process would meet the same error."""
    while not ring["stop"] and not orphaned(parent):
        time.sleep(IDLE)


def _serve(page: LivePage, stream: Stream | RobotStream, parent: int) -> None:
    """Read the ring, and draw new contacts while a browser is connected, with a limited share of a core."""
    reported, drawn, saved = -np.inf, -1, SAVED
    due = last = time.monotonic()
    spent = time.process_time()
    while not stream.ring["stop"] and not orphaned(parent):
        begun, watched = time.monotonic(), page.watched
        stream.look(watched)
        with page.at_once():
            if watched and stream.next_one != drawn and (newest := stream.newest) is not None:
                page.show(newest)
                drawn = stream.next_one
            if begun - reported >= REPORTED:
                stream.gather()
                reported = begun
                if watched:
                    page.tell(stream.window, stream.figures())
        now = time.process_time()
        saved += SHARE * (begun - last) - (now - spent)
        saved = min(max(saved, -SHARE * IDLE), SAVED)  # no debt of minutes, once a slow spell is over
        last, spent = begun, now
        pause = max(TICK, -saved / SHARE) if watched else IDLE
        due = max(due + pause, begun)  # where the last picture came late, the next one makes up for it
        time.sleep(max(0.001, due - time.monotonic()))
