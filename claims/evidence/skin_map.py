"""Where cells sit: the fit to the paper's own wrist, lengths where the unrolled sheet is known, strain, hard meshes."""

from collections.abc import Callable, Iterator

import numpy as np

from claims.clock import timed
from claims.evidence.skin_general import general
from claims.evidence.skin_hard import hard_rows
from claims.evidence.skin_shapes import Cone, Elliptic, Sphere, Torus, round_mesh, wristlike
from claims.row import Row, shared, skipped
from palpate.sensors.taxels.skin_map import Sheet, map_skin
from palpate.sensors.taxels.skin_map.layout import lay
from palpate.sensors.taxels.skin_map.model import SkinMap
from palpate.sensors.taxels.skin_map.paper import paper_surface
from palpate.sensors.taxels.skin_map.sections import cut
from palpate.sensors.taxels.skin_map.sheet import placed
from palpate.sensors.taxels.skin_map.shell import Site, full_sections, shell
from palpate.spatial.pose import Pose
from palpate.surfaces import Mesh
from palpate.surfaces.bspline import BSplineSurface

SHEET = Sheet(6, 22, (0.01, 0.01))
ORIGIN, HEADING = np.array([-0.0366, 0.02923, -0.20067]), np.array([0.1, -0.959, -0.265])
LINK = Pose(np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), np.zeros(3))  # undoes the file's Y_UP, as RViz does
DEVELOPABLE = {
    "cylinder": Cone(0.035, 0.0),
    "elliptic cylinder 37 x 32": Elliptic(0.037, 0.032),
    "cone 1.67 deg": Cone(0.035, 1.67),
    "cone 10 deg": Cone(0.035, 10.0),
}


def rows(small: bool) -> Iterator[Row]:
    """Table 2, facets or vertices, time, lengths, strain, harder shapes and bad input."""
    link = wrist()
    if link is None:
        yield from skipped("table 2 and the time, on the paper's own wrist", "")
    else:
        yield from _table_2(link, small)
        yield from _time(link, small)
    yield from _modes()
    yield from _lengths(small)
    yield from _strain(link, small)
    yield from hard_rows(small, link)


def wrist() -> Mesh | None:
    """R_WRIST_Y of the paper's robot, in the link's frame; None where it is absent."""
    folder = shared()
    return None if folder is None else Mesh.load(folder / "data/hrp4c/R_WRIST_Y_LINK_mesh.dae").transformed(LINK)


def _table_2(link: Mesh, small: bool) -> Iterator[Row]:
    for name, target, values, took, limits in splines(link, small):
        mean, worst = values[:, 1].max(), values[:, 2].max()
        ways = zip(("to mesh", "from mesh"), values, strict=True)
        got = "; ".join(f"{way} {low:.3f}, {most:.3f}, {mid:.3f}" for way, (low, mid, most) in ways)
        passed = None if limits is None else mean <= limits[0] and worst <= limits[1]
        yield Row(f"table 2, min, max, mean in mm: {name}", target, f"{got}; {took:.1f} ms", passed)


def splines(link: Mesh, small: bool) -> Iterator[tuple[str, str, np.ndarray, float, tuple[float, float] | None]]:
    """For every way its name, its target, min, mean, max [mm] to and from the mesh, its time [ms] and its limits."""
    site = placed(link, SHEET, ORIGIN, HEADING)
    chart, span = full_sections(site)
    triangles = site.triangles
    given = Mesh.from_arrays(link.vertices, link.faces[site.facets], smooth=False)
    count, times = (30, 1) if small else (90, 5)
    u, v = np.linspace(*span, count + 1), np.linspace(-np.pi, np.pi, 4 * count, endpoint=False)
    offsets = cut(chart, triangles, u, v).offset
    starts, spokes = chart.lines(u[:, None], v[None, :])
    outside = (starts + offsets[..., None] * spokes).reshape(-1, 3)
    for reading in ("greville",) if small else ("literal", "greville"):
        for n in (10,) if small else (5, 10):
            for m in (10,) if small else (5, 10):

                def made(n: int = n, m: int = m, reading=reading) -> BSplineSurface:
                    return paper_surface(chart, triangles, span, n, m, reading)

                limits = (0.15, 0.60) if reading == "greville" and n == m == 10 else None
                target = "<= 0.15 mean, 0.60 worst" if limits else "the paper's 10, 10: 0.854 mean, 3.856 worst"
                name = f"the paper's way, {reading}, cubic, 2 m half planes, n = {n}, m = {m}"
                yield name, target, _both_ways(made(), given, outside, small), _best(made, times), limits

    def ours() -> BSplineSurface:
        return shell(site, SHEET.size, mode="facets").surface

    surface = ours()
    name = f"ours, along facets, {surface.points} control points"
    yield name, "<= 0.10 mean, 0.60 worst", _both_ways(surface, given, outside, small), _best(ours, times), (0.10, 0.60)


