"""Draw the links of a robot on the page, moving, and list its sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Int

from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import rotation_from_quaternion
from palpate.spatial.shown import three_digits
from palpate.viewer.drawing import box, corners, simpler
from palpate.viewer.heat import FineMesh
from palpate.viewer.scene import Scene

if TYPE_CHECKING:
    from viser import ClientHandle, GlbHandle, GuiApi, ViserServer

GREY = (196, 204, 212, 255)
FACETS = 20_000  # of all links in a picture of a film or a report: more is slow to draw
Triangles = tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]
"""Vertices [m] and faces of a link, in its frame."""


@takes_arrays
class RobotLayer:
    """A layer of the page that draws a robot's links where they are, and lists its sensors.

    Args:
        links: link -> triangles, of those that have a geometry.
        quaternions: (m, k, 4) x, y, z, w of these links in the base at each sample of the scene; NaN where not known.
        positions: (m, k, 3) [m] likewise.
        sensors: sensor -> force [N] of its contacts at each sample, (m,): 0 without a contact, NaN without readings.
        rates: sensor -> readings per second.

    Raises:
        InputError: arrays of other shapes.
    """

    def __init__(
        self,
        links: Mapping[str, Triangles],
        quaternions: Float[np.ndarray, "m k 4"],
        positions: Float[np.ndarray, "m k 3"],
        sensors: Mapping[str, Float[np.ndarray, " m"]],
        rates: Mapping[str, float],
    ) -> None:
        self._links, self._sensors, self._rates = links, sensors, rates
        self._turned, self._moved = _filled(quaternions), _filled(positions)
        self._handles: list[GlbHandle] = []

    @property
    def covers(self) -> bool:
        """Return False: contacts are drawn on the links."""
        return False

    @cached_property
    def _fine(self) -> list[FineMesh]:
        """Links as a picture shows them, each in its frame."""
        most = FACETS // max(len(self._links), 1)
        few = (simpler(vertices, faces, most) for vertices, faces in self._links.values())
        meshes = [_smooth(*each) for each in few]
        return [FineMesh(mesh.vertices, mesh.vertex_normals, mesh.faces) for mesh in meshes]

    def body_at(self, index: int) -> FineMesh:
        """Return all links, at most about 20,000 facets, in the base at a sample of the scene; none where not known."""
        parts = [
            (each.vertices @ turn.T + move, each.normals @ turn.T, each.faces)
            for each, turn, move in zip(
                self._fine, rotation_from_quaternion(self._turned[index]), self._moved[index], strict=True
            )
            if np.isfinite(move).all()
        ]
        first = np.cumsum([0, *(len(vertices) for vertices, _, _ in parts)])
        nothing = np.zeros((0, 3))
        return FineMesh(
            np.concatenate([nothing, *(vertices for vertices, _, _ in parts)]),
            np.concatenate([nothing, *(normals for _, normals, _ in parts)]),
            np.concatenate([nothing.astype(np.int64), *(part[2] + k for part, k in zip(parts, first, strict=False))]),
        )

    @property
    def places(self) -> Float[np.ndarray, "n 3"]:
        """Return corners of all links over the motion, (n, 3) [m]."""
        seen = np.linspace(0, max(len(self._moved) - 1, 0), 20).astype(int)
        boxes = [corners(box(vertices)) for vertices, _ in self._links.values()]
        made = [
            corner @ rotation_from_quaternion(self._turned[i, k]).T + self._moved[i, k]
            for i in np.unique(seen)
            for k, corner in enumerate(boxes)
            if np.isfinite(self._moved[i, k]).all()
        ]
        return np.concatenate([np.zeros((1, 3)), *made])

    def draw(self, server: ViserServer | ClientHandle, scene: Scene) -> None:
        """Draw the links."""
        self._handles = [
            server.scene.add_glb(f"/robot/{k}", _glb(vertices / scene.size, faces), cast_shadow=False)
            for k, (vertices, faces) in enumerate(self._links.values())
        ]

    def panel(self, gui: GuiApi) -> None:
        """Add a checkbox that hides the robot."""
        seen = gui.add_checkbox("robot", True, hint="hide it to see the contacts behind it")

        def switch(_: object) -> None:
            for handle in self._handles:
                handle.visible = seen.value

        seen.on_update(switch)

    def show(self, scene: Scene, index: int) -> None:
        """Move the links to where they are at a sample."""
        for k, handle in enumerate(self._handles):
            if np.isfinite(self._moved[index, k]).all():
                handle.wxyz = np.roll(self._turned[index, k], 1)
                handle.position = scene.placed(self._moved[index, k])

    def rows(self, scene: Scene, index: int) -> list[tuple[str, str]]:
        """Return (sensor, text) pairs: its contact force or that it has none, and its rate."""
        return [
            (name, f"{_state(float(force[index]))}, {three_digits(self._rates[name])} Hz")
            for name, force in self._sensors.items()
        ]

    def legend(self) -> list[str]:
        """Return no items."""
        return []


class LiveRobotLayer(RobotLayer):
    """A layer of the live page that draws a robot's links where they are now, and lists its sensors.

    Args:
        links: link -> triangles, of those that have a geometry.
        quaternions: (k, 4) x, y, z, w of these links in the base at first.
        positions: (k, 3) [m] likewise.

    Raises:
        InputError: arrays of other shapes.
    """

    def __init__(
        self, links: Mapping[str, Triangles], quaternions: Float[np.ndarray, "k 4"], positions: Float[np.ndarray, "k 3"]
    ) -> None:
        super().__init__(links, quaternions[None], positions[None], {}, {})
        self._listed: tuple[tuple[str, str], ...] = ()

    def move(self, quaternions: Float[np.ndarray, "k 4"], positions: Float[np.ndarray, "k 3"]) -> None:
        """Set where the links are now, as in the constructor."""
        self._turned, self._moved = quaternions[None], positions[None]

    def describe(self, rows: Sequence[tuple[str, str]]) -> None:
        """Set what is listed, (name, text) pairs."""
        self._listed = tuple(rows)

    def show(self, scene: Scene, index: int) -> None:
        """Move the links to where they are."""
        super().show(scene, 0)

    def rows(self, scene: Scene, index: int) -> list[tuple[str, str]]:
        """Return the pairs that are listed."""
        return [*self._listed]


def _state(force: float) -> str:
    if np.isnan(force):
        return "no readings"
    return f"{three_digits(force)} N" if force > 0 else "nothing touches"


def _filled(values: Float[np.ndarray, "m k w"]) -> Float[np.ndarray, "m k w"]:
    """Return poses in which those that are not known are the ones before, or else the first known."""
    known = np.isfinite(values).all(axis=(1, 2))
    if not known.any():
        return values
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return values[np.where(last < 0, int(known.argmax()), last)]


def _smooth(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Any:
    """Return a mesh of trimesh whose vertices are doubled along creases."""
    import trimesh

    graph: Any = trimesh.graph
    return graph.smooth_shade(trimesh.Trimesh(vertices, faces, process=True), angle=0.5)


def _glb(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> bytes:
    import trimesh

    mesh = _smooth(vertices, faces)
    mesh.visual.vertex_colors = np.tile(np.array(GREY, np.uint8), (len(mesh.vertices), 1))
    made = BytesIO()
    trimesh.Scene([mesh]).export(made, file_type="glb")
    return made.getvalue()
