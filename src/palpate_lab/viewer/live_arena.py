"""A live page of robots in an arena: a three-dimensional view, and what each robot feels and does."""

from __future__ import annotations

from base64 import b64encode
from html import escape
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Int

from palpate.opencv import opencv
from palpate.viewer._style import MUTED, RULE, STATUS, mixed
from palpate.viewer.camera import fit
from palpate.viewer.legend import dot, item, strip
from palpate.viewer.server import Served
from palpate.viewer.widgets import card, dock, theme
from palpate_lab.simulation.arena.layout import ArenaLayout
from palpate_lab.simulation.arena.moment import ArenaMoment
from palpate_lab.simulation.arena.settings import RobotSettings
from palpate_lab.viewer.arena import Trails, colour, newtons, outline
from palpate_lab.viewer.arena_picture import senses

if TYPE_CHECKING:
    from viser import SceneApi

TICK, SLOW = 1 / 15, 1 / 4  # s of the clock between two pictures, and between two states of the panel and the trails
PATIENCE = 0.05  # s between two looks at the panel while it waits
BEFORE = np.array([0.0, -0.57, 0.82])  # where the camera stands: before the lower wall, and above it
ASIDE = 0.06  # m from a robot to its number
HEAD = 0.14  # m: how high the number of a robot is drawn
TALL, WALL, BLOCK = 0.06, 0.05, 0.09  # m: how high a robot, the walls and blocks are drawn
THICK = 0.02  # m of a wall
ARROW, LONGEST = 0.06, 0.3  # m of an arrow for each newton, and at most
MOST = 6  # contacts of a robot that are drawn
SEEN = 8  # robots whose cameras are shown
FASTEST = 20.0
PUSH = (150, 25, 0)  # red, green, blue of an arrow: what the page's lights make vermilion
_RED = "#cc3311"


class LiveArena(Served):
    """A live page of an arena, served like `Served`.

    Args:
        arena: arena to draw.
        radius: radius of a robot [m].
        host: address to listen at.
        port: first port to try; 0 for any.

    Raises:
        InputError: viser or OpenCV is not installed, or nothing can listen there.
    """

    def __init__(
        self, arena: ArenaLayout, radius: float = RobotSettings.radius, host: str = "127.0.0.1", port: int = 8080
    ) -> None:
        super().__init__(host, port)
        self.arena = arena
        self._trails = Trails(arena.robots)
        self._drawn = self._told = -np.inf
        self._due, self._last = monotonic(), 0.0
        self._paused = False
        corners = np.array([(x, y, z) for x in (0.0, arena.size[0]) for y in (0.0, arena.size[1]) for z in (0.0, HEAD)])
        self.look(lambda aspect: fit(corners, BEFORE / np.linalg.norm(BEFORE), aspect))
        with self._server.atomic():
            space = self._server.scene
            space.configure_default_lights(cast_shadow=False)
            _add_field(space, arena)
            self._blocks = _add_blocks(space, arena)
            self._robots = [_Robot(space, robot, radius) for robot in range(arena.robots)]
            self._add_panel()

    @property
    def paused(self) -> bool:
        """True while the run is paused on the page or by `pause`."""
        return self._paused

    @property
    def speed(self) -> float:
        """Speed selected on the page, in simulated seconds per second."""
        return float(self._speed.value)

    def pause(self, on: bool) -> None:
        """Pause the run or resume it, as the page's button does."""
        self._paused = on
        self._button.label = "Resume" if on else "Pause"

    def show(self, scene: ArenaMoment, *, now: bool = False) -> None:
        """Draw a moment on the page, unless another one was drawn within the last `TICK` (1/15) seconds.

        Args:
            scene: moment to draw.
            now: draw it in any case.
        """
        self._trails.add(scene.poses)
        if not now and monotonic() - self._drawn < TICK:
            return
        self._drawn = monotonic()
        slow = now or self._drawn - self._told >= SLOW
        with self._server.atomic():
            for handle, (x, y, turn) in zip(self._blocks, scene.blocks.tolist(), strict=True):
                handle.position, handle.wxyz = (x, y, BLOCK / 2), _about_z(turn)
            for drawn in self._robots:
                drawn.show(scene)
            if slow:
                self._tell(scene)

    def _tell(self, scene: ArenaMoment) -> None:
        """Update the trails, the text and the views, which are slow to draw."""
        self._told = monotonic()
        for drawn in self._robots:
            drawn.tell(scene, self._trails)
        self._words.content = _words(scene)
        self._views.content = _inline(senses(scene, SEEN, 120))

    def wait(self, time: float) -> None:
        """Wait until a time [s] of the run is due on the page, and as long as the page is paused.

        A run that falls behind does not catch up afterwards.

        Args:
            time: time of the next moment [s], never earlier than in the previous call.
        """
        self._due += max(0.0, time - self._last) / self.speed
        self._last = time
        while self._paused or monotonic() < self._due:
            if self._paused:
                self._due = monotonic() + PATIENCE
            sleep(min(PATIENCE, max(0.0, self._due - monotonic())))
        self._due = max(self._due, monotonic() - PATIENCE)

    def _add_panel(self) -> None:
        gui = self._server.gui
        dock(gui, f"arena, layout {self.arena.name}" if self.arena.name else "arena")
        self._words = gui.add_html("")
        self._button = gui.add_button("Pause", hint="the run stands still meanwhile")
        self._button.on_click(lambda _: self.pause(not self._paused))
        self._speed = gui.add_slider(
            "speed [\u00d7]", 0.5, FASTEST, 0.5, 1.0, hint="times real time, where the computer can keep up with it"
        )
        with gui.add_folder("What they feel"):
            self._views = gui.add_html("")
        with gui.add_folder("Show", expand_by_default=False):
            dark = gui.add_checkbox("dark", False)
        dark.on_update(lambda _: theme(gui, dark.value))
        gui.add_html(strip(_legend(self.arena)))


