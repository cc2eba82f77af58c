"""The pictures of the documentation, by the project's own commands.

The README's first: what `palpate demo` found, drawn from its files alone. Of touch navigation: the last picture of the
film of a run. Run: `make pictures`, after `make demo`; or `python docs/pictures/make.py FOLDER`, of another demo's.
"""

from __future__ import annotations

import sys
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
from matplotlib.colors import LightSource
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from PIL import Image

import palpate
from palpate.cli import main as palpate_command
from palpate.contact.events import Events, find_touches
from palpate.io.contacts import read_contacts

HERE = Path(__file__).resolve().parent
MM = 1e3
COLOURS, MORE = 64, 256  # enough for two blues and grey, and for the colours of robots; a third of the size
ARROW = 2.5  # mm for a newton
SKIN, DEEP, LIGHT = "#c9d4e3", "#1b4f9c", LightSource(azdeg=300, altdeg=50)


def main(folder: Path) -> None:
    """Draw the body with its touches, and their forces over time."""
    contacts = read_contacts(folder / "contacts.csv")
    mesh = palpate.Mesh.load(folder / "probe.stl", unit="mm")
    touches = find_touches(contacts)
    drawn = Figure(figsize=(9.6, 4.0), dpi=100, layout="constrained")
    left, right = drawn.subfigures(1, 2, width_ratios=(1.15, 1.0))
    _body(left.add_subplot(projection="3d"), mesh, contacts, touches)
    _forces(right.subplots(), contacts, touches)
    plain = BytesIO()
    drawn.savefig(plain, format="png")
    _save(Image.open(plain), "demo.png")


def arena() -> None:
    """Four robots on their way, from the film of a run."""
    with TemporaryDirectory() as folder:
        film = f"{folder}/run.mp4"
        words = ["--seed", "7", "--seconds", "80", "--output", f"{folder}/run.mcap", "--film", film]
        palpate_command(["simulate", "arena", *words])
        video = cv2.VideoCapture(film)
        video.set(cv2.CAP_PROP_POS_FRAMES, video.get(cv2.CAP_PROP_FRAME_COUNT) - 1)
        _save(Image.fromarray(video.read()[1][:, :, ::-1]), "arena.png", MORE)


def _save(picture: Image.Image, name: str, colours: int = COLOURS) -> None:
    picture.convert("RGB").quantize(colours, Image.Quantize.FASTOCTREE).save(HERE / name, optimize=True)


def _body(axes: Any, mesh: palpate.Mesh, contacts: palpate.Contacts, touches: Events) -> None:
    """Every touch as an arrow that ends on the body, along the force at its peak, with its ellipsoid as a disc."""
    corners = MM * mesh.vertices[mesh.faces]
    axes.add_collection3d(
        Poly3DCollection(corners, facecolors=SKIN, shade=True, lightsource=LIGHT, linewidths=0, alpha=0.35)
    )
    peak = [int(np.nanargmin(np.abs(contacts.time - when))) for when in touches.peak_time]
    point, force = MM * touches.point, contacts.estimate.force[peak]
    axes.quiver(*(point - ARROW * force).T, *(ARROW * force).T, color=DEEP, arrow_length_ratio=0.2, linewidth=1.4)
    axes.scatter(*point.T, color=DEEP, s=9, depthshade=False)
    size = np.ptp(corners.reshape(-1, 3), axis=0)
    axes.set_box_aspect(tuple(size), zoom=1.0)
    axes.set(**{f"{axis}lim": (low, high) for axis, (low, high) in zip("xyz", _ends(corners), strict=True)})
    axes.set_axis_off()
    axes.view_init(elev=24, azim=-62)
    measures = " x ".join(f"{side:.0f}" for side in size)
    axes.set_title(f"{len(touches)} touches of a probe of {measures} mm", fontsize=10)


def _ends(corners: Any) -> list[tuple[float, float]]:
    points = corners.reshape(-1, 3)
    return list(zip(points.min(axis=0), points.max(axis=0), strict=True))


def _forces(axes: Any, contacts: palpate.Contacts, touches: Events) -> None:
    start = float(contacts.time[0])
    strength = np.linalg.norm(contacts.estimate.force, axis=1)
    axes.plot(contacts.time - start, strength, color=DEEP, linewidth=0.9)
    for number, (begin, end) in enumerate(zip(touches.start - start, touches.end - start, strict=True), start=1):
        axes.axvspan(begin, end, color=SKIN, alpha=0.5, linewidth=0)
        axes.text((begin + end) / 2, 1.01, str(number), transform=axes.get_xaxis_transform(), ha="center", fontsize=7)
    deviation = MM * float(np.median(touches.deviation))
    axes.set(xlabel="time [s]", ylabel="force [N]", ylim=(0, None), xlim=(0, float(contacts.time[-1]) - start))
    axes.set_title(f"placed to {deviation:.2f} mm (1 sigma, median)", fontsize=10, pad=16)
    axes.spines[["top", "right"]].set_visible(False)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE.parents[1] / "demo")
    arena()
