"""Meshes that are hard to lay a sheet on, and calls that make no sense: mapped, or refused with the reason."""

import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import trimesh

from claims.command import cli
from claims.evidence.skin_shapes import round_mesh, wristlike
from claims.row import Row
from palpate.errors import PalpateError
from palpate.sensors.taxels.skin_map import Sheet, map_skin
from palpate.surfaces import Mesh

START, AHEAD = wristlike(np.array(-0.02), np.array(0.4)), np.array([0.0, 1.0, 0.0])


def hard_rows(small: bool, link: Mesh | None) -> Iterator[Row]:
    """Harder shapes, then bad input through the command."""
    sheet = Sheet(4, 10, (0.01, 0.01))
    clean = _smooth(48, 33)
    laid = partial(map_skin, sheet=sheet, origin=START, heading=AHEAD)
    ought = laid(clean).centres

    def off(mesh: Mesh) -> str:
        return f"mapped, {1e3 * np.linalg.norm(laid(mesh).centres - ought, axis=-1).max():.4f} mm from it"

    for what, mesh in {
        "soup": soup(clean),
        "doubled, both ways round": _doubled(clean),
        "a body inside": _filled(clean),
    }.items():
        got = off(mesh)
        yield Row(f"{what}: the map of the clean mesh", "<= 0.001 mm", got, float(got.split()[1]) <= 1e-3)
    got = _tried(box_link(), Sheet(4, 10, (0.01, 0.01)), (0.03, -0.02, -0.02), (0, 1, 0))
    yield Row("a sharp edge (square link, edges of 90 deg)", "mapped or refused with the reason", *got)
    for size in (0.006, 0.03):
        what = f"a hole of {2e3 * size:.0f} mm under the sheet"
        yield Row(what, "mapped or refused with the reason", *_tried(holed(clean, size), sheet, START, AHEAD))
    yield _seam(clean)
    for count in (1_000, 20_000) if small else (1_000, 20_000, 500_000):
        around = int(np.sqrt(count * 1.4))
        mesh = _smooth(around, max(3, count // (2 * around)))
        begin = time.perf_counter()
        got = off(mesh)
        took = time.perf_counter() - begin
        what = f"{len(mesh.faces):,} triangles: from the map of 3,072"
        yield Row(what, "<= 0.1 mm", f"{got}, {took:.2f} s the first time", float(got.split()[1]) <= 0.1)
    yield from _bad_input(small, clean)


def _smooth(around: int, rings: int) -> Mesh:
    return round_mesh(wristlike, around, np.linspace(-0.04, 0.04, rings))


def soup(mesh: Mesh) -> Mesh:
    """Every triangle with corners of its own, in any order and winding."""
    rng = np.random.default_rng(2)
    corners = mesh.vertices[mesh.faces[rng.permutation(len(mesh.faces))]]
    turned = rng.random(len(corners)) < 0.5
    corners[turned] = corners[turned][:, ::-1]
    return Mesh.from_arrays(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def _doubled(mesh: Mesh) -> Mesh:
    return Mesh.from_arrays(mesh.vertices, np.concatenate([mesh.faces, mesh.faces[:, ::-1]]))


def _filled(mesh: Mesh) -> Mesh:
    inner = trimesh.creation.box((0.02, 0.02, 0.06))
    faces = np.concatenate([mesh.faces, np.asarray(inner.faces) + len(mesh.vertices)])
    return Mesh.from_arrays(np.concatenate([mesh.vertices, np.asarray(inner.vertices)]), faces)


def box_link() -> Mesh:
    corners = 0.03 * np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]])
    vertices = np.array([(x, y, z) for z in (-0.05, 0.05) for x, y in corners])
    sides = [(i, (i + 1) % 4) for i in range(4)]
    return Mesh.from_arrays(vertices, [f for i, j in sides for f in ((i, j, 4 + j), (i, 4 + j, 4 + i))])


def holed(mesh: Mesh, radius: float) -> Mesh:
    """Without the facets within `radius` [m] of a point that lies under the sheet."""
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    hole = wristlike(np.array(0.0), np.array(1.4))
    return Mesh.from_arrays(mesh.vertices, mesh.faces[np.linalg.norm(middle - hole, axis=1) > radius])


def _tried(mesh: Mesh, sheet: Sheet, origin, heading) -> tuple[str, bool]:
    try:
        found = map_skin(mesh, sheet, origin=origin, heading=heading)
    except PalpateError as reason:
        return f"refused: {reason}", True
    return f"mapped, strain {100 * found.strain[0]:.2f} % rms; {'; '.join(found.notes)}", True


def _seam(mesh: Mesh) -> Row:
    """Lengths between neighbours, wherever round the link the sheet begins."""
    worst = 0.0
    for angle in np.linspace(-np.pi, np.pi, 12, endpoint=False) + 0.01:
        point, ahead = wristlike(np.array(-0.02), np.array(angle)), wristlike(np.array(-0.02), np.array(angle + 1e-5))
        found = map_skin(mesh, Sheet(4, 22, (0.01, 0.01)), origin=point, heading=ahead - point)
        step = np.linalg.norm(np.diff(found.centres, axis=1), axis=-1)
        worst = max(worst, 1e3 * float(np.abs(step - 0.01).max()))
    got = f"neighbours' distance differs from 10 mm by {worst:.2f} mm at most (chords of arcs, and strain)"
    return Row("a closed wrist, the seam anywhere: 12 origins round it, 4 x 22 cells", "<= 0.5 mm", got, worst <= 0.5)


def _bad_input(small: bool, mesh: Mesh) -> Iterator[Row]:
    good = {"--unit": "mm", "--sheet": "4x10", "--cell": "10", "--origin": _text(1e3 * START), "--heading": "0,1,0"}
    bad = {
        "a sheet far larger than the link": {"--sheet": "40x60"},
        "an origin off the surface": {"--origin": "0,0,200"},
        "planes that miss the mesh": {"--heights": "500,600"},
        "a heading along the normal": {"--heading": _text(mesh.project(START[None])[1][0])},
        "an origin that is no number": {"--origin": "a,b,c"},
        "NaN": {"--origin": "nan,0,0"},
        "a wrong unit": {"--unit": "m"},
        "no cells": {"--sheet": "0x10"},
        "a negative cell": {"--cell": "-10"},
        "an unknown suffix": {"-o": "map.xyz"},
    }
    with TemporaryDirectory() as scratch:
        file = Path(scratch) / "wrist.stl"
        trimesh.Trimesh(1e3 * mesh.vertices, mesh.faces, process=False).export(file)
        said = []
        for what, change in list(bad.items())[: 2 if small else None]:
            options = {**good, "-o": "map.toml", **change}
            out = Path(scratch) / options.pop("-o")
            done = cli("map", "skin", file, *(f"{key}={value}" for key, value in options.items()), "-o", out)
            sentence = done.stderr.strip().replace(f"{scratch}/", "")
            fine = done.returncode not in (0, None) and "Traceback" not in done.stderr and sentence.count("\n") == 0
            said.append((fine, f"{what}: {sentence}"))
    got = "; ".join(text for _, text in said)
    what = f"bad input for maps, {len(said)} kinds: a sentence, exit code not 0, no traceback"
    yield Row(what, "all", got, all(fine for fine, _ in said))


def _text(values: np.ndarray) -> str:
    return ",".join(f"{value:.4f}" for value in values)