class _Robot:
    """A drawn robot: a disc with a nose, its number, its path so far, and arrows of the forces on it."""

    def __init__(self, space: SceneApi, robot: int, radius: float) -> None:
        name, own = f"/robot_{robot + 1}", colour(robot)
        self._robot, self._radius, self._own = robot, radius, own
        self._frame = space.add_frame(name, show_axes=False)
        body, faces = _disc(radius, TALL)
        space.add_mesh_simple(f"{name}/body", body, faces, color=_deep(own), flat_shading=True, cast_shadow=False)
        nose = np.array([[1.0, 0.0], [0.35, 0.5], [0.35, -0.5]]) * radius * 0.9
        flat = np.column_stack([nose, np.full(3, TALL + 0.002)])
        space.add_mesh_simple(
            f"{name}/nose", flat, np.array([[0, 1, 2]]), color=(255, 255, 255), side="double", cast_shadow=False
        )
        self._number = space.add_label(f"{name}_number", f"{robot + 1}", anchor="center-center", font_screen_scale=0.85)
        nothing = np.zeros((1, 2, 3), dtype=np.float32)
        self._trail = space.add_line_segments(
            f"/trail_{robot + 1}", nothing, mixed(own, 0.2), thickness=3.0, thickness_units="screen"
        )
        self._arrows = [
            space.add_arrows(
                f"/force_{robot + 1}/{at}",
                nothing,
                PUSH,
                shaft_radius=0.008,
                head_radius=0.022,
                head_length=0.035,
            )
            for at in range(MOST)
        ]
        self._trail.visible, self._shown = False, 0
        for arrow in self._arrows:
            arrow.visible = False

    def show(self, scene: ArenaMoment) -> None:
        """Move the robot to its pose at a moment, and draw the forces on it."""
        x, y, heading = scene.poses[self._robot].tolist()
        self._frame.position, self._frame.wxyz = (x, y, 0.0), _about_z(heading)
        self._push(scene)

    def tell(self, scene: ArenaMoment, trails: Trails) -> None:
        """Draw the robot's path so far."""
        if (length := trails.length(self._robot)) > max(1, self._shown):
            self._shown, way = length, trails.of(self._robot)
            way = np.column_stack([way, np.full(length, 0.003)]).astype(np.float32)
            self._trail.points, self._trail.visible = np.stack([way[:-1], way[1:]], axis=1), True

    def _push(self, scene: ArenaMoment) -> None:
        pose, felt = scene.poses[self._robot], scene.touches[self._robot]
        felt = np.zeros((0, 2)) if felt is None else felt
        rows: list[list[float]] = felt[np.argsort(-felt[:, 1], kind="stable")][:MOST].tolist()
        away = pose[2] + rows[0][0] + np.pi if rows else np.pi / 2  # its number, from the arrow of the hardest push
        beside = (self._radius + ASIDE) * np.array([np.cos(away), np.sin(away)])
        self._number.position = (*(pose[:2] + beside).tolist(), TALL)
        for at, arrow in enumerate(self._arrows):
            there = at < len(rows)
            if arrow.visible != there:
                arrow.visible = there
            if there:
                angle, force = rows[at]
                out = np.array([np.cos(pose[2] + angle), np.sin(pose[2] + angle), 0.0])
                tip = np.array([pose[0], pose[1], BLOCK + 0.02]) + self._radius * out  # above the block that pushes
                tail = tip + max(ARROW, min(ARROW * force, LONGEST)) * out
                arrow.points = np.stack([tail, tip])[None].astype(np.float32)


