"""`python -m experiments.skin_map [--small]`: table 2 and the geometry of figures 6 to 8 beside ours, into README.md.

With --small the table is measured on fewer points and printed, and the page is left as it is.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from evidence.machine import machine
from evidence.skin_contacts import protocol
from evidence.skin_map import HEADING, ORIGIN, SHEET, table, wrist
from palpate.sensors.taxels.skin_map import map_skin
from palpate.sensors.taxels.skin_map.model import SkinMap
from palpate.sensors.taxels.skin_map.paper import paper_map
from palpate.surfaces import Mesh

PAGE = Path(__file__).with_name("README.md")
PAPER = {  # n, m: min, max, mean [mm] of the geometric distance, and time [ms], as printed in table 2
    (5, 5): (0.001, 3.820, 0.987, 344),
    (5, 10): (0.001, 3.856, 0.824, 414),
    (10, 5): (0.001, 3.820, 1.006, 598),
    (10, 10): (0.001, 3.856, 0.854, 766),
}


def main() -> int:
    """0, or 1 where the recording is absent."""
    parser = argparse.ArgumentParser(prog="python -m experiments.skin_map", description=__doc__)
    parser.add_argument("--small", action="store_true", help="fewer points; print, and write nothing")
    options = parser.parse_args()
    link = wrist()
    if link is None:
        sys.stderr.write("no shared data: set PALPATE_SHARED, or put it in ../shared beside the project\n")
        return 1
    text = "\n".join(_page(link, options.small))
    if options.small:
        sys.stdout.write(text)
    else:
        PAGE.write_text(text, encoding="utf-8")
    return 0


def _page(link: Mesh, small: bool) -> Iterator[str]:
    yield from [
        "# The skin map paper: a B-spline of the wrist, and where its cells lie",
        "",
        "Written by `python -m experiments.skin_map`; nothing here is typed by hand but the paper's own figures.",
        "The mesh is the paper's robot's (R_WRIST_Y of HRP-4C): its outer shell, between the heights where sections",
        "across its axis are complete and run over no rim.",
        "",
        *[f"- {line}" for line in machine()],
        "",
        "## Table 2: distance of spline and mesh",
        "",
        "Theirs was measured with MeshLab, on a crop of the mesh and planes that are not told; ours on points of one",
        "against the other surface, both ways. The text does not say the degree, nor on how many sides of the axis a",
        "plane counts: we read cubics and both sides (2 m half planes). *literal* gives the section's points uniform",
        "parameters and stacks the curves' control points as the surface's; with clamped uniform knots both are wrong",
        "near the ends, and that is what makes it so poor. *greville* gives points the parameters of their control",
        "points, in both directions: the paper's 0.854 mm lies between the two.",
        "",
        "| way | min, max, mean to the mesh [mm] | min, max, mean from the mesh [mm] | time [ms] |",
        "| --- | --- | --- | --- |",
    ]
    for (n, m), (low, high, mean, took) in PAPER.items():
        yield f"| the paper, n = {n}, m = {m} | {low:.3f}, {high:.3f}, {mean:.3f} | | {took} |"
    for name, _, values, took, _ in table(link, small):
        ways = [f"{low:.3f}, {high:.3f}, {mean:.3f}" for low, mean, high in values]
        yield f"| {name} | {ways[0]} | {ways[1]} | {took:.1f} |"
    yield from _figures(link)
    yield from _bench(3 if small else 50)


def _figures(link: Mesh) -> Iterator[str]:
    ours = map_skin(link, SHEET, origin=ORIGIN, heading=HEADING)
    by_facets = map_skin(link, SHEET, origin=ORIGIN, heading=HEADING, mode="facets")
    theirs = paper_map(link, SHEET, origin=ORIGIN, heading=HEADING)
    better = paper_map(link, SHEET, origin=ORIGIN, heading=HEADING, reading="greville")
    yield from [
        "",
        "## Figures 6 to 8: where cells are and which way they face",
        "",
        "The figures compare the map with a force/torque sensor and with motion capture; those recordings are not",
        "public. First what the map itself adds to their errors: cells of the paper's way (equal parameters over the",
        "whole link) beside cells of a sheet that does not stretch, on the same mesh, from the same corner. Then the",
        "same comparisons on a simulated bench.",
        "",
        "| | mean | worst |",
        "| --- | --- | --- |",
    ]
    others = {"the paper's way, literal": theirs, "the paper's way, greville": better}
    for name, other in (*others.items(), ("along facets instead of through vertices", by_facets)):
        apart, turned = _apart(ours, other)
        yield f"| {name}: cells off by [mm] | {1e3 * apart.mean():.2f} | {1e3 * apart.max():.2f} |"
        yield f"| {name}: normals turned by [deg] | {turned.mean():.2f} | {turned.max():.2f} |"
    for name, skin in (*others.items(), ("ours", ours)):
        for axis, what in ((1, "columns"), (0, "rows")):
            step = 1e3 * np.linalg.norm(np.diff(skin.centres, axis=axis), axis=-1)
            worst = step.flat[np.abs(step - 10).argmax()]
            yield f"| {name}: between neighbouring {what} (10 on the sheet) [mm] | {step.mean():.2f} | {worst:.2f} |"
    yield from [
        "",
        f"Ours: strain {100 * ours.strain[0]:.2f} % rms, {100 * ours.strain[1]:.1f} % at worst; "
        f"{np.count_nonzero(ours.overlap)} of 132 cells overlap. {' '.join(note + '.' for note in ours.notes)}",
        "",
    ]


def _bench(count: int) -> Iterator[str]:
    """Figures 6 to 8 on the simulated bench, by the paper's measures and in 3-D."""
    small, wide = protocol(count, 0.3), protocol(count, 3.0)
    yield from [
        f"The bench: 19 touches, {count} times, of an exactly known sheet round a cylinder, with a sensor below and a",
        "wand that cameras lose now and then (`palpate_lab.simulation.skin_session`). Its noise, gains and forces are",
        "ours; the paper's errors hold a real map's, a real sensor's and the alignment of its frames by hand besides.",
        "",
        "| | theirs | touches of 0.3 cells | patches of 3 cells |",
        "| --- | --- | --- | --- |",
    ]
    rows = (
        ("7: directions, sensor, x and y of unit vectors [%]", "2.9", lambda j: 100 * np.nanmean(j.paper)),
        ("directions, sensor, in space [deg]", "", lambda j: np.degrees(np.nanmean(np.concatenate(j.turned)))),
        ("8: positions, sensor, z set to zero [mm]", "4.2", lambda j: 1e3 * np.nanmean([one[0] for one in j.flat])),
        ("positions, sensor, in space [mm]", "", lambda j: 1e3 * np.nanmean(np.concatenate(j.sensor))),
        ("8: positions, wand, z set to zero [mm]", "14.0", lambda j: 1e3 * np.nanmean([one[1] for one in j.flat])),
        ("positions, wand, in space [mm]", "", lambda j: 1e3 * np.nanmean(np.concatenate(j.wand))),
    )
    for what, theirs, ours in rows:
        yield f"| {what} | {theirs} | {ours(small):.2f} | {ours(wide):.2f} |"
    yield from [
        "",
        "A perfect map that names the cell errs 3.82 mm from a touch smaller than it, and its normal by what the link",
        "turns within a cell. Figure 6 draws the touches that these rows sum up.",
        "",
    ]


def _apart(one: SkinMap, other: SkinMap) -> tuple[np.ndarray, np.ndarray]:
    cosine = np.clip(np.einsum("rci,rci->rc", one.normals, other.normals), -1.0, 1.0)
    return np.linalg.norm(one.centres - other.centres, axis=-1), np.degrees(np.arccos(cosine))


if __name__ == "__main__":
    sys.exit(main())
