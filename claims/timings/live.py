"""`palpate live` on a Net F/T at 7 kHz: from the device's send to the contact, with recorder and page; blocks; pynetft.

The device is a process that sends each sample at its own time, as evenly as the machine lets it: how evenly is told
beside each figure, and so is the load, since on a machine that others use both are what is measured.
"""

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager, nullcontext, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from claims.clock import timed
from claims.row import Row, scratch
from palpate.live.live import Live
from palpate.live.netft import HEADER, REQUEST, SAMPLE, START
from palpate.live.netft_device import NetFtDevice
from palpate.live.record import ring_of
from palpate.live.source import Batch
from palpate.live.stream_buffer import StreamBuffer
from palpate_lab.simulation import BumpySphere, touch_wrenches

RATE, FACETS, R = 7000.0, 20_000, 0.03  # Hz; of the body; m
MIDDLE, LATE, WORST = 200.0, 500.0, 2000.0  # us: p50, p99 and p99.9 with real-time priority
ASKED, SOON, SOON_LATE = 100.0, 0.5, 3.0  # lines a second; ms at their sink: p50, p99
BLOCK = 4.0  # us a sample, in blocks of 16 and more
PRIORITY = 50  # of the device's process: below the receiver's
HOST, COUNTS = "127.0.0.1", 1e6
SETTLE = 2.0  # s at the start that are not counted: recorder and page begin then
NOISE = [0.02] * 3 + [0.001] * 3  # N, N m
RIG = """\
[surface]
mesh = "body.stl"
unit = "m"
[force_torque]
units = {{ force = "N", torque = "N m" }}
noise = {{ force = 0.02, torque = 0.001 }}
[estimate]
contact = {{ on = 0.5, off = 0.3 }}
[source]
kind = "netft"
address = "{host}"
port = {port}
web = {web}
"""


def wrenches(count: int) -> np.ndarray:
    """Of touches of 4 N, every other tenth of a second, and noise."""
    body, rng = BumpySphere(R), np.random.default_rng(1)
    points = body.sample(1 + count // 1400, rng)
    each = 4.0 * touch_wrenches(points, body.normals(points), rng)
    touched = np.repeat(each, 1400, axis=0)[:count]
    touched[np.arange(count) % 1400 < 700] = 0.0
    return touched + rng.normal(size=(count, 6)) * NOISE


def device(told: Connection, seconds: float) -> None:
    """A process of its own: serves the page, and once it is asked, sends; what it tells: ports, then times of sends."""
    with suppress(AttributeError, PermissionError):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})  # or it shares a processor with the receiver
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    page = NetFtDevice(rate=RATE)
    page.open()
    count = round(seconds * RATE)
    samples = np.zeros(count, dtype=SAMPLE)
    samples["rdt"] = samples["ft"] = np.arange(1, count + 1)
    samples["counts"] = np.rint(COUNTS * wrenches(count))
    raw = [each.tobytes() for each in samples]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.bind((HOST, 0))
        told.send((sender.getsockname()[1], page.web))
        while True:
            request, peer = sender.recvfrom(64)
            if REQUEST.unpack(request)[1] == START:
                break
        told.send(_sent(sender, peer, raw))
    page.close()


def _sent(sender: socket.socket, peer: tuple[str, int], raw: list[bytes]) -> np.ndarray:
    """Sends each at its own time; [ns] on the clock of the day, just before each was sent."""
    sent, begin = np.empty(len(raw), dtype=np.int64), time.monotonic()
    for k, each in enumerate(raw):
        left = begin + k / RATE - time.monotonic()
        if left > 0:
            time.sleep(left)
        sent[k] = time.time_ns()
        sender.sendto(each, peer)
    return sent


@contextmanager
def _device(folder: Path, seconds: float) -> Generator[tuple[Connection, tuple[int, int]]]:
    """The process, once it can be asked: what it tells, and its ports."""
    heard, told = get_context("spawn").Pipe(duplex=False)
    process = get_context("spawn").Process(target=device, args=(told, seconds))
    process.start()
    try:
        port, web = heard.recv()
        (folder / "rig.toml").write_text(RIG.format(host=HOST, port=port, web=web), encoding="utf-8")
        yield heard, (port, web)
    finally:
        process.terminate()
        process.join()


def _evenly(sent: np.ndarray) -> str:
    late = (sent - sent[0] - np.arange(len(sent)) * 1e9 / RATE) * 1e-3
    late -= np.percentile(late, 1)
    return f"sent late by p50 {np.median(late):.0f}, p99 {np.percentile(late, 99):.0f} us; {_load()}"


def _load() -> str:
    return f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors"


