"""Draw body, heat, contacts, trails and layers in the page's 3D view, as handles that are moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from palpate.viewer.camera import fit
from palpate.viewer.heat import FineMesh, colours, linear
from palpate.viewer.legend import AXES
from palpate.viewer.marker import FORCE, OTHER, TRACE, Marker
from palpate.viewer.scene import Scene, SceneMoment, ShownContact, before, rounded_up

if TYPE_CHECKING:
    from viser import ClientHandle, GlbHandle, LabelHandle, ViserServer

LETTER = 0.02  # sizes of the body from the end of an axis to its name


@dataclass(frozen=True)
class DrawSettings:
    """The viewer's choices: heat or not, seconds of trail, magnification of the ellipses, numbers of touches."""

    heat: bool
    trail: float
    magnification: int
    numbers: bool = False


class Scene3D:
    """A scene in the page's 3D view, drawn in the units of `Scene.placed`.

    Args:
        server: the server, to draw for all browsers, or one browser.
        scene: scene whose moments are shown; another of the same body may take its place.
    """

    def __init__(self, server: ViserServer | ClientHandle, scene: Scene) -> None:
        self.scene, self._server, self._space = scene, server, server.scene
        self._space.configure_default_lights(cast_shadow=False)  # slow where there is no graphics card
        self._add_ground()
        self._bodies: dict[bool, GlbHandle] = {}  # with and without heat, each made when first wanted
        self._markers: list[Marker] = []
        self._others: list[Marker] = []
        self._numbers: list[LabelHandle] = []
        nothing = np.zeros((1, 2, 3))
        self._trail = self._space.add_line_segments("/trail", nothing, FORCE, thickness=3.0, thickness_units="screen")
        for layer in scene.layers:
            layer.draw(server, scene)

    def show(self, moment: SceneMoment, settings: DrawSettings) -> None:
        """Move everything drawn to a moment and apply the settings."""
        if self.scene.body is not None:
            self._show_body(self.scene.body, settings.heat)
        self._show_numbers(settings.numbers)
        self.show_trail(moment, settings.trail)
        self.move(self.scene, moment, settings.magnification)

    def move(self, scene: Scene, moment: SceneMoment, magnification: int) -> None:
        """Move only contacts and layers to a moment.

        Args:
            scene: scene whose sample the layers show; arrows have the scales of `self.scene`.
            moment: of that scene.
            magnification: factor by which the ellipses are drawn larger.
        """
        self._move_markers(self._markers, moment.contacts, magnification)
        if (other := self.scene.meanwhile(moment.seconds)) is not None:
            self._move_markers(self._others, other.contacts, magnification, "/beside", OTHER)
        for layer in self.scene.layers:
            layer.show(scene, moment.index)

    def _move_markers(
        self,
        markers: list[Marker],
        contacts: Sequence[ShownContact],
        magnification: int,
        root: str = "",
        ink: tuple[int, int, int] = FORCE,
    ) -> None:
        while len(markers) < len(contacts):
            markers.append(Marker(self._space, len(markers), root, ink))
        for marker, contact in zip_longest(markers, contacts):
            marker.show(self.scene, contact, magnification)

    def face(self, client: ClientHandle, contact: ShownContact | None = None) -> None:
        """Turn a browser's camera to a contact; None: to the body, from the side of its strongest contact."""
        with client.atomic():
            seen = () if contact is None else (contact,)
            client.camera.position, client.camera.look_at = aim(
                self.scene, client.camera.aspect, seen, near=contact is not None
            )

    def show_trail(self, moment: SceneMoment, seconds: float) -> None:
        """Show the contacts' paths in the seconds before a moment of `scene`."""
        segments, age = self.scene.trail(moment.index, seconds)
        self._trail.visible = bool(len(segments)) and seconds > 0
        if self._trail.visible:
            shade = TRACE[0] + np.clip(age, 0.0, 1.0)[:, None] * (TRACE[1] - TRACE[0])
            self._trail.points = self.scene.placed(segments).astype(np.float32)
            self._trail.colors = np.repeat(shade.astype(np.uint8)[:, None], 2, axis=1)

    def _show_numbers(self, wanted: bool) -> None:
        """Show or hide the numbers of the touches, drawn on first use."""
        if wanted and not self._numbers:
            found, size = self.scene.touches, self.scene.size
            places = self.scene.placed(found.point + 0.02 * size * found.normal)
            self._numbers = [
                self._space.add_label(f"/touches/{k + 1}", f"{k + 1}", position=place, font_screen_scale=0.75)
                for k, place in enumerate(places)
                if np.isfinite(place).all()
            ]
        for label in self._numbers:
            if label.visible != wanted:
                label.visible = wanted

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
        trimesh.Scene([mesh]).export(made, file_type="glb", tree_postprocessor=_both_sides)
        return made.getvalue()

    def _add_ground(self) -> None:
        """Add a grid under the body and the axes of the surface's frame."""
        size = self.scene.size
        cell = rounded_up(size / 12)
        floor = self.scene.placed(self.scene.bounds[0] - 0.03 * size)[2]
        self._space.add_grid(
            "/grid", width=2.0, height=2.0, position=(0.0, 0.0, floor), cell_size=cell / size,
            section_size=5 * cell / size, cell_color=(206, 212, 218), section_color=(168, 176, 184),
            fade_distance=4.0,
        )  # fmt: skip
        axes = self.scene.placed(self.scene.axes).astype(np.float32)
        inks = np.repeat(linear(np.array(AXES, np.uint8))[:, None], 2, axis=1)
        self._space.add_line_segments("/axes", axes, inks, thickness=3.0, thickness_units="screen")
        for letter, end in zip("xyz", axes[:, 1] + LETTER * np.eye(3), strict=True):
            self._space.add_label(
                f"/axes/{letter}", letter, position=end, anchor="center-center", font_screen_scale=0.75
            )


def _both_sides(tree: dict[str, Any]) -> None:
    """Make the facets of a glTF visible from both sides."""
    tree["materials"] = [{"doubleSided": True}]
    for mesh in tree["meshes"]:
        for part in mesh["primitives"]:
            part["material"] = 0


def aim(
    scene: Scene, aspect: float, contacts: Sequence[ShownContact] = (), covered: float | None = None, near: bool = False
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Return position and target, (3,) each, of a camera that sees body and arrows, in `Scene.placed` units.

    Args:
        scene: the scene.
        aspect: width over height of the picture.
        contacts: must be seen, the first from its side if the body does not move; without any, those of the moment
            shown first.
        covered: share of the height that is hidden, see `fit`.
        near: only the first contact and its surroundings must be seen.
    """
    contacts = contacts or scene.at(scene.opening).contacts
    first = contacts[0]
    sided = first.located and (near or scene.moving is None)  # else upright: a contact may be below a robot
    direction = before(first.normal) if sided else np.array([0.55, -0.7, 0.456])
    points = scene.seen_near(first) if near and first.located else scene.seen_with(contacts)
    return fit(scene.placed(points), direction / np.linalg.norm(direction), aspect, covered)
