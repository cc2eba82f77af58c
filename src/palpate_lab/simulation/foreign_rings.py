"""Two soft rings of other mechanics than the barrel's: an elastic ring on a foundation, and a half-space's surface.

An estimator that was made on one laboratory is judged on these. Both are known by the motion of nodes round the ring
under forces on them, u = C f, and bodies press on them as `_foreign_rings` has it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

NODES, STEPS = 720, 6  # round the ring; of pressing in, and of dragging
MARKERS: Float[np.ndarray, " m"] = 2.0 * np.pi * np.arange(24) / 24  # rad
OUTER, WALL, DEEP = 0.055, 0.004, 0.008  # m: outer radius, wall of the elastic ring, depth of a half-space's markers
SKIN = 1.5e8  # Pa/m: of a body's own touch on the skin
POISSON = 0.49
_ROUND = 2.0 * np.pi * np.arange(NODES) / NODES
_ARC = OUTER * 2.0 * np.pi / NODES  # m


@dataclass(frozen=True)
class Pressing:
    """A body that is pressed in, then dragged.

    Args:
        angle: of its way inwards [rad].
        depth: of its foremost point [m].
        radius: of its tip [m]; infinite: a plate.
        slide: along rising angles [m].
    """

    angle: float
    depth: float
    radius: float = 0.01
    slide: float = 0.0


@dataclass(frozen=True)
class PressedIn:
    """Bodies' (k,) centres of pressure [rad], forces inwards and along rising angles [N], and markers (m, 2) [m].

    The markers' motion is outwards and along rising angles.
    """

    angle: Float[np.ndarray, " k"]
    force: Float[np.ndarray, " k"]
    shear: Float[np.ndarray, " k"]
    markers: Float[np.ndarray, "m 2"]


@dataclass(frozen=True)
class ForeignRing:
    """A ring by its compliance.

    Args:
        inner: radius of the markers [m].
        width: along the ring's axis [m], on which bodies press.
        outside: (2 n, 2 n) motion of the outer surface by forces on it [m/N], node by node outwards and along.
        inside: (2 m, 2 n) motion of the markers.
    """

    inner: float
    width: float
    outside: Float[np.ndarray, "a a"]
    inside: Float[np.ndarray, "m a"]

    def press(self, bodies: Sequence[Pressing], friction: float) -> PressedIn:
        """Press bodies in, then drag them; return what they do as `PressedIn`."""
        from palpate_lab.simulation import _foreign_rings

        rows = np.array([(body.angle, body.depth, body.radius, body.slide) for body in bodies])
        near, own = _near(rows)
        both = np.stack([2 * near, 2 * near + 1], axis=1).ravel()
        ways = np.arange(1, STEPS * (1 + bool(rows[:, 3].any())) + 1) / STEPS
        stages = np.stack([np.minimum(ways, 1.0), np.maximum(ways - 1.0, 0.0)], axis=1)
        law = np.array([friction, 1.0 / (SKIN * self.width * _ARC), OUTER])
        normal, loads, moved = np.empty((3, len(near), 2))
        compliance = np.ascontiguousarray(self.outside[np.ix_(both, both)])
        _foreign_rings.press(compliance, _ROUND[near], rows[own], stages, law, normal, loads, moved)
        tangent = np.stack([normal[:, 1], -normal[:, 0]], axis=1)
        force = loads[:, :1] * normal + loads[:, 1:] * tangent
        found = [
            _centre(_ROUND[near[own == k]], loads[own == k, 0], force[own == k], moved[own == k]) for k in set(own)
        ]
        angle, push, shear = np.array(found).T
        return PressedIn(angle, push, shear, (self.inside[:, both] @ force.ravel()).reshape(-1, 2))


def _near(bodies: Float[np.ndarray, "k 4"]) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes that bodies may touch, and which body each of them may."""
    own = np.full(NODES, -1)
    for k, (angle, depth, radius, slide) in enumerate(bodies.tolist()):
        half = np.sqrt(2.0 * depth / (1.0 / radius + 1.0 / OUTER)) / OUTER  # a circle's chord
        reach = 1.3 * half + np.radians(3.0) + abs(slide) / OUTER
        own[(np.abs((_ROUND - angle + np.pi) % (2.0 * np.pi) - np.pi) < reach) & (own < 0)] = k
    near = np.flatnonzero(own >= 0)
    return near, own[near]


def _centre(at: np.ndarray, pressure: np.ndarray, force: np.ndarray, moved: np.ndarray) -> tuple[float, float, float]:
    """Return a body's centre of pressure [rad], force inwards and along [N]."""
    turn = np.exp(1j * at)
    place = np.sum(pressure * (OUTER + moved[:, 0] + 1j * moved[:, 1]) * turn)
    total = np.sum((force[:, 0] + 1j * force[:, 1]) * turn) * np.conj(place) / abs(place)
    return float(np.angle(place) % (2.0 * np.pi)), -float(total.real), float(total.imag)