def _latency(folder: Path, seconds: float, *, realtime: bool) -> tuple[np.ndarray, np.ndarray, int]:
    """From send to contact [us] of each sample after the start, when these were sent [ns], and how many were lost."""
    record = folder / f"{'realtime' if realtime else 'usual'}.mcap"
    with _device(folder, seconds) as (heard, _):
        words = ["live", "--rig", folder / "rig.toml", "--record", record, "--view", "--port", "0"]
        command = [sys.executable, "-m", "palpate", *map(str, words), "--realtime", str(realtime)]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as running:
            try:
                sent: np.ndarray = heard.recv()
                ring = StreamBuffer(ring_of(record))
                time.sleep(0.5)
                slots, first = ring.read(0, ring["answered"])
                ring.close()
            finally:
                running.terminate()
    keep = slots["number"] > SETTLE * RATE
    lost = int(slots["lost"].sum())
    number = first + np.arange(len(slots)) + np.cumsum(slots["lost"])
    return (slots["ready"] - sent[number])[keep] * 1e-3, sent[number[keep]], lost


def _latencies(folder: Path, seconds: float, *, judged: bool) -> Iterator[Row]:
    for realtime, busy in ((True, False), (True, True), (False, False)):
        what = f"send to contact at 7 kHz, recorder and page running, {'real-time' if realtime else 'usual'} priority"
        what += ", every processor busy with other work" if busy else ""
        with _busy() if busy else nullcontext():
            took, sent, lost = _latency(folder, seconds, realtime=realtime)
        got, met = f"{_late(took)} us of {len(took):,}; {lost} lost", not lost
        met = met and bool(np.all(np.percentile(took, [50, 99, 99.9]) <= [MIDDLE, LATE, WORST]))
        target = f"p50 <= {MIDDLE:g}, p99 <= {LATE:g}, p99.9 <= {WORST:g} us" if realtime and judged else ""
        yield Row(what, target, f"{got}; {_evenly(sent)}", met if target else None)


@contextmanager
def _busy() -> Generator[None]:
    """As many processes as processors, that do nothing but compute."""
    command = [sys.executable, "-c", "while True: pass"]
    working = [subprocess.Popen(command) for _ in range(os.cpu_count() or 1)]
    try:
        yield
    finally:
        for each in working:
            each.kill()
            each.wait()


