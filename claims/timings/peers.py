"""Other estimators of a contact beside ours, on the same wrenches.

Each is made for a surface and answers one wrench at a time with a point; NaN where it has none. Truth is the point that
the wrench was made at, on the exact surface.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import least_squares

import palpate
from claims.clock import by_blocks
from claims.evidence.bodies import touched
from claims.page import table
from claims.timings.measure import short
from claims.timings.rivals import embree_scene
from palpate.surfaces import Ellipsoid as EllipsoidEquation
from palpate.surfaces import plane
from palpate_lab.papers.iterative import locate_iteratively
from palpate_lab.peers.wrench_peers import Answer, nearest_vertex
from palpate_lab.simulation import EllipsoidBody, touch_wrenches

R = 0.010  # m
AXES = (R, 0.7 * R, 0.5 * R)
PITCHES = (0.0, 0.1, 0.3, 1.0)  # of R
HEIGHT = 0.02  # m of the plane over the sensor
FACETS = 20_000
BLOCK = 100
NOWHERE = np.full(3, np.nan)
EQUATION, ITERATIVE = "Palpate, soft_finger on the equation", "Palpate, iterative on the equation"
WRITTEN_OUT = "scipy LM written out, analytic Jacobian"


@dataclass(frozen=True, eq=False)
class Scene:
    """Touches of one surface: a mesh, its equation where there is one, and wrenches made at known points."""

    name: str
    mesh: palpate.Mesh
    equation: EllipsoidEquation | None
    points: np.ndarray
    wrenches: np.ndarray


@dataclass(frozen=True, eq=False)
class Measured:
    """Of one estimator on one scene: errors (n,) [m], NaN without an answer, and times (n,) [us]."""

    errors: np.ndarray
    times: np.ndarray


def scenes(count: int) -> list[Scene]:
    """A plane over the sensor, touched with pitch, and an ellipsoid with pitches up to its size."""
    rng = np.random.default_rng(3)
    level = np.array([0.0, 0.0, 1.0])
    points = np.column_stack([rng.uniform(-0.03, 0.03, (count, 2)), np.full(count, HEIGHT)])
    pressed = touch_wrenches(points, np.broadcast_to(level, points.shape), rng, pitch=0.3 * R)
    made = [Scene("plane, h to 0.3 R", plane((0.0, 0.0, HEIGHT), level, 0.1), None, points, pressed)]
    body = EllipsoidBody(AXES)
    mesh, equation = palpate.Mesh.from_arrays(*body.mesh(FACETS)), EllipsoidEquation(AXES)
    for pitch in PITCHES:
        points, wrenches = touched(body, count, rng, pitch=pitch * R)
        name = f"ellipsoid, h to {pitch:g} R" if pitch else "ellipsoid, h = 0"
        made.append(Scene(name, mesh, equation, points, wrenches))
    return made


def answers(scene: Scene) -> dict[str, Answer]:
    """Every estimator that is installed and can take this surface."""
    made: dict[str, Answer | None] = {
        "Palpate, soft_finger": located(palpate.Locator(scene.mesh, torsion=3 * R)),
        "Palpate, wrench_axis": located(palpate.Locator(scene.mesh, "wrench_axis", torsion=3 * R)),
        "bota-tactile-sensing-utils, one plane": bota_plane(HEIGHT) if scene.equation is None else None,
        "first hit of the line of action, embreex": _first_hit(scene.mesh),
    }
    if scene.equation is not None:
        made["nearest vertex by torque residual"] = nearest_vertex(scene.mesh)
        made[EQUATION] = located(palpate.Locator(scene.equation, torsion=3 * R))
        made[ITERATIVE] = _iterated(scene.equation)
        made[WRITTEN_OUT] = _levenberg_marquardt(scene.equation.axes, analytic=True)
        made["scipy LM written out, numeric Jacobian"] = _levenberg_marquardt(scene.equation.axes, analytic=False)
    return {name: answer for name, answer in made.items() if answer is not None}


def located(locator: palpate.Locator) -> Answer:
    """Return a locator's point of a wrench, with what it takes to write the whole answer into an array."""
    out = locator.empty()

    def answer(wrench: np.ndarray) -> np.ndarray:
        locator(wrench, out)
        return out[:3]

    return answer


def bota_plane(height: float) -> Answer | None:
    """A sensor maker's contact point, on the plane z = height [m]; None where the package is not installed."""
    try:
        from bota_tactile_sensing_utils import BotaContactPoint, BotaContactPointConfig
    except ImportError:
        return None
    config = BotaContactPointConfig()
    config.geometry.dz = height
    config.force_threshold = 1e-6
    contact = BotaContactPoint(config)
    out = np.zeros(3)

    def answer(wrench: np.ndarray) -> np.ndarray:
        contact.update(wrench, out)
        return out if contact.in_contact() else NOWHERE

    return answer


