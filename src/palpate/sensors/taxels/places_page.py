"""Show taxel places on a page, coloured by module or standard deviation, with their ellipsoids."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, UInt8

from palpate.sensors.taxels.layer import CORNERS, FACES, tangent_frames
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.spatial.pose import quaternion_from_rotation
from palpate.surfaces import Surface
from palpate.viewer.camera import fit
from palpate.viewer.heat import colours, linear
from palpate.viewer.scene import MAGNIFICATIONS, Scene, no_contacts, prepare
from palpate.viewer.scene3d import DrawSettings, Scene3D
from palpate.viewer.server import Served
from palpate.viewer.widgets import dock, table

if TYPE_CHECKING:
    from viser import ClientHandle, GuiApi, ViserServer

__all__ = ["PlacesLayer", "TaxelPage", "serve_taxels"]

CHI2_95 = 7.814727903251179  # of three degrees of freedom
LIFT = 4e-4  # m: patches stand out from the link
SIDE = 0.6  # of the distance to the nearest taxel
THIN = 0.02  # of its longest axis that an ellipsoid is thick at least, so that it can be seen
MODULES = np.array(  # Okabe and Ito's colours, and two more: told apart by the colour-blind
    [(0, 114, 178), (230, 159, 0), (0, 158, 115), (204, 121, 167), (86, 180, 233), (213, 94, 0), (150, 140, 40)]
)
LOOSE, NEVER = (150, 158, 166), (20, 24, 30)
ONE_SIDED = 0.1  # length of the mean of the normals of a skin that is not round its link


class PlacesLayer:
    """A layer of patches at the taxels, with a black rim on those never touched, and their 95 % ellipsoids.

    Args:
        places: to draw.
        surface: of the link, for normals that are not known; None: these point away from the middle.
    """

    def __init__(self, places: TaxelPlaces, surface: Surface | None = None) -> None:
        there = places.there
        self._points = places.positions[there]
        normals = places.normals[there].copy()
        lacking = ~np.isfinite(normals).all(axis=1)
        away = self._points - self._points.mean(axis=0)
        length = np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
        normals[lacking] = (away / length)[lacking] if surface is None else surface.project(self._points[lacking])[1]
        self.normals: Float[np.ndarray, "k 3"] = normals
        self._module, self._pokes = places.module[there], places.pokes[there]
        self._covariance, self._deviation = places.covariance[there], places.deviations()[there]
        self._known = np.isfinite(self._covariance).all(axis=(1, 2))
        self.never = (self._pokes == 0) & bool(self._pokes.any())

    @property
    def covers(self) -> bool:
        """Return True: the taxels cover the body."""
        return True

    @property
    def places(self) -> Float[np.ndarray, "k 3"]:
        """Return the positions of the taxels, (k, 3) [m]."""
        return self._points

    def draw(self, server: ViserServer | ClientHandle, scene: Scene) -> None:
        """Draw patches, rims, ellipsoids and module numbers in the server's scene."""
        self._scene = scene
        side = self._side()
        frames = tangent_frames(self.normals, np.eye(3)[np.argmin(np.abs(self.normals), axis=1)])
        turns = np.roll(quaternion_from_rotation(frames), 1, axis=1)
        lifted = scene.placed(self._points + LIFT * self.normals)
        add = server.scene.add_batched_meshes_simple
        self._patches = add(
            "/taxels", CORNERS, FACES, turns, lifted, batched_scales=np.full((len(turns), 3), side / scene.size),
            batched_colors=self._colours("module"), side="double", lod="off", cast_shadow=False,
        )  # fmt: skip
        if self.never.any():
            under = scene.placed(self._points + 0.5 * LIFT * self.normals)[self.never]
            scales = np.full((len(under), 3), 1.45 * side / scene.size)
            add(
                "/never", CORNERS, FACES, turns[self.never], under, batched_scales=scales, batched_colors=NEVER,
                side="double", lod="off", cast_shadow=False,
            )  # fmt: skip
        for number in np.unique(self._module[self._module >= 0]).tolist():
            rows = self._module == number
            outward = self.normals[rows].mean(axis=0)
            server.scene.add_label(
                f"/module/{number}", f"{number}",
                position=scene.placed(self._points[rows].mean(axis=0) + 0.02 * scene.size * outward),
                font_screen_scale=0.9,
            )  # fmt: skip
        self._server = server
        self._ellipsoids(self._magnification(scene.size))

    def _magnification(self, size: float) -> int:
        """Return the magnification that makes the median ellipsoid visible on a body of a size [m]."""
        if not self._known.any():
            return 1
        axis = float(np.sqrt(CHI2_95 * np.median(np.linalg.eigvalsh(self._covariance[self._known])[:, -1])))
        return next((times for times in MAGNIFICATIONS if times * axis >= size / 60), MAGNIFICATIONS[-1])

    def _ellipsoids(self, times: int) -> None:
        """Draw the ellipsoids magnified `times`; 0: remove them."""
        rows = np.flatnonzero(self._known)
        if not times or not len(rows):
            self._server.scene.remove_by_name("/ellipsoids")
            return
        import trimesh

        ball = trimesh.creation.icosphere(subdivisions=2)
        axes, rotations = ellipsoid_axes(self._covariance[rows])
        lifted = self._scene.placed((self._points + 2 * LIFT * self.normals)[rows])
        self._server.scene.add_batched_meshes_simple(
            "/ellipsoids", np.asarray(ball.vertices), np.asarray(ball.faces),
            np.roll(quaternion_from_rotation(rotations), 1, axis=1), lifted,
            batched_scales=times * axes / self._scene.size, batched_colors=(70, 80, 92), opacity=0.4, lod="off",
            cast_shadow=False,
        )  # fmt: skip

    def panel(self, gui: GuiApi) -> None:
        """Add the choice of colours, their legend, the size of ellipsoids, and a checkbox that hides taxels."""
        known = {"module": True, "deviation": self._known.any(), "pokes": self._pokes.any()}
        options = [by for by, there in known.items() if there]
        chosen = gui.add_dropdown("colour", tuple(options), initial_value=options[0])
        self._legend = gui.add_html(self._explained(options[0]))

        def coloured(_: object) -> None:
            self._patches.batched_colors = self._colours(chosen.value)
            self._legend.content = self._explained(chosen.value)

        chosen.on_update(coloured)
        if self._known.any():
            sizes = {"hidden": 0} | {f"x {times}": times for times in MAGNIFICATIONS}
            first = f"x {self._magnification(self._scene.size)}"
            shown = gui.add_dropdown("95 % ellipsoids", tuple(sizes), initial_value=first)
            shown.on_update(lambda _: self._ellipsoids(sizes[shown.value]))
        seen = gui.add_checkbox("taxels", True, hint="hide them to see the body below")
        seen.on_update(lambda _: setattr(self._patches, "visible", seen.value))

    def show(self, scene: Scene, index: int) -> None:
        """Do nothing: places do not change."""

    def rows(self, scene: Scene, index: int) -> list[tuple[str, str]]:
        """Return []: the caption has no rows."""
        return []

    def legend(self) -> list[str]:
        """Return []: the panel explains the colours."""
        return []

    def _side(self) -> float:
        from scipy.spatial import cKDTree  # here: scipy is slow to import

        if len(self._points) < 2:
            return 3e-3
        distances = np.asarray(cKDTree(self._points).query(self._points, k=2)[0])
        return SIDE * float(np.median(distances[:, 1]))

    def _colours(self, by: str) -> UInt8[np.ndarray, "k 3"]:
        if by == "module":
            shade = np.where(self._module[:, None] >= 0, MODULES[self._module % len(MODULES)], LOOSE)
            return linear(shade.astype(np.uint8))
        values = self._deviation if by == "deviation" else self._pokes.astype(np.float64)
        return linear(colours(np.nan_to_num(values / max(float(np.nanmax(values)), 1e-12))))

    def _explained(self, by: str) -> str:
        if by == "module":
            said = "each module has a colour and its number; taxels on none are grey"
        elif by == "deviation":
            said = f"darkest: {1e3 * float(np.nanmax(self._deviation)):.2f} mm, root of the trace of the covariance"
        else:
            said = f"darkest: {int(self._pokes.max())} pokes"
        rim = f"; {int(self.never.sum())} on a black rim were never touched" if self.never.any() else ""
        return f'<p style="opacity:.75;margin:.2em 1em">{escape(said + rim)}</p>'


