"""Laws: what the answer may not depend on, and where it may jump."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

import palpate
from claims.evidence.bodies import BODIES, BUMPIER, R, mesh_of, path, touched
from claims.row import Row
from palpate_lab.simulation import Body, contact_wrenches

NOISE = np.array([0.02] * 3 + [5e-4] * 3)  # N, N m


@dataclass(frozen=True)
class Unchanged:
    """How far contacts are from what they were.

    Attributes:
        gap: of any candidate or answer [m]; lost: wrenches with candidates of another number; sets: candidates held
            against each other.
        normal: of any answer; covariance: of any answer, as a share of the largest; status: answers with another.
    """

    gap: float
    lost: int
    sets: int
    normal: float
    covariance: float
    status: int


def rows(small: bool) -> Iterator[Row]:
    """Order, rigid motion, continuity, and the jump at a crease."""
    count = 40 if small else 1_000
    yield from _invariance(count)
    yield from _no_jump(2_000 if small else 50_000)
    yield from _crease(100 if small else 2_000)


def _bodies() -> dict[str, tuple[Body, bool]]:
    named = {**{name.split(" ")[0]: (body, True) for name, body in BODIES.items()}, "bumpier": (BUMPIER, True)}
    return {**named, "ellipsoid, faceted": (BODIES["ellipsoid 1 : 0.7 : 0.5"], False)}


def _invariance(count: int) -> Iterator[Row]:
    for what, change in (("any order of facets and vertices", shuffled), ("any rigid motion (within 0.5 m)", moved)):
        worst, lost, sets = [], 0, 0
        for name, (body, smooth) in _bodies().items():
            rng = np.random.default_rng(11)
            mesh = mesh_of(body, 2_000, smooth)
            wrenches = touched(body, count, rng, pitch=R)[1]
            found = unchanged(mesh, wrenches, *change(mesh, wrenches, rng))
            worst.append((name, found.gap / mesh.size))
            lost, sets = lost + found.lost, sets + found.sets
        size = max(gap for _, gap in worst)
        got = f"{size:.1e} of the body at most over {sets:,} candidates of {count * len(worst):,} wrenches"
        got += "; candidates of another number: " + str(lost)
        got += " (" + ", ".join(f"{name} {gap:.0e}" for name, gap in worst) + ")"
        title = f"same answer and candidates (as a set, pitch to R, any angle): {what}"
        yield Row(title, "1e-9 of the body", got, size <= 1e-9 and lost == 0)


def unchanged(
    mesh: palpate.Mesh, wrenches: np.ndarray, other: palpate.Mesh, turned: np.ndarray, back: palpate.Pose
) -> Unchanged:
    """Hold the contacts of wrenches on a mesh against those of others on another, which `back` brings back."""
    before, after = (palpate.Locator(m, torsion=np.inf, noise=NOISE) for m in (mesh, other))
    gaps, lost, sets = [0.0], 0, 0
    for first, second in zip(wrenches, turned, strict=True):
        a, b = before.candidates(first), after.candidates(second)
        gap = _as_sets(a.point, back.apply(b.point))
        lost += not np.isfinite(gap)
        gaps.append(gap)
        sets += len(a.point)
    matrix, covariance = back.inverse().wrench_matrix(), np.diag(NOISE**2)
    one = before.run(wrenches, sequential=False)
    two = after.run(turned, matrix @ covariance @ matrix.T, sequential=False)
    gaps.append(float(np.abs(one.point - back.apply(two.point)).max()))
    spread = np.abs(back.rotation @ two.covariance @ back.rotation.T - one.covariance).max()
    gap, turned_by = (
        np.max([gap for gap in gaps if np.isfinite(gap)]),
        np.abs(one.normal - back.rotate(two.normal)).max(),
    )
    share, others = spread / np.abs(one.covariance).max(), np.count_nonzero(one.status != two.status)
    return Unchanged(float(gap), lost, sets, float(turned_by), float(share), int(others))


def _as_sets(a: np.ndarray, b: np.ndarray) -> float:
    """Largest distance from any point of either set to the other; inf where they differ in number."""
    if len(a) != len(b):
        return np.inf
    apart = np.linalg.norm(a[:, None] - b[None], axis=2)
    return float(max(apart.min(axis=0).max(), apart.min(axis=1).max())) if len(a) else 0.0


def shuffled(
    mesh: palpate.Mesh, wrenches: np.ndarray, rng: np.random.Generator
) -> tuple[palpate.Mesh, np.ndarray, palpate.Pose]:
    """Facets in another order, each begun at another corner, vertices renumbered."""
    number = rng.permutation(len(mesh.vertices))
    vertices = np.empty_like(mesh.vertices)
    vertices[number] = mesh.vertices
    faces = number[mesh.faces][rng.permutation(len(mesh.faces))]
    begin = rng.integers(0, 3, len(faces))[:, None]
    faces = np.take_along_axis(faces, (np.arange(3) + begin) % 3, axis=1)
    return palpate.Mesh.from_arrays(vertices, faces, crease=mesh.crease), wrenches, palpate.Pose.identity()


def moved(
    mesh: palpate.Mesh, wrenches: np.ndarray, rng: np.random.Generator
) -> tuple[palpate.Mesh, np.ndarray, palpate.Pose]:
    """Another place and attitude; the normals are made anew there."""
    pose = palpate.Pose(Rotation.random(random_state=5).as_matrix(), rng.uniform(-0.5, 0.5, 3))
    vertices = mesh.vertices @ pose.rotation.T + pose.translation
    force, moment = wrenches[:, :3] @ pose.rotation.T, wrenches[:, 3:] @ pose.rotation.T
    turned = np.concatenate([force, moment + np.cross(pose.translation, force)], axis=1)
    return palpate.Mesh.from_arrays(vertices, mesh.faces, crease=mesh.crease), turned, pose.inverse()


def _no_jump(count: int) -> Iterator[Row]:
    """The finger slides in ever smaller steps: where nothing jumps, the answer's steps shrink alike."""
    steps = (10e-6, 1e-6, 0.1e-6)
    for name, body in {**BODIES, "bumpier sphere (0.4)": BUMPIER}.items():
        mesh = mesh_of(body, 20_000)
        ratios = [largest_steps(body, mesh, count, step) for step in steps]
        got = ", ".join(f"{ratio:.2f} at {step * 1e6:g} um" for ratio, step in zip(ratios, steps, strict=True))
        what = f"no jump as the wrench slides, {name}, h/R <= 0.3: largest step of the answer over the finger's"
        yield Row(what, "<= 2 at any step", got, None if "bumpier" in name else max(ratios) <= 2)


