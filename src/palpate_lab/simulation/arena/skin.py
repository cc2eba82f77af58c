"""Move the markers of a soft skin under known forces, by tables, thousands of times a second.

An engine of rigid bodies computes where and how hard a robot is touched; the barrel of the marker ring [marker ring,
III] computes what its skin does then. Its contact is solved once for each kind of body, and the pressing forces are
turned around the ring; in linear elasticity movements by several touches add up. Compared with the exact
`Barrel.press` one effect is missing: a neighbour's dent changes how a body lies on the skin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from palpate_lab.simulation.barrel import Barrel
from palpate_lab.simulation.barrel_contact import Band, Indenter, Settled, settle
from palpate_lab.simulation.barrel_elasticity import BarrelSettings
from palpate_lab.simulation.ring_session import RingUnit

KINDS = ("flat", "corner", "round")  # a wall or a block's side, a block's upright edge, another robot's skin
LARGEST = 8.0  # N: beyond, movements are scaled
LEVELS = 12  # of force, closer where it is small
STEPS = 12  # of depth, while a body comes down
SHEARED = 0.45  # of the largest depth, where shear is taken
SLIDE = 0.002  # m to either side
FRICTION = 0.4
_EDGE, _SKIN = 0.004, 0.055  # m: radius of an upright edge, and of another robot


def _body(kind: str, angle: float, radius: float) -> Indenter:
    """Return the body of a kind, pressed in by some 10 N."""
    deep = {"flat": 0.29, "corner": 0.5, "round": 0.34}[kind] * radius
    if kind == "flat":
        return Indenter("plate", angle, deep)
    return Indenter("cylinder", angle, deep, _EDGE if kind == "corner" else _SKIN)


@dataclass(frozen=True, eq=False)
class RingSkin:
    """The markers of a barrel under touches.

    Attributes:
        rest: (m, 3, 3) [m] each marker unloaded: the middle of its disc, and the disc's edge around the ring and along
            its axis; the middle is the point whose image is the centroid of the disc's.
        presses: (kinds, angles, levels + 1, 9 m) [m] movements of `rest` at `largest` (i / levels)^2 newtons.
        shears: (kinds, angles, 9 m) [m/N] movements per newton of shear.
        largest: (kinds,) [N] largest force of the tables.
    """

    rest: Float[np.ndarray, "m 3 3"]
    presses: np.ndarray = field(repr=False)
    shears: np.ndarray = field(repr=False)
    largest: Float[np.ndarray, " kinds"]

    @staticmethod
    def built(unit: RingUnit) -> RingSkin:
        """Compute the `RingSkin` of a unit (a second or two; coarse units are quicker).

        Raises:
            InputError: scikit-fem is not installed.
        """
        barrel = Barrel.built(unit.barrel)
        weights = _disc(barrel.settings)
        rest = disc_points(barrel.settings, barrel.rest)
        answer = barrel.answer.reshape(*barrel.rest.shape, -1)
        moves = np.einsum("mabij,mbjf->maif", weights, answer, optimize=True).reshape(rest.size, -1)
        made = [_tables(barrel, kind, moves) for kind in KINDS]
        presses, shears = (np.stack([each[k] for each in made]).astype(np.float32) for k in (0, 1))
        for array in (rest, presses, shears):
            array.flags.writeable = False
        return RingSkin(rest, presses, shears, np.array([each[2] for each in made]))

    def markers(self, touches: Float[np.ndarray, "k 5"]) -> Float[np.ndarray, "m 3 3"]:
        """Return the positions of the discs (m, 3, 3) [m] under touches, in the order of `rest`.

        Args:
            touches: (k, 5) angle [rad], inward force [N], shear along rising angle [N], depth (not used: it follows
                from the force by the skin's own stiffness), and kind, a number into `KINDS`.
        """
        from palpate_lab.simulation.arena._skin import superposed  # compiled: loaded when first needed

        out = np.empty(self.rest.size)
        touches = np.ascontiguousarray(touches, dtype=np.float64)
        superposed(self.rest.reshape(-1), self.presses, self.shears, self.largest, touches, out)
        return out.reshape(self.rest.shape)


def disc_points(settings: BarrelSettings, points: Float[np.ndarray, "*n m q 3"]) -> Float[np.ndarray, "*n m 3 3"]:
    """Return each marker's middle and two points of its edge, (*n, m, 3, 3) [m], as in `RingSkin.rest`.

    `points` (*n, m, 1 + p, 3) [m] are centres and outlines, as in `Barrel.rest`.
    """
    return np.einsum("mabij,...mbj->...mai", _disc(settings), points, optimize=True)


def _disc(settings: BarrelSettings) -> Float[np.ndarray, "m 3 q 3 3"]:
    """Return the weights that take a marker's centre and outline to the three points of `RingSkin.rest`.

    An outline p0 + U cos t + V sin t + A cos 2t + B sin 2t in the plane of U and V, as of a disc on bent skin, has its
    area's centroid at p0 + ((A_u + B_v) U + (B_u - A_v) V) / 2; radial parts are seen along V.
    """
    count = settings.outline
    t = 2.0 * np.pi * np.arange(count) / count
    one, c, s = np.ones(count) / count, np.cos(t) * 2 / count, np.sin(t) * 2 / count
    c2, s2 = np.cos(2 * t) * 2 / count, np.sin(2 * t) * 2 / count
    turn = 2.0 * np.pi * np.arange(settings.markers) / settings.markers
    zero = np.zeros_like(turn)
    out, along = (
        np.stack([np.cos(turn), np.sin(turn), zero], axis=-1),
        np.stack([-np.sin(turn), np.cos(turn), zero], -1),
    )
    up = np.broadcast_to([0.0, 0.0, 1.0], out.shape)

    def dyad(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return a[:, :, None] * b[:, None, :]

    by_cosine = dyad(along, along) - dyad(up, up) - dyad(out, out)
    by_sine = dyad(along, up) + dyad(up, along)
    middle = one[None, :, None, None] * np.eye(3) + 0.5 * (
        c2[None, :, None, None] * by_cosine[:, None] + s2[None, :, None, None] * by_sine[:, None]
    )
    weights = np.zeros((settings.markers, 3, 1 + count, 3, 3))
    weights[:, :, 1:] = middle[:, None]
    weights[:, 1, 1:] += c[None, :, None, None] * np.eye(3)
    weights[:, 2, 1:] += s[None, :, None, None] * np.eye(3)
    return weights


def _tables(barrel: Barrel, kind: str, moves: Float[np.ndarray, "r f"]) -> tuple[np.ndarray, np.ndarray, float]:
    """Compute movements of one kind: (angles, levels + 1, r) by force, (angles, r) per newton of shear; largest force.

    A barrel is unevenly thick: where it is softer, a body sinks in deeper at the same force and lies on more of the
    skin. So the pressing forces at an angle are taken from the force that sinks in as deep where the contact was
    solved.
    """
    band = barrel.band
    ladders = [_ladder(band, kind, column) for column in (0, 1)]  # the middle and the edge of a brick differ
    softness = _softness(band, ladders, 0.3 * LARGEST)
    largest = min(LARGEST, min(each.x[-1] for each in ladders) / softness.max())
    levels = largest * (np.arange(LEVELS + 1) / LEVELS) ** 2
    presses, shears = np.zeros((band.columns, LEVELS + 1, len(moves))), np.zeros((band.columns, len(moves)))
    for odd, ladder in enumerate(ladders):
        sheared = _sheared(band, kind, odd)
        for column in range(odd, band.columns, 2):
            ratio = softness[column]
            pattern = ladder(levels * ratio) / ratio
            presses[column] = _turned(band, pattern, column - odd) @ moves.T
            shears[column] = _turned(band, sheared, column - odd) @ moves.T
    return presses, shears, float(largest)


def _softness(band: Band, ladders: Sequence[CubicSpline], force: float) -> Float[np.ndarray, " c"]:
    """Return the skin's movement under a force at each column, relative to the columns where the contact was solved."""
    work = np.zeros(band.columns)
    for odd, ladder in enumerate(ladders):
        turned = np.stack([_turned(band, ladder(force), k) for k in range(0, band.columns, 2)])
        work[odd::2] = np.einsum("kf,kf->k", turned @ band.compliance, turned)
        work[odd::2] /= work[odd]
    return work


def _ladder(band: Band, kind: str, column: int) -> CubicSpline:
    """Return the nodal forces (f,) of a body at a column of nodes as a spline over its force [N]."""
    body = _body(kind, column * 2.0 * np.pi / band.columns, float(band.outer(np.zeros(1))[0]))
    shares = ((np.arange(STEPS) + 1.0) / STEPS) ** 1.4
    found = settle(band, [body], FRICTION, [(float(each), 0.0) for each in shares])
    force = np.array([0.0, *(each.force[0] for each in found)])
    return CubicSpline(force, np.stack([0.0 * found[0].nodal, *(each.nodal for each in found)]))


def _sheared(band: Band, kind: str, column: int) -> Float[np.ndarray, " f"]:
    """Return the nodal forces per newton of shear: half the difference of drags to either side."""
    body = _body(kind, column * 2.0 * np.pi / band.columns, float(band.outer(np.zeros(1))[0]))

    def dragged(slide: float) -> Settled:
        moved = Indenter(body.kind, body.angle, SHEARED * body.depth, body.radius, slide)
        return settle(band, [moved], FRICTION)[-1]

    there, back = dragged(SLIDE), dragged(-SLIDE)
    return (there.nodal - back.nodal) / (there.shear[0] - back.shear[0])


def _turned(band: Band, nodal: Float[np.ndarray, "*n f"], columns: int) -> Float[np.ndarray, "*n f"]:
    """Return nodal forces turned around the ring by a number of columns."""
    angle = columns * 2.0 * np.pi / band.columns
    c, s = np.cos(angle), np.sin(angle)
    split = np.roll(nodal.reshape(*nodal.shape[:-1], band.columns, -1, 2), columns, axis=-3)
    x, y = split[..., 0], split[..., 1]
    return np.stack([c * x - s * y, s * x + c * y], axis=-1).reshape(nodal.shape)
