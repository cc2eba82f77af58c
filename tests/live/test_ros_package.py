"""The packages of ros2/: without ROS what they name exists; with rclpy the node's contacts arrive."""

import ast
import inspect
import json
import os
import re
import signal
import subprocess
import sys
import tomllib
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

from palpate.cli.live import live
from palpate.contact import Status
from palpate.files.message_types import DEFINITIONS
from palpate.live.publish_ros import TOPICS
from tests.support.live_rings import RADIUS, sphere_rig

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = [ROOT / "ros2" / name for name in ("palpate_msgs", "palpate_ros")]
MESSAGES, NODE = PACKAGES
SHOWS = {"MarkerArray": "MarkerArray", "PoseWithCovariance": "PoseWithCovarianceStamped", "Wrench": "WrenchStamped"}


@pytest.fixture
def words(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[str]]:
    """The node's function that types the options; it needs nothing of rclpy."""
    monkeypatch.setitem(sys.modules, "rclpy", ModuleType("rclpy"))
    monkeypatch.syspath_prepend(str(NODE))
    return import_module("palpate_ros.live").words


def _parameters() -> dict[str, Any]:
    (node,) = yaml.safe_load((NODE / "config" / "live.yaml").read_text()).values()
    return node["ros__parameters"]


def _fields(message: str) -> tuple[dict[str, str], dict[str, int]]:
    """Fields by name, and constants."""
    lines = [line.partition("#")[0].split() for line in (MESSAGES / "msg" / f"{message}.msg").read_text().splitlines()]
    fields = {words[1]: words[0] for words in lines if words and "=" not in words[1]}
    constants = (words[1].split("=") for words in lines if words and "=" in words[1])
    return fields, {name: int(value) for name, value in constants}


@pytest.mark.parametrize("package", PACKAGES, ids=lambda each: each.name)
def test_a_package_states_what_ros_asks_for(package: Path) -> None:
    """The elements that REP 149 requires, the version of Palpate, and each dependency once."""
    root = ElementTree.parse(package / "package.xml").getroot()
    assert root.get("format") == "3"
    assert {"name", "version", "description", "maintainer", "license"} <= {each.tag for each in root}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert (root.findtext("name"), root.findtext("version")) == (package.name, project["version"])
    assert root.findtext("license") == project["license"]
    depends = [each.text for each in root if each.tag.endswith("depend")]
    assert len(depends) == len(set(depends))
    kind = {MESSAGES: "ament_cmake", NODE: "ament_python"}[package]
    assert root.findtext("export/build_type") == kind


def test_the_package_depends_on_what_its_files_import_and_name() -> None:
    root = ElementTree.parse(NODE / "package.xml").getroot()
    depends = {each.text for each in root.iter("exec_depend")}
    imported = {
        node.module.partition(".")[0] if isinstance(node, ast.ImportFrom) and node.module else node.names[0].name
        for file in (NODE / "palpate_ros" / "live.py", NODE / "launch" / "live.launch.py")
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.Import | ast.ImportFrom)
    }
    assert imported - set(sys.stdlib_module_names) <= depends
    assert {kind.partition("/")[0] for kind in TOPICS.values()} <= depends


def test_what_is_installed_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """The launch file finds its program and files by these names."""
    given: dict[str, Any] = {}
    monkeypatch.setattr("setuptools.setup", given.update)
    monkeypatch.chdir(NODE)
    exec(compile((NODE / "setup.py").read_text(), "setup.py", "exec"), {})
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert (given["name"], given["version"], given["packages"]) == ("palpate_ros", version, ["palpate_ros"])
    installed = {Path(file).name: folder for folder, files in given["data_files"] for file in files}
    assert all((NODE / file).is_file() for _, files in given["data_files"] for file in files)
    assert installed["palpate_ros"] == "share/ament_index/resource_index/packages"
    assert {installed[name] for name in ("live.yaml", "palpate.rviz")} == {"share/palpate_ros/config"}
    assert installed["live.launch.py"] == "share/palpate_ros/launch"
    launch = (NODE / "launch" / "live.launch.py").read_text()
    compile(launch, "live.launch.py", "exec")
    declared = re.findall(r'DeclareLaunchArgument\(\s*"(\w+)"', launch)
    assert sorted(declared) == sorted(set(re.findall(r'LaunchConfiguration\("(\w+)"\)', launch)))
    assert given["entry_points"]["console_scripts"] == ["live = palpate_ros.live:main"]
    assert {'executable="live"', '"live.yaml"', '"palpate.rviz"'} <= set(
        re.findall(r'executable="live"|"(?:live\.yaml|palpate\.rviz)"', launch)
    )


