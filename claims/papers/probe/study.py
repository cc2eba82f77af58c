"""Presses on every mark, what the sensor makes of them, and how far the estimates are from both truths."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

import palpate
from claims.papers.probe import assumed
from claims.papers.probe.assumed import NOISE
from claims.papers.probe.draws import Draws
from claims.papers.probe.press import Press, press, tilted
from claims.papers.probe.shapes import PROBES, Probe
from palpate_lab.simulation import contact_wrenches

ANGLES = {"perpendicular": (0.0, "in-plane"), "in-plane": (30.0, "in-plane"), "out-of-plane": (30.0, "out-of-plane")}
REPEATS = 3  # the paper pressed each mark three times
FINE, SIMPLE = 0.5e-3, 4e-3  # m, edges


@dataclass(frozen=True)
class Size:
    """How much is run: builds, spacing of the surface's elements [m], readings for the bound."""

    builds: int
    spacing: float
    readings: int

    @classmethod
    def of(cls, small: bool) -> Size:
        return cls(30, 0.5e-3, 300) if small else cls(300, 0.15e-3, 4_000)


class Meshes:
    """Of one probe: fine for what the surface is, simplified for what the paper worked with; and locators."""

    def __init__(self, probe: Probe) -> None:
        self.probe = probe
        self._meshes: dict[str, palpate.Mesh] = {}
        self._locators: dict[tuple[str, str], palpate.Locator] = {}

    def mesh(self, name: str) -> palpate.Mesh:
        """The one called "fine" or "simple", smooth or ", flat"."""
        if name not in self._meshes:
            edge = FINE if name.startswith("fine") else SIMPLE
            self._meshes[name] = self.probe.mesh(edge, smooth="flat" not in name)
        return self._meshes[name]

    def locator(self, mesh: str, method: str = "soft_finger") -> palpate.Locator:
        if (mesh, method) not in self._locators:
            self._locators[mesh, method] = palpate.Locator(self.mesh(mesh), method)
        return self._locators[mesh, method]


