"""A barrel of silicone that rigid bodies press: the contact point, the force, and the movement of the markers.

The barrel of the marker ring [marker ring, III], as mechanics: linear elasticity of a body whose thickness is uneven
(`barrel_elasticity`), unilateral contact with friction on its outer side (`barrel_contact`). Angles about z, from x.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from palpate_lab.simulation.barrel_contact import Band, Indenter, Settled, settle
from palpate_lab.simulation.barrel_elasticity import BarrelSettings, compliance, solid

__all__ = ["Barrel", "Indenter", "Pressed"]


@dataclass(frozen=True, eq=False)
class Pressed:
    """A loaded barrel.

    Attributes:
        angle: (k,) [rad] angle of each body's centre of pressure; NaN where it does not touch.
        force: (k,) [N] inward force at that angle.
        shear: (k,) [N] force on the skin along rising angle.
        depth: (k,) [m] depth of each body's foremost point inside the unloaded surface.
        markers: (m, 3) [m] centres of the markers.
        discs: (m, p, 3) [m] outlines of the markers.
    """

    angle: Float[np.ndarray, " k"]
    force: Float[np.ndarray, " k"]
    shear: Float[np.ndarray, " k"]
    depth: Float[np.ndarray, " k"]
    markers: Float[np.ndarray, "m 3"]
    discs: Float[np.ndarray, "m p 3"]


@dataclass(frozen=True, eq=False)
class Barrel:
    """A barrel ready to be pressed.

    Attributes:
        settings: shape and material.
        band: the outer side near the equator and its compliance.
        rest: (m, 1 + p, 3) [m] each marker's centre and outline, unloaded.
        answer: (m (1 + p) 3, f) [m/N] their movements by forces on the band's nodes.
    """

    settings: BarrelSettings
    band: Band
    rest: Float[np.ndarray, "m q 3"]
    answer: Float[np.ndarray, "r f"] = field(repr=False)

    @staticmethod
    @lru_cache(maxsize=2)
    def built(settings: BarrelSettings) -> Barrel:
        """Mesh, factorise and condense a `Barrel` (seconds); the last two barrels are kept in memory.

        Raises:
            InputError: scikit-fem is not installed.
        """
        body = solid(settings)
        levels = np.unique(np.round(body.place[:, 2], 9))
        rows = int(np.searchsorted(levels, settings.band + 1e-9))
        skin = body.node[:, :rows, 2]
        rest, theta = _marker_points(settings)
        tall = 1 + 2 * int(np.searchsorted(settings.rows, float(np.abs(rest[..., 2]).max())))
        inner = body.node[:, :tall, 0]
        loaded = (3 * skin.ravel()[:, None] + np.arange(2)).ravel()
        answered = (3 * inner.ravel()[:, None] + np.arange(3)).ravel()
        both = compliance(body, np.concatenate([loaded, answered]), loaded)
        square = both[: len(loaded)]
        band = Band(settings.outer, body.place[skin][:, :, 2][0], (square + square.T) / 2.0)
        weights = _inner_weights(theta, rest[..., 2], 2 * settings.around, levels[:tall])
        held = both[len(loaded) :].reshape(inner.size, 3, -1)
        answer = np.einsum("qi,iaf->qaf", weights, held)
        answer[rest.reshape(-1, 3)[:, 2] < 0.0, 2] *= -1.0  # below the equator: the mirror image
        answer = answer.reshape(-1, len(loaded))
        for array in (rest, answer):
            array.flags.writeable = False
        return Barrel(settings, band, rest, answer)

    def press(self, bodies: Sequence[Indenter], friction: float = 0.4) -> Pressed:
        """Press rigid bodies side by side into the unloaded barrel, and return the loaded one as a `Pressed`.

        Args:
            bodies: bodies that are first pressed along the radius to their depths, then slid.
            friction: Coulomb's coefficient; it acts around the ring.

        Raises:
            InputError: a depth or radius is impossible, or the bodies crowd the skin so that no equilibrium is
                found.
        """
        return self._seen(bodies, settle(self.band, bodies, friction)[-1], 1.0)

    def follow(
        self, bodies: Sequence[Indenter], shares: Sequence[tuple[float, float]], friction: float = 0.4
    ) -> list[Pressed]:
        """Press bodies step by step, with the history of friction, and return a list with a `Pressed` for each step.

        Args:
            bodies: as for `press`.
            shares: share of their depths and share of their slides reached at each step.
            friction: Coulomb's coefficient.

        Raises:
            InputError: a depth or radius is impossible, or the bodies crowd the skin so that no equilibrium is
                found.
        """
        found = settle(self.band, bodies, friction, shares)
        return [self._seen(bodies, each, down) for each, (down, _) in zip(found, shares, strict=True)]

    def _seen(self, bodies: Sequence[Indenter], found: Settled, down: float) -> Pressed:
        moved = self.rest + (self.answer @ found.nodal).reshape(self.rest.shape)
        depth = down * np.array([each.depth for each in bodies], dtype=float)
        return Pressed(found.angle, found.force, found.shear, depth, moved[:, 0], moved[:, 1:])


def _marker_points(settings: BarrelSettings) -> tuple[np.ndarray, np.ndarray]:
    """Return centres and outlines of the markers at rest (m, q, 3), ring by ring, and their angles (m, q)."""
    around = 2.0 * np.pi * np.arange(settings.outline) / settings.outline
    turn = np.tile(2.0 * np.pi * np.arange(settings.markers) / settings.markers, len(settings.rings))
    height = np.repeat(settings.rings, settings.markers)
    radius = settings.outer(height) - settings.thickness_at(turn)
    across = np.concatenate([[0.0], np.cos(around)]) * settings.marker_radius
    theta = turn[:, None] + across / radius[:, None]
    z = height[:, None] + np.concatenate([[0.0], np.sin(around)]) * settings.marker_radius
    radius = settings.outer(z) - settings.thickness_at(theta)
    return np.stack([radius * np.cos(theta), radius * np.sin(theta), z], axis=-1), theta


def _inner_weights(
    theta: Float[np.ndarray, "m q"], z: Float[np.ndarray, "m q"], columns: int, levels: Float[np.ndarray, " r"]
) -> Float[np.ndarray, "p n"]:
    """Return weights (m q, nodes) that interpolate from the inner side's nodes, column by column, to points on it."""
    column, share = _columns(theta.ravel(), columns)
    up = np.abs(z).ravel()
    brick = np.clip(np.searchsorted(levels[::2], up, side="right") - 1, 0, len(levels) // 2 - 1)
    row = 2 * brick[:, None] + np.arange(3)
    low, high = levels[row[:, 0]], levels[row[:, 2]]
    height = _quadratic(2.0 * (up - low) / (high - low))
    weights = np.zeros((len(up), columns, len(levels)))
    at = np.arange(len(up))[:, None, None]
    weights[at, column[:, :, None], row[:, None, :]] = share[:, :, None] * height[:, None, :]
    return weights.reshape(len(up), -1)


def _quadratic(at: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    """Return Lagrange's quadratics at 0, 1, 2."""
    return np.stack([(at - 1) * (at - 2) / 2, at * (2 - at), at * (at - 1) / 2], axis=-1)


def _columns(angle: Float[np.ndarray, " n"], columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the three columns of nodes (n, 3) of the brick at each angle, and their shape functions (n, 3)."""
    at = np.mod(angle, 2.0 * np.pi) * columns / (2.0 * np.pi)
    first = (2 * np.floor(at / 2)).astype(int)
    return (first[:, None] + np.arange(3)) % columns, _quadratic(at - first)
