"""Read a sensor on a serial port: frames (`palpate.live.cobs`) or lines (`palpate.live.lines`).

The last sample of a read is stamped with the computer's clock right after it, earlier ones backwards from there, a
period apart: that of the rig's `rate`, or the time that the bytes take at `baud`. Stamps do not decrease, even if the
clock goes back. FTDI's adapters delay a read by up to 16 ms by default.
"""

from __future__ import annotations

import errno
import os
import select
import time
from collections import deque
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Int
from numpy.typing import DTypeLike

from palpate.errors import InputError, importing_extra
from palpate.live.lines import LineFrames
from palpate.live.source import SILENT, Batch, drained
from palpate.setup.setup import Setup
from palpate.setup.source import RigSource

if TYPE_CHECKING:
    from serial import Serial

    from palpate.live.cobs import CobsFrames

_READ, _PIECES = 65536, 16  # bytes, and how often they are taken at once: more than the kernel holds
_BEHIND = 100_000_000  # ns: smallest step back of the clock that is reported
_AGAIN = 0.5  # s between attempts to open a port that vanished
_NOISE = 1.0  # s of bytes without a sample, after which that is reported
_OFTEN = 1.0  # s between sentences about damage
_BITS = 10  # of a byte on the line, with start and stop
_KEPT = 100  # sentences kept at most until `events` is called
_BUSY = (errno.EAGAIN, errno.EBUSY)
_NO_PORT = (errno.ENOENT, errno.ENXIO, errno.ENODEV)