def largest_steps(body: Body, mesh: palpate.Mesh, count: int, step: float, pitch: float = 0.3 * R) -> float:
    """The answer's largest step over the finger's, which slides in steps of about `step` [m]."""
    points, wrenches = path(body, count, step, pitch)
    locator = palpate.Locator(mesh)
    locator.reset(points[0])
    answer = locator.run(wrenches).point
    went, ought = (np.linalg.norm(np.diff(p, axis=0), axis=1).max() for p in (answer, points))
    return float(went / ought)


@dataclass(frozen=True)
class Ridges:
    """What was seen at ridges.

    Attributes:
        jump: (n,) how far the jump's length is from the derivation's [m]; along: the same seen along the force.
        between: (n,) whether the points between are equally valid edge contacts.
    """

    jump: np.ndarray
    along: np.ndarray
    between: np.ndarray


def ridges(count: int) -> Ridges:
    """Ridges of any angle: the same wrench, moved by a nanometre to either side of the edge.

    A facet takes what lies within 1e-8 of its size outside it (rounding at shared edges), so less does not tell.
    """
    rng = np.random.default_rng(17)
    jump, seen, valid = [], [], []
    for _ in range(count):
        half = rng.uniform(0.2, 1.2)  # half the angle between the normals
        mesh, first, second = _ridge(half)
        locator = palpate.Locator(mesh, friction=2.3, torsion=np.inf)
        aim = first * rng.uniform(0.2, 1) + second * rng.uniform(0.2, 1)
        aim += rng.uniform(-0.3, 0.3) * np.array([0.0, 1.0, 0.0])
        f = -aim / np.linalg.norm(aim)
        if max(f @ first, f @ second) > -0.4:
            continue
        h, force = rng.uniform(-5e-3, 5e-3), rng.uniform(1.0, 10.0) * f
        edge = np.array([0.0, rng.uniform(-0.01, 0.01), 0.0])
        made = contact_wrenches(edge, first, force, np.array(h * np.linalg.norm(force) / (f @ first)))
        sides = []
        for side in (first, second):
            shift = np.array([1e-9 * np.sign(side[0]), 0.0, 0.0])
            moved = made + np.concatenate([np.zeros(3), np.cross(shift, force)])
            locator.reset(edge)
            sides.append(locator.run(moved[None], sequential=False).point[0])
        apart = sides[1] - sides[0]
        across = np.linalg.norm(apart - f * (f @ apart))
        exact = abs(h) * np.linalg.norm(np.cross(first, second)) / ((f @ first) * (f @ second))
        shifts = [np.cross(f, n) / (f @ n) for n in (first, second)]
        jump.append(abs(np.linalg.norm(apart) - exact))
        seen.append(abs(across - abs(h) * np.linalg.norm(shifts[0] - shifts[1])))
        valid.append(_between(made, sides, first, second))
    return Ridges(np.array(jump), np.array(seen), np.array(valid))