def _published(folder: Path, runs: int, seconds: float, *, judged: bool) -> Iterator[Row]:
    """JSON lines at their sink, and the device's samples at the same sink without Palpate, in turns."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sink, _first():
        sink.bind((HOST, 0))
        sink.settimeout(1.0)
        both = [(_direct(folder, sink, seconds), _sunk(folder, sink, seconds)) for _ in range(runs)]
    alone, lines = zip(*both, strict=True)
    middle, late = np.median([np.percentile(took, [50, 99]) for took, _ in lines], axis=0) * 1e-3
    usual, plain = np.median([np.percentile(took, [50, 99]) for took in alone], axis=0) * 1e-3
    rate = float(np.median([rate for _, rate in lines]))
    met = abs(rate / ASKED - 1) < 0.01 and ((middle <= SOON and late <= SOON_LATE) or late <= 2 * plain)
    target = f"p50 <= {SOON:g}, p99 <= {SOON_LATE:g} ms, or p99 <= 2 times that without; {ASKED:g} a second"
    got = (
        f"p50 {middle:.2f}, p99 {late:.2f} ms, {rate:.1f} a second; without Palpate p50 {usual:.2f}, p99 {plain:.2f} ms"
    )
    what = f"send to JSON over UDP at its sink, 7 kHz, median of {runs} runs"
    yield Row(what, target if judged else "", f"{got}; {_load()}", met if judged else None)


@contextmanager
def _first() -> Generator[None]:
    """Real-time priority for this process, as the device has it, so that the sink itself is not late."""
    granted = False
    with suppress(AttributeError, PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        granted = True
    try:
        yield
    finally:
        if granted:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def _heard(sink: socket.socket) -> Iterator[tuple[int, bytes]]:
    """When each datagram came [ns], and its bytes, until a second passes without one."""
    begun = False
    while True:
        try:
            raw = sink.recv(1 << 16)
        except TimeoutError:
            if begun:
                return
            continue
        begun = True
        yield time.time_ns(), raw


def _sunk(folder: Path, sink: socket.socket, seconds: float) -> tuple[np.ndarray, float]:
    """From send to the sink [us] of each line after the start, and lines a second."""
    with _device(folder, seconds) as (heard, _):
        words = ["live", "--rig", folder / "rig.toml", "--publish", f"udp:{HOST}:{sink.getsockname()[1]}"]
        command = [sys.executable, "-m", "palpate", *map(str, words)]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as running:
            try:
                came, raw = zip(*_heard(sink), strict=True)
                sent: np.ndarray = heard.recv()
            finally:
                running.terminate()
    when, sample = np.array(came), np.array([json.loads(line)["sample"] for line in raw])
    keep = when > when[0] + SETTLE * 1e9
    when = when[keep]
    return (when - sent[sample[keep]]) * 1e-3, float((len(when) - 1) / np.ptp(when) * 1e9)


def _direct(folder: Path, sink: socket.socket, seconds: float) -> np.ndarray:
    """From send to the sink [us] of each sample after the start, which the sink asks for itself."""
    with _device(folder, seconds) as (heard, (port, _)):
        sink.sendto(REQUEST.pack(HEADER, START, 0), (HOST, port))
        came, raw = zip(*_heard(sink), strict=True)
        sent: np.ndarray = heard.recv()
    number = np.array([int.from_bytes(each[:4], "big") for each in raw]) - 1
    return ((np.array(came) - sent[number]) * 1e-3)[number > SETTLE * RATE]


def _peer(folder: Path, seconds: float) -> Row:
    """Samples of pynetft: no contacts, and no process but its own."""
    what = "send to sample at 7 kHz, pynetft"
    try:
        import pynetft
    except ImportError:
        return Row(what, "", "skipped: pynetft is not installed")
    with _device(folder, seconds) as (heard, (port, web)):
        config = pynetft.Config(sensor_host=HOST, rdt_port=port, http_port=web, receive_timeout=1.0)
        seen: list[tuple[int, int]] = []
        with pynetft.Client(config, queue_size=1000) as client, suppress(TimeoutError, pynetft.NetFTError):
            for each in client.samples(timeout=0.5):
                seen.append((each.rdt_sequence - 1, time.time_ns()))
        sent: np.ndarray = heard.recv()
    got = np.array([each for each in seen if SETTLE * RATE < each[0] < len(sent)]).reshape(-1, 2)
    if not len(got):
        return Row(what, "", "no samples")
    took, missing = (got[:, 1] - sent[got[:, 0]]) * 1e-3, int(np.ptp(got[:, 0])) + 1 - len(got)
    return Row(what, "", f"{_late(took)} us; {missing:,} lost; {_evenly(sent)}")


def _late(took: np.ndarray) -> str:
    return "p50 {:.0f}, p99 {:.0f}, p99.9 {:.0f}, worst {:.0f}".format(*np.percentile(took, [50, 99, 99.9, 100]))


class Memory:
    """A source that gives so many samples whenever it is asked."""

    shape: tuple[int, ...] = (6,)
    dtype: Any = np.float64
    poses = False

    def __init__(self, values: np.ndarray, size: int) -> None:
        self.values, self.size, self.next = values, size, 0

    def open(self) -> None:
        """Nothing to open."""

    def close(self) -> None:
        """Nor to close."""

    def events(self) -> list[str]:
        return []

    def receive(self, batch: Batch, timeout: float) -> int:
        here = slice(self.next, self.next + self.size)
        self.next = here.stop % (len(self.values) - self.size)
        batch.stamp[: self.size], batch.lost[: self.size] = time.time_ns(), 0
        batch.values[: self.size] = self.values[here]
        return self.size


def _blocks(folder: Path, *, judged: bool) -> Iterator[Row]:
    """Through `Live.step`: into a ring in memory, through the estimator, contacts into the ring."""
    values = wrenches(14_000)
    (folder / "rig.toml").write_text(RIG.format(host=HOST, port=1, web=1), encoding="utf-8")
    for size in (1, 16, 256):
        live = Live(folder / "rig.toml", source=Memory(values, size))
        ring = StreamBuffer.make(folder / f"ring{size}", live.form())
        live.into(ring)
        count = max(60, 14_000 // size)
        with live:
            for _ in range(20):
                live.step()
            spent = time.thread_time_ns()
            took = timed(lambda _, step=live.step: step(), count)
            spent = (time.thread_time_ns() - spent) * 1e-3 / ((count + 1) * size)
        ring.close()
        got = f"{spent:.2f} us of processor a sample over all; a step p50 {np.median(took):.0f} us; {_load()}"
        target = f"<= {BLOCK:g} us a sample" if judged and size >= 16 else ""
        yield Row(f"blocks of {size}: ring, estimate, ring", target, got, spent <= BLOCK if target else None)


def rows(small: bool) -> Iterator[Row]:
    """A body of 20k facets, full answers; small judges nothing."""
    seconds = 5.0 if small else 30.0
    with scratch() as folder:
        trimesh.Trimesh(*BumpySphere(R).mesh(FACETS), process=False).export(folder / "body.stl")
        yield from _blocks(folder, judged=not small)
        yield _peer(folder, seconds)
        yield from _latencies(folder, seconds, judged=not small)
        yield from _published(folder, 1 if small else 5, 15.0, judged=not small)
