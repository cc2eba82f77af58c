"""The page of `palpate live`: pictures a second in a browser, and how much of a core they take, at 1 and 7 kHz.

A picture that reached the browser is a message of its socket that came by itself: viser sends what was changed at once
as one. The browser draws in software on the same machine, as it would not on a robot's, so the load is told too.
"""

from __future__ import annotations

import os
import tempfile
import threading
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import trimesh

from benchmarks.live import HOST, RIG, Memory, R, wrenches
from evidence.page import CHROMIUM, browser
from evidence.row import Row
from palpate.cli.live_page import show
from palpate.io.live.live import Live
from palpate.io.live.ring import Ring
from palpate.simulation import BumpySphere

__all__ = ["rows"]

COMMAND = "python -m benchmarks --only live_page"
NAME = "live page"
FACETS, TICK = 20_000, 0.002  # s between two blocks of samples
PICTURES, SHARE = 29.0, 10.0  # a second; % of a core
SETTLE, SECONDS = 5.0, 20.0  # s: once the browser has the body; that are counted
APART = 0.005  # s: messages that are closer belong to one picture


def rows(small: bool) -> Iterator[Row]:
    """A body of 20k facets, touched every other tenth of a second; small judges nothing."""
    what = "pictures a second in chromium, and the page's share of a core"
    if CHROMIUM is None:
        yield Row(NAME, what, "", "skipped: no chromium", None, COMMAND)
        return
    for rate in (1000, 7000):
        with tempfile.TemporaryDirectory() as scratch:
            pictures, share = _watched(Path(scratch), rate, 3.0 if small else SECONDS)
        got = f"{pictures:.1f} a second, {share:.1f} % of a core; load {os.getloadavg()[0]:.1f} on {os.cpu_count()}"
        target = "" if small else f">= {PICTURES:g} a second at <= {SHARE:g} %"
        met = pictures >= PICTURES and share <= SHARE if target else None
        yield Row(NAME, f"{rate:,} Hz: {what}", target, got, met, COMMAND)


def _watched(folder: Path, rate: int, seconds: float) -> tuple[float, float]:
    """Pictures a second that reach a browser, and % of a core of the page's process."""
    trimesh.Trimesh(*BumpySphere(R).mesh(FACETS), process=False).export(folder / "body.stl")
    rig, came = folder / "rig.toml", list[float]()
    rig.write_text(RIG.format(host=HOST, port=1, web=1), encoding="utf-8")
    with _streaming(folder, rate) as ring, browser() as view:
        process = get_context("spawn").Process(target=show, args=(ring.path, rig, 0, os.getpid()), daemon=True)
        process.start()
        try:
            view.on("websocket", lambda socket: socket.on("framereceived", lambda _: came.append(time.monotonic())))
            view.goto(_address(ring))
            view.wait_for_function("window.body")
            view.wait_for_timeout(1e3 * SETTLE)
            came.clear()
            spent, begun = _spent(process.pid), time.monotonic()
            view.wait_for_timeout(1e3 * seconds)
            spent, took = _spent(process.pid) - spent, time.monotonic() - begun
        finally:
            process.terminate()
            process.join()
    return (np.diff(came) > APART).sum() / took, 100.0 * spent / took


@contextmanager
def _streaming(folder: Path, rate: int) -> Generator[Ring]:
    """A ring that a thread fills, received and answered."""
    live = Live(folder / "rig.toml", source=Memory(wrenches(14_000), round(rate * TICK)))
    ring, over = Ring.make(folder / "ring", live.form()), threading.Event()
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


def _address(ring: Ring) -> str:
    """Of the page, once it has said so."""
    end = time.monotonic() + 60.0
    while time.monotonic() < end:
        for _, sentence in ring.said(0)[0]:
            if sentence.startswith("the page is at "):
                return sentence.split(" ")[4]
        time.sleep(0.1)
    raise TimeoutError("the page did not say where it is")


def _spent(process: int | None) -> float:
    """[s] of processor."""
    words = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")
