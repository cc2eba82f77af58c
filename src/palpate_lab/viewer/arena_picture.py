"""Draw moments of an arena from above, for films and the live page; the same moment gives the same pixels."""

from __future__ import annotations

from collections import Counter
from math import ceil

import numpy as np
from jaxtyping import Float, UInt8

from palpate.opencv import opencv
from palpate.viewer._style import DARK, MUTED, RULE, STATUS, mixed
from palpate.viewer.ink import Ink
from palpate_lab.simulation.arena.layout import ArenaLayout
from palpate_lab.simulation.arena.moment import ArenaMoment
from palpate_lab.simulation.arena.settings import RobotSettings
from palpate_lab.viewer.arena import FORCE, Trails, colour, newtons, outline, standing

SIZE = (960, 720)
HEAD, FOOT, SIDE = 48, 118, 24  # px above, below and at the sides of the field
LONG = 0.045  # m of an arrow for each newton
LONGEST = 0.22  # m
CELLS = 6  # robots that have a cell of their own below the field
_GROUND, _FLOOR = (244, 246, 248), (255, 255, 255)
_FIXED, _PUSHED = mixed(STATUS[3], 0.1), mixed(STATUS[5], 0.55)
_BLIND = (204, 51, 17)


class ArenaPicture:
    """A renderer of successive moments of one arena, in which robots leave trails.

    Args:
        arena: arena to draw.
        radius: radius of a robot [m].

    Raises:
        InputError: OpenCV is not installed.
    """

    def __init__(self, arena: ArenaLayout, radius: float = RobotSettings.radius) -> None:
        self.arena, self._radius, self._trails = arena, radius, Trails(arena.robots)
        self._ink = Ink(opencv())
        width, height = arena.size
        self._scale = min((SIZE[0] - 2 * SIDE) / width, (SIZE[1] - HEAD - FOOT) / height)
        self._corner = (SIZE[0] - self._scale * width) / 2, HEAD + self._scale * height
        self._empty = self._ground()

    def draw(self, scene: ArenaMoment) -> UInt8[np.ndarray, "720 960 3"]:
        """Return the picture of a moment, (720, 960, 3): blue, green, red."""
        self._trails.add(scene.poses)
        picture = self._empty.copy()
        self._draw_trails(picture)
        self._draw_blocks(picture, scene.blocks)
        for robot in range(self.arena.robots):
            self._draw_robot(picture, scene, robot)
        for robot, felt in enumerate(scene.touches):
            if felt is not None:
                self._draw_touches(picture, scene.poses[robot], felt)
        self._caption(picture, scene)
        return picture

    def _placed(self, points: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """Return the pixels of points of the field [m]."""
        return points * [self._scale, -self._scale] + self._corner

    def _ground(self) -> UInt8[np.ndarray, "720 960 3"]:
        """Draw the field, a grid of half metres, the walls and the goals."""
        ink, (width, height) = self._ink, self.arena.size
        picture = np.empty((SIZE[1], SIZE[0], 3), dtype=np.uint8)
        picture[:] = _GROUND[::-1]
        corners = self._placed(np.array([[0, 0], [width, 0], [width, height], [0, height]], dtype=float))
        ink.area(picture, corners, _FLOOR)
        for x in np.arange(0.5, width, 0.5):
            ink.line(picture, self._placed(np.array([[x, 0], [x, height]])), mixed(RULE, 0.4), 1)
        for y in np.arange(0.5, height, 0.5):
            ink.line(picture, self._placed(np.array([[0, y], [width, y]])), mixed(RULE, 0.4), 1)
        for robot, goal in enumerate(self.arena.goals):
            at, radius = self._placed(goal), self._scale * 0.10
            ink.disc(picture, at, radius, mixed(colour(robot), 0.85))
            ink.ring(picture, at, radius, mixed(colour(robot), 0.2), 2)
            ink.middle(picture, str(robot + 1), at, 0.55, mixed(colour(robot), 0.1))
        ink.loop(picture, corners, DARK, 4)
        return picture

    def _draw_trails(self, picture: np.ndarray) -> None:
        for robot in range(self.arena.robots):
            if self._trails.length(robot) > 1:
                self._ink.line(picture, self._placed(self._trails.of(robot)), mixed(colour(robot), 0.45), 2)

    def _draw_blocks(self, picture: np.ndarray, blocks: Float[np.ndarray, "m 3"]) -> None:
        for block in standing(self.arena, blocks):
            corners, movable = self._placed(outline(block, self.arena.size)), block.mass is not None
            if len(corners) < 3:
                continue
            self._ink.area(picture, corners, _PUSHED if movable else _FIXED)
            self._ink.loop(picture, corners, mixed(STATUS[5] if movable else MUTED, 0.0), 2 if movable else 1)
            if movable and len(corners) == 4:  # a light cross marks it as no wall for the colour-blind
                self._ink.line(picture, corners[[0, 2]], mixed(STATUS[5], 0.2), 1)
                self._ink.line(picture, corners[[1, 3]], mixed(STATUS[5], 0.2), 1)

    def _draw_robot(self, picture: np.ndarray, scene: ArenaMoment, robot: int) -> None:
        """Draw a disc with the skin as its rim, a nose in the direction of its heading, and its number."""
        ink, (x, y, heading) = self._ink, scene.poses[robot].tolist()
        at, radius, own = self._placed(np.array([x, y])), self._scale * self._radius, colour(robot)
        pale = 0.5 if scene.arrived[robot] else 0.0
        ink.disc(picture, at, radius, mixed(own, pale))
        ink.ring(picture, at, radius, _BLIND if scene.touches[robot] is None else mixed(DARK, pale), 2)
        nose = np.array([[1.0, 0.0], [0.62, 0.34], [0.62, -0.34]]) * radius * 0.98
        turned = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
        ink.area(picture, nose @ turned.T * [1.0, -1.0] + at, (255, 255, 255))
        ink.middle(picture, str(robot + 1), at, min(0.5, radius / 26), (255, 255, 255))

    def _draw_touches(self, picture: np.ndarray, pose: Float[np.ndarray, "3"], felt: Float[np.ndarray, "k 2"]) -> None:
        """Draw an arrow for each contact force, its tip at the contact point."""
        for angle, force in felt.tolist():
            out = np.array([np.cos(pose[2] + angle), np.sin(pose[2] + angle)])
            tip = pose[:2] + self._radius * out
            tail = tip + min(LONG * force, LONGEST) * out
            self._ink.arrow(picture, self._placed(np.stack([tail, tip])), FORCE)

    def _caption(self, picture: np.ndarray, scene: ArenaMoment) -> None:
        ink, robots = self._ink, self.arena.robots
        ink.text(picture, f"{scene.time:6.1f} s", (SIDE, 32), 0.75, DARK, 2)
        words = f"{int(scene.arrived.sum())} of {robots} arrived"
        ink.text(picture, words, (SIZE[0] - SIDE - ink.width(words, 0.6), 31), 0.6, DARK)
        if self.arena.name:
            ink.middle(picture, self.arena.name, np.array([SIZE[0] / 2, 25.0]), 0.5, mixed(MUTED, 0.0))
        (self._cells if robots <= CELLS else self._counts)(picture, scene)

    def _cells(self, picture: np.ndarray, scene: ArenaMoment) -> None:
        """Draw each robot's camera image or skin, its forces, its state and the reason."""
        ink, robots = self._ink, self.arena.robots
        wide, top = (SIZE[0] - 2 * 14) // max(robots, 3), SIZE[1] - FOOT + 12
        high = FOOT - 22
        for robot in range(robots):
            left = 14 + robot * wide
            view = _view(ink, scene, robot, high)
            view = view[:, (view.shape[1] - high) // 2 :][:, :high]  # a camera's middle
            picture[top : top + high, left : left + view.shape[1]] = view
            x, room = left + view.shape[1] + 8, wide - view.shape[1] - 14
            ink.text(picture, ink.cut(f"{robot + 1} {scene.states[robot]}", 0.42, room), (x, top + 14), 0.42, DARK)
            felt, said = scene.touches[robot], newtons(scene.touches[robot])
            shade = _BLIND if felt is None else FORCE if len(felt) else mixed(MUTED, 0.0)
            ink.text(picture, ink.cut(said, 0.4, room), (x, top + 32), 0.4, shade)
            for row, words in enumerate(_wrapped(ink, scene.whys[robot], 0.34, room, rows=4)):
                ink.text(picture, words, (x, top + 48 + 14 * row), 0.34, mixed(MUTED, 0.0))

    def _counts(self, picture: np.ndarray, scene: ArenaMoment) -> None:
        """Draw the number of robots in each state."""
        counted = sorted(Counter(scene.states).items(), key=lambda each: (-each[1], each[0]))[:12]
        for at, (state, count) in enumerate(counted):
            column, row = divmod(at, 4)
            place = SIDE + 310 * column, SIZE[1] - FOOT + 34 + 22 * row
            self._ink.text(picture, f"{count:3d}  {state}", place, 0.5, DARK)


def senses(scene: ArenaMoment, most: int, height: int, columns: int = 2) -> UInt8[np.ndarray, "h w 3"]:
    """Draw each robot's camera image, or its skin as a ring with the contact forces, side by side with numbers.

    Args:
        scene: moment of one robot or more.
        most: largest number of robots that are shown.
        height: height of each view [px].
        columns: number of views in a row.

    Returns:
        One picture (h, w, 3): blue, green, red.

    Raises:
        InputError: OpenCV is not installed.
    """
    ink = Ink(opencv())
    views = [_view(ink, scene, robot, height) for robot in range(min(most, len(scene.poses)))]
    for robot, view in enumerate(views):
        ink.disc(view, np.array([14.0, 14.0]), 10.0, colour(robot))
        ink.middle(view, str(robot + 1), np.array([14.0, 14.0]), 0.42, (255, 255, 255))
    high, wide = views[0].shape[:2]
    rows = ceil(len(views) / columns)
    picture = np.full((rows * (high + 4) - 4, columns * (wide + 4) - 4, 3), 255, dtype=np.uint8)
    for at, view in enumerate(views):
        y, x = (high + 4) * (at // columns), (wide + 4) * (at % columns)
        picture[y : y + high, x : x + wide] = view
    return picture


def _view(ink: Ink, scene: ArenaMoment, robot: int, height: int) -> UInt8[np.ndarray, "h w 3"]:
    """Draw one robot's camera image, or its skin as a ring with the robot's front at the top."""
    if scene.frames is not None:
        frame = scene.frames[robot]
        wide = round(height * frame.shape[1] / frame.shape[0])
        return ink.shrunk(frame, (wide, height))
    view, felt = np.full((height, height, 3), 255, dtype=np.uint8), scene.touches[robot]
    middle, ring = np.array([height / 2, height / 2]), 0.26 * height
    ink.disc(view, middle, ring, mixed(colour(robot), 0.85))
    ink.ring(view, middle, ring, _BLIND if felt is None else colour(robot), 3)
    nose = np.array([[0.0, -0.85], [0.22, -0.5], [-0.22, -0.5]]) * ring + middle
    ink.area(view, nose, colour(robot))
    if felt is None:
        ink.middle(view, "blind", middle, height / 220, _BLIND)
        return view
    for angle, force in felt.tolist():
        out = np.array([-np.sin(angle), -np.cos(angle)])  # ahead is up, and to the left of it is left
        tip = middle + ring * out
        ink.arrow(view, np.stack([tip + max(0.09, 0.22 * min(force / 5.0, 1.0)) * height * out, tip]), FORCE)
    return view


def _wrapped(ink: Ink, words: str, size: float, room: int, rows: int) -> list[str]:
    """Return a sentence as at most `rows` lines that fit into `room` [px], the last one cut."""
    lines = [""]
    for word in words.split():
        longer = f"{lines[-1]} {word}".strip()
        if ink.width(longer, size) <= room or not lines[-1]:
            lines[-1] = longer
        else:
            lines.append(word)
    if len(lines) > rows:
        lines[rows - 1] = " ".join(lines[rows - 1 :])
    return [ink.cut(line, size, room) for line in lines[:rows]]
