"""Pictures of the demo's probe on a force/torque sensor, from the files that `make demo` leaves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from drawing import DEEP, MM, MORE, SKIN, WARM, arrows, body, browser, figure, photographed, save
from matplotlib.collections import PolyCollection

import palpate
from palpate.contact.events import Events
from palpate.contact.touch_finder import find_touches
from palpate.files.contacts import read_contacts

ARROW = 2.2  # mm for a newton
MAGNIFIED = 5  # times that ellipses are drawn larger than they are


def demo(folder: Path) -> None:
    """Twenty touches, and their forces over time."""
    contacts = read_contacts(folder / "contacts.csv")
    mesh = palpate.Mesh.load(folder / "probe.stl", unit="mm")
    touches = find_touches(contacts)
    drawn = figure()
    left, right = drawn.subfigures(1, 2, width_ratios=(1.15, 1.0))
    axes: Any = left.add_subplot(projection="3d")
    body(axes, mesh, (24, -62))
    arrows(axes, touches.point, contacts.force[_peaks(contacts, touches)], ARROW)
    measures = " x ".join(f"{side:.0f}" for side in MM * np.ptp(mesh.vertices[mesh.faces.reshape(-1)], axis=0))
    axes.set_title(f"{len(touches)} touches of a probe of {measures} mm", fontsize=10)
    _forces(right.subplots(), contacts, touches)
    save(drawn, "demo")


def _peaks(contacts: palpate.Contacts, touches: Events) -> list[int]:
    return [int(np.nanargmin(np.abs(contacts.time - when))) for when in touches.peak_time]


def _forces(axes: Any, contacts: palpate.Contacts, touches: Events) -> None:
    start = float(contacts.time[0])
    strength = np.linalg.norm(contacts.force, axis=1)
    axes.plot(contacts.time - start, strength, color=DEEP, linewidth=0.9)
    for number, (begin, end) in enumerate(zip(touches.start - start, touches.end - start, strict=True), start=1):
        axes.axvspan(begin, end, color=SKIN, alpha=0.5, linewidth=0)
        axes.text((begin + end) / 2, 1.01, str(number), transform=axes.get_xaxis_transform(), ha="center", fontsize=7)
    deviation = MM * float(np.median(touches.deviation))
    axes.set(xlabel="time [s]", ylabel="force [N]", ylim=(0, None), xlim=(0, float(contacts.time[-1]) - start))
    axes.set_title(f"placed to {deviation:.2f} mm (1 sigma, median)", fontsize=10, pad=16)
    axes.spines[["top", "right"]].set_visible(False)


def ellipses(folder: Path) -> None:
    """The peak of each touch with its 95 % ellipse, from the side that it faces most."""
    contacts = read_contacts(folder / "contacts.csv")
    peak = _peaks(contacts, find_touches(contacts))
    mesh = palpate.Mesh.load(folder / "probe.stl", unit="mm")
    facing = np.abs(contacts.normal[peak]).argmax(axis=1)
    drawn = figure(9.6, 4.6)
    sides = [(across, up, depth, side) for side in (1, -1) for across, up, depth in ((0, 1, 2), (0, 2, 1), (1, 2, 0))]
    for axes, (across, up, depth, side) in zip(drawn.subplots(2, 3).ravel(), sides, strict=True):
        flat = MM * mesh.vertices[mesh.faces][:, :, [across, up]]
        axes.add_collection(PolyCollection(list(flat), facecolors=SKIN, edgecolors=SKIN, linewidths=0.3))
        here = [
            k for k, most in zip(peak, facing, strict=True) if most == depth and side * contacts.normal[k, depth] > 0
        ]
        for k in here:
            seen = [across, up]
            _ellipse(axes, contacts.point[k][seen], contacts.covariance[k][np.ix_(seen, seen)])
        axes.set(aspect="equal", xlim=(-36, 36), ylim=(-24, 24))
        axes.set(xlabel=f"{'xyz'[across]} [mm]", ylabel=f"{'xyz'[up]} [mm]")
        axes.set_title(f"facing {'+' if side > 0 else '-'}{'xyz'[depth]}: {len(here)}", fontsize=10)
        axes.spines[["top", "right"]].set_visible(False)
    drawn.suptitle(
        f"{len(peak)} touches and their 95 % ellipses, drawn {MAGNIFIED} times as large as they are", fontsize=10
    )
    save(drawn, "ellipses")


def _ellipse(axes: Any, place: Any, covariance: Any) -> None:
    values, vectors = np.linalg.eigh(covariance)
    turn = np.linspace(0, 2 * np.pi, 60)
    ring = vectors @ (np.sqrt(5.99 * np.maximum(values, 0))[:, None] * np.stack([np.cos(turn), np.sin(turn)]))
    axes.plot(*(MM * (place[:, None] + MAGNIFIED * ring)), color=DEEP, linewidth=1.0)
    axes.plot(*(MM * place), ".", color=DEEP, markersize=3)


def candidates(folder: Path) -> None:
    """A wrench that several places of a body could have made: why a contact is ambiguous."""
    mesh = palpate.Mesh.from_trimesh(trimesh.creation.torus(30.0, 10.0, 64, 32), unit="mm")
    force, point = np.array([-5.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.003])
    locator = palpate.Locator(mesh, noise=[0.02] * 3 + [0.001] * 3)
    found = locator.candidates(np.concatenate([force, np.cross(point, force)]))
    drawn = figure(6.4, 3.0)
    axes: Any = drawn.subplots(subplot_kw={"projection": "3d"})
    body(axes, mesh, (32, -75), alpha=0.2, zoom=1.35)
    places = found.point[found.plausible]
    arrows(axes, places, np.tile(force, (len(places), 1)), ARROW, WARM)
    axes.plot(*(MM * np.array([[0.055, 0, 0.003], [-0.045, 0, 0.003]])).T, color=DEEP, linewidth=0.8, linestyle="--")
    axes.set_title(f"one wrench, one line of action, {len(places)} places that could have been pressed", fontsize=10)
    save(drawn, "candidates")


def report(folder: Path) -> None:
    """The first screen of the report that `palpate estimate --report` writes."""
    with browser(1100, 930) as page:
        page.goto((folder / "report.html").as_uri())
        page.wait_for_timeout(500)
        save(photographed(page), "report")


def view(folder: Path) -> None:
    """The page that `palpate view` serves, at its opening touch."""
    from palpate.setup import load_rig
    from palpate.viewer.scene import prepare
    from palpate.viewer.server import Page

    rig = load_rig(folder / "rig.toml")
    scene = prepare(rig.surface.load(rig.folder), read_contacts(folder / "contacts.csv"), title="touches.mcap")
    with Page(scene, port=0) as served, browser(1280, 800) as page:
        page.set_default_timeout(120e3)
        page.goto(served.address)
        page.wait_for_selector("canvas")
        page.get_by_text("contact", exact=True).first.wait_for()
        page.locator(".mantine-Notification-closeButton").first.click()  # that there is no graphics card here
        page.wait_for_timeout(6000)
        save(photographed(page), "view", MORE)
