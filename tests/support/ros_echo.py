"""A node of the real ROS 2, for an interpreter that has rclpy: what comes on /to_ros/KIND goes out on /from_ros/KIND.

Usage: ros_echo.py package/Type ...; it ends when its input does, and then prints how many of each it has sent.
"""

from __future__ import annotations

import importlib
import json
import sys
import threading
from functools import partial
from typing import Any

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile

LATCHED = "std_msgs/Float64MultiArray"


def main(kinds: list[str]) -> None:
    """Echo until the input ends."""
    rclpy.init()
    node: Any = rclpy.create_node("echo")
    counts: dict[str, int] = {}
    types: dict[str, Any] = {}
    for kind in kinds:
        package, name = kind.split("/")
        types[kind] = getattr(importlib.import_module(f"{package}.msg"), name)
        topic = kind.replace("/", "_")
        publisher = node.create_publisher(types[kind], f"/from_ros/{topic}", 50)
        node.create_subscription(types[kind], f"/to_ros/{topic}", partial(echo, publisher, counts, kind), 50)
    holds = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    held = node.create_publisher(types[LATCHED], "/from_ros/held", holds)
    held.publish(types[LATCHED](data=[1.0, 2.0, 3.0]))
    again = node.create_publisher(types[LATCHED], "/from_ros/held_again", holds)
    node.create_subscription(types[LATCHED], "/to_ros/held", partial(echo, again, counts, "held"), holds)
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    say("ready")
    while not ended.is_set():
        rclpy.spin_once(node, timeout_sec=0.1)
    say(json.dumps(counts))


def say(text: str) -> None:
    """One line to whoever started this."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def echo(publisher: Any, counts: dict[str, int], kind: str, message: Any) -> None:
    """The same message again."""
    publisher.publish(message)
    counts[kind] = counts.get(kind, 0) + 1


if __name__ == "__main__":
    main(sys.argv[1:])
