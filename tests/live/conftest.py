"""What tests of a stream share: who listens, a domain of ROS 2 of their own, and the real ROS 2 in an environment."""

import fcntl
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from itertools import count
from pathlib import Path

import pytest

from palpate.live.dds import DdsNode

_tests = count()
ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("rclpy", "rmw-fastrtps-cpp", "geometry-msgs", "nav-msgs", "sensor-msgs", "std-msgs", "visualization-msgs")
LOOPBACK_ONLY = """<?xml version="1.0" encoding="UTF-8" ?>
<dds xmlns="http://www.eprosima.com"><profiles>
<transport_descriptors><transport_descriptor><transport_id>lo</transport_id><type>UDPv4</type>
<interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList></transport_descriptor></transport_descriptors>
<participant profile_name="lo" is_default_profile="true"><rtps>
<userTransports><transport_id>lo</transport_id></userTransports>
<useBuiltinTransports>false</useBuiltinTransports></rtps></participant>
</profiles></dds>
"""


@pytest.fixture
def domain() -> int:
    """Of each test of each process another; ports of higher ones belong to others, too."""
    return 1 + (13 * os.getpid() + next(_tests)) % 100


@pytest.fixture
def node(domain: int) -> Iterator[DdsNode]:
    """A participant of that domain, open, with the loopback interface."""
    pytest.importorskip("cyclonedds", reason="ROS 2 is reached through cyclonedds")
    with closing(DdsNode(domain)) as made:
        assert made.open() == ""
        yield made


@pytest.fixture(scope="session")
def rclpy() -> Path:
    """The interpreter of an environment with the real ROS 2 client, made once and kept in .cache."""
    with (ROOT / ".cache" / "rclpy.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # another worker may make it
        return _environment(ROOT / ".cache" / f"rclpy-{sys.version_info.major}.{sys.version_info.minor}")


def _environment(folder: Path) -> Path:
    python, done = folder / "bin" / "python", folder / "complete"
    if done.exists():
        return python
    uv = shutil.which("uv", path=os.pathsep.join([str(ROOT / ".tools" / "bin"), os.environ.get("PATH", "")]))
    if uv is None:
        pytest.skip("real ROS 2: there is no uv to install rclpy with")
    for command in (
        [uv, "venv", "--clear", "--python", sys.executable, str(folder)],
        [uv, "pip", "install", "--python", str(python), *(f"ros-{name}" for name in PACKAGES)],
    ):
        try:
            made = subprocess.run(command, capture_output=True, text=True, timeout=180, check=False)
        except subprocess.TimeoutExpired:
            pytest.skip("real ROS 2: installing rclpy takes too long here")
        if made.returncode:
            pytest.skip(f"real ROS 2: rclpy cannot be installed here: {made.stderr.strip().splitlines()[-1]}")
    done.touch()
    return python


@pytest.fixture
def of_ros(domain: int, tmp_path: Path) -> dict[str, str]:
    """The surroundings of a program of the real ROS 2 that stays on this machine."""
    profile = tmp_path / "loopback.xml"
    profile.write_text(LOOPBACK_ONLY)
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | {
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "FASTDDS_DEFAULT_PROFILES_FILE": str(profile),
        "ROS_LOG_DIR": str(tmp_path),
    }