def _both_ways(surface: BSplineSurface, given: Mesh, outside: np.ndarray, small: bool) -> np.ndarray:
    """Min, mean, max [mm] of the spline's points from the mesh, and of the mesh's from the spline, finely meshed."""
    (u0, u1), (v0, v1) = surface.domain
    inner = np.stack(np.meshgrid(np.linspace(u0, u1, 61), np.linspace(v0, v1, 361), indexing="ij"), axis=-1)
    points, _ = surface.at(inner)
    flat = points.reshape(-1, 3)
    to_mesh = np.linalg.norm(flat - given.project(flat)[0], axis=1)
    fine = surface.mesh(60, 240) if small else surface.mesh(200, 800)
    from_mesh = np.linalg.norm(outside - fine.project(outside)[0], axis=1)
    return 1e3 * np.array([[d.min(), d.mean(), d.max()] for d in (to_mesh, from_mesh)])


def _best(made: Callable[[], object], times: int) -> float:
    """The shortest of several calls [ms]: what else runs on the machine only adds."""
    return 1e-3 * timed(lambda _: made(), times).min()


def _time(link: Mesh, small: bool) -> Iterator[Row]:
    site = placed(link, SHEET, ORIGIN, HEADING)
    times = 1 if small else 30
    for mode in ("facets", "vertices"):
        spline = _best(lambda mode=mode: shell(site, SHEET.size, mode=mode), times)
        whole = _best(lambda mode=mode: map_skin(link, SHEET, origin=ORIGIN, heading=HEADING, mode=mode), times)
        got = f"{spline:.1f} ms; {whole:.1f} ms with the layout and all else (best of {times}; the paper 344-766 ms)"
        passed = None if small else spline <= 15 and whole <= 100  # never judged where others may be running
        yield Row(f"time, {mode}, warm, from a loaded mesh", "spline <= 15 ms, all <= 100 ms", got, passed)


def _modes() -> Iterator[Row]:
    """A smooth wrist of which only 24 x 8 facets are given."""
    mesh = round_mesh(wristlike, 24, np.linspace(-0.04, 0.04, 9))
    for mode in ("facets", "vertices"):
        off, turned, _ = _against(mesh, mode)
        got = f"{off.mean():.4f} mm mean, {off.max():.4f} worst; {turned.mean():.3f} deg mean, {turned.max():.3f} worst"
        passed = bool(off.mean() <= 0.02 and turned.max() <= 0.2) if mode == "vertices" else None
        target = "<= 0.02 mm mean, 0.2 deg worst" if mode == "vertices" else "(copies the facets)"
        yield Row(f"smooth wrist-like truth tessellated 24 x 8, mode {mode}", target, got, passed)
    *_, note = _against(mesh, None)
    fine = _against(round_mesh(wristlike, 128, np.linspace(-0.04, 0.04, 65)), None)[2]
    got = f"24 x 8: {note}; 128 x 64: {fine}"
    yield Row("the mode chosen by the mesh", "vertices, facets", got, "vertices" in note and "facets" in fine)


