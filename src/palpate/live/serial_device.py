"""Simulate a sensor on a serial port: samples are sent on a pseudo-terminal as a real device sends them."""

from __future__ import annotations

import json
import os
import select
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError

__all__ = ["SerialDevice"]


class SerialDevice:
    """A simulated serial sensor, a `Device`; its counter also counts samples that nobody listens to.

    The kernel stores some kB that the listener has not read yet; samples that do not fit are dropped as complete units.

    Args:
        framing: "cobs" or "lines", see `palpate.live.cobs` and `.lines`.
        number: type of the numbers in a frame: one of `palpate.live.cobs.TYPES`.
        link: path of a symbolic link to the pseudo-terminal, whose name changes each time; None: no link.

    Attributes:
        dropped: number of samples dropped for lack of room.
    """

    def __init__(self, framing: str = "cobs", number: str = "f4", link: str | Path | None = None) -> None:
        self.dropped = 0
        self._framing, self._number = framing, number
        self._link = None if link is None else Path(link)
        self._line: int | None = None
        self._counter = 0
        self._rest = b""  # of a sample that went out in part
        self._heard = False  # by somebody, when samples were last sent

    def open(self) -> str:
        """Open the pseudo-terminal, and return the [source] of a rig as TOML.

        Raises:
            InputError: the system has no pseudo-terminals, or `link` is a file or cannot be made.
        """
        self.close()
        try:
            import tty

            self._line, other = os.openpty()
        except (OSError, ImportError, AttributeError) as problem:
            raise InputError(
                f"a pseudo-terminal cannot be opened ({problem}).", hint="Choose another device."
            ) from problem
        tty.setraw(other)
        name = os.ttyname(other)
        os.close(other)  # so that the kernel reports whether somebody else has it open
        os.set_blocking(self._line, False)
        self._keep_link(name)
        address = json.dumps(str(self._link or name))  # quoted as TOML quotes, too
        return f'[source]\nkind = "serial"\naddress = {address}\nframing = "{self._framing}"\n'

    def send(self, stamp: Int[np.ndarray, " n"], values: Float[np.ndarray, "n k"]) -> int:
        """Send samples without waiting, and return how many there was room for; 0 if nobody listens."""
        data, ends = self._encoded(values)
        self._counter = (self._counter + len(values)) % 2**32
        if self._line is None or not self._listened(self._line):
            return 0
        bounds = np.append(0, ends) + len(self._rest)  # of what was left over, and of each sample
        data = self._rest + data
        written = _written(self._line, data)
        sent = int(
            np.searchsorted(bounds, written)
        )  # the last of them may be out in part: its rest goes first next time
        self._rest = data[written : int(bounds[sent])]
        self.dropped += len(ends) - sent
        return sent

    def close(self) -> None:
        """Close the pseudo-terminal, as if the sensor were unplugged, and remove the link; may be called again."""
        if self._line is not None:
            os.close(self._line)
            self._line = None
            self._rest, self._heard = b"", False
            if self._link is not None:
                self._link.unlink(missing_ok=True)

    def _encoded(self, values: Float[np.ndarray, "n k"]) -> tuple[bytes, Int[np.ndarray, " n"]]:
        if self._framing == "lines":
            from palpate.live.lines import printed

            return printed(values, self._counter)
        from palpate.live.cobs import encoded

        return encoded(values, self._counter, self._number)

    def _listened(self, line: int) -> bool:
        """Return whether the other end is open; a new listener gets the end of a frame first."""
        poll = select.poll()
        poll.register(line, select.POLLOUT)
        heard = not any(event & select.POLLHUP for _, event in poll.poll(0))
        if heard and not self._heard:
            self._rest = b"\r\n" if self._framing == "lines" else b"\x00"
        self._heard = heard
        return heard

    def _keep_link(self, name: str) -> None:
        if self._link is None:
            return
        if self._link.exists() and not self._link.is_symlink():
            raise InputError("is a file, so that the link to the port cannot be made here.", where=str(self._link))
        try:
            self._link.unlink(missing_ok=True)
            self._link.symlink_to(name)
        except OSError as problem:
            raise InputError(
                f"the link to the port cannot be made ({problem.strerror}).", where=str(self._link)
            ) from problem


def _written(line: int, data: bytes) -> int:
    """Write data without waiting, and return the number of bytes for which there was room."""
    written = 0
    while written < len(data):
        try:
            written += os.write(line, data[written:])
        except BlockingIOError:
            break
    return written
