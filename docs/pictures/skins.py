"""Pictures of skins: a sheet on a link, contacts of a frame, and a skin above a force/torque sensor."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from drawing import DEEP, MM, WARM, arrows, body, figure, run, save

import palpate
from palpate.files.contacts import read_contacts
from palpate.sensors.taxels.place_formats import read_taxel_places

FRAME = 0.01  # s from a frame of the forearm's skin to the next
FOREARM = ("--seed", 7, "--seconds", 30)
SIDE = (18.0, -50.0)  # degrees that the link is seen from


def forearm(folder: Path) -> Path:
    """The session that `palpate simulate forearm` makes, once, and its contacts, of the skin alone and of both."""
    made = folder / "forearm"
    if not made.exists():
        run("simulate", "forearm", "-o", made, *FOREARM)
    both = made / "both.mcap"
    for name, more in (("skin", ("--sensor", "skin")), ("fused", ())):
        if not (made / f"{name}.csv").exists():
            run("estimate", both, "--rig", made / "both.toml", *more, "-o", made / f"{name}.csv")
    return made


def skin_map(folder: Path) -> None:
    """Where the cells of a flat sheet come to lie on a link: `palpate map skin`."""
    link = forearm(folder) / "link.stl"
    mesh = palpate.Mesh.load(link, unit="m")
    sheet = palpate.Sheet(rows=8, columns=11, pitch=(0.01, 0.01))
    laid = palpate.map_skin(mesh, sheet, origin=(0.0355, 0.0, -0.04), heading=(0, 0.4, 0.9))
    drawn = figure(6.4, 5.4)
    axes: Any = drawn.subplots(subplot_kw={"projection": "3d"})
    body(axes, mesh, SIDE, alpha=0.2)
    centres, normals = laid.centres.reshape(-1, 3), laid.normals.reshape(-1, 3)
    near = normals @ _toward(*SIDE) > 0
    rows = np.repeat(np.arange(sheet.rows), sheet.columns)
    axes.scatter(
        *(MM * (centres + 0.001 * normals))[near].T, c=rows[near], cmap="viridis", s=34, marker="s", depthshade=False
    )
    size = f"on a link of {MM * float(np.ptp(mesh.vertices[:, 2])):.0f} mm"
    axes.set_title(f"{sheet.rows} x {sheet.columns} cells of 10 mm, laid without stretching {size}", fontsize=10)
    save(drawn, "skin_map")


def _toward(elevation: float, azimuth: float) -> Any:
    e, a = np.radians([elevation, azimuth])
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def skin_contacts(folder: Path) -> None:
    """The load of each cell in one frame of an unrolled skin, and the contacts that were found in it."""
    made = forearm(folder)
    rig = palpate.load_rig(made / "both.toml")
    contacts = read_contacts(made / "skin.csv")
    when = _busiest(contacts)
    with palpate.open_log(made / "both.mcap", rig, sensor="skin") as log:
        block = next(each for each in log if when in each.time)
        cells = block.channels["cells"][np.flatnonzero(block.time == when)[0]]
        rest = next(iter(log)).channels["cells"][0]
    here = (contacts.time == when) & contacts.answered
    drawn = figure(9.6, 4.0)
    axes = drawn.subplots()
    shown = axes.imshow(np.clip(cells - rest, 0, None).reshape(10, -1), cmap="Blues", origin="lower")
    drawn.colorbar(shown, ax=axes, label="counts above rest", shrink=0.8).outline.set_visible(False)
    force = np.linalg.norm(contacts.force[here], axis=1)
    for row, column, newton in zip(
        contacts.features["row"][here], contacts.features["column"][here], force, strict=True
    ):
        axes.plot(column, row, "o", color=WARM, markersize=8)
        axes.annotate(f"{newton:.1f} N", (column, row), (14, 14), textcoords="offset points", color=WARM, weight="bold")
    axes.set(xticks=range(0, 22, 3), yticks=range(0, 10, 3), xlabel="column", ylabel="row")
    axes.set_title(f"{np.count_nonzero(here)} contacts in one frame of 10 x 22 cells", fontsize=10)
    save(drawn, "skin_contacts")


def _busiest(contacts: palpate.Contacts) -> float:
    """The time with most contacts, of these the one with the largest of the smallest forces."""
    table = pl.DataFrame({"time": contacts.time, "force": np.linalg.norm(contacts.force, axis=1)}).filter(
        contacts.answered
    )
    each = table.group_by("time").agg(pl.len(), pl.col("force").min()).sort("len", "force")
    return float(each["time"][-1])


def fusion(folder: Path) -> None:
    """Each contact with its force in 3-D, from a skin and a force/torque sensor together, beside the truth."""
    made = forearm(folder)
    mesh = palpate.Mesh.load(made / "link.stl", unit="m")
    contacts = read_contacts(made / "fused.csv")
    contacts, every = contacts[contacts.located], pl.read_csv(made / "truth.csv")
    frames = [np.rint(times / FRAME).astype(int) for times in (contacts.time, every["time"].to_numpy())]
    found, true = (np.bincount(each, minlength=max(map(np.max, frames)) + 1) for each in frames)
    when = _busiest(contacts[(found == true)[frames[0]]])  # of the frames in which all contacts are found
    here = np.abs(contacts.time - when) < FRAME / 2
    truth = every.filter((pl.col("time") - when).abs() < FRAME / 2)
    drawn = figure(6.4, 5.4)
    axes: Any = drawn.subplots(subplot_kw={"projection": "3d"})
    body(axes, mesh, SIDE, alpha=0.25, zoom=0.9)
    arrows(axes, truth.select("px", "py", "pz").to_numpy(), truth.select("fx", "fy", "fz").to_numpy(), 6.0, WARM)
    arrows(axes, contacts.point[here], contacts.force[here], 6.0, DEEP)
    most = np.linalg.norm(contacts.force[here], axis=1).max()
    length = MM * float(np.ptp(mesh.vertices[:, 2]))
    title = f"{np.count_nonzero(here)} contacts, up to {most:.1f} N: found (blue), true (orange)"
    axes.set_title(f"{title}\nlink {length:.0f} mm long, arrows 6 mm a newton", fontsize=10)
    save(drawn, "fusion")


def taxels(folder: Path) -> None:
    """Where taxels of a forearm were found from the wrenches of pokes, and where they are."""
    made = folder / "pokes"
    if not made.exists():
        run("simulate", "pokes", "-o", made)
        run("calibrate", "taxels", made / "pokes.mcap", "--rig", made / "rig.toml", "-o", made / "skin.toml")
    found, truth = (read_taxel_places(made / name).positions for name in ("skin.toml", "truth.csv"))
    drawn = figure(6.4, 4.6)
    axes: Any = drawn.subplots(subplot_kw={"projection": "3d"})
    body(axes, palpate.Mesh.load(made / "forearm.stl", unit="m"), (20, -60), alpha=0.15, zoom=1.1)
    axes.scatter(*(MM * truth).T, facecolors="none", edgecolors=WARM, s=40, depthshade=False, label="true")
    axes.scatter(*(MM * found).T, color=DEEP, s=10, depthshade=False, label="found")
    axes.legend(frameon=False, loc="upper right")
    off = MM * np.median(np.linalg.norm(found - truth, axis=1))
    size = MM * float(np.ptp(truth, axis=0).max())
    axes.set_title(
        f"{len(found)} taxels over {size:.0f} mm from 300 pokes; the median is {off:.1f} mm off", fontsize=10
    )
    save(drawn, "taxels")
