"""A stand-in for a driver that publishes to ROS 2."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from palpate.live.dds import DdsNode, Writer, ros_name
from palpate.live.ros_messages import array_message, image_message, stamped

__all__ = ["RosDevice"]


class RosDevice:
    """Publishes samples: six numbers as WrenchStamped, three colours as Image, anything else as Float64MultiArray.

    Args:
        topic: to publish.
        shape: of one sample: (6,) of a wrench, (height, width, 3) of images, else an array.
        domain, interface: as of a `Node`.
        frame_id: of headers.
    """

    def __init__(
        self,
        topic: str = "/wrench",
        shape: tuple[int, ...] = (6,),
        domain: int = 0,
        interface: str = "",
        frame_id: str = "sensor",
    ) -> None:
        self._topic, self._shape, self._frame_id = topic, shape, frame_id
        self._node = DdsNode(domain, interface)
        self._writer: Writer | None = None

    @property
    def kind(self) -> str:
        """Type of its messages."""
        if self._shape == (6,):
            return "geometry_msgs/WrenchStamped"
        images = len(self._shape) == 3 and self._shape[2] == 3
        return "sensor_msgs/Image" if images else "std_msgs/Float64MultiArray"

    def open(self) -> str:
        """See `palpate.live.device.Device`; the topic stands with the sensor in a rig."""
        self._node.open()
        self._writer = self._node.writer(self._topic, self.kind, depth=1000)
        lines = ["[source]", 'kind = "ros2"', f"domain = {self._node.domain}"]
        if self._node.interface:
            lines.append(f'interface = "{self._node.interface}"')
        return "\n".join([*lines, f'# and topic = "{ros_name(self._topic)}" in the table of the sensor', ""])

    def send(self, stamp: Int[np.ndarray, " n"], values: Float[np.ndarray, "n k"]) -> int:
        """See `palpate.live.device.Device`.

        Args:
            stamp: [ns], of the headers; an array has none.
            values: the numbers of a sample in one row.
        """
        if self._writer is None or not self._writer.readers:
            return 0
        return sum(self._writer.write(message) for message in self._messages(stamp, values))

    def close(self) -> None:
        """Leave the domain."""
        self._writer = None
        self._node.close()

    def _messages(self, stamp: Int[np.ndarray, " n"], values: Float[np.ndarray, "n k"]) -> list[bytes]:
        kind = self.kind
        if kind == "geometry_msgs/WrenchStamped":
            return stamped(self._frame_id, stamp, values)
        samples = values.reshape(-1, *self._shape)
        if kind == "sensor_msgs/Image":
            return [image_message(int(at), self._frame_id, one) for at, one in zip(stamp, samples, strict=True)]
        return [array_message(one) for one in samples]
