"""A taxel sheet in the browser: the link with its cells as heat, touches as arrows, the sheet unrolled beside it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from time import monotonic
from types import TracebackType

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from palpate.contact.several import SkinTouches
from palpate.sensors.skin_map import SkinMap
from palpate.surfaces.mesh import Mesh
from palpate.viewer.heat import colours
from palpate.viewer.server import listen, quiet

__all__ = ["SkinPage", "SkinScene", "serve_skin", "unrolled"]

TICK = 0.1  # s between two pictures
PIXELS = 18  # of a cell of the unrolled sheet
LIFT = 3e-4  # m: cells stand out from the link
ARROW = 0.5  # of the sheet's size: the longest
FORCE = (0, 48, 120)


@dataclass(frozen=True, eq=False)
class SkinScene:
    """What is shown.

    Attributes:
        title: of the page.
        place: where the cells sit.
        body: the link's mesh, in the map's frame; None: the sheet alone.
        time: (n,) [s]; force: (n, rows, columns) [N].
        touches: of these frames.
    """

    title: str
    place: SkinMap
    body: Mesh | None
    time: Float[np.ndarray, " n"]
    force: Float32[np.ndarray, "n rows columns"]
    touches: SkinTouches

    def __len__(self) -> int:
        return len(self.time)

    @property
    def most(self) -> float:
        """[N] that is drawn darkest."""
        return max(float(np.quantile(self.force.max(axis=(1, 2)), 0.99)), 1e-6)

    @property
    def strongest(self) -> int:
        """The frame with most force: shown first."""
        return int(self.force.sum(axis=(1, 2)).argmax())

    def at(self, index: int) -> Int[np.ndarray, " k"]:
        """Rows of the touches of a frame."""
        low, high = np.searchsorted(self.touches.sample, [index, index + 1])
        rows: Int[np.ndarray, " k"] = np.arange(int(low), int(high), dtype=np.int64)
        return rows[self.touches.found[rows]]

    def quads(self) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
        """Every cell as two facets with corners of their own, a little above the link."""
        place = self.place
        row, column = np.meshgrid(np.arange(place.rows), np.arange(place.columns), indexing="ij")
        half = 0.47  # a gap between cells
        corners = [
            place.at(row + half * a, column + half * b) for a, b in ((-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0))
        ]
        points = np.stack([point + LIFT * normal for point, normal in corners], axis=2).reshape(-1, 3)
        first = 4 * np.arange(row.size)[:, None]
        faces = np.concatenate([first + np.array(three) for three in ((0, 1, 2), (0, 2, 3))])
        a, b, c = points[faces[0]]
        if np.cross(b - a, c - a) @ place.normals[0, 0] < 0:
            faces = faces[:, ::-1]
        return points, faces.astype(np.int64)


def unrolled(force: np.ndarray, most: float, touches: Float[np.ndarray, "k 2"]) -> UInt8[np.ndarray, "h w 3"]:
    """The sheet as a picture, the last row on top, with a dark dot where each touch is.

    Args:
        force: (rows, columns) [N].
        most: [N] that is drawn darkest.
        touches: (k, 2) row and column of each.
    """
    shade = colours(np.clip(force.ravel() / most, 0.0, 1.0)).reshape(*force.shape, 3)
    picture = np.repeat(np.repeat(shade, PIXELS, axis=0), PIXELS, axis=1)
    picture[::PIXELS], picture[:, ::PIXELS] = 255, 255
    down, across = np.indices(picture.shape[:2])
    for row, column in touches:
        away = (down / PIXELS - 0.5 - row) ** 2 + (across / PIXELS - 0.5 - column) ** 2
        picture[away < 0.05] = FORCE
    return picture[::-1].copy()


def serve_skin(
    scene: SkinScene, host: str = "127.0.0.1", port: int = 8080, up: Callable[[str], None] = lambda address: None
) -> None:
    """Serve the page until Ctrl-C; arguments as of `viewer.server.serve`."""
    try:
        with SkinPage(scene, host, port) as page:
            up(page.address)
            threading.Event().wait()
    except KeyboardInterrupt:  # how this ends
        return


class SkinPage:
    """A scene with a timeline, served from threads of its own until `stop`."""

    def __init__(self, scene: SkinScene, host: str = "127.0.0.1", port: int = 8080) -> None:
        self.scene = scene
        self._server = listen(host, port)
        self._points, self._faces = scene.quads()
        low, high = self._points.min(axis=0), self._points.max(axis=0)
        self._centre, self._size = (low + high) / 2, float(np.linalg.norm(high - low))
        self._wake = threading.Condition()
        self._stopping = False
        self._names: list[str] = []
        self._build()
        self.show(scene.strongest)
        self._painter = threading.Thread(target=self._paint, name="palpate-skin", daemon=True)
        self._painter.start()

    @property
    def address(self) -> str:
        """To open in a browser."""
        return f"http://{self._server.get_host()}:{self._server.get_port()}"

    def show(self, index: int) -> None:
        """Draw one frame."""
        scene = self.scene
        rows = scene.at(index)
        touches = scene.touches
        places = np.column_stack([touches.row[rows], touches.column[rows]])
        with self._server.atomic():
            self._server.scene.add_glb("/cells", self._cells(index), cast_shadow=False)
            self._arrows(rows)
            self._sheet.image = unrolled(scene.force[index], scene.most, places)
            self._told.content = self._words(index, rows)

    def stop(self) -> None:
        """Close the page and free its port."""
        with self._wake:
            self._stopping = True
            self._wake.notify_all()
        self._painter.join(timeout=5.0)
        with quiet():
            self._server.stop()

    def __enter__(self) -> SkinPage:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, raised: BaseException | None, at: TracebackType | None
    ) -> None:
        self.stop()

    def _build(self) -> None:
        scene, gui = self.scene, self._server.gui
        gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        gui.set_panel_label(f"Palpate \u00b7 {scene.title}")
        camera = self._server.initial_camera
        camera.position, camera.look_at, camera.up = np.array([0.7, -0.9, 0.5]), np.zeros(3), np.array([0.0, 0.0, 1.0])
        if scene.body is not None:
            vertices = (scene.body.vertices - self._centre) / self._size
            self._server.scene.add_mesh_simple(
                "/link", vertices, scene.body.faces, color=(203, 209, 216), side="double"
            )
        flat = unrolled(scene.force[0], scene.most, np.zeros((0, 2)))
        self._sheet = gui.add_image(flat, label="the sheet, unrolled")
        self._told = gui.add_markdown("")
        self._slider = gui.add_slider("frame", 0, max(len(scene) - 1, 1), 1, scene.strongest)
        self._play = gui.add_checkbox("play", False)
        self._slider.on_update(lambda event: self.show(self._frame()) if event.client else None)
        self._play.on_update(lambda event: self._nudge())

    def _frame(self) -> int:
        return min(int(self._slider.value), len(self.scene) - 1)

    def _nudge(self) -> None:
        with self._wake:
            self._wake.notify_all()

    def _cells(self, index: int) -> bytes:
        import trimesh

        share = np.clip(self.scene.force[index].ravel() / self.scene.most, 0.0, 1.0)
        linear = (colours(np.repeat(share, 4).astype(np.float64)) / 255.0) ** 2.2  # a glTF's vertex colours are linear
        mesh = trimesh.Trimesh(
            (self._points - self._centre) / self._size,
            np.concatenate([self._faces, self._faces[:, ::-1]]),  # seen from within too
            process=False,
            vertex_colors=(255 * linear).round().astype(np.uint8),
        )
        made = BytesIO()
        mesh.export(made, file_type="glb")
        return made.getvalue()

    def _arrows(self, rows: Int[np.ndarray, " k"]) -> None:
        """One that pushes with its tip for each touch; those of the frame before go."""
        estimate, space = self.scene.touches.estimate, self._server.scene
        for name in self._names:
            space.remove_by_name(name)
        self._names = []
        longest = max(float(np.nanmax(self.scene.touches.load, initial=0.0)), 1e-6)
        for row in rows.tolist():
            tip = (estimate.point[row] - self._centre) / self._size
            shaft = ARROW * estimate.force[row] / longest
            name = f"/touch/{self.scene.touches.contact[row]}"
            space.add_arrows(
                name, np.stack([tip - shaft, tip])[None], FORCE, shaft_radius=0.008, head_radius=0.02, head_length=0.05
            )
            self._names.append(name)

    def _words(self, index: int, rows: Int[np.ndarray, " k"]) -> str:
        touches = self.scene.touches
        lines = [f"**{self.scene.time[index]:.2f} s**, {len(rows)} touch{'' if len(rows) == 1 else 'es'}"]
        lines += [
            f"- {touches.contact[row]}: {touches.load[row]:.2f} N at row {touches.row[row]:.2f}, column "
            f"{touches.column[row]:.2f}; {1e-3 * touches.pressure[row]:.1f} kPa on {1e4 * touches.area[row]:.1f} cm^2"
            for row in rows.tolist()
        ]
        return "\n".join(lines)

    def _paint(self) -> None:
        """Plays in real time while the box is ticked."""
        last = monotonic()
        while not self._stopping:
            with self._wake:
                self._wake.wait(timeout=TICK if self._play.value else None)
            now = monotonic()
            if self._play.value and not self._stopping:
                time: Float[np.ndarray, " n"] = self.scene.time
                index = self._frame()
                after = int(np.searchsorted(time, float(time[index]) + min(now - last, 1.0)))
                self._slider.value = after if after < len(time) else 0
                self.show(self._frame())
            last = now
