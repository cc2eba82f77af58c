"""Sensors on a robot's links: sheets of taxels, pads of pillars, fingertips on load cells and wrists, and their places.

A touch lands on a `TouchRegion`: what feels it, and the surface that it presses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from palpate.spatial.pose import Pose
from palpate_lab.simulation.cell_array import CellArray
from palpate_lab.simulation.robot.tree import RobotLink, Three
from palpate_lab.simulation.shapes import EllipsoidBody
from palpate_lab.simulation.skin_bench import Rolled
from palpate_lab.simulation.three_axis_skins import ThreeAxisSkin

EDGE = 1.5  # cells of a sheet next to its edge in which no touch is aimed
_STEEPEST = 0.45  # least cosine between a fingertip's z and the direction from its centre to a touch


@dataclass(frozen=True)
class SheetPatch:
    """A sheet of one-axis taxels round a cylinder of a link; `pose` is that of its axis in the link."""

    name: str
    link: str
    pose: Pose
    sheet: Rolled

    @property
    def ring(self) -> bool:
        """Return whether the sheet closes round the cylinder."""
        return self.sheet.columns > self.sheet.period - 0.5

    def places(self, draws: Float[np.ndarray, "n 2"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Return points [m] and normals in the link's frame, (n, 3) each, for draws from 0 to 1."""
        edge = np.array([EDGE, 0.0 if self.ring else EDGE])
        most = np.array([self.sheet.rows - 1.0, self.sheet.columns - (0.0 if self.ring else 1.0)])
        row, column = (edge + draws * (most - 2 * edge)).T
        points, normals = self.sheet.at(row, column)
        return self.pose.apply(points), self.pose.rotate(normals)


@dataclass(frozen=True)
class BareFace:
    """A flat part of a link that no skin covers: the middle of a side, and two half-lengths [m] along x and y of it."""

    link: str
    pose: Pose
    half: tuple[float, float]

    def places(self, draws: Float[np.ndarray, "n 2"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Return points [m] and normals in the link's frame, (n, 3) each, for draws from 0 to 1."""
        points = np.column_stack([(2 * draws - 1) * self.half, np.zeros(len(draws))])
        return self.pose.apply(points), np.tile(self.pose.rotation[:, 2], (len(draws), 1))


@dataclass(frozen=True)
class PadPatch:
    """A flat pad of three-axis taxels; `pose` is that of its middle in the link, z outward."""

    name: str
    link: str
    pose: Pose
    skin: ThreeAxisSkin

    def places(self, draws: Float[np.ndarray, "n 2"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Return points [m] and normals in the link's frame, (n, 3) each, for draws from 0 to 1: up to outer taxels."""
        x, y, _ = np.abs(self.skin.positions).max(axis=0).tolist()
        return BareFace(self.link, self.pose, (x, y)).places(draws)


@dataclass(frozen=True)
class CellTip:
    """A fingertip, an ellipsoid on load cells, about the origin of its link, touched from z."""

    name: str
    link: str
    body: EllipsoidBody
    cells: CellArray

    def places(self, draws: Float[np.ndarray, "n 2"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Return points [m] and normals in the link's frame, (n, 3) each, for draws from 0 to 1."""
        up, turn = 1.0 - draws[:, 0] * (1.0 - _STEEPEST), 2 * np.pi * draws[:, 1]
        flat = np.sqrt(1.0 - up**2)
        points = self.body.on_ray(np.column_stack([flat * np.cos(turn), flat * np.sin(turn), up]) * self.body.axes)
        return points, self.body.normals(points)


@dataclass(frozen=True)
class WristSensor:
    """A force/torque sensor in the frame `link`, whose only child is the link `surface`.

    Attributes:
        bias: (6,) [N, N m].
        noise: standard deviations [N, N m] of one reading.
    """

    name: str
    link: str
    surface: str
    bias: Float[np.ndarray, "6"]
    noise: tuple[float, float] = (0.03, 8e-4)


Sensor = SheetPatch | PadPatch | CellTip | WristSensor
TouchedPart = SheetPatch | PadPatch | CellTip | BareFace


@dataclass(frozen=True)
class TouchRegion:
    """Surfaces of which one is touched at a time, or a sheet on both sides at once.

    Attributes:
        parts: the surfaces, of which each touch takes one.
        wrist: name of the force/torque sensor that carries them, or "".
    """

    parts: tuple[TouchedPart, ...]
    wrist: str = ""


@dataclass(frozen=True)
class LabRobot:
    """A robot with its sensors.

    Attributes:
        name, base: of the robot, and of the link that does not move.
        links: parents before children.
        sensors: the sensors.
        regions: where it is touched.
        pillars: pad like all of its pads, with gains of its own: the one that was calibrated.
        grasps: True: touches of several regions at the same time are those of a grasp.
    """

    name: str
    base: str
    links: tuple[RobotLink, ...]
    sensors: tuple[Sensor, ...]
    regions: tuple[TouchRegion, ...]
    pillars: ThreeAxisSkin
    grasps: bool = False

    def sites(self) -> list[str]:
        """Return the links in whose frames the weight beyond them is measured: of wrists and fingertips."""
        return [each.link for each in self.sensors if isinstance(each, WristSensor | CellTip)]


def facing(at: Three, outward: Three, along: Three) -> Pose:
    """Return the pose of a plane's middle in a link: z outward, x along."""
    z, x = np.array(outward), np.array(along)
    return Pose(np.column_stack([x, np.cross(z, x), z]), np.array(at))
