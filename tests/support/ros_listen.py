"""A node of the real ROS 2, for an interpreter that has rclpy: it prints one message of each topic, as JSON.

Usage: ros_listen.py TOPIC package/Type ...; it ends when each has come, of markers one that shows a contact.
"""

from __future__ import annotations

import importlib
import json
import sys
from functools import partial
from typing import Any

import rclpy


def main(words: list[str]) -> None:
    """Listen until all have come."""
    rclpy.init()
    node: Any = rclpy.create_node("listener")
    heard: dict[str, dict[str, Any]] = {}
    for topic, kind in zip(words[::2], words[1::2], strict=True):
        package, name = kind.split("/")
        node.create_subscription(
            getattr(importlib.import_module(f"{package}.msg"), name), topic, partial(keep, heard, topic), 10
        )
    while len(heard) < len(words) // 2:
        rclpy.spin_once(node, timeout_sec=0.1)
    sys.stdout.write(json.dumps(heard))


def keep(heard: dict[str, dict[str, Any]], topic: str, message: Any) -> None:
    """The parts of a message that are compared."""
    if hasattr(message, "markers"):
        if len(message.markers) > 1:
            kinds = [each.type for each in message.markers]
            heard[topic] = {"frame": message.markers[-1].header.frame_id, "kinds": kinds}
        return
    heard[topic] = {"frame": message.header.frame_id}
    if hasattr(message, "wrench"):
        heard[topic]["force"] = [message.wrench.force.x, message.wrench.force.y, message.wrench.force.z]
    else:
        at = message.pose.pose.position
        heard[topic]["point"] = [at.x, at.y, at.z]


if __name__ == "__main__":
    main(sys.argv[1:])
