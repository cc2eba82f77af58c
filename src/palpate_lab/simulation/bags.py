"""Write MCAP files as robots record them, message by message by rosbags, and so not by the code that reads them."""

from __future__ import annotations

import heapq
import shutil
import tempfile
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from palpate.errors import importing_extra

Stamped = tuple[int, str, Any]  # ns, topic, message


class Bag:
    """An MCAP file that grows by a message at a time; made by `open_bag`.

    Attributes:
        types: message types by their names.
    """

    def __init__(self, writer: Any, store: Any, kinds: Mapping[str, str]) -> None:
        self.types = store.types
        self._writer, self._store = writer, store
        self._topics = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in kinds.items()}

    def write(self, stamp: int, topic: str, message: Any) -> None:
        """Write the next message.

        Args:
            stamp: time stamp [ns], never earlier than that of the message before.
            topic: one of the topics given to `open_bag`.
            message: message of that topic's type.
        """
        at = self._topics[topic]
        self._writer.write(at, stamp, self._store.serialize_cdr(message, at.msgtype))


@contextmanager
def open_bag(path: Path, kinds: Mapping[str, str], defined: Mapping[str, str] | None = None) -> Generator[Bag]:
    """Yield a `Bag` to write one MCAP file; the file appears under its name when the block ends well.

    Args:
        path: path of the file.
        kinds: topic -> type, as in "std_msgs/msg/UInt8MultiArray".
        defined: type -> definition of types that are not ROS's own.

    Raises:
        InputError: rosbags is not installed.
    """
    with importing_extra("writing MCAP needs rosbags", "ros"):
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in (defined or {}).items():
        store.register(get_types_from_msg(text, name))
    with tempfile.TemporaryDirectory(dir=path.parent) as scratch:  # rosbags writes a folder with one MCAP in it
        bag = Path(scratch) / "bag"
        with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            yield Bag(writer, store, kinds)
        shutil.move(bag / "bag.mcap", path)


def write_bag(
    path: Path,
    kinds: Mapping[str, str],
    made: Callable[[Any], Iterable[Iterable[Stamped]]],
    defined: Mapping[str, str] | None = None,
) -> None:
    """Write one MCAP file.

    Args:
        path: path of the file.
        kinds: topic -> type, as in "std_msgs/msg/UInt8MultiArray".
        made: function from the message types to an iterable for each topic of (stamp [ns], topic, message), in the
            order of their stamps.
        defined: type -> definition of types that are not ROS's own.

    Raises:
        InputError: rosbags is not installed.
    """
    with open_bag(path, kinds, defined) as bag:
        for stamp, topic, message in heapq.merge(*made(bag.types), key=lambda each: each[0]):
            bag.write(stamp, topic, message)


def wrenches(
    types: Any, topic: str, time: Float[np.ndarray, " n"], rows: Float[np.ndarray, "n 6"], frame: str = "ft_sensor"
) -> Iterator[Stamped]:
    """Yield (stamp [ns], topic, message) with a WrenchStamped of a frame for each time [s] and row [N, N m]."""
    vector, wrench, stamped = (types[f"geometry_msgs/msg/{name}"] for name in ("Vector3", "Wrench", "WrenchStamped"))
    for stamp, row in zip(nanoseconds(time), rows.tolist(), strict=True):
        yield stamp, topic, stamped(header(types, stamp, frame), wrench(vector(*row[:3]), vector(*row[3:])))


def poses(
    types: Any,
    topic: str,
    time: Float[np.ndarray, " n"],
    quaternions: Float[np.ndarray, "n 4"],
    positions: Float[np.ndarray, "n 3"] | tuple[float, float, float],
) -> Iterator[Stamped]:
    """Yield (stamp [ns], topic, message) with a PoseStamped in the base for each orientation x, y, z, w.

    A single position [m] is that of all; stamps before 0 are omitted.
    """
    point, turn, pose, stamped = (
        types[f"geometry_msgs/msg/{name}"] for name in ("Point", "Quaternion", "Pose", "PoseStamped")
    )
    places = np.broadcast_to(positions, (len(time), 3)).tolist()
    for stamp, place, row in zip(nanoseconds(time), places, quaternions.tolist(), strict=True):
        if stamp >= 0:
            yield stamp, topic, stamped(header(types, stamp, "base"), pose(point(*place), turn(*row)))


def joint_states(
    types: Any,
    topic: str,
    time: Float[np.ndarray, " n"],
    names: Sequence[str],
    positions: Float[np.ndarray, "n k"],
    velocities: Float[np.ndarray, "n _"] | None = None,
) -> Iterator[Stamped]:
    """Yield (stamp [ns], topic, message) with a JointState for each row of positions, and of velocities if given."""
    state, none = types["sensor_msgs/msg/JointState"], np.zeros(0)
    fast = np.zeros((len(time), 0)) if velocities is None else velocities
    for stamp, row, speeds in zip(nanoseconds(time), positions, fast, strict=True):
        yield stamp, topic, state(header(types, stamp, ""), list(names), row, speeds, none)


def readings(
    types: Any,
    topic: str,
    time: Float[np.ndarray, " n"],
    frames: UInt8[np.ndarray, "n ..."],
    labels: tuple[str, ...],
) -> Iterator[Stamped]:
    """Yield (stamp [ns], topic, message) with a UInt8MultiArray for each sample of a skin, with a label for each axis.

    Stamps before 0 are omitted.
    """
    array, layout, size = (
        types[f"std_msgs/msg/{name}"] for name in ("UInt8MultiArray", "MultiArrayLayout", "MultiArrayDimension")
    )
    shape = frames.shape[1:]
    strides = np.cumprod(shape[::-1])[::-1].tolist()
    about = layout([size(*each) for each in zip(labels, shape, strides, strict=True)], 0)
    for stamp, row in zip(nanoseconds(time), frames, strict=True):
        if stamp >= 0:
            yield stamp, topic, array(about, row.ravel())


def header(types: Any, stamp: int, frame: str) -> Any:
    """Return a std_msgs/Header with a stamp [ns] and the name of a frame."""
    seconds, rest = divmod(stamp, 10**9)
    return types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](seconds, rest), frame)


def nanoseconds(time: Float[np.ndarray, " n"]) -> list[int]:
    """Return times (n,) [s] as stamps [ns], a list of n integers."""
    return np.rint(time * 1e9).astype(np.int64).tolist()
