"""Write a run in the arena as files: what robots would have recorded, and separately what really happened."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from palpate.errors import InputError
from palpate.files.models.toml import toml_lines
from palpate.opencv import opencv
from palpate_lab.simulation.arena.layout import ArenaLayout
from palpate_lab.simulation.arena.moment import ArenaMoment
from palpate_lab.simulation.bags import header, open_bag

QUALITY = 85  # of JPEG
BLOCKS = "/truth/blocks"
STILL = 5e-4, 3e-3  # m, rad: a block that has moved less is not written again
KINDS = ("flat", "edge", "robot")  # of what touches
TRUTH = ("time", "robot", "angle_deg", "depth_mm", "force_n", "shear_n", "kind")
FELT = ("time", "robot", "angle_deg", "force_n")
TOUCHES = ("time", "px", "py", "pz", "nx", "ny", "nz", "fx", "fy", "fz", "angle_deg", "depth_mm", "force_n", "shear_n")
_GEOMETRY, _IMAGE = "geometry_msgs/msg", "sensor_msgs/msg/CompressedImage"
_ROBOT = {  # topics of each robot
    "pose": f"{_GEOMETRY}/PoseStamped",
    "truth/pose": f"{_GEOMETRY}/PoseStamped",
    "wheels": "sensor_msgs/msg/JointState",
    "contacts": f"{_GEOMETRY}/WrenchStamped",
    "state": "std_msgs/msg/String",
}
_CAMERA = "camera/compressed"
RIG = """# The ring of one robot in {name}.mcap. What really touched it is in {name}_robot_1_truth.csv.
# All robots wear the same ring: for another one change the number in the topic.
[marker_ring]
model = "{name}_ring.toml"
topic = "/robot_1/camera/compressed"
"""


def files_of(recording: Path, robots: int, images: bool) -> dict[str, Path]:
    """Return a dict of kind -> path of all files of a run, next to its recording.

    The kinds are recording, arena, truth and felt; with images also rig, ring, and "truth 1" and so on for each robot.
    """
    ends = {"arena": "arena.toml", "truth": "truth.csv", "felt": "felt.csv"}
    if images:
        ends |= {"rig": "rig.toml", "ring": "ring.toml"}
        ends |= {f"truth {k}": f"robot_{k}_truth.csv" for k in range(1, robots + 1)}
    return {"recording": recording} | {
        what: recording.with_name(f"{recording.stem}_{end}") for what, end in ends.items()
    }


def write_rig(recording: Path) -> None:
    """Write the rig of the first robot's camera; the caller writes the ring's model to `files_of`'s "ring"."""
    file = files_of(recording, 1, True)["rig"]
    file.write_text(RIG.format(name=recording.stem), encoding="utf-8")


def write_arena(file: Path, layout: ArenaLayout, settings: Mapping[str, object]) -> None:
    """Write the arena and the settings of its run as TOML.

    Args:
        file: file to write.
        layout: the arena.
        settings: numbers and texts that are written first.

    Raises:
        OSError: the file cannot be written.
    """
    lines = ["# Lengths in metres, angles in radians; a block without a mass is fixed."]
    stated = {**settings, "name": layout.name, "size": layout.size, "starts": layout.starts.tolist()}
    lines += _lines({**stated, "goals": layout.goals.tolist()})
    for block in layout.blocks:
        lines += ["", "[[block]]", *_lines({name: value for name, value in vars(block).items() if value is not None})]
    file.write_text("\n".join([*lines, ""]), encoding="utf-8")


def _lines(table: Mapping[str, object]) -> list[str]:
    return [line for name, value in table.items() for line in toml_lines(name, value)]