def _against(mesh: Mesh, mode) -> tuple[np.ndarray, np.ndarray, str]:
    """Distances [mm] and angles [deg] of the spline from the smooth truth, over 60 of its 80 mm."""
    point = wristlike(np.array(-0.03), np.array(0.0))
    sides = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    found = shell(Site(mesh, np.arange(len(mesh.faces)), point, sides[1], sides[0]), (0.06, 0.22), mode=mode)
    rng = np.random.default_rng(0)
    z, angle = rng.uniform(-0.03, 0.03, 5000), rng.uniform(-np.pi, np.pi, 5000)
    truth, step = wristlike(z, angle), 1e-6
    by_z = wristlike(z + step, angle) - wristlike(z - step, angle)
    ought = np.cross(wristlike(z, angle + step) - wristlike(z, angle - step), by_z)
    ought /= np.linalg.norm(ought, axis=1, keepdims=True)
    uv = found.surface.nearest(truth, found.chart.coordinates(truth)[:, :2])
    points, normals = found.surface.at(uv)
    turned = np.degrees(np.arcsin(np.minimum(np.linalg.norm(np.cross(normals, ought), axis=1), 1.0)))
    return 1e3 * np.linalg.norm(points - truth, axis=1), turned, found.notes[0].split(":")[0] if found.notes else ""


def _lengths(small: bool) -> Iterator[Row]:
    headings = (0.0, 35.0, 160.0) if small else (0.0, 10.0, 35.0, 70.0, 90.0, 125.0, 160.0, 180.0, 250.0, 330.0)
    for name, shape in DEVELOPABLE.items():
        exact, worst = 0.0, 0.0
        for heading in headings:
            start, ahead, points, normals = unrolled(shape, heading)
            layout = lay(shape, start, ahead, Sheet(points.shape[0], points.shape[1], (0.01, 0.01)))
            place = shape.derivatives(layout.uv[1::2, 1::2])
            out = np.cross(place[..., 1, :], place[..., 2, :])
            exact = max(exact, 1e3 * float(np.linalg.norm(place[..., 0, :] - points, axis=-1).max()))
            worst = max(worst, _turned(out / np.linalg.norm(out, axis=-1, keepdims=True), normals))
        got = f"{exact:.6f} mm, {worst:.5f} deg at worst over {len(headings)} headings"
        what = f"unrolled exactly, {name}: every cell, on the exact surface"
        yield Row(what, "<= 0.005 mm, 0.02 deg", got, exact <= 0.005 and worst <= 0.02)
    for around, mode, rings, limits in ((24, "vertices", 11, (0.005, 0.02)), (96, "facets", 31, (0.05, 0.1))):
        for name, shape in DEVELOPABLE.items():
            mesh = round_mesh(shape.point, around, np.linspace(-0.15, 0.15, rings))
            off, turn = 0.0, 0.0
            for heading in headings:
                start, ahead, points, normals = unrolled(shape, heading)
                corner = shape.derivatives(start)[0]
                sheet = Sheet(6, points.shape[1], (0.01, 0.01))
                found = map_skin(mesh, sheet, origin=corner, heading=ahead, mode=mode)
                off = max(off, 1e3 * float(np.linalg.norm(found.centres - points, axis=-1).max()))
                turn = max(turn, _turned(found.normals, normals))
            got = f"{off:.4f} mm, {turn:.4f} deg at worst"
            what = f"unrolled, {name}, mesh of {around} facets round, mode {mode}: every cell"
            yield Row(what, f"<= {limits[0]} mm, {limits[1]} deg", got, off <= limits[0] and turn <= limits[1])


