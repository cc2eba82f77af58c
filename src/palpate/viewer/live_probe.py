"""A probe on a surface that moves, while it happens: poses in, a picture and two curves out."""

from __future__ import annotations

from collections import deque

import numpy as np
from jaxtyping import Float, Int

from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import Pose
from palpate.viewer.server import Served
from palpate.viewer.widgets import add_curves, dock

__all__ = ["LiveProbe"]

SCALE = 10.0  # of the picture: the page likes things of about one unit
SHOWN = 300  # rows of a curve
ARROW = 0.01 * SCALE  # for each newton


@takes_arrays
class LiveProbe(Served):
    """A page that is fed, served as `Served` is; drawn about the place of the surface at the first call.

    Args:
        vertices: (v, 3) of the probe [m].
        faces: (f, 3) of it.
        plate: (3,) length, width and height of the drawn phantom, its surface on top [m].
        host: to listen at.
        port: the first to try.

    Raises:
        InputError: viser is not installed, or nothing can listen there.
    """

    def __init__(
        self,
        vertices: Float[np.ndarray, "v 3"],
        faces: Int[np.ndarray, "f 3"],
        plate: tuple[float, float, float],
        host: str = "127.0.0.1",
        port: int = 8080,
    ) -> None:
        super().__init__(host, port)
        space, gui = self._server.scene, self._server.gui
        space.set_up_direction("+z")
        space.configure_default_lights(cast_shadow=False)
        self._server.initial_camera.position, self._server.initial_camera.look_at = (1.6, -2.6, 1.8), (0.0, 0.0, 0.6)
        self._probe = space.add_frame("/probe", show_axes=False)
        self._phantom = space.add_frame("/phantom", show_axes=False)
        sides = tuple(SCALE * side for side in plate)
        space.add_mesh_simple("/probe/body", SCALE * vertices, faces, color=(41, 97, 158), flat_shading=False)
        space.add_box(
            "/phantom/body", (232, 178, 153), (sides[0], sides[1], sides[2]),
            opacity=0.75, position=(0.0, 0.0, -sides[2] / 2),
        )  # fmt: skip
        nothing = np.zeros((1, 2, 3), dtype=np.float32)
        self._arrow = space.add_arrows("/force", nothing, (213, 94, 0), shaft_radius=0.02, head_radius=0.05)
        dock(gui, "moving phantom")
        self._words = gui.add_markdown("")
        self._rows: deque[tuple[float, ...]] = deque(maxlen=SHOWN)
        self._force = add_curves(gui, ("force [N]",), ("#0072b2",))
        self._angle = add_curves(gui, ("in-plane [deg]", "out-of-plane [deg]"), ("#d55e00", "#009e73"))
        self._middle: np.ndarray | None = None

    def show(
        self,
        time: float,
        probe: Pose,
        phantom: Pose,
        push: Float[np.ndarray, "2 3"],
        angles: tuple[float, float],
        words: str,
    ) -> None:
        """Draw a moment.

        Args:
            time: [s].
            probe: T_base_probe.
            phantom: T_base_surface, z out of it.
            push: where the force acts and the force, in the base [m], [N].
            angles: of the probe's axis to the normal, in-plane and out-of-plane [rad].
            words: what is going on.
        """
        middle = phantom.translation if self._middle is None else self._middle
        self._middle = middle
        force = float(np.linalg.norm(push[1]))
        self._rows.append((time, force, *np.degrees(angles)))
        columns = [np.ascontiguousarray(column) for column in np.array(self._rows).T]
        with self._server.atomic():
            for handle, pose in ((self._probe, probe), (self._phantom, phantom)):
                handle.position = SCALE * (pose.translation - middle)
                handle.wxyz = np.roll(pose.quaternion(), 1)
            tip = SCALE * (push[0] - middle)
            self._arrow.visible = force > 0.05
            self._arrow.points = np.stack([tip - ARROW * push[1], tip])[None].astype(np.float32)
            self._words.content = words
            self._force.data = (columns[0], columns[1])
            self._angle.data = (columns[0], columns[2], columns[3])
