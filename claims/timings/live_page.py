"""The page of `palpate live`: pictures a second that are sent, and how much of a core they take, at 1 and 7 kHz.

A picture is a message of the page's socket: the page changes all that it changes in a turn at once, which viser sends
as one. Something touches all the time, since a picture that is as the one before is not sent. A browser here draws in
software, on the processors of the page and of all else that runs, as it would not on a robot's; what it does not fetch
in time is replaced by what comes after it. So a client that only reads is told too.
"""

import os
import tempfile
import threading
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import trimesh

from claims.evidence.page import CHROMIUM, browser
from claims.evidence.page_client import CAMERA, opened
from claims.row import Row
from claims.timings.live import HOST, RIG, Memory, R, wrenches
from palpate.cli.live_page import show
from palpate.live.live import Live
from palpate.live.stream_buffer import StreamBuffer
from palpate_lab.simulation import BumpySphere

TOKEN = "of_this_benchmark"
FACETS, TICK = 20_000, 0.002  # s between two blocks of samples
PICTURES, SHARE = 30.0, 10.0  # a second; % of a core
SETTLE, SECONDS = 5.0, 20.0  # s: once the page is seen; that are counted
TOUCH = 700  # samples of a touch, of which none is without one

Watch = Callable[[str, float, Callable[[], None]], list[float]]


def rows(small: bool) -> Iterator[Row]:
    """A body of 20k facets that is touched; small judges nothing."""
    watchers: list[tuple[str, Watch]] = [("a client that only reads", _reading), ("chromium", _browsing)]
    for rate in (1000, 7000):
        for who, watch in watchers:
            what = f"{rate:,} Hz: pictures a second to {who}, and the page's share of a core"
            if watch is _browsing and CHROMIUM is None:
                yield Row(what, "", "skipped: no chromium")
                continue
            with tempfile.TemporaryDirectory() as scratch:
                pictures, share = _watched(Path(scratch), rate, watch, 3.0 if small else SECONDS)
            each = 10.0 * share / pictures if pictures else float("nan")
            load = f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()}"
            got = f"{pictures:.1f} a second, {share:.1f} % of a core, {each:.2f} ms each; {load}"
            target = "" if small else f">= {PICTURES:g} a second at <= {SHARE:g} %"
            enough = pictures >= PICTURES - 1.0 / SECONDS  # of 30 a second 599 to 601 fall into 20 s
            yield Row(what, target, got, enough and share <= SHARE if target else None)


def _watched(folder: Path, rate: int, watch: Watch, seconds: float) -> tuple[float, float]:
    """Pictures a second that reach who watches, and % of a core of the page's process."""
    trimesh.Trimesh(*BumpySphere(R).mesh(FACETS), process=False).export(folder / "body.stl")
    rig, spent = folder / "rig.toml", list[tuple[float, float]]()
    rig.write_text(RIG.format(host=HOST, port=1, web=1), encoding="utf-8")
    with _streaming(folder, rate) as ring:
        process = get_context("spawn").Process(
            target=show, args=((ring.path,), rig, None, HOST, 0, TOKEN, os.getpid()), daemon=True
        )
        process.start()
        try:
            came = watch(_address(ring), seconds, lambda: spent.append((_spent(process.pid), time.monotonic())))
        finally:
            process.terminate()
            process.join()
    used, took = np.diff(spent, axis=0)[0]
    return len(came) / took, 100.0 * used / took


def _browsing(address: str, seconds: float, mark: Callable[[], None]) -> list[float]:
    """When messages reached a browser [s]; `mark` is called before and after they are counted."""
    came = list[float]()
    with browser() as view:
        view.on("websocket", lambda socket: socket.on("framereceived", lambda _: came.append(time.monotonic())))
        view.goto(address)
        view.wait_for_function("window.body")
        view.wait_for_timeout(1e3 * SETTLE)
        came.clear()
        mark()
        view.wait_for_timeout(1e3 * seconds)
        mark()
    return came


def _reading(address: str, seconds: float, mark: Callable[[], None]) -> list[float]:
    """The same of a process that reads and does nothing with it."""
    heard, told = get_context("spawn").Pipe()
    process = get_context("spawn").Process(target=_read, args=(address, told), daemon=True)
    process.start()
    heard.recv()
    time.sleep(SETTLE)
    begun = time.monotonic()
    mark()
    time.sleep(seconds)
    mark()
    heard.send("enough")
    came: list[float] = heard.recv()
    process.join()
    return [at for at in came if begun <= at < begun + seconds]


def _read(address: str, told: Connection) -> None:
    from msgspec import msgpack

    came = list[float]()
    with opened(address) as socket:
        socket.send(msgpack.encode(CAMERA))
        told.send("connected")
        while not told.poll():
            with suppress(TimeoutError):
                socket.recv(timeout=0.5)
                came.append(time.monotonic())
    told.send(came)


@contextmanager
def _streaming(folder: Path, rate: int) -> Generator[StreamBuffer]:
    """A ring that a thread fills, received and answered."""
    touched = wrenches(14_000).reshape(-1, 2, TOUCH, 6)[:, 1].reshape(-1, 6)
    live = Live(folder / "rig.toml", source=Memory(touched, round(rate * TICK)))
    ring, over = StreamBuffer.make(folder / "ring", live.form()), threading.Event()
    live.into(ring)

    def fill() -> None:
        due = time.monotonic()
        while not over.wait(max(0.0, due - time.monotonic())):
            live.step()
            due += TICK

    with live:
        filler = threading.Thread(target=fill)
        filler.start()
        try:
            yield ring
        finally:
            over.set()
            filler.join()
            ring.close()


def _address(ring: StreamBuffer) -> str:
    end = time.monotonic() + 60.0
    while time.monotonic() < end:
        for _, sentence in ring.events(0)[0]:
            if sentence.startswith("the page is at "):
                return f"{sentence.split(' ')[4]}/?token={TOKEN}"
        time.sleep(0.1)
    raise TimeoutError("the page did not say where it is")


def _spent(process: int | None) -> float:
    """[s] of processor."""
    words = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")
