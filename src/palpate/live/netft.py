"""Read wrenches from an ATI Net F/T or Ethernet Axia over UDP (RDT)."""

from __future__ import annotations

import errno
import math
import select
import socket
import struct
import time
from collections import deque
from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import DTypeLike

from palpate.errors import InputError
from palpate.files.units import FORCE_UNITS, TORQUE_UNITS, known_unit
from palpate.live.datagrams import Datagrams, ask_buffer, packed_address
from palpate.live.netft_page import UNREACHED, read_page
from palpate.live.netft_status import status_word
from palpate.live.sequence import SequenceCounters
from palpate.live.source import BATCH, SILENT, Batch, drained
from palpate.setup.setup import Setup
from palpate.setup.source import RigSource
from palpate.signals.recording import FORCE

REQUEST = struct.Struct(">HHI")  # 0x1234, a command, number of samples (0: without end)
HEADER, STOP, START, BIAS = 0x1234, 0, 2, 0x42
SAMPLE = np.dtype([("rdt", ">u4"), ("ft", ">u4"), ("status", ">u4"), ("counts", ">i4", 6)])
_SLOTS = np.dtype([*SAMPLE.descr, ("rest", "V28")])  # longer than a sample, so that a longer datagram is noticed
_BUFFER = 4 << 20  # bytes of receive buffer to ask for: more than a second at the fastest rate
_BOOKED = 832  # bytes that Linux books in twice the buffer for each datagram
_ASK = 0.5  # s without a sample between requests to the device to send
_FIRST, _PAGE, _PAGE_AGAIN = 2.0, 2.0, 0.3  # s to wait: for the first sample; for the page; for it, while samples come
_RETRY, _RETRIES = 2.0, 5  # s between tries to read the page after a reconnection, and how many
_SAID_EACH = 1.0  # s between two sentences of one kind
_MOST_SAID = 200
_MISSING, _GAPS = "missing samples", "gaps"  # as counted in sentences