class TaxelPage(Served):
    """A page of taxel places, served as `Served` is.

    Args:
        places, surface: as of `PlacesLayer`; without a surface only the taxels are drawn.
        title: of the page.
        facts: names and values for the panel.
        host, port: to listen at; port 0 for any free port.

    Raises:
        InputError: viser is not installed, or the server cannot listen at the port.
    """

    def __init__(
        self,
        places: TaxelPlaces,
        surface: Surface | None = None,
        title: str = "",
        facts: Sequence[tuple[str, str]] = (),
        *,
        host: str = "127.0.0.1",
        port: int = 8080,
    ) -> None:
        layer = PlacesLayer(places, surface)
        scene = prepare(surface, no_contacts(), title, (layer,))
        super().__init__(host, port)
        outward = layer.normals.mean(axis=0)  # of a skin on one side of the link: it is seen from there
        one_sided = float(np.linalg.norm(outward)) > ONE_SIDED
        direction = outward / np.linalg.norm(outward) + [0.0, 0.0, 0.25] if one_sided else np.array([0.55, -0.7, 0.456])
        points = scene.placed(np.concatenate([layer.places, np.zeros((0, 3)) if one_sided else scene.outline]))
        self.look(lambda aspect: fit(points, direction / np.linalg.norm(direction), aspect))
        with self._server.atomic():
            scene3d = Scene3D(self._server, scene)
            scene3d.show(scene.at(0), DrawSettings(heat=False, trail=0.0, magnification=1))
            dock(self._server.gui, title)
            rows = table([(escape(name), escape(value)) for name, value in facts])
            self._server.gui.add_html(f'<div style="margin:.4em 1em">{rows}</div>')
            layer.panel(self._server.gui)


def serve_taxels(
    places: TaxelPlaces,
    surface: Surface | None,
    title: str,
    facts: Sequence[tuple[str, str]],
    *,
    host: str = "127.0.0.1",
    port: int = 8080,
    up: Callable[[str], None] = lambda address: None,
) -> None:
    """Serve the page of taxel places until Ctrl-C, and call `up` with its address.

    Raises:
        InputError: viser is not installed, or the server cannot listen at the port.
        GeometryError: an implicit surface cannot be drawn.
    """
    try:
        with TaxelPage(places, surface, title, facts, host=host, port=port) as page:
            up(page.address)
            threading.Event().wait()
    except KeyboardInterrupt:  # how this ends
        return


def ellipsoid_axes(
    covariance: Float[np.ndarray, "k 3 3"],
) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3 3"]]:
    """Return half-axes (k, 3) [m] of the 95 % ellipsoids, sqrt(7.815 eigenvalues), and rotations (k, 3, 3).

    Half-axes are at least 2 % of the longest; the columns of a rotation are their directions.
    """
    values, vectors = np.linalg.eigh(covariance)
    axes = np.sqrt(CHI2_95 * np.maximum(values, 0.0))
    vectors[:, :, 0] *= np.sign(np.linalg.det(vectors))[:, None]
    return np.maximum(axes, THIN * axes[:, -1:]), vectors
