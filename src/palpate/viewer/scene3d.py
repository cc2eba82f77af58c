"""What stands in the page's 3D view: body, heat, contacts, trails and layers, as handles that are moved."""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
from itertools import zip_longest
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from palpate.viewer.heat import FineMesh, colours, linear
from palpate.viewer.marker import FORCE, Marker
from palpate.viewer.scene import Moment, Scene, ShownContact, nice

if TYPE_CHECKING:
    from viser import GlbHandle, ViserServer

__all__ = ["DISTANCE", "Scene3D", "Settings"]

TRACE = np.array([(0, 90, 170), (170, 205, 235)])  # now, and long ago
DISTANCE = 1.31  # of the camera from the middle, in sizes of the body


@dataclass(frozen=True)
class Settings:
    """What a person chose to see: heat or not, seconds of trail, magnification of the ellipses."""

    heat: bool
    trail: float
    magnification: int


class Scene3D:
    """Draws in the units of `Scene.placed`.

    Attributes:
        scene: whose moments are shown; another of the same body may take its place.
    """

    def __init__(self, server: ViserServer, scene: Scene) -> None:
        self.scene, self._server, self._space = scene, server, server.scene
        self._space.configure_default_lights(cast_shadow=False)  # slow where there is no graphics card
        self._place_camera(server)
        self._add_ground()
        self._bodies: dict[bool, GlbHandle] = {}  # with and without heat, each made when first wanted
        self._markers: list[Marker] = []
        nothing = np.zeros((1, 2, 3))
        self._trail = self._space.add_line_segments("/trail", nothing, FORCE, thickness=3.0, thickness_units="screen")
        for layer in scene.layers:
            layer.draw(server, scene)

    def show(self, moment: Moment, settings: Settings) -> None:
        """Move everything to a moment."""
        if self.scene.body is not None:
            self._show_body(self.scene.body, settings.heat)
        self.show_trail(moment, settings.trail)
        self.move(self.scene, moment, settings.magnification)

    def move(self, scene: Scene, moment: Moment, magnification: int) -> None:
        """Move contacts and layers alone.

        Args:
            scene: that the moment is of; arrows have the scales of `self.scene`.
            moment: to be shown.
            magnification: of the ellipses.
        """
        while len(self._markers) < len(moment.contacts):
            self._markers.append(Marker(self._space, len(self._markers)))
        for marker, contact in zip_longest(self._markers, moment.contacts):
            marker.show(self.scene, contact, magnification)
        for layer in self.scene.layers:
            layer.show(scene, moment.index)

    def face(self, contact: ShownContact) -> None:
        """Turn everybody's camera to a contact."""
        for client in self._server.get_clients().values():
            with client.atomic():
                client.camera.position = _before(contact)
                client.camera.look_at = np.zeros(3)

    def show_trail(self, moment: Moment, seconds: float) -> None:
        """Where contacts were in the seconds before a moment of `scene`."""
        segments, age = self.scene.trail(moment.index, seconds)
        self._trail.visible = bool(len(segments)) and seconds > 0
        if self._trail.visible:
            shade = TRACE[0] + np.clip(age, 0.0, 1.0)[:, None] * (TRACE[1] - TRACE[0])
            self._trail.points = self.scene.placed(segments).astype(np.float32)
            self._trail.colors = np.repeat(shade.astype(np.uint8)[:, None], 2, axis=1)

    def _show_body(self, body: FineMesh, warm: bool) -> None:
        if warm not in self._bodies:
            name = "/body/warm" if warm else "/body/bare"
            self._bodies[warm] = self._space.add_glb(name, self._drawn(body, warm), cast_shadow=False)
        for kind, handle in self._bodies.items():
            handle.visible = kind == warm

    def _drawn(self, body: FineMesh, warm: bool) -> bytes:
        import trimesh

        heat = self.scene.heat
        share = heat / max(float(heat.max()), 1e-12) * warm
        mesh = trimesh.Trimesh(
            self.scene.placed(body.vertices), body.faces, vertex_normals=body.normals, process=False,
            vertex_colors=linear(colours(share)),
        )  # fmt: skip
        made = BytesIO()
        mesh.export(made, file_type="glb")
        return made.getvalue()

    def _place_camera(self, server: ViserServer) -> None:
        """On the side of the contact that is shown first."""
        camera, opening = server.initial_camera, self.scene.at(self.scene.opening).contacts[0]
        away = _before(opening) if opening.located else DISTANCE * np.array([0.55, -0.7, 0.456])
        camera.position, camera.look_at, camera.up = away, np.zeros(3), np.array([0.0, 0.0, 1.0])
        camera.near, camera.far = 0.01, 100.0

    def _add_ground(self) -> None:
        """A grid under the body with the size of its cell, and the axes of the surface's frame: the scale."""
        low, high = self.scene.bounds
        size = self.scene.size
        cell = nice(size / 12)
        x, y, floor = self.scene.placed(low - 0.03 * size).tolist()
        self._space.add_grid(
            "/grid", width=2.0, height=2.0, position=(0.0, 0.0, floor), cell_size=cell / size,
            section_size=5 * cell / size, cell_color=(206, 212, 218), section_color=(168, 176, 184),
            fade_distance=4.0,
        )  # fmt: skip
        self._space.add_label("/grid/cell", f"grid {1e3 * cell:g} mm", position=(x, y - 0.12, 0.0))
        length = float(np.abs(np.stack([low, high])).max() / size + 0.1)
        self._space.add_frame(
            "/axes", position=self.scene.placed(np.zeros(3)), axes_length=length, axes_radius=0.0025,
            origin_radius=0.006, origin_color=(90, 98, 106),
        )  # fmt: skip
        for name, end in zip("xyz", length * np.eye(3), strict=True):
            self._space.add_label(f"/axes/{name}", name, position=end, font_screen_scale=0.8, depth_test=True)


def _before(contact: ShownContact) -> Float[np.ndarray, "3"]:
    """Where a camera sees a contact, in units of the scene: before it, somewhat from above and aside."""
    direction = contact.normal + 0.5 * np.cross([0.0, 0.0, 1.0], contact.normal) + [0.0, 0.0, 0.4]
    length = float(np.linalg.norm(direction))
    return DISTANCE * (direction / length if length > 0.1 else contact.normal)
