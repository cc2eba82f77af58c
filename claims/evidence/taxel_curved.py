"""Taxels anywhere on a strongly curved link, touched at several places at once, alone and fused with a wrench.

The link is a cylinder, which unrolls without strain. Its taxels lie under a soft layer: pressure is Hertz's on a disc,
and a taxel feels the mean vertical stress on its square in a half space (Boussinesq). The estimator fits Gaussians.

Fused with a wrench the squares leave no gaps, so that readings add up to the force: taxels that feel points 0.45
pitches deep give forces that are 33 % off, whatever the estimator.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from claims.evidence.taxel_limit import inside_ellipse
from claims.papers.fused_contacts.rows import FORCE
from claims.row import Row
from palpate.contact.contacts import Contacts
from palpate.sensors.fused.locator import FusedLocator, FusionSettings
from palpate.sensors.taxels.estimator import TaxelEstimator
from palpate.sensors.taxels.health import Health
from palpate.sensors.taxels.model import TaxelBody
from palpate.surfaces.mesh import Mesh
from palpate_lab.simulation.forearm import Cone
from palpate_lab.simulation.poke_bench import boussinesq

__all__ = ["rows"]

SEED = 900
RADII = (0.03, 0.045, 0.06)  # m, of links
PITCH, ROWS = 0.017, 11  # m between taxels, and their number along the link
APART = (1.5, 4.0)  # pitches from touch to touch
DEPTH, DISC = (0.3, 0.9), (0.1, 0.3)  # pitches: of taxels under the surface, and radius of a touch of 1 N
SIDE = (0.0, 1.0)  # pitches, of a taxel's square
UNEQUAL, NOISE = 0.1, 5e-3  # deviations of gains, and N of a reading
COMMON, OWN = 7e-4, 5e-4  # m along each axis: errors of poked places, of all taxels together and of each
NEWTONS, FRICTION = (2.0, 12.0), 0.5  # as of the fused contacts
WRENCH = np.repeat([0.04, 1.5e-3], 3)  # N, N m
FAR = 5.0  # deviations


@dataclass(frozen=True)
class _Link:
    """Unrolled places (k, 2) [m] of the taxels of a link, depth of its layer and their side [m], counts per pascal."""

    radius: float
    flat: np.ndarray
    pitch: float
    depth: float
    side: float
    scale: float = 1.0

    def at(self, flat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (n, 3) [m] and outward normals of unrolled places, along the link and around it; 150 mm from z = 0."""
        angle = flat[:, 1] / self.radius
        out = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
        return self.radius * out + np.outer(flat[:, 0] + 0.15, [0.0, 0.0, 1.0]), out

    def felt(self, flat: np.ndarray, newtons: np.ndarray, disc: np.ndarray) -> np.ndarray:
        """What the taxels read (k,) of touches at unrolled places (n, 2), with radii of 1 N [m]."""
        ring = np.sqrt((np.arange(5) + 0.5) / 5)[:, None]
        angle = np.pi * np.arange(10) / 5 + 2.4 * np.arange(5)[:, None]
        unit = np.stack([ring * np.cos(angle), ring * np.sin(angle)], axis=-1).reshape(-1, 2)
        load = np.broadcast_to(np.sqrt(1.0 - ring**2), angle.shape).ravel()
        spread = flat[:, None] + (disc * np.cbrt(newtons))[:, None, None] * unit
        within = self.side * ((np.arange(3) + 0.5) / 3 - 0.5)
        cells, turn = self.flat[:, None] + np.stack(np.meshgrid(within, within), axis=-1).reshape(-1, 2), self.turn
        away = cells.reshape(-1, 1, 1, 2) - spread
        away[..., 1] = (away[..., 1] + 0.5 * turn) % turn - 0.5 * turn
        stress = boussinesq((away**2).sum(axis=-1), self.depth) @ (load / load.sum())
        return self.scale * (stress @ newtons).reshape(len(self.flat), -1).mean(axis=1)

    @property
    def turn(self) -> float:
        """Way once around [m]."""
        return 2.0 * np.pi * self.radius


