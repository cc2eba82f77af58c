"""What stands in the page's space: body, heat, contact, force, ellipse and trail, as handles that are moved."""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from palpate.viewer.cells import CellBoxes, Twist
from palpate.viewer.heat import colours
from palpate.viewer.scene import Moment, Scene, nice

if TYPE_CHECKING:
    from viser import GlbHandle, ViserServer

__all__ = ["Settings", "Stage"]

FORCE, POINT = (0, 48, 120), (16, 24, 32)
TRACE = np.array([(0, 90, 170), (170, 205, 235)])  # now, and long ago
DISTANCE = 1.31  # of the camera from the middle, in sizes of the body
_CIRCLE = np.stack([np.cos(np.linspace(0, 2 * np.pi, 65)), np.sin(np.linspace(0, 2 * np.pi, 65)), np.zeros(65)], axis=1)


@dataclass(frozen=True)
class Settings:
    """What a person chose to see: heat or not, seconds of trail, magnification of the ellipse."""

    heat: bool
    trail: float
    magnification: int


class Stage:
    """Draws in units of the body's size about its middle, so that a needle and a torso look alike to the camera."""

    def __init__(self, server: ViserServer, scene: Scene) -> None:
        self._scene, self._size, self._centre = scene, scene.mesh.size, scene.mesh.centre
        self._server, self._space = server, server.scene
        self._space.configure_default_lights(cast_shadow=False)  # dear where there is no graphics card
        self._place_camera(server)
        self._ground()
        self._bodies: dict[bool, GlbHandle] = {}  # with and without heat, each made when first wanted
        self._contact = self._space.add_frame("/contact", show_axes=False)
        self._space.add_icosphere("/contact/point", radius=0.008, color=POINT, cast_shadow=False)
        self._space.add_arrows(
            "/contact/normal", np.array([[[0, 0, 0], [0, 0, 0.12]]]), POINT, shaft_radius=0.002, head_radius=0.006,
            head_length=0.02,
        )  # fmt: skip
        self._disc = self._space.add_mesh_simple(
            "/contact/disc", _CIRCLE, _fan(65), color=FORCE, opacity=0.25, side="double", cast_shadow=False
        )
        self._rim = self._space.add_line_segments(
            "/contact/ellipse", np.stack([_CIRCLE[:-1], _CIRCLE[1:]], axis=1), FORCE, thickness=2.0,
            thickness_units="screen",
        )  # fmt: skip
        self._arrow = self._space.add_arrows(
            "/force", np.zeros((1, 2, 3)), FORCE, shaft_radius=0.007, head_radius=0.018, head_length=0.05
        )
        self._label = self._space.add_label("/force_label", "", anchor="bottom-center")
        self._twist = Twist(self._space, scene.estimate)
        known = scene.cells is not None and bool(np.isfinite(scene.cells.positions).all())
        self._cells = CellBoxes(self._space, scene, scene.cells) if scene.cells is not None and known else None
        nothing = np.zeros((1, 2, 3))
        self._trail = self._space.add_line_segments("/trail", nothing, FORCE, thickness=3.0, thickness_units="screen")

    def show(self, moment: Moment, settings: Settings) -> None:
        """Move everything to a moment."""
        self._show_body(settings.heat)
        self._show_trail(moment, settings.trail)
        if self._cells is not None:
            self._cells.show(moment)
        located = moment.located
        self._contact.visible = self._arrow.visible = self._label.visible = located
        if located:
            self._show_contact(moment, settings.magnification)
            self._show_force(moment)
            self._twist.show(moment)

    def face(self, moment: Moment) -> None:
        """Turn everybody's camera to a contact, somewhat from above and aside, as far away as at the start."""
        aside = np.cross([0.0, 0.0, 1.0], moment.normal)
        direction = moment.normal + 0.5 * aside + [0.0, 0.0, 0.4]
        for client in self._server.get_clients().values():
            with client.atomic():
                client.camera.position = DISTANCE * direction / np.linalg.norm(direction)
                client.camera.look_at = np.zeros(3)

    def _show_contact(self, moment: Moment, magnification: int) -> None:
        x, y, z, w = moment.turn.tolist()
        self._contact.position = self._placed(moment.point + 1e-3 * self._size * moment.normal)
        self._contact.wxyz = (w, x, y, z)
        known = bool(np.isfinite(moment.axes).all())
        self._disc.visible = self._rim.visible = known
        if known:
            long, short = (magnification * moment.axes / self._size).tolist()
            self._disc.scale = self._rim.scale = (long, short, 1.0)

    def _show_force(self, moment: Moment) -> None:
        """An arrow that pushes with its tip."""
        tip = self._placed(moment.point)
        shaft = moment.force * self._scene.newton / self._size
        length = float(np.linalg.norm(shaft))
        self._arrow.head_length, self._arrow.head_radius = min(0.05, 0.6 * length), min(0.018, 0.3 * length)
        self._arrow.points = np.stack([tip - shaft, tip])[None].astype(np.float32)
        self._label.position = tip - shaft - (0.03 * shaft / length if length > 0 else 0.0)
        self._label.text = f"{np.linalg.norm(moment.force):.1f} N"

    def _show_trail(self, moment: Moment, seconds: float) -> None:
        segments, age = self._scene.trail(moment.index, seconds)
        self._trail.visible = bool(len(segments)) and seconds > 0
        if self._trail.visible:
            shade = TRACE[0] + np.clip(age, 0.0, 1.0)[:, None] * (TRACE[1] - TRACE[0])
            self._trail.points = self._placed(segments).astype(np.float32)
            self._trail.colors = np.repeat(shade.astype(np.uint8)[:, None], 2, axis=1)

    def _show_body(self, warm: bool) -> None:
        if warm not in self._bodies:
            name = "/body/warm" if warm else "/body/bare"
            self._bodies[warm] = self._space.add_glb(name, self._body(warm), cast_shadow=False)
        for kind, body in self._bodies.items():
            body.visible = kind == warm

    def _body(self, warm: bool) -> bytes:
        import trimesh

        heat, body = self._scene.heat, self._scene.skin
        share = heat / max(float(heat.max()), 1e-12) * warm
        linear = (colours(share) / 255.0) ** 2.2  # a glTF's vertex colours are linear
        mesh = trimesh.Trimesh(
            self._placed(body.vertices), body.faces, vertex_normals=body.normals, process=False,
            vertex_colors=(255 * linear).round().astype(np.uint8),
        )  # fmt: skip
        made = BytesIO()
        mesh.export(made, file_type="glb")
        return made.getvalue()

    def _place_camera(self, server: ViserServer) -> None:
        camera = server.initial_camera
        away = DISTANCE * np.array([0.55, -0.7, 0.456])
        camera.position, camera.look_at, camera.up = away, np.zeros(3), np.array([0.0, 0.0, 1.0])
        camera.near, camera.far = 0.01, 100.0

    def _ground(self) -> None:
        """A grid under the body with its cell said, and the axes of the surface's frame: the scale of the picture."""
        low, high = self._scene.mesh.bounds
        cell = nice(self._size / 12)
        x, y, floor = self._placed(low - 0.03 * self._size).tolist()
        self._space.add_grid(
            "/grid", width=2.0, height=2.0, position=(0.0, 0.0, floor), cell_size=cell / self._size,
            section_size=5 * cell / self._size, cell_color=(206, 212, 218), section_color=(168, 176, 184),
            fade_distance=4.0,
        )  # fmt: skip
        self._space.add_label("/grid/cell", f"grid {1e3 * cell:g} mm", position=(x, y - 0.12, 0.0))
        origin = self._placed(np.zeros(3))
        length = float(np.abs(np.stack([low, high])).max() / self._size + 0.1)
        self._space.add_frame(
            "/axes", position=origin, axes_length=length, axes_radius=0.0025, origin_radius=0.006,
            origin_color=(90, 98, 106),
        )  # fmt: skip
        for name, end in zip("xyz", length * np.eye(3), strict=True):
            self._space.add_label(f"/axes/{name}", name, position=end, font_screen_scale=0.8, depth_test=True)

    def _placed(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
        return (points - self._centre) / self._size


def _fan(count: int) -> np.ndarray:
    return np.stack([np.zeros(count - 2, int), np.arange(1, count - 1), np.arange(2, count)], axis=1)