@dataclass(frozen=True, eq=False)
class Case:
    """All marks of one probe pressed at one angle.

    Attributes:
        number: for the dice.
        marks: (n, 3) [m]; tangents: (n, 2, 3) at the marks.
        presses: n of them, in the marks' order.
    """

    number: int
    probe: Probe
    marks: np.ndarray
    tangents: np.ndarray
    presses: list[Press]

    def at(self, forces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Wrenches and centroids when the forces were (builds, n, repeats) [N]."""
        pairs = [one.at(forces[:, i].ravel()) for i, one in enumerate(self.presses)]
        shape = (forces.shape[0], forces.shape[2])
        wrenches, centroids = (np.stack([pair[k].reshape(*shape, -1) for pair in pairs], axis=1) for k in (0, 1))
        return wrenches, centroids


def case(
    name: str, angle: str, spacing: float, pad: assumed.Pad | None = None, twist: float = 0.0, centred: bool = False
) -> Case:
    """Press every mark of a probe at an angle; tilts alternate in sign from mark to mark.

    The tip's axis goes through the mark, or, `centred`, its ball's middle goes to where the mark's normal is.
    """
    probe = PROBES[name]
    marks, normals = probe.marked()
    degrees, plane = ANGLES[angle]
    pad = pad or assumed.Pad()
    signs = np.where(np.arange(len(marks)) % 2, -1.0, 1.0)
    aims = marks + centred * pad.radius * normals
    presses = [
        press(probe, mark, tilted(normal, sign * degrees, plane), pad, twist, spacing, aim)
        for mark, aim, normal, sign in zip(marks, aims, normals, signs, strict=True)
    ]
    first = np.cross(normals, [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    tangents = np.stack([first, np.cross(normals, first)], axis=1)
    return Case(10 * list(PROBES).index(name) + list(ANGLES).index(angle), probe, marks, tangents, presses)


@dataclass(frozen=True, eq=False)
class Errors:
    """Distances [m], (builds, marks, repeats), to the mark under the tip's axis and to the pressure's centre."""

    mark: np.ndarray
    centroid: np.ndarray


def errors(
    some: Case,
    locator: palpate.Locator,
    draws: Draws,
    causes: Collection[str],
    forces: tuple[float, float] = assumed.FORCE_SPAN,
    repeats: int = REPEATS,
    worse_payload: bool = False,
    presses: int | None = None,
    mounted: palpate.Pose | None = None,
) -> Errors:
    """Every mark of every build, `repeats` times, at random forces within bounds [N].

    Args:
        some: the presses.
        locator: on the mesh that is taken for the surface.
        draws: the dice.
        causes: what goes wrong.
        forces: bounds [N].
        repeats: readings of a mark.
        worse_payload: the payload is misjudged as on the real recording.
        presses: 1 when the repeats are readings of one press, aimed once; None: each is a press.
        mounted: (builds,) T_sensor_probe as calibrated; None: as drawn.
    """
    count = len(some.marks)
    size = np.random.default_rng([draws.seed, some.number]).uniform(*forces, (draws.builds, count, repeats))
    wrenches, centroids = some.at(size)
    sensed = draws.sensed(wrenches, causes, some.number)
    if worse_payload:
        sensed = draws.worse_payload(sensed)
    if mounted is not None:
        sensed = np.einsum("bij,bmrj->bmri", mounted.inverse().wrench_matrix(), sensed)
    found = locator.run(sensed.reshape(-1, 6), sequential=False)
    points = found.point.reshape((*sensed.shape[:-1], 3))
    missed = draws.missed(count, presses or repeats, causes, some.number)
    off = np.einsum("bmrk,mki->bmri", missed, some.tangents)
    # pressed at mark + off, so everything else moved along by as much: the same as a mark off the other way
    mark = np.linalg.norm(points + off - some.marks[:, None], axis=-1)
    return Errors(mark, np.linalg.norm(points - centroids, axis=-1))


def calibrated(some: Case, mesh: palpate.Mesh, draws: Draws, causes: Collection[str]) -> palpate.Pose:
    """T_sensor_probe of every build, identified from one more press on each mark, taken to be where it was drawn."""
    count, number = len(some.marks), some.number + 100  # other presses: other dice
    size = np.random.default_rng([draws.seed, number]).uniform(*assumed.FORCE_SPAN, (draws.builds, count, 1))
    wrenches, _ = some.at(size)
    off = np.einsum("bmrk,mki->bmri", draws.missed(count, 1, causes, number), some.tangents)
    wrenches[..., 3:] += np.cross(off, wrenches[..., :3])  # the contact moved along with the tip
    sensed = draws.sensed(wrenches, causes, number)[:, :, 0]
    found = [palpate.identify_mounting(w, mesh, initial=palpate.Pose.identity(), points=some.marks) for w in sensed]
    return palpate.Pose([each.pose.rotation for each in found], [each.pose.translation for each in found])


def bound(probe: Probe, point: np.ndarray, wrench: np.ndarray) -> float:
    """The rms error [m] on the surface that no unbiased estimate undercuts, for one reading with the assumed noise.

    Cramer-Rao, by the forward model alone: a soft finger at p(u, v) makes W = (F, p x F + tau n(p)), six numbers that
    hold six unknowns (F, u, v, tau), so the bound is J^-1 Sigma J^-T, with J by central differences on the exact shape.
    """
    normal = probe.normals(point)
    first = np.cross(normal, [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first)
    tangents = np.stack([first, np.cross(normal, first)])
    torque = (wrench[3:] - np.cross(point, wrench[:3])) @ normal
    at = np.concatenate([wrench[:3], [0.0, 0.0, torque]])

    def forward(x: np.ndarray) -> np.ndarray:
        here = probe.land(point + x[:, 3:5] @ tangents, normal)
        return contact_wrenches(here, probe.normals(here), x[:, :3], x[:, 5])

    steps = np.diag([1e-3] * 3 + [1e-6] * 2 + [1e-5])
    slopes = (forward(at + steps) - forward(at - steps)) / (2 * np.diag(steps)[:, None])
    inverse = np.linalg.inv(slopes.T)
    covariance = inverse @ np.diag(NOISE**2) @ inverse.T
    return float(np.sqrt(covariance[3, 3] + covariance[4, 4]))


def noise_over_bound(some: Case, locator: palpate.Locator, force: float, readings: int) -> np.ndarray:
    """Rms error to the pressure's centre with nothing but noise, over the bound, mark by mark (n,)."""
    draws = Draws(readings, 7)
    count = len(some.marks)
    wrenches, centroids = some.at(np.full((1, count, 1), force))
    bounds = np.array([bound(some.probe, centroids[0, i, 0], wrenches[0, i, 0]) for i in range(count)])
    found = errors(some, locator, draws, ("noise, single reading",), (force, force), 1).centroid[..., 0]
    return np.sqrt(np.mean(found**2, axis=0)) / bounds
