"""Images that say their number and their colour, in files of every kind that holds images."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
HEIGHT, WIDTH, RATE = 48, 64, 25.0
COLOUR = (200, 120, 40)  # blue, green, red
CODECS = {"log.avi": "MJPG", "log.mp4": "mp4v", "log.mkv": "mp4v"}
BAGS = ("log.bag", "bag", "log.mcap")
RAW, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"

Message = tuple[str, Any]  # type, and fields behind the header, as its class takes them


def frame(number: int, height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    """Eight bits of the number as bright and dark columns, so that no coding loses it; below them the colour."""
    image = np.empty((height, width, 3), dtype=np.uint8)
    bits = np.array([60 + 140 * (number >> bit & 1) for bit in range(8)], dtype=np.uint8)
    image[: height // 2] = np.repeat(bits, width // 8)[None, :, None]
    image[height // 2 :] = COLOUR
    return image


def numbers(images: np.ndarray) -> list[int]:
    """What `frame` wrote."""
    height, width = images.shape[1:3]
    columns = images[:, : height // 2].mean(axis=(1, 3)).reshape(len(images), 8, width // 8).mean(axis=2)
    return ((columns > 130) @ (1 << np.arange(8))).tolist()


def colour(images: np.ndarray) -> np.ndarray:
    """(3,) the mean of what `frame` coloured, away from the columns."""
    return images[:, 5 * images.shape[1] // 8 :].mean(axis=(0, 1, 2))


def write_video(path: Path, count: int, rate: float = RATE) -> Path:
    """Frames 0, 1, ... by OpenCV."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*CODECS[f"log{path.suffix}"]), rate, (WIDTH, HEIGHT))
    for number in range(count):
        writer.write(frame(number))
    writer.release()
    return path


def write_frames(folder: Path, names: Iterable[str]) -> Path:
    """Frames 0, 1, ... under these names."""
    folder.mkdir()
    for number, name in enumerate(names):
        cv2.imwrite(str(folder / name), frame(number))
    return folder


def raw(pixels: np.ndarray, encoding: str, *, padding: int = 0, big: bool = False) -> Message:
    """The fields of an image; rows may be longer than their pixels."""
    lines = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1)
    lines = np.hstack([lines, np.zeros((len(pixels), padding), dtype=np.uint8)])
    return RAW, (*pixels.shape[:2], encoding, int(big), lines.shape[1], lines.ravel())


def compressed(image: np.ndarray, suffix: str) -> Message:
    """The fields of a compressed image."""
    return COMPRESSED, (suffix, cv2.imencode(f".{suffix}", image)[1].ravel())


def write_images(
    path: Path, messages: Sequence[Message], *, topic: str = "/camera", stamps: Sequence[int] = (), chunked: bool = True
) -> Path:
    """A ROS 1 bag, a ROS 2 bag or an MCAP file of one topic; recorded 1 s behind their stamps [ns], 40 ms apart."""
    first = path.suffix == ".bag"
    store = ROS1 if first else ROS2
    kind, stamps = messages[0][0], stamps or [10**9 + 4 * 10**7 * k for k in range(len(messages))]
    raws: list[bytes] = []
    for stamp, (_, fields) in zip(stamps, messages, strict=True):
        time, make = store.types["builtin_interfaces/msg/Time"], store.types["std_msgs/msg/Header"]
        header = make(*((0,) if first else ()), time(*divmod(stamp, 10**9)), "camera")
        message = store.types[kind](header, *fields)
        raws.append(bytes(store.serialize_ros1(message, kind) if first else store.serialize_cdr(message, kind)))
    write_messages(path, raws, kind, topic, stamps, chunked=chunked)
    return path


def write_messages(
    path: Path, raws: Sequence[bytes], kind: str, topic: str, stamps: Sequence[int], *, chunked: bool = True
) -> None:
    """The same, of their bytes."""
    if path.suffix == ".mcap":
        with path.open("wb") as file:
            writer = Writer(file, compression=CompressionType.NONE, use_chunking=chunked)
            writer.start(profile="ros2", library="test")
            channel = writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", b""))
            for stamp, content in zip(stamps, raws, strict=True):
                writer.add_message(channel, stamp + 10**9, content, stamp)
            writer.finish()
        return
    made: Any = Writer1(path) if path.suffix == ".bag" else Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP)
    with made as bag:
        connection = bag.add_connection(topic, kind, typestore=ROS1 if path.suffix == ".bag" else ROS2)
        for stamp, content in zip(stamps, raws, strict=True):
            bag.write(connection, stamp + 10**9, content)