def _crease(count: int) -> Iterator[Row]:
    found = ridges(count)
    size, target = 0.1, "1e-7 of the body"
    exact_text = "|h| |N1 x N2|/((f . N1)(f . N2))"
    got = f"off by {found.jump.max():.1e} m at most, {len(found.jump)} ridges"
    yield Row(f"jump across a crease is {exact_text}", target, got, found.jump.max() <= 1e-7 * size)
    got = f"off by {found.along.max():.1e} m at most"
    what = "the same seen along the force is |h| |f x N1/(f . N1) - f x N2/(f . N2)|"
    yield Row(what, target, got, found.along.max() <= 1e-7 * size)
    got = f"{np.mean(found.between):.1%} of the points between, with a normal between N1 and N2"
    yield Row("points between the two are equally valid edge contacts", "all", got, bool(np.all(found.between)))


def _ridge(half: float) -> tuple[palpate.Mesh, np.ndarray, np.ndarray]:
    """A long prism whose ridge runs along y at the origin, and the normals on its two sides."""
    first, second = np.array([-np.sin(half), 0, np.cos(half)]), np.array([np.sin(half), 0, np.cos(half)])
    width, depth = 0.02 * np.cos(half), 0.02 * np.sin(half)
    section = [(0.0, 0.0), (-width, -depth), (width, -depth)]
    vertices = np.array([(x, y, z) for y in (-0.05, 0.05) for x, z in section])
    faces = [[0, 1, 4], [0, 4, 3], [0, 3, 5], [0, 5, 2], [1, 2, 5], [1, 5, 4], [0, 2, 1], [3, 4, 5]]
    return palpate.Mesh.from_arrays(vertices, faces, crease=0.05), first, second


def _between(wrench: np.ndarray, sides: list[np.ndarray], first: np.ndarray, second: np.ndarray) -> bool:
    """Is what is left of the torque at points between along a normal between, so that a soft finger makes it?"""
    for share in (0.25, 0.5, 0.75):
        point = (1 - share) * sides[0] + share * sides[1]
        left = wrench[3:] - np.cross(point, wrench[:3])
        weights, _, _, _ = np.linalg.lstsq(np.stack([first, second], axis=1), left, rcond=None)
        rest = left - weights[0] * first - weights[1] * second
        if np.linalg.norm(rest) > 1e-8 * np.linalg.norm(wrench[:3]) or weights[0] * weights[1] < 0:
            return False
    return True