class NetFt:
    """A Net F/T as a `palpate.live.source.Source` of wrenches in N and N m.

    Origin and axes are those that the device is set to. Samples that the device marks as invalid are NaN.

    Args:
        address: name or IPv4 address.
        port: UDP port of its samples (RDT).
        web: TCP port of its page (HTTP).
        rate: [Hz] expected; `events` reports that the device's page states another. None: the page's.
    """

    shape: tuple[int, ...] = (6,)
    dtype: DTypeLike = np.float64
    poses = False

    def __init__(self, address: str, port: int = 49152, web: int = 80, rate: float | None = None) -> None:
        self._address, self._port, self._web, self._rate = address, port, web, rate
        self._said: deque[str] = deque(maxlen=_MOST_SAID)
        self._close: list[socket.socket] = []

    @classmethod
    def of(cls, stated: RigSource, setup: Setup) -> NetFt:
        """Return the `NetFt` that a rig's [source] names, not opened yet.

        Raises:
            InputError: the rig has no force/torque sensor, or its units are not N and N m.
        """
        sensors = [each.kind for each in setup.sensors.values() if FORCE in each.kind.channels]
        if not sensors:
            hint = "Add [force_torque] to the rig, or use another kind of source."
            raise InputError("a Net F/T sends wrenches, but the rig has no [force_torque].", where="rig", hint=hint)
        read = sensors[0].layout(setup)
        if (known_unit(read.force_unit, FORCE_UNITS), known_unit(read.torque_unit, TORQUE_UNITS)) != ("N", "N m"):
            what = f"must be N and N m, not {read.force_unit} and {read.torque_unit}, for samples of a Net F/T."
            hint = 'Write units = { force = "N", torque = "N m" }; the device\'s own units are converted.'
            raise InputError(what, where=f"[{sensors[0].name}] units", hint=hint)
        return cls(stated.address, stated.port, stated.web, stated.rate)

    def open(self) -> None:
        """Read the device's page, request samples, and wait for the first.

        Raises:
            InputError: the name is unknown, the device does not answer, is no Net F/T, or sends no samples.
        """
        self.close()
        self._host = self._resolved()
        self._page = read_page(self._host, self._web, where=self._address, timeout=_PAGE)
        if not self._page.streaming:
            hint = "Open it in a browser, and enable RDT under Communications."
            raise InputError("does not send samples: RDT is disabled on its web page.", where=self._address, hint=hint)
        self._begin()
        try:
            self._await_first()
        except BaseException:
            self.close()
            raise
        self._say_connected()

    def receive(self, batch: Batch, timeout: float) -> int:
        """Fill a batch and return how many samples came; wait up to `timeout` [s] for the first.

        A silent device is requested to start again every 0.5 s.

        Raises:
            OSError: the socket cannot be read.
        """
        deadline = time.monotonic() + timeout
        if timeout > 0:
            self._wait(min(timeout, self._ask_at - time.monotonic()))
        while True:
            taken = self._datagrams.take(len(batch))
            if taken and (count := self._keep(taken, batch)):
                return count
            now = time.monotonic()
            self._watch(now)
            if now >= deadline:
                return 0
            self._wait(min(deadline, self._ask_at) - now)

    def events(self) -> list[str]:
        """Return the events since the last call, one sentence each; frequent ones counted, once a second."""
        now = time.monotonic()
        if self._close and now >= self._tell_at and (told := list(self._counted())):
            self._said.extend(told)
            self._tell_at = now + _SAID_EACH
        return drained(self._said)

    @property
    def late(self) -> int:
        """Number of samples that were counted as missing and arrived later."""
        return self._sequence.late

    @property
    def unknown(self) -> int:
        """Number of restarts of both counters, after which the number of missing samples is unknown."""
        return self._sequence.unknown

    def position(self) -> tuple[int, ...]:
        """Return the counters at the last sample received; () before the first."""
        return self._sequence.position

    def resume(self, position: tuple[int, ...]) -> None:
        """Count the samples missing since an earlier source's position as lost before the next one."""
        self._sequence.resume(position)

    def close(self) -> None:
        """Request the device to stop, and close the socket; may be called again."""
        for receiver in self._close:
            self._send(STOP)
            self._said.extend(self._counted())
            receiver.close()
        self._close.clear()

    def _begin(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._close = [self._socket]
        self._granted = ask_buffer(self._socket, _BUFFER)
        self._datagrams = Datagrams(self._socket, _SLOTS, BATCH)
        slot = self._datagrams.slot  # views are made once: making one costs as much as a sample
        self._rdt, self._ft, self._status, self._raw = (slot[name] for name in SAMPLE.names or ())
        self._peer = packed_address((self._host, self._port))
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)
        now = time.monotonic()
        self._sequence, self._word = SequenceCounters(), status_word(self._page.product)
        self._per_unit: Float[np.ndarray, "6"] = np.repeat([self._page.force, self._page.torque], 3)
        self._last_status, self._status_said = 0, dict[int, float]()
        self._heard = self._tell_at = now
        self._ask_at, self._away, self._silent, self._unreachable = now, False, False, False
        self._retry_at, self._retries = math.inf, 0
        self._malformed = self._foreign = 0
        self._told: dict[str, int] = {}

    def _resolved(self) -> str:
        try:
            found = socket.getaddrinfo(self._address, None, socket.AF_INET, socket.SOCK_DGRAM)
        except (OSError, UnicodeError) as problem:
            what = f"no device named {self._address!r} is found in this network."
            hint = "Check the name, or write the address, such as 192.168.1.1."
            raise InputError(what, where="[source] address", hint=hint) from problem
        return str(found[0][4][0])

    def _await_first(self) -> None:
        """Request samples until one of the device waits; raise InputError if none comes within 2 s."""
        end = time.monotonic() + _FIRST
        while (now := time.monotonic()) < end:
            if now >= self._ask_at and (problem := self._ask(now)):
                what = f"a request for samples cannot be sent ({problem})."
                raise InputError(what, where=self._address, hint=UNREACHED)
            self._wait(min(end, self._ask_at) - now)
            while (seen := self._peek()) is not None:
                if seen:
                    self._heard = time.monotonic()
                    self._ask_at = self._heard + _ASK
                    return
                if self._datagrams.take(1):
                    self._genuine(1)
        what = f"sends no samples to this machine within {_FIRST:g} s, although its page reports a {self._page.called}."
        hint = f"Check that no firewall blocks UDP from port {self._port}, and that port is that of RDT."
        raise InputError(what, where=self._address, hint=hint)

    def _peek(self) -> bool | None:
        """Return whether the first waiting datagram is a sample of the device; None: none waits."""
        try:
            content, sender = self._socket.recvfrom(_SLOTS.itemsize, socket.MSG_PEEK)
        except (BlockingIOError, InterruptedError):
            return None
        return len(content) == SAMPLE.itemsize and sender == (self._host, self._port)

    def _wait(self, seconds: float) -> None:
        if seconds > 0:
            self._poll.poll(math.ceil(seconds * 1e3))

    def _send(self, command: int) -> str:
        """Send a command, and return why it failed, or ""."""
        try:
            self._socket.sendto(REQUEST.pack(HEADER, command, 0), (self._host, self._port))
        except OSError as problem:
            if problem.errno in (errno.EPERM, errno.EACCES):
                return "this machine's firewall blocks it"
            return str(problem.strerror or problem)
        return ""

    def _ask(self, now: float) -> str:
        self._ask_at = now + _ASK
        return self._send(START)

    def _keep(self, taken: int, batch: Batch) -> int:
        rows = self._genuine(taken)
        if rows is not None and not len(rows):
            return 0
        pick = slice(taken) if rows is None else rows
        sequence, rdt = self._sequence, self._rdt[pick].tolist()
        restarts, unknown = sequence.restarts, sequence.unknown
        stamps: Int[np.ndarray, " n"] = self._datagrams.stamp[pick]
        kept = sequence.follow(rdt, self._ft[pick].tolist(), stamps.tolist(), batch.lost)
        now, restarted = time.monotonic(), sequence.restarts > restarts
        if self._away or restarted or now >= self._retry_at:
            missing = 0 if kept == [] else int(batch.lost[0])
            self._back(now, restarted, None if sequence.unknown > unknown else missing)
        self._heard, self._ask_at = now, now + _ASK
        if kept is not None:
            stamps, pick = stamps[kept], np.arange(taken)[pick][kept]
        count = len(stamps)
        batch.stamp[:count] = stamps
        values = batch.values[:count]
        np.divide(self._raw[pick], self._per_unit, out=values)
        status = self._status[pick]
        if count and (self._last_status or any(status.tolist())):
            values[self._bad(status.astype(np.int64), now)] = np.nan
        return count

    def _genuine(self, taken: int) -> Int[np.ndarray, " n"] | None:
        """Return the indices of the datagrams that are samples of the device; None: all are."""
        length, sender = self._datagrams.length[:taken], self._datagrams.sender[:taken]
        if length.tolist().count(SAMPLE.itemsize) == taken == sender.tolist().count(self._peer):
            return None
        wrong, strange = length != SAMPLE.itemsize, sender != self._peer
        self._foreign += int(strange.sum())
        self._malformed += int((wrong & ~strange).sum())
        return np.flatnonzero(~(wrong | strange))

    def _bad(self, status: Int[np.ndarray, " n"], now: float) -> Bool[np.ndarray, " n"]:
        """Return (n,) whether each sample is invalid; report changes of the status."""
        bad = self._word.bad(status)
        before = np.concatenate([[self._last_status], status[:-1]])
        for new in dict.fromkeys(status[status != before].tolist()):
            if now - self._status_said.get(new, -math.inf) >= _SAID_EACH:
                self._status_said[new] = now
                left = "; samples are NaN until it clears" if self._word.bad(np.array([new]))[0] else ""
                self._say(f"status 0x{new:08x}: {self._word.read(new)}{left}")
        if len(self._status_said) > _MOST_SAID:  # the status word takes arbitrary values
            self._status_said.clear()
        self._last_status = int(status[-1])
        return bad

    def _watch(self, now: float) -> None:
        """Request samples again, and report a silence once."""
        if now < self._ask_at:
            return
        problem = self._ask(now)
        self._sequence.expect_restart()
        if not self._away:
            self._away = True
            self._say(f"no samples for {now - self._heard:.1f} s: requesting them again every {_ASK:g} s")
        if problem and not self._unreachable:
            self._unreachable = True
            self._say(f"a request for samples cannot be sent ({problem})")
        if not self._silent and now - self._heard >= SILENT:
            self._silent = True
            self._say(
                f"no samples for {SILENT:g} s: check its power and cable, and that no other program reads it, "
                "because it sends to only one"
            )

    def _back(self, now: float, restarted: bool, missing: int | None) -> None:
        """Report that samples come again or counters restarted, and read the page again."""
        if missing is None:
            guess = f" (about {(now - self._heard) * self._page.rate:.0f})" if self._page.rate and self._away else ""
            count = f"its counters restarted, so the number of missing samples is unknown{guess}"
        else:
            count = f"{missing} missing" + (", and its counter restarted" if restarted else "")
        if self._away:
            self._say(f"samples come again after {now - self._heard:.2f} s: {count}")
        elif restarted:
            self._say(f"sending began again, after its restart or because of another program: {count}")
        if self._away or restarted:
            self._retries = 0
        self._away = self._silent = self._unreachable = False
        self._read_again()

    def _read_again(self) -> None:
        """Read the page again, as the tool may differ; schedule another try if it does not answer."""
        self._retry_at = math.inf
        try:
            page = read_page(self._host, self._web, where=self._address, timeout=_PAGE_AGAIN)
        except InputError as problem:
            self._retries += 1
            again = self._retries < _RETRIES
            if again:
                self._retry_at = time.monotonic() + _RETRY
            if not again or self._retries == 1:
                more = "another try follows" if again else "no further try follows"
                self._say(f"its page cannot be read again, {more}; its previous scale stays in use: {problem.what}")
            return
        before, self._page = self._page, page
        if (before.force, before.torque) != (page.force, page.torque):
            self._per_unit[:] = np.repeat([page.force, page.torque], 3)
            self._say(f"calibration changed: now {page.called}, {page.scale}; before {before.called}, {before.scale}")
        elif before.called != page.called:
            self._say(f"another device with the same calibration: now {page.called}, before {before.called}")
        self._word = status_word(page.product)

    def _counted(self) -> Iterator[str]:
        """Yield sentences on frequent events not reported yet."""
        sequence = self._sequence
        now = {
            _MISSING: sequence.missing,
            _GAPS: sequence.gaps,
            "datagrams dropped by this machine, which read too slowly": self._datagrams.dropped,
            "samples that came late, first counted as missing": sequence.late,
            "samples that came twice, used once": sequence.repeated,
            "datagrams without the length of a sample, ignored": self._malformed,
            "datagrams from another sender, ignored": self._foreign,
        }
        new = {what: count - self._told.get(what, 0) for what, count in now.items()}
        self._told, gaps = now, new.pop(_GAPS)
        for what, count in new.items():
            if count:
                yield f"{self._address}: {what}: {count}" + (f", {_GAPS}: {gaps}" if what == _MISSING else "")

    def _say(self, what: str) -> None:
        self._said.append(f"{self._address}: {what}")

    def _say_connected(self) -> None:
        page, granted = self._page, self._granted
        pace = f", {page.rate:g} samples/s" if page.rate else ""
        self._say(f"connected to {page.called}{pace}, {page.scale}")
        if page.rate and self._rate and abs(self._rate / page.rate - 1) > 0.01:
            hint = "set the rate on its page, under Communications"
            self._say(f"sends {page.rate:g} samples/s, but the rig states {self._rate:g}: {hint}")
        rate = page.rate or self._rate
        held = f", about {2e3 * granted / _BOOKED / rate:.0f} ms of samples" if rate else ""
        short = f", less than {_BUFFER >> 10} KiB as requested: run sudo sysctl -w net.core.rmem_max={_BUFFER}"
        self._say(f"receive buffer of {granted >> 10} KiB{held}{short if granted < _BUFFER else ''}")
