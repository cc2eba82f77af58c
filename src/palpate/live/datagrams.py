"""Read all waiting datagrams of a socket in one call, with the kernel's stamps."""

from __future__ import annotations

import ctypes
import errno
import os
import socket
import struct
import sys
import time

import numpy as np
from jaxtyping import Int, UInt32, UInt64

_TIMESTAMPNS, _RXQ_OVFL, _RCVBUFFORCE = 35, 40, 33  # of Linux, not in `socket`
_DONTWAIT = 0x40
_ADDRESS = 16  # bytes of a sockaddr_in, of which the first 8 identify the sender


class _Message(ctypes.Structure):
    """The C structure `msghdr`, with pointers as integers for NumPy."""

    _fields_ = [
        ("name", ctypes.c_size_t),
        ("name_size", ctypes.c_uint32),
        ("vector", ctypes.c_size_t),
        ("vector_size", ctypes.c_size_t),
        ("control", ctypes.c_size_t),
        ("control_size", ctypes.c_size_t),
        ("flags", ctypes.c_int),
    ]


class _Header(ctypes.Structure):
    """The C structure `mmsghdr`: a message's header and its length."""

    _fields_ = [("message", _Message), ("length", ctypes.c_uint32)]


class _Vector(ctypes.Structure):
    """The C structure `iovec`: address and size of a buffer."""

    _fields_ = [("base", ctypes.c_size_t), ("size", ctypes.c_size_t)]


class _Control(ctypes.Structure):
    """A datagram's control data: its stamp, and the number of drops if there are any."""

    _fields_ = [
        ("size", ctypes.c_size_t),
        ("level", ctypes.c_int),
        ("kind", ctypes.c_int),
        ("seconds", ctypes.c_long),
        ("nanoseconds", ctypes.c_long),
        ("drops_size", ctypes.c_size_t),
        ("drops_level", ctypes.c_int),
        ("drops_kind", ctypes.c_int),
        ("drops", ctypes.c_uint32),
        ("rest", ctypes.c_uint32),
    ]


class Datagrams:
    """A reader of datagrams from a UDP socket of IPv4, which fills the same arrays again in each call.

    Args:
        receiver: the socket, which is set not to block.
        slots: structured dtype of a datagram's bytes.
        size: most datagrams read at once.

    Attributes:
        slot: (size,) bytes of each datagram, as far as a slot holds them.
        length: (size,) number of bytes of each, at most a slot's.
        sender: (size,) address of each sender, as `packed_address` returns it.
        stamp: (size,) int64 [ns] since 1970: arrival of each at the kernel, or the time of the read without its stamp.
        dropped: number of datagrams so far that the kernel dropped, as the buffer was full; 0 if it does not count.
    """

    def __init__(self, receiver: socket.socket, slots: np.dtype[np.void], size: int) -> None:
        receiver.setblocking(False)
        self._socket = receiver
        self.slot = np.zeros(size, dtype=slots)
        self.length: UInt32[np.ndarray, " n"] = np.zeros(size, dtype=np.uint32)
        self.sender: UInt64[np.ndarray, " n"] = np.zeros(size, dtype=np.uint64)
        self.stamp: Int[np.ndarray, " n"] = np.zeros(size, dtype=np.int64)
        self.dropped = 0
        self._many: _Many | None = _Many(self, receiver) if sys.platform == "linux" else None

    def take(self, most: int) -> int:
        """Read up to `most` waiting datagrams into the attributes, without waiting, and return their number.

        Raises:
            OSError: the socket cannot be read.
        """
        most = min(most, len(self.slot))
        return self._many.take(self, most) if self._many is not None else self._one_by_one(most)

    def _one_by_one(self, most: int) -> int:
        whole = self.slot.view(np.uint8).data
        size = self.slot.dtype.itemsize
        for k in range(most):
            try:
                self.length[k], address = self._socket.recvfrom_into(whole[k * size : (k + 1) * size])
            except (BlockingIOError, InterruptedError):
                return k
            self.sender[k], self.stamp[k] = packed_address(address), time.time_ns()
        return most