def _drawn(radius: float, rng: np.random.Generator, *, gaps: bool = True) -> _Link:
    """A link whose readings are newtons: their sum along a touch's normal is its force, on average over places."""
    around = round(2.0 * np.pi * radius / PITCH)
    pitch = 2.0 * np.pi * radius / around
    along, across = np.meshgrid(pitch * (np.arange(ROWS) - 0.5 * (ROWS - 1)), pitch * np.arange(around), indexing="ij")
    flat, depth = np.stack([along.ravel(), across.ravel()], axis=1), pitch * rng.uniform(*DEPTH)
    link = _Link(radius, flat, pitch, depth, pitch * (rng.uniform(*SIDE) if gaps else 1.0))
    places, normals = pitch * rng.uniform(-0.5, 0.5, (50, 2)), link.at(link.flat)[1]
    sums = np.array([link.felt(one[None], np.ones(1), np.full(1, DISC[0] * pitch)) @ normals for one in places])
    return replace(link, scale=1.0 / float(np.linalg.norm(sums, axis=1).mean()))


def _skin(link: _Link, rng: np.random.Generator, poked: bool) -> TaxelEstimator:
    """The estimator, with true places, or with those of pokes and their covariance."""
    points, normals = link.at(link.flat)
    flat, covariance = np.eye(3) - normals[:, :, None] * normals[:, None, :], None
    if poked:
        error = COMMON * rng.standard_normal(3) + OWN * rng.standard_normal(points.shape)
        points, covariance = points + np.einsum("kij,kj->ki", flat, error), (COMMON**2 + OWN**2) * flat
    none = np.zeros(len(points), dtype=bool)
    health = Health(np.zeros(len(points)), np.full(len(points), NOISE), none, none)
    return TaxelEstimator(TaxelBody.placed(points, normals, covariance=covariance), health=health)


def rows(small: bool) -> Iterator[Row]:
    """Yield rows of two touches at once, with true and poked places, and of fusion with a wrench."""
    for poked in (False, True):
        yield from _pairs(*((1, 8) if small else (24, 10)), poked=poked, small=small)
    for count in FORCE:
        yield from _fused(count, *((1, 6) if small else (30, 12)), small=small)


def _pairs(links: int, touches: int, *, poked: bool, small: bool) -> Iterator[Row]:
    """Contacts of pairs that were found as two, in deviations from the truth."""
    off, covariance, tried = list[np.ndarray](), list[np.ndarray](), 0
    for seed, radius in ((seed, radius) for seed in range(links) for radius in RADII):
        rng = np.random.default_rng([SEED, seed, round(1e3 * radius), poked])
        link = _drawn(radius, rng)
        skin = _skin(link, rng, poked)
        for k in range(touches):
            turn, way = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(*APART) * link.pitch
            one = np.array([rng.uniform(-1.0, 1.0), rng.uniform(0.0, 50.0)]) * link.pitch
            pair = np.stack([one, one + way * np.array([np.cos(turn), np.sin(turn)])])
            found, order = _found(skin, link, pair, rng.uniform(*NEWTONS, 2), rng, k)
            tried += 1
            if order is not None:
                off.append(found.point - link.at(pair)[0][order])
                covariance.append(found.covariance)
    away, spread = np.concatenate(off), np.concatenate(covariance)
    values, axes = np.linalg.eigh(spread)
    square = (np.einsum("kia,ki->ka", axes[:, :, 1:], away) ** 2 / values[:, 1:]).sum(axis=1)
    held, far = float(inside_ellipse(away, spread).mean()), int((square > FAR**2).sum())
    places = "poked" if poked else "true"
    what = f"two touches 1.5 to 4 pitches apart, R = 30, 45, 60 mm, {places} places"
    yield Row(f"{what}: beyond {FAR:g} deviations", "0", f"{far} of {len(away):,}", not far)
    got = f"{held:.1%} (rms {np.sqrt(0.5 * square.mean()):.2f} deviations along each axis; {_middle(away)})"
    yield Row("the same: truth in the 95 % ellipse", "93-97 %", got, None if small else 0.93 <= held <= 0.97)
    yield Row("the same: found as two", "", f"{len(off)} of {tried}")


