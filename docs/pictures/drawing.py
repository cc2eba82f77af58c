"""What the pictures share: how a body is drawn, how a page is photographed, how small a file is made."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import LightSource
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from PIL import Image

import palpate
from palpate.cli import main as palpate_command

HERE = Path(__file__).resolve().parent
MM = 1e3
COLOURS, MORE = 128, 256  # enough for two blues and grey, and for the colours of robots; a third of the size
PAPER = 249  # as light as this is white
SKIN, DEEP, WARM, LIGHT = "#c9d4e3", "#1b4f9c", "#d9822b", LightSource(azdeg=300, altdeg=50)
SCREEN = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


def run(*words: object) -> None:
    """One command of Palpate's, as a person would type it."""
    if code := palpate_command([str(word) for word in words]):
        raise SystemExit(f"palpate {' '.join(map(str, words))} left with {code}")


def pixels(drawn: Figure) -> Image.Image:
    """The picture of a figure."""
    plain = BytesIO()
    drawn.savefig(plain, format="png")
    return Image.open(plain).convert("RGB")


def save(picture: Figure | Image.Image, name: str, colours: int = COLOURS) -> None:
    """As a small PNG beside this file."""
    picture = pixels(picture) if isinstance(picture, Figure) else picture
    few = picture.convert("RGB").quantize(colours, Image.Quantize.FASTOCTREE)
    palette = np.reshape(few.getpalette() or [], (-1, 3))
    palette[np.all(palette >= PAPER, axis=1)] = 255  # white is a little blue otherwise
    few.putpalette(palette.astype(np.uint8).tobytes())
    few.save(HERE / f"{name}.png", optimize=True)


def figure(width: float = 9.6, height: float = 4.0) -> Figure:
    """In inches of 100 pixels."""
    return Figure(figsize=(width, height), dpi=100, layout="constrained")


def body(axes: Any, mesh: palpate.Mesh, view: tuple[float, float], alpha: float = 0.35, zoom: float = 1.0) -> None:
    """The body [mm], nothing about it; what is drawn behind it shines through."""
    corners = MM * mesh.vertices[mesh.faces]
    axes.add_collection3d(
        Poly3DCollection(corners, facecolors=SKIN, shade=True, lightsource=LIGHT, linewidths=0, alpha=alpha)
    )
    points = corners.reshape(-1, 3)
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    axes.set_box_aspect(tuple(high - low), zoom=zoom)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_axis_off()
    axes.view_init(elev=view[0], azim=view[1])


def arrows(axes: Any, point: Any, force: Any, scale: float, colour: str = DEEP) -> None:
    """Forces [N] that end where they act [m], so many mm for a newton."""
    axes.quiver(
        *(MM * point - scale * force).T,
        *(scale * force).T,
        color=colour,
        arrow_length_ratio=0.2,
        linewidth=1.6,
        clip_on=False,
    )
    axes.scatter(*(MM * point).T, color=colour, s=10, depthshade=False)


@contextmanager
def browser(width: int, height: int) -> Iterator[Any]:
    """A page of Debian's chromium (`make browser`)."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=list(SCREEN))
        yield opened.new_page(viewport={"width": width, "height": height})
        opened.close()


def photographed(page: Any) -> Image.Image:
    """What the page shows now."""
    return Image.open(BytesIO(page.screenshot()))
