"""A live page of a probe on a moving surface: a three-dimensional view and two plots."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import Pose
from palpate.viewer._style import STATUS
from palpate.viewer.camera import fit
from palpate.viewer.legend import dot, item, strip
from palpate.viewer.marker import facing
from palpate.viewer.server import Served
from palpate.viewer.widgets import add_curves, card, dock

if TYPE_CHECKING:
    from viser import CylinderHandle

SCALE = 10.0  # of the picture: the page likes things of about one unit
SHOWN = 300  # rows of a curve
ARROW = 0.01 * SCALE  # for each newton
LEAST = 0.05  # N that are drawn
FROM = np.array([0.5, -0.82, 0.28])  # where the camera stands
ARM, PROBE, TISSUE, PUSH = (205, 209, 214), (41, 97, 158), (232, 178, 153), (150, 25, 0)


@takes_arrays
class LiveProbe(Served):
    """A live page of a probe on a moving phantom, served like `Served`.

    The view is centred on the surface's position at the first call of `show`.

    Args:
        vertices: (v, 3) vertices of the probe [m].
        faces: (f, 3) faces of the probe.
        plate: (3,) length, width and height of the drawn phantom, its surface on top [m].
        wanted: target contact force [N].
        host: address to listen at.
        port: first port to try.

    Raises:
        InputError: viser is not installed, or nothing can listen there.
    """

    def __init__(
        self,
        vertices: Float[np.ndarray, "v 3"],
        faces: Int[np.ndarray, "f 3"],
        plate: tuple[float, float, float],
        wanted: float,
        host: str = "127.0.0.1",
        port: int = 8080,
    ) -> None:
        super().__init__(host, port)
        self._space, self._gui, self._wanted = self._server.scene, self._server.gui, wanted
        self._space.set_up_direction("+z")
        self._space.configure_default_lights(cast_shadow=False)
        self._probe = self._space.add_frame("/probe", show_axes=False)
        self._phantom = self._space.add_frame("/phantom", show_axes=False)
        sides = (SCALE * plate[0], SCALE * plate[1], SCALE * plate[2])
        self._space.add_mesh_simple("/probe/body", SCALE * vertices, faces, color=PROBE, flat_shading=False)
        self._space.add_box("/phantom/body", TISSUE, sides, opacity=0.3, position=(0.0, 0.0, -sides[2] / 2))
        nothing = np.zeros((1, 2, 3), dtype=np.float32)
        self._arrow = self._space.add_arrows("/force", nothing, PUSH, shaft_radius=0.03, head_radius=0.08)
        self._links: list[CylinderHandle] = []
        self._corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-1.0, 0.0)]) * sides
        self._add_panel()
        self._rows: deque[tuple[float, ...]] = deque(maxlen=SHOWN)
        self._middle: np.ndarray | None = None

    def _add_panel(self) -> None:
        gui = self._gui
        dock(gui, "moving phantom")
        self._words = gui.add_html("")
        self._force = add_curves(gui, ("force [N]",), ("#0072b2",), target="target [N]")
        self._angle = add_curves(gui, ("in-plane [°]", "out-of-plane [°]"), ("#d55e00", "#009e73"), target="target [°]")
        arm, probe = dot(ARM, "arm"), dot(PROBE, "probe")
        push = item("arrow", "rgb(185,100,65)", "force on the probe")  # as it is seen through the tissue
        gui.add_html(strip([arm, probe, dot(TISSUE, "moving tissue"), push]))

    def show(
        self,
        time: float,
        probe: Pose,
        phantom: Pose,
        push: Float[np.ndarray, "2 3"],
        angles: tuple[float, float],
        words: str,
        arm: tuple[Float[np.ndarray, "k 2 3"], Sequence[float]] = (np.zeros((0, 2, 3)), ()),
    ) -> None:
        """Draw a moment on the page: probe, phantom, arm and force, and the curves of force and angles.

        Args:
            time: time [s].
            probe: pose of the probe, T_base_probe.
            phantom: pose of the surface, T_base_surface, z out of it.
            push: (2, 3) contact point [m] and force on the probe [N], in the base.
            angles: angles of the probe's axis to the surface normal, in-plane and out-of-plane [rad].
            words: the state, and after a colon the reason.
            arm: (k, 2, 3) ends of the arm's links in the base, and their radii [m].

        Raises:
            InputError: arrays of other shapes.
        """
        force, ends = float(np.linalg.norm(push[1])), SCALE * arm[0]
        if self._middle is None:
            self._middle = phantom.translation
            sides = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
            around = [end + SCALE * radius * sides for link, radius in zip(ends, arm[1], strict=True) for end in link]
            seen = np.concatenate([self._corners, *(each - SCALE * self._middle for each in around)])
            self.look(lambda aspect: fit(seen, FROM / np.linalg.norm(FROM), aspect))
            self._links = [self._link(k, *each) for k, each in enumerate(zip(ends, arm[1], strict=True))]
        self._rows.append((time, force, self._wanted, *np.degrees(angles), 0.0))
        columns = [np.ascontiguousarray(column) for column in np.array(self._rows).T]
        with self._server.atomic():
            for handle, pose in ((self._probe, probe), (self._phantom, phantom)):
                handle.position = SCALE * (pose.translation - self._middle)
                handle.wxyz = np.roll(pose.quaternion(), 1)
            for link, (begin, end) in zip(self._links, ends, strict=True):
                link.position, link.wxyz = (begin + end) / 2 - SCALE * self._middle, facing(end - begin)
            tip = SCALE * (push[0] - self._middle)
            self._arrow.visible = force > LEAST
            self._arrow.points = np.stack([tip - ARROW * push[1], tip])[None].astype(np.float32)
            self._words.content = self._described(time, force, angles, words)
            self._force.data = (columns[0], columns[1], columns[2])
            self._angle.data = (columns[0], columns[3], columns[4], columns[5])

    def _link(self, number: int, ends: Float[np.ndarray, "2 3"], radius: float) -> CylinderHandle:
        """Draw one link of the arm, whose length stays constant."""
        length = float(np.linalg.norm(ends[1] - ends[0]))
        return self._space.add_cylinder(f"/arm/{number}", SCALE * radius, length, ARM)

    def _described(self, time: float, force: float, angles: tuple[float, float], words: str) -> str:
        state, _, why = words.partition(": ")
        turned = [f"{angle:+z.2f}°" for angle in np.degrees(angles)]
        rows = [
            ("target", f"{self._wanted:.1f} N, at right angles"),
            ("off the normal", f"{turned[0]} in-plane, {turned[1]} out-of-plane"),
        ]
        rows += [("reason", escape(why)), ("time", f"{time:.1f} s")]
        return card(f"{force:.2f} N", escape(state), STATUS[0 if force > LEAST else 3], why, rows)