def _elastic_ring(seed: int) -> ForeignRing:
    """Return a ring that stretches and bends on springs, unevenly round it.

    Its energy is half of the sum over nodes of E A ((w + v') / R)^2 + E I ((w'' - v') / R^2)^2 + k w^2 + l v^2, times
    R dphi [Timoshenko and Gere 1961, 7]; an area at the height h above the middle line moves along by
    v (1 + h / R) - w' h / R.
    """
    rng = np.random.default_rng([51, seed])
    thick, width, stiff = (
        WALL * (1.0 + 0.03 * rng.standard_normal()),
        0.03,
        1.5e6 * (1.0 + 0.05 * rng.standard_normal()),
    )
    radius, one, order = OUTER - thick / 2.0, np.eye(NODES), np.fft.fftfreq(NODES, 1.0 / NODES)
    between = np.exp(1j * np.pi * order / NODES)  # stretch between nodes: at nodes, a wave from node to node has none
    shifted, sloped, slope, bent = (
        np.fft.ifft(each[:, None] * np.fft.fft(one, axis=0), axis=0).real
        for each in (between, 1j * order * between, 1j * order, -(order**2))
    )
    stretch, bend = np.hstack([shifted, sloped]) / radius, np.hstack([bent, -slope]) / radius**2
    first, second = rng.uniform(0.0, 2.0 * np.pi, 2)
    uneven = 1.0 + 0.06 * np.cos(_ROUND - first) + 0.03 * np.cos(2.0 * _ROUND - second)
    springs = np.concatenate([6.6e3 * (1.0 + 0.05 * rng.standard_normal()) * uneven, 3.6e3 * uneven])
    energy = stiff * width * (thick * stretch.T @ stretch + thick**3 / 12.0 * bend.T @ bend) + np.diag(springs)
    middle = np.linalg.inv(energy * radius * 2.0 * np.pi / NODES)

    def at(height: float) -> np.ndarray:
        share, by_node = height / radius, np.arange(2 * NODES).reshape(2, NODES).T.ravel()
        return np.block([[one, 0.0 * one], [-share * slope, (1.0 + share) * one]])[by_node]

    outer, inner = at(thick / 2.0), at(-thick / 2.0)
    return ForeignRing(OUTER - thick, width, outer @ middle @ outer.T, _of_markers(inner @ middle @ outer.T))


def _half_space(seed: int) -> ForeignRing:
    """Return the surface of a half-space that is rolled up, its stiffness uneven round it.

    By the motion under a point's force, normal and along the surface [Johnson 1985, 3.2 and 3.6], spread over a
    millimetre. Markers lie so deep that a dent is as wide there as they are apart.
    """
    rng = np.random.default_rng([52, seed])
    stiff = 0.03e6 * (1.0 + 0.05 * rng.standard_normal())
    soft = np.sqrt(1.0 + 0.06 * np.cos(_ROUND - rng.uniform(0.0, 2.0 * np.pi)))
    x = OUTER * ((_ROUND[:, None] - _ROUND + np.pi) % (2.0 * np.pi) - np.pi)

    def moved(z: float, spread: float) -> np.ndarray:
        rho = np.sqrt(x**2 + z**2 + spread**2)
        far, free = rho + z + spread, 1.0 - 2.0 * POISSON
        deep = z**2 / rho**3 + 2.0 * (1.0 - POISSON) / rho
        side = 1.0 / rho + x**2 / rho**3 + free * (1.0 / far - x**2 / (rho * far**2))
        mixed, turn = x * z / rho**3, free * x / (rho * far)
        both = np.array([[deep, -(mixed + turn)], [-(mixed - turn), side]])  # outwards is against z, by force outwards
        both *= (1.0 + POISSON) / (2.0 * np.pi * stiff) * soft[:, None] * soft
        return both.transpose(2, 0, 3, 1).reshape(2 * NODES, 2 * NODES)

    outside = moved(0.0, 1.5e-3)
    return ForeignRing(OUTER - DEEP, 0.02, 0.5 * (outside + outside.T), _of_markers(moved(DEEP, 0.5e-3)))


def _of_markers(motion: np.ndarray) -> np.ndarray:
    """Return the rows of the nodes at which markers are."""
    return motion.reshape(NODES, 2, -1)[:: NODES // len(MARKERS)].reshape(2 * len(MARKERS), -1)


FOREIGN: dict[str, Callable[[int], ForeignRing]] = {"elastic ring": _elastic_ring, "half-space": _half_space}
