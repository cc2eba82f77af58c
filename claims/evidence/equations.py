"""Surfaces with an equation: contacts found, and a mesh's way to them."""

from collections.abc import Callable, Iterator

import numpy as np

import palpate
from claims.evidence.bodies import R, touched
from claims.row import Row
from palpate.spatial.pose import Pose
from palpate.surfaces import Cylinder, Ellipsoid, EllipticCylinder, Paraboloid, Sphere, superquadric
from palpate.surfaces.analytic import Analytic
from palpate_lab.simulation import touch_wrenches
from palpate_lab.simulation.shapes import EllipsoidBody as Truth

AXES = (R, 0.7 * R, 0.5 * R)
POSE = Pose.from_rotation_vector((0.7, -0.4, 1.1), (0.004, -0.003, 0.03))
SURFACES: dict[str, Callable[[], Analytic]] = {  # made when asked for: a superquadric is compiled
    "sphere": lambda: Sphere(R, pose=POSE),
    "ellipsoid": lambda: Ellipsoid(AXES, pose=POSE),
    "cylinder": lambda: Cylinder(0.7 * R, R, pose=POSE),
    "elliptic cylinder": lambda: EllipticCylinder(0.014, 0.005, 0.016, upper=True, pose=POSE),
    "paraboloid": lambda: Paraboloid((R, 2 * R), 0.8 * R, pose=POSE),
    "superquadric": lambda: superquadric(AXES, (0.9, 0.8), pose=POSE),
}


def rows(small: bool) -> Iterator[Row]:
    """Every surface, and the order of convergence of meshes, which tests/laws has instead of small."""
    count = 200 if small else 20_000
    for name, make in SURFACES.items():
        yield _found(name, make(), count)
    if not small:
        yield _order(2_000)


def _found(name: str, surface: Analytic, count: int) -> Row:
    """Wrenches made at points of its own chart, with normals from differences of its value."""
    rng = np.random.default_rng(3)
    chart = surface.pose.apply(surface.chart(200)[0])
    points = chart[rng.integers(len(chart), size=count)]
    step = 1e-6 * R
    slope = [(surface.value(points + step * e) - surface.value(points - step * e)) / (2 * step) for e in np.eye(3)]
    normals = np.stack(slope, axis=-1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    wrenches = touch_wrenches(points, normals, rng, tan_theta=1.0, pitch=R)
    answer = palpate.Locator(surface, friction=1.5, torsion=np.inf).run(wrenches, sequential=False)
    error = np.linalg.norm(answer.point - points, axis=1)
    missed = int((~answer.answered).sum())
    worst = np.nanmax(error)
    what = f"{name}: wrenches at pitches up to R, tan(theta) up to 1, located where they were made"
    got = f"{count - missed} of {count:,} answered, {worst / R:.1e} R off at most"  # by the normals, not by Newton
    return Row(what, "all, within 1e-6 R", got, missed == 0 and worst < 1e-6 * R)


def orders(count: int) -> tuple[np.ndarray, list[float]]:
    """Orders of convergence in the edge on meshes of 500 to 32,000 facets, and the rms errors [m]."""
    rng = np.random.default_rng(4)
    truth, surface = Truth(AXES), Ellipsoid(AXES)
    points, wrenches = touched(truth, count, rng, pitch=0.3 * R)
    errors = []
    for facets in (500, 2_000, 8_000, 32_000):
        answer = palpate.Locator(surface.mesh(facets), torsion=np.inf).run(wrenches, sequential=False)
        errors.append(float(np.sqrt(np.nanmean(np.sum((answer.point - points) ** 2, axis=1)))))
    return np.log2(np.divide(errors[:-1], errors[1:])), errors  # the edge halves from one to the next


def _order(count: int) -> Row:
    found, errors = orders(count)
    sizes = ", ".join(f"{1e6 * error:.2f} um" for error in errors)
    what = "soft finger on meshes of the ellipsoid, 500 to 32,000 facets: order of convergence in the edge"
    got = f"{', '.join(f'{order:.2f}' for order in found)} ({sizes})"
    return Row(what, "2", got, np.all(np.abs(found - 2.0) < 0.25))