def test_parameters_are_the_options_of_palpate_live_with_their_defaults(words: Callable[..., list[str]]) -> None:
    parameters = _parameters()
    options = inspect.signature(live).parameters
    assert set(parameters) == set(options) - {"rig"}
    typed = words({"rig": "rig.toml"} | parameters)
    assert typed[:2] == ["--rig", "rig.toml"]
    assert typed[2:4] == ["--publish", "ros2"]
    for name, value in zip(typed[4::2], typed[5::2], strict=True):
        assert value == str(options[name.removeprefix("--")].default)


def test_options_are_typed_as_the_command_reads_them(words: Callable[..., list[str]]) -> None:
    given = {"view": True, "realtime": False, "seconds": 2.5, "publish": ["ros2", "unix:a"], "riig": "x"}
    typed = words(given, "7")
    assert " ".join(typed) == (
        "--view --realtime False --seconds 2.5 --publish ros2:7 --publish unix:a --riig x"  # the last is refused
    )


def test_rviz_shows_topics_that_are_published_with_displays_of_their_types() -> None:
    rviz = yaml.safe_load((NODE / "config" / "palpate.rviz").read_text())["Visualization Manager"]
    displays = {each["Topic"]["Value"]: each for each in rviz["Displays"] if "Topic" in each}
    assert set(displays) == {topic for topic in TOPICS if not topic.endswith("/contacts")}
    for topic, each in displays.items():
        plugin = each["Class"].removeprefix("rviz_default_plugins/")
        assert SHOWS[plugin] == TOPICS[topic].partition("/")[2]
        assert each["Topic"]["Durability Policy"] == "Volatile"  # nothing is latched
    shown = re.search(r"SHOWN = (.*?)  #", (NODE / "launch" / "live.launch.py").read_text())
    assert shown is not None
    assert {f"/palpate/contact/{name}" for name in ast.literal_eval(shown[1])} == set(displays)


@pytest.mark.parametrize("message", ["Contact", "ContactArray"])
def test_messages_are_those_that_are_published(message: str) -> None:
    fields, constants = _fields(message)
    assert ", ".join(f"{kind} {name}" for name, kind in fields.items()) == DEFINITIONS[f"palpate_msgs/{message}"]
    if constants:
        assert constants == {each.name: each.value for each in Status}
    assert f"msg/{message}.msg" in (MESSAGES / "CMakeLists.txt").read_text()


def test_the_node_is_heard_by_the_real_ros(rclpy: Path, of_ros: dict[str, str], tmp_path: Path) -> None:
    """A log of a sphere pressed at a place that is known, replayed by the node with its own parameters."""
    pytest.importorskip("cyclonedds", reason="ROS 2 is reached through cyclonedds")
    place = RADIUS * np.array([0.6, 0.0, 0.8])
    force = -4.0 * place / RADIUS
    wrenches = np.random.default_rng(2).normal(0.0, 1e-3, (2000, 6)) * [1, 1, 1, 0.01, 0.01, 0.01]
    wrenches[500:, :3] += force
    rows = np.column_stack([np.arange(len(wrenches)) / 500.0, wrenches])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="time,fx,fy,fz,tx,ty,tz", comments="")
    rig = sphere_rig(tmp_path)
    rig.write_text(rig.read_text() + "loop = true\n")
    listener = [str(rclpy), str(ROOT / "tests" / "support" / "ros_listen.py")]
    listener += [word for topic, kind in TOPICS.items() if not kind.startswith("palpate") for word in (topic, kind)]
    script = "from palpate_ros.live import main; main()"  # what colcon installs
    node = [str(rclpy), "-c", script, "--ros-args", "--params-file", str(NODE / "config" / "live.yaml")]
    node += ["-p", f"rig:={rig}", "-p", "realtime:=false"]
    paths = os.pathsep.join(filter(None, [str(NODE), os.environ.get("PYTHONPATH")]))
    programs = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    with subprocess.Popen(node, env=of_ros | {"PYTHONPATH": paths, "PATH": programs}) as running:
        try:
            heard = json.loads(subprocess.run(listener, env=of_ros, capture_output=True, check=True, timeout=60).stdout)
        finally:  # or it would be waited for
            running.send_signal(signal.SIGINT)
        assert running.wait(30) == 0
    assert {message["frame"] for message in heard.values()} == {"surface"}
    np.testing.assert_allclose(heard["/palpate/contact/pose"]["point"], place, atol=1e-3)  # 4 N, 1 mN, 0.01 mN m
    np.testing.assert_allclose(heard["/palpate/contact/wrench"]["force"], force, atol=0.01)
    assert heard["/palpate/contact/markers"]["kinds"] == [0, 0, 2]  # all are deleted, an arrow, an ellipsoid