class SerialPort:
    """A sensor on a serial port, as a `Source`.

    Args:
        stated: the rig's [source].
        shape: shape of one sample.

    Raises:
        InputError: `columns` do not fit, or frames need the package cobs, which is not installed.
    """

    dtype: DTypeLike = np.float64
    poses = False
    late = 0  # a serial port keeps the order

    def __init__(self, stated: RigSource, shape: tuple[int, ...]) -> None:
        self.shape = shape
        self._stated = stated
        self._count = int(np.prod(shape))
        self._frames = _frames(stated, self._count)
        self._port: Serial | None = None
        self._said: deque[str] = deque(maxlen=_KEPT)
        self._stamp = 0  # ns: of the last sample
        self._arrived = 0  # ns: of the last read
        self._behind = False  # the clock is, since it went back
        self._bytes = 0  # since the last sample
        self._heard = self._noisy = self._away = self._tried = 0.0  # s: last sample, first byte since, port gone, tried
        self._told = False  # that there are no samples
        self._sound, self._fault = False, 0.0  # samples came since faults were said, and when [s] that was
        self._period = 1e9 / stated.rate if stated.rate else 0.0  # ns between samples
        self._uncounted = 0  # times that the port was away, of a device that does not count its samples

    @classmethod
    def of(cls, stated: RigSource, setup: Setup) -> SerialPort:
        """Return the `SerialPort` that a rig's [source] names, not opened yet.

        Raises:
            InputError: the sensor reads neither wrenches nor one array, `columns` do not fit, or frames need the
                package cobs, which is not installed.
        """
        layout = setup.layout()
        if layout.wrench is not None:
            return cls(stated, (6,))
        if layout.images is not None or len(layout.arrays) != 1:
            what = f"{setup.kind.called} cannot come over a serial port."
            raise InputError(what, where="source.kind", hint="Use another kind.")
        return cls(stated, layout.arrays[0].shape)

    def open(self) -> None:
        """Open the port for this process only.

        Raises:
            InputError: pyserial is not installed, the port does not exist, is in use, is no serial port or may not be
                opened, or the baud rate is not supported.
        """
        self.close()
        self._port = self._opened()
        self._begin(time.monotonic())

    def receive(self, batch: Batch, timeout: float) -> int:
        """Fill a batch and return how many samples came; wait up to `timeout` [s] for the first."""
        end = time.monotonic() + timeout
        if count := self._take(batch):
            return count
        while True:  # at least once, for a timeout of 0
            left = max(end - time.monotonic(), 0.0)
            if self._port is None:
                self._return(left)
            elif select.select([self._port.fileno()], [], [], left)[0]:
                self._read(self._port)
                if count := self._take(batch):
                    return count
            self._watch(now := time.monotonic())
            if now >= end:
                return 0

    def events(self) -> list[str]:
        """Return the events since the last call, one sentence each; faults of frames once a second at most."""
        now = time.monotonic()
        if self._sound and now - self._fault >= _OFTEN and (faults := self._frames.faults()):
            self._say(f"{'; '.join(faults)}.")
            self._sound, self._fault = False, now
        return drained(self._said)

    @property
    def unknown(self) -> int:
        """Number of times that samples were missing whose number no counter tells."""
        return self._uncounted + self._frames.unknown

    def position(self) -> tuple[int, ...]:
        """Return the device's counter at the last sample; () before the first, and if it does not count."""
        return self._frames.position()

    def resume(self, position: tuple[int, ...]) -> None:
        """Count the samples missing since an earlier source's position as lost before the next one."""
        self._frames.resume(position)

    def close(self) -> None:
        """Close the port; may be called again."""
        if self._port is not None:
            self._port.close()
            self._port = None

    def _take(self, batch: Batch) -> int:
        count = self._frames.take(batch.values.reshape(len(batch), -1), batch.lost)
        if count == 0:
            return 0
        if self._told:
            self._say(f"samples come again, after {time.monotonic() - self._heard:.1f} s.")
        total = count + self._frames.waiting()
        if not self._stated.rate and self._bytes:
            self._period = _BITS * 1e9 / self._stated.baud * self._bytes / total
        self._spread(batch.stamp[:count], total)
        self._bytes, self._told, self._sound = 0, False, True
        self._heard = time.monotonic()
        return count

    def _spread(self, stamp: Int[np.ndarray, " n"], total: int) -> None:
        """Fill the stamps [ns] of the next of the `total` samples of a read."""
        if self._behind:
            self._arrived = self._stamp + round(total * self._period)
        step = min(round(self._period), (self._arrived - self._stamp) // total)
        stamp[:] = self._arrived - step * np.arange(total - 1, total - 1 - len(stamp), -1)
        self._stamp = int(stamp[-1])

    def _read(self, port: Serial) -> None:
        pieces: list[bytes] = []
        gone = ""
        try:
            while len(pieces) < _PIECES and (more := os.read(port.fileno(), _READ)):
                pieces.append(more)
            gone = "" if pieces else "hung up"  # no bytes, although the port was readable
        except BlockingIOError:
            pass  # some kernels report an empty port so; others return no bytes
        except OSError as problem:
            gone = str(problem.strerror)
        if pieces:
            data = b"".join(pieces)
            self._arrived = self._clock()
            self._noisy = self._noisy if self._bytes else time.monotonic()
            self._bytes += len(data)
            self._frames.feed(data)
        if gone:
            self.close()
            self._away = self._tried = time.monotonic()
            self._say(f"the port disappeared ({gone}): it is tried again every {_AGAIN:g} s.")

    def _clock(self) -> int:
        now = time.time_ns()
        if now < self._stamp - _BEHIND and not self._behind:
            self._say("the clock of this computer went back: stamps continue from the last one until it has caught up.")
        self._behind = now < self._stamp
        return now

    def _return(self, left: float) -> None:
        """Wait for the next attempt to open a vanished port, up to `left` [s], and make it."""
        time.sleep(max(0.0, min(left, self._tried + _AGAIN - time.monotonic())))
        now = time.monotonic()
        if now < self._tried + _AGAIN:
            return
        self._tried = now
        try:
            self._port = self._opened()
        except InputError:
            return  # `events` has reported that it is away
        self._say(f"the port is back after {now - self._away:.1f} s.")
        self._uncounted += not self.position()
        self._begin(now)

    def _begin(self, now: float) -> None:
        self._frames.forget()
        self._heard, self._told, self._bytes = now, False, 0

    def _watch(self, now: float) -> None:
        """Report once that no samples come."""
        quiet = now - self._heard
        if self._told:
            return
        if self._port is not None and self._bytes > 256 + 32 * self._count and now - self._noisy >= _NOISE:
            self._say(f"{self._bytes} bytes in {now - self._noisy:.1f} s, {self._frames.awaited()}")
        elif quiet >= SILENT:
            why = f": {self._bytes} bytes came, {self._frames.awaited()}" if self._bytes else "."
            self._say(f"no samples for {quiet:.1f} s{why if self._port else ': the port is still missing.'}")
        else:
            return
        self._told = True

    def _say(self, what: str) -> None:
        self._said.append(f"{self._stated.address}: {what}")

    def _opened(self) -> Serial:
        with importing_extra("serial ports need pyserial", "live"):
            import termios

            from serial import Serial
        try:
            return Serial(self._stated.address, self._stated.baud, timeout=0, exclusive=True)
        except (OSError, ValueError, OverflowError, termios.error) as problem:
            raise _explained(problem, self._stated) from problem


def _frames(stated: RigSource, count: int) -> CobsFrames | LineFrames:
    """Return the decoder for a framing; raise InputError if `columns` do not fit."""
    if stated.framing == "cobs":
        if stated.columns is not None:
            hint = 'Remove it, or write framing = "lines".'
            raise InputError('applies only to framing = "lines".', where="source.columns", hint=hint)
        with importing_extra("frames on a serial port need cobs", "live"):
            from palpate.live.cobs import CobsFrames
        return CobsFrames(count)
    if stated.columns is not None and len(stated.columns) != count:
        what = f"names {len(stated.columns)} numbers of a line, but the sensor has {count}."
        raise InputError(what, where="source.columns")
    return LineFrames(count, stated.columns)


def _explained(problem: Exception, stated: RigSource) -> InputError:
    """Return the error of a port that cannot be opened."""
    number, where = getattr(problem, "errno", None), stated.address
    if number in _NO_PORT:
        return InputError("the port does not exist.", where=where, hint=_ports())
    if number in (errno.EACCES, errno.EPERM):
        hint = "Join its group: `sudo usermod -aG dialout $USER`, then log in again."
        return InputError("you do not have permission to open this port.", where=where, hint=hint)
    if number in _BUSY:
        return InputError("is used by another program.", where=where, hint=f"Run `fuser {where}` to find it.")
    if number == errno.EISDIR or "could not configure port" in str(problem).lower():
        return InputError("is not a serial port.", where=where, hint=_ports())
    if isinstance(problem, (ValueError, OverflowError)):
        return InputError(f"the port does not support {stated.baud} baud.", where=where, hint="Correct source.baud.")
    return InputError(f"cannot be opened ({problem}).", where=where, hint=_ports())


def _ports() -> str:
    from serial.tools.list_ports import comports

    names = sorted(port.device for port in comports())
    return f"Write one of: {', '.join(names)}." if names else "No port exists: check that the device is plugged in."