def _first_hit(mesh: palpate.Mesh) -> Answer | None:
    """Where the wrench axis first meets a facet; in millimetres and float32, as embree has it."""
    cast = embree_scene(mesh, output=True)
    if cast is None:
        return None
    middle, size = mesh.centre, mesh.size

    def answer(wrench: np.ndarray) -> np.ndarray:
        force, moment = wrench[:3], wrench[3:]
        along = force / np.sqrt(force @ force)
        foot = np.array(_cross(force, moment)) / (force @ force)
        origin = foot + along * (along @ (middle - foot) - size)
        ray = cast(np.float32(1e3 * origin[None]), np.float32(along[None]))
        return origin + 1e-3 * float(ray["tfar"][0]) * along if ray["primID"][0] >= 0 else NOWHERE

    return answer


def _iterated(equation: EllipsoidEquation) -> Answer:
    solve = partial(locate_iteratively, surface=equation, torsion=3 * R)

    def answer(wrench: np.ndarray) -> np.ndarray:
        found = solve(wrench)
        return found.point if found.status == palpate.Status.CONTACT else NOWHERE

    return answer


def _levenberg_marquardt(axes: tuple[float, float, float], analytic: bool) -> Answer:
    """As a paper's author would write it for one ellipsoid: four equations, as few operations as they take.

    Started from where the wrench axis goes in, or is nearest; scipy's own tolerances. Lengths in R, forces in |F|.
    """
    squares = (np.array(axes) / R) ** -2.0
    a, b, c = squares

    def residuals(x: np.ndarray, f: np.ndarray, m: np.ndarray) -> np.ndarray:
        (px, py, pz, k), (fx, fy, fz), (mx, my, mz) = x, f, m
        return np.array(
            [
                mx - (py * fz - pz * fy) + 2 * k * a * px,
                my - (pz * fx - px * fz) + 2 * k * b * py,
                mz - (px * fy - py * fx) + 2 * k * c * pz,
                a * px * px + b * py * py + c * pz * pz - 1.0,
            ]
        )

    def derivative(x: np.ndarray, f: np.ndarray, _m: np.ndarray) -> np.ndarray:
        (px, py, pz, k), (fx, fy, fz) = x, f
        return 2.0 * np.array(
            [
                [k * a, -fz / 2, fy / 2, a * px],
                [fz / 2, k * b, -fx / 2, b * py],
                [-fy / 2, fx / 2, k * c, c * pz],
                [a * px, b * py, c * pz, 0.0],
            ]
        )

    jac = derivative if analytic else "2-point"

    def answer(wrench: np.ndarray) -> np.ndarray:
        size = np.sqrt(wrench[:3] @ wrench[:3])
        f, m = wrench[:3] / size, wrench[3:] / (size * R)
        foot = np.array(_cross(f, m))
        square, linear, rest = (squares * f) @ f, (squares * f) @ foot, (squares * foot) @ foot - 1.0
        start = foot - (linear + np.sqrt(max(linear * linear - square * rest, 0.0))) / square * f
        found = least_squares(residuals, np.array([*start, 0.0]), jac, method="lm", args=(f, m))
        point, pressed = found.x[:3], (squares * found.x[:3]) @ f < 0
        return R * point if pressed and found.cost < 1e-12 else NOWHERE

    return answer


def _cross(a: np.ndarray, b: np.ndarray) -> tuple[float, float, float]:
    """Of two short vectors: np.cross takes ten times as long."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


def measure(scene: Scene) -> dict[str, Measured]:
    """Every estimator, a hundred wrenches each in turn, so that a busy moment of the machine falls on all alike."""
    asked, count = answers(scene), len(scene.wrenches)
    points = {name: np.empty((count, 3)) for name in asked}

    def into(name: str) -> Callable[[int], None]:
        return lambda i: points[name].__setitem__(i, asked[name](scene.wrenches[i]))

    times = by_blocks({name: into(name) for name in asked}, count, BLOCK)
    return {name: Measured(np.linalg.norm(points[name] - scene.points, axis=1), times[name]) for name in asked}


def parts(count: int) -> dict[str, object]:
    """Return what stands in the section of RESULTS.md, by its place there."""
    made = scenes(count)
    found = {scene.name: measure(scene) for scene in made}
    names = dict.fromkeys(name for each in found.values() for name in each)
    curved = [found[scene.name] for scene in made[1:]]
    took = {name: _median(curved if name in curved[0] else [found[made[0].name]], name) for name in names}
    lines = [[name, *(_cell(each.get(name)) for each in found.values()), short(took[name])] for name in names]
    return {
        "wrenches": count * len(PITCHES),
        "facets": FACETS,
        "iterative": took[ITERATIVE] / took[EQUATION],
        "written_out": took[WRITTEN_OUT] / took[EQUATION],
        "peers": table(("", *found, "time [us]"), lines, "---:"),
    }


def _median(scenes: list[dict[str, Measured]], name: str) -> float:
    """Return the median time of all calls [us]."""
    return float(np.median(np.concatenate([found[name].times for found in scenes])))


def _cell(measured: Measured | None) -> str:
    if measured is None:
        return ""
    errors = 1e6 * measured.errors
    missing = int(np.sum(np.isnan(errors)))
    said = f"{short(float(np.nanmedian(errors)))} ({short(float(np.nanpercentile(errors, 99)))})"
    return f"{said}, {missing} none" if missing else said