def unrolled(shape, degrees: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A start, a heading there, and where the cells of a flat sheet come to lie, with their normals, in closed form.

    22 columns round the shape, 11 where the heading runs along it.
    """
    u, v, step = (-0.03 if np.sin(np.radians(degrees)) >= -0.5 else 0.03), 0.3, 1e-7
    d = shape.derivatives(np.array([u, v]))
    up, west = (way / np.linalg.norm(way) for way in d[1:3])
    angle = np.radians(degrees)
    ahead = -np.cos(angle) * west + np.sin(angle) * up
    corner = shape.unroll(np.array(u), np.array(v))
    ways = (shape.unroll(*map(np.array, at)) - corner for at in ((u, v - step), (u + step, v)))
    x, y = (way / np.linalg.norm(way) for way in ways)
    columns = 22 if abs(np.sin(angle)) < 0.5 else 11
    row, column = np.meshgrid((np.arange(6) + 0.5) * 0.01, (np.arange(columns) + 0.5) * 0.01, indexing="ij")
    right, left = np.cos(angle) * x + np.sin(angle) * y, -np.sin(angle) * x + np.cos(angle) * y
    place = shape.derivatives(shape.roll(corner + column[..., None] * right + row[..., None] * left))
    out = np.cross(place[..., 1, :], place[..., 2, :])
    return np.array([u, v]), ahead, place[..., 0, :], out / np.linalg.norm(out, axis=-1, keepdims=True)


def _turned(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.degrees(np.arcsin(min(np.linalg.norm(np.cross(one, other), axis=-1).max(), 1.0))))


def _strain(link: Mesh | None, small: bool) -> Iterator[Row]:
    start, west = np.array([-0.02, 0.0]), np.array([0.0, -1.0, 0.0])
    cases = {
        "sphere, R = 100 mm, 6 x 12": (Sphere(0.1), start, west, (6, 12)),
        "torus patch, 80 + 60 mm, 6 x 12": (Torus(0.08, 0.06), start, west, (6, 12)),
    }
    if small:
        cases = {"sphere, R = 100 mm, 3 x 6": (Sphere(0.1), start, west, (3, 6))}
    elif link is not None:
        found = map_skin(link, SHEET, origin=ORIGIN, heading=HEADING)
        assert found.surface is not None
        begin = found.surface.nearest(ORIGIN[None], _first_uv(found))[0]
        cases["the real wrist, 6 x 22"] = (found.surface, begin, HEADING, (6, 22))
    for name, (surface, begin, heading, cells) in cases.items():
        size = 0.01 * cells[0], 0.01 * cells[1]
        sheet = Sheet(*cells, (0.01, 0.01))
        ours = lay(surface, begin, heading, sheet)
        same = general(surface, begin, heading, size, cells, 2, degree=3)
        got = f"{100 * ours.rms:.3f} % rms, {100 * ours.worst:.2f} % worst in {ours.rounds} rounds; {100 * same:.3f} %"
        what = f"least strain, {name}: rms against a general optimiser's over the same splines"
        yield Row(what, "within 2 %", got, abs(ours.rms / same - 1.0) <= 0.02)
        if small:
            continue
        energies = [general(surface, begin, heading, size, cells, per) ** 2 for per in (1, 2, 4)]
        limit = np.sqrt(energies[-1] - (energies[-2] - energies[-1]) / 3.0)  # the error falls with the step's square
        finer = [lay(surface, begin, heading, sheet, elements=len_) for len_ in (cells[1] // 2, cells[1], 128)]
        got = f"bilinear general {', '.join(f'{100 * np.sqrt(e):.3f}' for e in energies)} -> {100 * limit:.3f} %; "
        got += f"ours with 1/2, 1, 2 elements a cell {', '.join(f'{100 * f.rms:.3f}' for f in finer)} %, "
        got += f"worst {', '.join(f'{100 * f.worst:.1f}' for f in finer)} %"
        passed = abs(ours.rms / limit - 1.0) <= 0.02 if "wrist" not in name else None
        what = f"convergence, {name}: against the extrapolated limit of another discretisation"
        yield Row(what, "within 2 %" if passed is not None else "(shown)", got, passed)


def _first_uv(found: SkinMap) -> np.ndarray:
    """Near the corner: half a cell and more back from the first centres."""
    uv = found.uv
    return (uv[0, 0] - 0.5 * (uv[1, 0] - uv[0, 0]) - 0.5 * (uv[0, 1] - uv[0, 0]))[None]
