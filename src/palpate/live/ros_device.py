"""Simulate a driver that publishes samples to ROS 2."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from palpate.live.dds import DdsNode, Writer, ros_name
from palpate.live.ros_messages import array_message, image_message, stamped

_FRAME = "sensor"  # that headers name


class RosDevice:
    """A simulated driver of WrenchStamped, Image or Float64MultiArray; see `palpate.live.source.Device`.

    Args:
        topic: topic to publish.
        shape: shape of one sample: (6,) for a wrench.
        domain: number of the domain, on this machine.
        images: whether samples are images, (height, width, 3).
    """

    def __init__(
        self, topic: str = "/wrench", shape: tuple[int, ...] = (6,), domain: int = 0, *, images: bool = False
    ) -> None:
        self._topic, self._shape, self._images = topic, shape, images
        self._node = DdsNode(domain)
        self._writer: Writer | None = None

    @property
    def kind(self) -> str:
        """Type of the messages, such as "geometry_msgs/WrenchStamped"."""
        if self._shape == (6,):
            return "geometry_msgs/WrenchStamped"
        return "sensor_msgs/Image" if self._images else "std_msgs/Float64MultiArray"

    def open(self) -> str:
        """Join the domain, and return the [source] of a rig as TOML.

        Raises:
            InputError: cyclonedds is not installed, the domain cannot be joined, or the topic's name is not valid.
        """
        self._node.open()
        self._writer = self._node.writer(self._topic, self.kind, depth=1000)
        topic = f'# and topic = "{ros_name(self._topic)}" in the table of the sensor'
        return f'[source]\nkind = "ros2"\ndomain = {self._node.domain}\n{topic}\n'

    def send(self, stamp: Int[np.ndarray, " n"], values: Float[np.ndarray, "n k"]) -> int:
        """Publish samples, and return how many were sent; 0 if nobody listens.

        Args:
            stamp: (n,) [ns] stamps of the headers; arrays have none.
            values: (n, k), the numbers of a sample in one row.
        """
        if self._writer is None or not self._writer.readers:
            return 0
        return sum(self._writer.write(message) for message in self._messages(stamp, values))

    def close(self) -> None:
        """Leave the domain; may be called again."""
        self._writer = None
        self._node.close()

    def _messages(self, stamp: Int[np.ndarray, " n"], values: Float[np.ndarray, "n k"]) -> list[bytes]:
        kind = self.kind
        if kind == "geometry_msgs/WrenchStamped":
            return stamped(_FRAME, stamp, values)
        samples = values.reshape(-1, *self._shape)
        if kind == "sensor_msgs/Image":
            return [image_message(int(at), _FRAME, one) for at, one in zip(stamp, samples, strict=True)]
        return [array_message(one) for one in samples]
