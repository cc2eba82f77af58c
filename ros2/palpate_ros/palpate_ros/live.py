"""A node that becomes `palpate live`: its parameters are the options of that command."""

import os
import shutil
import sys
from collections.abc import Mapping
from typing import Any

import rclpy

NOT_GIVEN = {"record": "", "sensor": "", "seconds": 0.0}  # a parameter of ROS always has a value
OF_ROS = ("use_sim_time", "start_type_description_service", "qos_overrides")


def main() -> None:
    """Replace this process by `palpate live`: signals, output and exit code are its own."""
    rclpy.init()
    node: Any = rclpy.create_node("palpate_live", automatically_declare_parameters_from_overrides=True)
    given = {name: each.value for name, each in node.get_parameters_by_prefix("").items()}
    rclpy.shutdown()
    program = shutil.which("palpate")
    if program is None:
        sys.exit("palpate is not on the PATH: pip install 'palpate[live]', or activate its environment.")
    options = {name: value for name, value in given.items() if not name.startswith(OF_ROS)}
    os.execv(program, [program, "live", *words(options, os.environ.get("ROS_DOMAIN_ID", ""))])


def words(options: Mapping[str, Any], domain: str = "") -> list[str]:
    """Return the options of `palpate live` as they are typed.

    Args:
        options: their values, by name; an unknown name is refused by `palpate live`.
        domain: number of the domain for `publish: ["ros2"]`; "": that of the rig's [source].
    """
    typed: list[str] = []
    for name, value in options.items():
        if name == "view":
            typed += ["--view"] if value else []
        elif name == "publish":
            all_to = [f"ros2:{domain}" if each == "ros2" and domain else each for each in value]
            typed += [word for to in all_to for word in ("--publish", to)]
        elif name not in NOT_GIVEN or value != NOT_GIVEN[name]:
            typed += [f"--{name}", str(value)]
    return typed