def _add_field(space: SceneApi, arena: ArenaLayout) -> None:
    """Draw the floor, the walls and the goals."""
    width, height = arena.size
    space.add_box(
        "/floor", (255, 255, 255), (width, height, 0.004), position=(width / 2, height / 2, -0.003), cast_shadow=False
    )
    lines = [[(x, 0.0), (x, height)] for x in np.arange(0.5, width, 0.5)]
    lines += [[(0.0, y), (width, y)] for y in np.arange(0.5, height, 0.5)]
    flat = np.array(lines)
    grid = np.concatenate([flat, np.full((*flat.shape[:2], 1), 0.001)], axis=-1).astype(np.float32)
    space.add_line_segments("/grid", grid, mixed(RULE, 0.0), thickness=1.0, thickness_units="screen")
    long, wide = width + 2 * THICK, height + 2 * THICK
    walls = {"south": (width / 2, -THICK / 2, long, THICK), "north": (width / 2, height + THICK / 2, long, THICK)}
    walls |= {"west": (-THICK / 2, height / 2, THICK, wide), "east": (width + THICK / 2, height / 2, THICK, wide)}
    for name, (x, y, across, up) in walls.items():
        space.add_box(
            f"/wall/{name}", mixed(MUTED, 0.1), (across, up, WALL), position=(x, y, WALL / 2), cast_shadow=False
        )
    for robot, (x, y) in enumerate(arena.goals.tolist()):
        body, faces = _disc(0.10, 0.002)
        space.add_mesh_simple(
            f"/goal_{robot + 1}",
            body,
            faces,
            color=_deep(mixed(colour(robot), 0.25)),
            position=(x, y, 0.0),
            cast_shadow=False,
        )
        beside = (0.12, 0.0, 0.0)
        space.add_label(
            f"/goal_{robot + 1}/name", f"goal {robot + 1}", position=beside, anchor="center-left", font_screen_scale=0.8
        )


def _add_blocks(space: SceneApi, arena: ArenaLayout) -> list[Any]:
    """Draw the blocks, fixed ones cut off at the walls, and return the movable ones, which are amber."""
    movable = list[Any]()
    for at, block in enumerate(arena.blocks):
        name = f"/block_{at + 1}"
        if block.mass is not None:
            sides = (2.0 * block.half[0], 2.0 * block.half[1], BLOCK)
            movable.append(space.add_box(name, _deep(mixed(STATUS[5], 0.0)), sides, cast_shadow=False))
        elif len(corners := outline(block, arena.size)) > 2:
            body, faces = _prism(corners, BLOCK)
            shade = _deep(mixed(STATUS[3], 0.0))
            space.add_mesh_simple(name, body, faces, color=shade, flat_shading=True, cast_shadow=False)
    return movable


