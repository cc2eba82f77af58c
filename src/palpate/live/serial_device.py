"""Simulate a sensor on a serial port by a pseudo-terminal."""

from __future__ import annotations

import os
import select

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError


class SerialDevice:
    """A simulated serial sensor; see `palpate.live.source.Device`.

    Its counter also counts samples that nobody reads or for which the kernel has no room.

    Args:
        framing: "cobs", with numbers as f32, or "lines".

    Attributes:
        dropped: number of samples dropped for lack of room.
    """

    def __init__(self, framing: str = "cobs") -> None:
        self.dropped = 0
        self._framing = framing
        self._line: int | None = None
        self._counter = 0
        self._rest = b""  # of a sample that went out in part
        self._heard = False  # by somebody, when samples were last sent

    def open(self) -> str:
        """Open the pseudo-terminal, and return the [source] of a rig as TOML.

        Raises:
            InputError: the system gives no pseudo-terminal.
        """
        self.close()
        try:
            import tty

            self._line, other = os.openpty()
        except (OSError, ImportError, AttributeError) as problem:
            what = f"a pseudo-terminal cannot be opened ({problem})."
            raise InputError(what, hint="Choose another device.") from problem
        tty.setraw(other)
        name = os.ttyname(other)
        os.close(other)  # so that the kernel reports whether somebody else has it open
        os.set_blocking(self._line, False)
        return f'[source]\nkind = "serial"\naddress = "{name}"\nframing = "{self._framing}"\n'

    def send(self, stamp: Int[np.ndarray, " n"], values: Float[np.ndarray, "n k"]) -> int:
        """Send samples without waiting, and return how many there was room for; 0 if nobody listens.

        Args:
            stamp: ignored.
            values: (n, k), a row for each sample.
        """
        data, ends = self._encoded(values)
        self._counter = (self._counter + len(values)) % 2**32
        if self._line is None or not self._listened(self._line):
            return 0
        bounds = np.append(0, ends) + len(self._rest)  # of what was left over, and of each sample
        data = self._rest + data
        written = _written(self._line, data)
        sent = int(np.searchsorted(bounds, written))  # the last may be out in part: its rest goes first next time
        self._rest = data[written : int(bounds[sent])]
        self.dropped += len(ends) - sent
        return sent

    def close(self) -> None:
        """Close the pseudo-terminal, as if the sensor were unplugged; may be called again."""
        if self._line is not None:
            os.close(self._line)
            self._line = None
            self._rest, self._heard = b"", False

    def _encoded(self, values: Float[np.ndarray, "n k"]) -> tuple[bytes, Int[np.ndarray, " n"]]:
        if self._framing == "lines":
            from palpate.live.lines import printed

            return printed(values, self._counter)
        from palpate.live.cobs import encoded

        return encoded(values, self._counter, "f4")

    def _listened(self, line: int) -> bool:
        """Return whether somebody listens; a new listener first gets the end of a frame."""
        poll = select.poll()
        poll.register(line, select.POLLOUT)
        heard = not any(event & select.POLLHUP for _, event in poll.poll(0))
        if heard and not self._heard:
            self._rest = b"\r\n" if self._framing == "lines" else b"\x00"
        self._heard = heard
        return heard


def _written(line: int, data: bytes) -> int:
    """Write without waiting, and return the number of bytes."""
    written = 0
    while written < len(data):
        try:
            written += os.write(line, data[written:])
        except BlockingIOError:
            break
    return written