class RunRecorder:
    """A writer of a run, moment by moment; a context manager, whose files are complete when it ends well.

    Args:
        recording: the MCAP file; the others are named as `files_of` says.
        robots: number of robots.
        images: True if cameras are recorded.
        radius: radius of the skin [m].

    Raises:
        InputError: rosbags is not installed, or OpenCV where cameras are recorded.
    """

    def __init__(self, recording: Path, robots: int, *, images: bool = False, radius: float = 0.055) -> None:
        self._robots, self._images, self._stack = robots, images, ExitStack()
        self._radius = radius
        self._cv2: Any = opencv() if images else None
        files = files_of(recording, robots, images)
        kinds = {f"/robot_{k + 1}/{name}": kind for k in range(robots) for name, kind in _ROBOT.items()}
        if images:
            kinds |= {f"/robot_{k + 1}/{_CAMERA}": _IMAGE for k in range(robots)}
        self._bag = self._stack.enter_context(open_bag(recording, kinds | {BLOCKS: f"{_GEOMETRY}/PoseArray"}))
        self._truth, self._felt = self._table(files["truth"], TRUTH), self._table(files["felt"], FELT)
        self._single = [self._table(files[f"truth {k + 1}"], TOUCHES) for k in range(robots)] if images else []
        self._states, self._blocks = [""] * robots, np.zeros((0, 3))

    def add(self, frame: ArenaMoment) -> None:
        """Write the next moment to all files of the run.

        Raises:
            InputError: OpenCV cannot write JPEG.
        """
        stamp = round(1e9 * frame.time)
        for robot in range(self._robots):
            name = f"/robot_{robot + 1}"
            self._pose(stamp, f"{name}/pose", frame.tracked[robot])
            self._pose(stamp, f"{name}/truth/pose", frame.poses[robot])
            self._wheels(stamp, f"{name}/wheels", frame.wheels[robot])
            self._net(stamp, robot, frame.touches[robot])
            self._state(stamp, robot, f"{frame.states[robot]}: {frame.whys[robot]}")
            if self._images and frame.frames is not None:
                self._camera(stamp, robot, frame.frames[robot])
        self._moved(stamp, frame.blocks)
        self._rows(frame)

    def _table(self, path: Path, names: tuple[str, ...]) -> Any:
        file = self._stack.enter_context(path.open("w", newline="", encoding="utf-8"))
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        return writer

    def _type(self, name: str) -> Any:
        return self._bag.types[name if "/" in name else f"{_GEOMETRY}/{name}"]

    def _posed(self, pose: Float[np.ndarray, "3"]) -> Any:
        """Return a geometry_msgs/Pose of x, y and a turn about the vertical."""
        x, y, turn = pose.tolist()
        way = self._type("Quaternion")(0.0, 0.0, float(np.sin(turn / 2)), float(np.cos(turn / 2)))
        return self._type("Pose")(self._type("Point")(x, y, 0.0), way)

    def _pose(self, stamp: int, topic: str, pose: Float[np.ndarray, "3"]) -> None:
        head = header(self._bag.types, stamp, "arena")
        self._bag.write(stamp, topic, self._type("PoseStamped")(head, self._posed(pose)))

    def _wheels(self, stamp: int, topic: str, wheels: Float[np.ndarray, "2"]) -> None:
        """Write the speeds of the tracks over the floor [m/s], as those of joints that slide."""
        head, none = header(self._bag.types, stamp, ""), np.zeros(0)
        kind = self._type("sensor_msgs/msg/JointState")
        self._bag.write(stamp, topic, kind(head, ["left", "right"], none, np.array(wheels), none))

    def _net(self, stamp: int, robot: int, felt: Float[np.ndarray, "k 2"] | None) -> None:
        """Write the sum of all felt forces as a wrench on the robot, in its frame; NaN if its skin gives no reading."""
        x = y = float("nan")
        if felt is not None:
            x = 0.0 - float(felt[:, 1] @ np.cos(felt[:, 0]))
            y = 0.0 - float(felt[:, 1] @ np.sin(felt[:, 0]))
        vector, name = self._type("Vector3"), f"robot_{robot + 1}"
        wrench = self._type("Wrench")(vector(x, y, 0.0), vector(0.0, 0.0, 0.0))
        stamped = self._type("WrenchStamped")(header(self._bag.types, stamp, name), wrench)
        self._bag.write(stamp, f"/{name}/contacts", stamped)

    def _state(self, stamp: int, robot: int, words: str) -> None:
        """Write a message if the state has changed."""
        if words != self._states[robot]:
            self._states[robot] = words
            self._bag.write(stamp, f"/robot_{robot + 1}/state", self._type("std_msgs/msg/String")(words))

    def _camera(self, stamp: int, robot: int, image: UInt8[np.ndarray, "h w 3"]) -> None:
        made, data = self._cv2.imencode(".jpg", image, [self._cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        if not made:
            hint = "pip install 'palpate[camera]'"
            raise InputError("the installed OpenCV cannot encode JPEG.", where="camera", hint=hint)
        head = header(self._bag.types, stamp, f"robot_{robot + 1}/camera")
        self._bag.write(stamp, f"/robot_{robot + 1}/{_CAMERA}", self._type(_IMAGE)(head, "jpeg", data.ravel()))

    def _moved(self, stamp: int, blocks: Float[np.ndarray, "m 3"]) -> None:
        """Write all movable blocks if one has moved."""
        if len(self._blocks) == len(blocks):
            change = np.abs(blocks - self._blocks)
            if not len(blocks) or (change[:, :2].max() < STILL[0] and change[:, 2].max() < STILL[1]):
                return
        self._blocks = blocks.copy()
        head = header(self._bag.types, stamp, "arena")
        self._bag.write(stamp, BLOCKS, self._type("PoseArray")(head, [self._posed(each) for each in blocks]))

    def _rows(self, frame: ArenaMoment) -> None:
        time = f"{frame.time:.6f}"
        for robot, felt in enumerate(frame.touches):
            rows: list[list[float]] = [] if felt is None else felt.tolist()
            self._felt.writerows((time, robot + 1, f"{np.degrees(a):.3f}", f"{f:.4f}") for a, f in rows)
        for robot, truth in enumerate(frame.truths):
            for row in truth:
                angle, force, shear, depth, kind = row.tolist()
                said = [f"{value:.5f}" for value in (np.degrees(angle), 1e3 * depth, force, shear)]
                self._truth.writerow((time, robot + 1, *said, KINDS[int(kind)]))
                if self._single:
                    self._single[robot].writerow((time, *_at(self._radius, angle, force, shear), *said))

    def __enter__(self) -> RunRecorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, value, trace)


def _at(radius: float, angle: float, force: float, shear: float) -> list[str]:
    """Return point, normal and force on the skin of a contact, in the ring's frame, as text."""
    c, s = float(np.cos(angle)), float(np.sin(angle))
    values = (radius * c, radius * s, 0.0, c, s, 0.0, -shear * s - force * c, shear * c - force * s, 0.0)
    return [f"{value:.6f}" for value in values]