def _disc(radius: float, high: float, sides: int = 40) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Return vertices and faces of a cylinder that stands on the floor."""
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    return _prism(radius * np.stack([np.cos(angle), np.sin(angle)], axis=1), high)


def _prism(corners: Float[np.ndarray, "k 2"], high: float) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Return vertices and faces of a prism on a convex, counter-clockwise outline, without its lower end."""
    sides = len(corners)
    low, upper = (np.column_stack([corners, np.full(sides, level)]) for level in (0.0, high))
    vertices = np.concatenate([low, upper, upper.mean(axis=0, keepdims=True)])
    at = np.arange(sides)
    after, top = (at + 1) % sides, np.full(sides, 2 * sides)
    wall = [np.stack([at, after, after + sides], axis=1), np.stack([at, after + sides, at + sides], axis=1)]
    return vertices, np.concatenate([*wall, np.stack([at + sides, after + sides, top], axis=1)])


def _deep(shade: tuple[int, int, int]) -> tuple[int, int, int]:
    """Return a darker colour that the page's lights brighten to the given one."""
    red, green, blue = (round(0.62 * part) for part in shade)
    return red, green, blue


def _about_z(turn: float) -> tuple[float, float, float, float]:
    """Return the quaternion w, x, y, z of a turn about the vertical [rad]."""
    return float(np.cos(turn / 2)), 0.0, 0.0, float(np.sin(turn / 2))


def _inline(picture: np.ndarray) -> str:
    """Return a picture as HTML that is never older than the text next to it."""
    code = b64encode(opencv().imencode(".jpg", picture)[1]).decode()
    return f'<img decoding="sync" alt="" style="display:block;width:100%" src="data:image/jpeg;base64,{code}">'


def _words(scene: ArenaMoment) -> str:
    """Return time, and each robot's state, forces and reason, as HTML."""
    rows = list[str]()
    for robot, (state, why) in enumerate(zip(scene.states, scene.whys, strict=True)):
        felt = scene.touches[robot]
        shade = _RED if felt is None else "inherit"
        red, green, blue = colour(robot)
        rows.append(
            f'<div style="display:flex;gap:.6em;margin:.45em 0"><span style="flex:none;width:1.7em;height:1.7em;'
            f"border-radius:50%;background:rgb({red},{green},{blue});color:#fff;text-align:center;line-height:1.7em;"
            f'font-weight:600">{robot + 1}</span><span><b>{escape(state)}</b> &middot; '
            f'<span style="color:{shade}">{newtons(felt)}</span>'
            f'<br><span style="opacity:.65">{escape(why)}</span></span></div>'
        )
    arrived, robots = int(scene.arrived.sum()), len(scene.states)
    ink = STATUS[0] if arrived == robots else STATUS[3]
    return card(
        f"{scene.time:.1f} s", f"{arrived} of {robots} arrived", ink, "robots at their goals", (), "".join(rows)
    )


def _legend(arena: ArenaLayout) -> list[str]:
    """Return the legend's entries for an arena, as HTML."""
    items = [item("arrow", "rgb(213,94,0)", f"push on a robot, and in its ring, up to {LONGEST / ARROW:.1f} N")]
    if arena.movable:
        items.append(dot(mixed(STATUS[5], 0.0), "block that can be pushed"))
    if len(arena.movable) < len(arena.blocks):
        items.append(dot(mixed(STATUS[3], 0.0), "fixed block"))
    return [*items, item("line", STATUS[7], "way so far, in the robot's colour"), "<span>grid 0.5 m</span>"]