def _middle(away: np.ndarray) -> str:
    off = 1e3 * np.linalg.norm(away, axis=1)
    return f"{np.median(off):.2f} mm median, {np.percentile(off, 95):.2f} mm 95 %"


def _found(
    skin: TaxelEstimator, link: _Link, flat: np.ndarray, newtons: np.ndarray, rng: np.random.Generator, k: int
) -> tuple[Contacts, np.ndarray | None]:
    """What is found in one frame, and the touch that each contact is; None if their number is another."""
    disc, gains = link.pitch * rng.uniform(*DISC, len(flat)), 1.0 + UNEQUAL * rng.standard_normal(len(link.flat))
    exact = link.felt(flat, newtons, disc)
    found = skin.update(100.0 * k, gains * exact + NOISE * rng.standard_normal(len(exact)))
    if len(found) != len(flat):
        return found, None
    apart = np.linalg.norm(found.point[:, None] - link.at(flat)[0], axis=2)
    return found, linear_sum_assignment(apart)[1]


def _fused(count: int, links: int, touches: int, *, small: bool) -> Iterator[Row]:
    """Forces of contacts that a skin and a wrench feel, where all are found; where not, an alarm is right."""
    locator = FusedLocator(Mesh.from_arrays(*Cone().mesh()), FusionSettings(friction=0.6, gain=UNEQUAL))
    errors, alarms, unseen = list[float](), list[bool](), list[bool]()
    for seed, radius in ((seed, radius) for seed in range(links) for radius in RADII):
        rng = np.random.default_rng([SEED, seed, round(1e3 * radius), count, 7])
        link = _drawn(radius, rng, gaps=False)
        skin = _skin(link, rng, poked=False)
        for k in range(touches):
            flat, newtons = _spaced(link, count, rng), rng.uniform(*NEWTONS, count)
            points, normals = link.at(flat)
            side = np.cross(normals, rng.standard_normal((count, 3)))
            side *= (FRICTION * np.sqrt(rng.uniform(size=count)) / np.linalg.norm(side, axis=1))[:, None]
            forces = newtons[:, None] * (side - normals)
            wrench = np.concatenate([forces.sum(axis=0), np.cross(points, forces).sum(axis=0)])
            found, order = _found(skin, link, flat, newtons, rng, k)
            pressing = np.maximum(-(found.force * found.normal).sum(axis=1), 0.0)
            places = (found.point, found.normal, pressing, np.zeros(len(found)), found.covariance)
            sensed = (wrench + WRENCH * rng.standard_normal(6))[None], np.diag(WRENCH**2)[None]
            fused = locator.fuse(*places, *sensed)
            (unseen if order is None else alarms).append(fused.alarm)
            if order is not None:
                errors += np.linalg.norm(fused.force - forces[order], axis=1).tolist()
    median, false = float(np.median(errors)), float(np.mean(alarms))
    what = f"{count} contacts at least 1.5 pitches apart, taxels fused with a wrench"
    met = None if small else median <= FORCE[count]
    yield Row(f"{what}: median error", f"<= {FORCE[count]} N", f"{median:.2f} N", met)
    met = None if small else 0.005 <= false <= 0.02
    yield Row("the same: false alarms, where all are found", "0.5-2 %", f"{false:.2%} of {len(alarms):,}", met)
    yield Row("the same: alarms where fewer or more are found", "", f"{sum(unseen)} of {len(unseen)}")


def _spaced(link: _Link, count: int, rng: np.random.Generator) -> np.ndarray:
    """Unrolled places with at least 1.5 pitches from each to each, and from the ends of the skin to all."""
    turn, reach = link.turn, 0.5 * (ROWS - 3) * link.pitch
    while True:
        flat = np.stack([rng.uniform(-reach, reach, count), rng.uniform(0.0, turn, count)], axis=1)
        away = flat[:, None] - flat
        away[..., 1] = (away[..., 1] + 0.5 * turn) % turn - 0.5 * turn
        apart = np.linalg.norm(away, axis=2) + np.diag(np.full(count, np.inf))
        if apart.min() >= APART[0] * link.pitch:
            return flat