class _Many:
    """A reader by Linux's recvmmsg."""

    def __init__(self, owner: Datagrams, receiver: socket.socket) -> None:
        from palpate.live import _stream  # compiled: loaded when first needed

        self._socket, size = receiver, len(owner.slot)
        self._headers, self._controls = np.zeros(size, dtype=_Header), np.zeros(size, dtype=_Control)
        self._vectors = np.zeros(size, dtype=_Vector)
        self._vectors["base"], self._vectors["size"] = _each(owner.slot), owner.slot.dtype.itemsize
        self._names = np.zeros((size, _ADDRESS // 8), dtype=np.uint64)
        message: np.ndarray = self._headers["message"]
        message["name"], message["name_size"] = _each(self._names), _ADDRESS
        message["vector"], message["vector_size"] = _each(self._vectors), 1
        message["control"], message["control_size"] = _each(self._controls), self._controls.itemsize
        self._said: np.ndarray = message["control_size"]  # views are made once: making one costs as much as a sample
        self._seconds: np.ndarray = self._controls["seconds"]
        self._nanoseconds: np.ndarray = self._controls["nanoseconds"]
        owner.length, owner.sender = self._headers["length"], self._names[:, 0]
        self._call = ctypes.CDLL(None, use_errno=True).recvmmsg
        self._call.argtypes = [ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int, ctypes.c_void_p]
        self._at = self._headers.ctypes.data
        self._stamps = _stream.stamped
        self._stamped(owner, 0)  # compiles
        for option in (_TIMESTAMPNS, _RXQ_OVFL):
            receiver.setsockopt(socket.SOL_SOCKET, option, 1)

    def take(self, owner: Datagrams, most: int) -> int:
        count = int(self._call(self._socket.fileno(), self._at, most, _DONTWAIT, None))
        if count < 0:
            number = ctypes.get_errno()
            if number in (errno.EAGAIN, errno.EINTR):
                return 0
            raise OSError(number, os.strerror(number))
        if self._stamped(owner, count) >= _Control.rest.offset:
            owner.dropped += (int(self._controls["drops"][count - 1]) - owner.dropped) & 0xFFFFFFFF
        return count

    def _stamped(self, owner: Datagrams, count: int) -> int:
        """Fill the stamps, and return the size of the last control data [bytes]."""
        least, size = _Control.drops_size.offset, self._controls.itemsize
        now = time.time_ns()  # the kernel starts to stamp a moment after the request
        return self._stamps(count, self._seconds, self._nanoseconds, least, now, owner.stamp, self._said, size)


def packed_address(address: tuple[str, int]) -> int:
    """Return a numeric IPv4 address and port as an integer: the first 8 bytes of Linux's sockaddr_in.

    Raises:
        OSError: the address is not numeric.
    """
    raw = struct.pack("=H", socket.AF_INET) + struct.pack(">H", address[1]) + socket.inet_aton(address[0])
    return int.from_bytes(raw, sys.byteorder)


def ask_buffer(receiver: socket.socket, size: int) -> int:
    """Request a receive buffer of `size` bytes, beyond the system's limit if permitted; return the bytes granted.

    On Linux this is half of the kernel's figure, the rest of which is for bookkeeping.
    """
    linux = sys.platform == "linux"
    try:
        receiver.setsockopt(socket.SOL_SOCKET, _RCVBUFFORCE if linux else socket.SO_RCVBUF, size)
    except PermissionError:  # beyond the limit, of root alone
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, size)
    return receiver.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // (2 if linux else 1)


def _each(rows: np.ndarray) -> UInt64[np.ndarray, " n"]:
    """Return the memory address of each row of an array, (n,)."""
    return (rows.ctypes.data + np.arange(len(rows)) * rows.strides[0]).astype(np.uint64)
