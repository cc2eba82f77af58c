"""Touches in and between fingers: gaps that are narrower than the ball which finds what can be reached.

Truth: points that a round tip of `TIP` can rest on, by the distance to points spread over the body, and from which a
random ray leaves it (embree); the wrenches are those of `touches`. A touch is what `palpate estimate` lists: a place,
its covariance, and whether most of its samples are ambiguous.
"""

from collections.abc import Iterator

import numpy as np
import trimesh
from scipy.spatial import cKDTree

import palpate
from claims.evidence.touches import FRICTION, LENGTH, NOISE, RATE, touch
from claims.row import Row
from palpate.contact import WrenchEstimator
from palpate.contact.touch_finder import find_touches
from palpate.signals import Recording
from palpate_lab.simulation import contact_wrenches

TIP, FINE = 3e-3, 5e-3  # m: radius of what touches; sides of facets
TORSION, PAUSE, FORCE = 5e-3, 60, 2.9  # m, samples without a touch, N of a single sample


def rows(small: bool) -> Iterator[Row]:
    for name, body in (("hand", hand()), ("gripper", gripper())):
        yield from _judge(name, body, 20 if small else 500)


def hand() -> trimesh.Trimesh:
    """Return four fingers of 10 x 18 x 70 mm on a palm, 19 mm apart."""
    fingers = [((0.010, 0.018, 0.072), (0.029 * (k - 1.5), 0.0, 0.034)) for k in range(4)]
    return _boxes(((0.103, 0.022, 0.080), (0.0, 0.0, -0.040)), *fingers)


def gripper() -> trimesh.Trimesh:
    """Return two fingers of 12 x 22 x 57 mm, 14 mm apart, with pads 10 mm apart, on a body of 75 mm."""
    sides = [((0.012, 0.022, 0.057), (0.013 * s, 0.0, 0.0265)) for s in (-1, 1)]
    pads = [((0.005, 0.025, 0.030), (0.0075 * s, 0.0, 0.042)) for s in (-1, 1)]
    return _boxes(((0.075, 0.075, 0.090), (0.0, 0.0, -0.045)), *sides, *pads)


def _boxes(*parts: tuple[tuple[float, ...], tuple[float, ...]]) -> trimesh.Trimesh:
    """Return boxes of these sides about these middles [m], fingers above z = 0."""
    placed = [trimesh.creation.box(sides, trimesh.transformations.translation_matrix(at)) for sides, at in parts]
    return trimesh.util.concatenate(placed).subdivide_to_size(FINE)


def _judge(name: str, body: trimesh.Trimesh, count: int) -> Iterator[Row]:
    rng, period = np.random.default_rng(23), LENGTH + PAUSE
    points, normals = _touchable(body, count, rng)
    locator = palpate.Locator(
        palpate.Mesh.from_trimesh(body, unit="m"), noise=NOISE, friction=FRICTION, torsion=TORSION
    )
    wrenches = NOISE * rng.standard_normal((count, period, 6))
    for one, point, normal in zip(wrenches, points, normals, strict=True):
        one[:LENGTH] = touch(point, normal, TORSION, rng)
    wrenches = wrenches.reshape(-1, 6)
    log = Recording(np.arange(len(wrenches)) / RATE, {"force": wrenches[:, :3], "torque": wrenches[:, 3:]})
    estimator = WrenchEstimator(locator, palpate.ForceTorque(NOISE), live=False)
    found = find_touches(palpate.Contacts.joined(list(estimator.stream([log]))))
    touched = (found.peak_time * RATE / period).astype(np.int64)
    error = np.linalg.norm(found.point - points[touched], axis=1)
    deviation = np.sqrt(np.trace(found.covariance, axis1=1, axis2=2))
    sure = found.ambiguous <= 0.5
    off = int(np.count_nonzero(sure & (error > 5 * deviation)))
    yield Row(f"{name}: touches found", f"{count}", f"{len(found)}", len(found) == count)
    yield Row(f"{name}: sure and more than 5 standard deviations off", "0", f"{off} of {count} touches", off == 0)
    yield Row(f"{name}: ambiguous", "<= 10 %", f"{np.mean(~sure):.1%}", np.mean(~sure) <= 0.1)
    middle = 1e3 * float(np.median(error))
    yield Row(f"{name}: median error", "<= 0.3 mm", f"{middle:.2f} mm", middle <= 0.3)
    away = np.linalg.norm(locator.surface.project(found.point)[0] - found.point, axis=1).max()
    yield Row(f"{name}: largest distance from the surface", "<= 0.05 mm", f"{1e3 * away:.4f} mm", away <= 5e-5)
    yield from _alone(name, locator, points, normals, rng)


def _alone(
    name: str, locator: palpate.Locator, points: np.ndarray, normals: np.ndarray, rng: np.random.Generator
) -> Iterator[Row]:
    """Yield the row of single samples, of forces along the normal."""
    clean = contact_wrenches(points, normals, -FORCE * normals, np.zeros(len(points)))
    found = locator.run(clean + NOISE * rng.standard_normal(clean.shape), sequential=False)
    deviation = np.sqrt(np.trace(found.covariance, axis1=1, axis2=2))
    sure = found.status == palpate.Status.CONTACT
    off = int(np.count_nonzero(sure & (np.linalg.norm(found.point - points, axis=1) > 5 * deviation)))
    got = f"{off} of {len(points)}; {np.mean(found.status == palpate.Status.AMBIGUOUS):.0%} ambiguous"
    yield Row(f"{name}: single samples of 2.9 N, `contact` and more than 5 standard deviations off", "", got)


def _touchable(body: trimesh.Trimesh, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return points on the fingers, uniform in area, and their normals."""
    dense = cKDTree(trimesh.sample.sample_surface_even(body, 100_000, seed=1)[0])
    points, facets = trimesh.sample.sample_surface(body, 40 * count, seed=2)
    points, normals = np.asarray(points), np.asarray(body.face_normals[facets])
    ends, ways = points + TIP * normals, rng.standard_normal(points.shape)
    ways *= np.sign(np.einsum("nk,nk->n", ways, normals))[:, None]
    scaled = trimesh.Trimesh(body.vertices * 1e3, body.faces, process=False)  # embree is blind to tenths of a mm in m
    free = (points[:, 2] > 0.0) & (dense.query(ends)[0] > 0.9 * TIP) & ~scaled.ray.intersects_any(1e3 * ends, ways)
    return points[free][:count], normals[free][:count]
