"""Rigid bodies on the outer side of a barrel: unilateral contact with Coulomb's friction around the ring.

Points of contact lie four by four in every brick, closer than the nodes, so that the force hardly ripples as a body
moves from node to node. Each pushes the skin off by a pressure k o, with o the depth of the moved point inside the
exact body, and k the skin's stiffness below the mesh's resolution; friction holds it at its first place of contact, up
to mu k o. With N the shape functions and G the skin's compliance, the nodal forces f solve f = N' a lambda(X + N G f):
a semi-smooth Newton, the contact's state being its active set. Friction has a history, so bodies come down, and slide,
in a few steps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse

from palpate.errors import InputError

STIFFNESS = (
    1.5e8  # N/m^3 of the contact: the skin as finely as the mesh cannot dent (Hertz: 58 kPa and 0.6 mm under 0.7 N)
)
TANGENTIAL = 0.75e8  # N/m^3 until it slips
FINE = 4  # points of contact along a brick's edge
SPARE = np.radians(4.0)  # around the ring, beyond where body and unloaded skin overlap
ROUNDS = 60
CLOSE = 1e-5  # N, of a nodal force


@dataclass(frozen=True)
class Indenter:
    """A rigid body pressed along the radius, as tall as the band; of a tip the slice at a height acts as a disc.

    Attributes:
        kind: "plate" (tangent to the ring), "tip" (a sphere) or "cylinder" (its axis along the barrel's).
        angle: angle of its axis [rad].
        depth: depth of its foremost point inside the unloaded surface [m].
        radius: radius of a tip or cylinder [m].
        slide: distance [m] that it then moves sideways, towards rising angle.
        width: width of a plate [m], across.
    """

    kind: Literal["plate", "tip", "cylinder"]
    angle: float
    depth: float
    radius: float = 0.01
    slide: float = 0.0
    width: float = 0.1


@dataclass(frozen=True, eq=False)
class Band:
    """The outer side of the barrel near the equator, of which half is modelled.

    Attributes:
        outer: function from heights [m] to outside radii [m].
        heights: (rows,) [m] heights of the rows of nodes.
        compliance: (2 nodes, 2 nodes) [m/N] along x and y, node = column x rows + row; forces on the upper half.
    """

    outer: Callable[[np.ndarray], np.ndarray]
    heights: Float[np.ndarray, " rows"]
    compliance: Float[np.ndarray, "f f"] = field(repr=False)

    def __post_init__(self) -> None:
        self.compliance.flags.writeable = False

    @property
    def columns(self) -> int:
        """Number of columns of nodes around the ring."""
        return len(self.compliance) // (2 * len(self.heights))


@dataclass(frozen=True, eq=False)
class Settled:
    """Contact in equilibrium: nodal forces of the upper half (f,) [N]; angle, force and shear of each body (k,)."""

    nodal: Float[np.ndarray, " f"]
    angle: Float[np.ndarray, " k"]
    force: Float[np.ndarray, " k"]
    shear: Float[np.ndarray, " k"]


@dataclass(frozen=True, eq=False)
class _Points:
    """Points of contact (q = 16 b) in every brick (b) that a body may touch: their body, place at rest, and area.

    `nodes` (n) are those of all bricks; `index` the nine of each brick's outer side among them.
    """

    owner: Int[np.ndarray, " q"]
    place: Float[np.ndarray, "q 2"]
    z: Float[np.ndarray, " q"]
    area: Float[np.ndarray, " q"]
    nodes: Int[np.ndarray, " n"]
    index: Int[np.ndarray, "b 9"]


@dataclass(frozen=True, eq=False)
class _Bodies:
    """Bodies at one instant, a row per point of contact (q): outward axis, front or centre, radius at its height."""

    axis: Float[np.ndarray, "q 2"]
    centre: Float[np.ndarray, "q 2"]
    radius: Float[np.ndarray, " q"]
    flat: Bool[np.ndarray, " q"]
    half: Float[np.ndarray, " q"]


@dataclass(frozen=True, eq=False)
class _State:
    """State of contact (q,): overlap, push and tangent on the skin (q, 2), sideways place, friction [Pa], stuck."""

    over: np.ndarray
    push: np.ndarray
    along: np.ndarray
    side: np.ndarray
    drag: np.ndarray
    stuck: np.ndarray


def _turned(vector: np.ndarray) -> np.ndarray:
    return np.stack([-vector[..., 1], vector[..., 0]], axis=-1)


def _check(bodies: Sequence[Indenter], radius: float) -> None:
    for at, each in enumerate(bodies):
        if not 0.0 <= each.depth <= 0.5 * radius:
            raise InputError(f"depth of body {at} must be from 0 to half the barrel's radius, not {each.depth} m.")
        if each.kind != "plate" and each.radius <= 0.0:
            raise InputError(f"radius of body {at} must be above 0, not {each.radius} m.")


def _points(band: Band, bodies: Sequence[Indenter]) -> _Points:
    """Return every point of the bricks that a body may touch."""
    rows, columns, radius = len(band.heights), band.columns, float(band.outer(np.zeros(1))[0])
    width = 4.0 * np.pi / columns
    owner: list[Int[np.ndarray, " a"]] = []
    turn: list[Int[np.ndarray, " a"]] = []
    for at, each in enumerate(bodies):
        reach = np.arccos(1.0 - each.depth / radius)
        if each.kind != "plate":
            reach = min(reach, np.arcsin(min(each.radius / (radius - each.depth), 1.0)))
        apart = np.abs(np.mod((np.arange(columns // 2) + 0.5) * width - each.angle + np.pi, 2 * np.pi) - np.pi)
        turn.append(np.flatnonzero(apart <= reach + abs(each.slide) / radius + SPARE + width / 2))
        owner.append(np.full(len(turn[-1]), at))
    turned, owned = np.concatenate(turn), np.concatenate(owner)
    levels = rows // 2
    column = (2 * turned[:, None] + np.arange(3)) % columns
    row = 2 * np.arange(levels)[:, None] + np.arange(3)
    number = (column[:, None, :, None] * rows + row[None, :, None, :]).reshape(-1, 9)
    nodes, index = np.unique(number, return_inverse=True)
    part, low, tall = (np.arange(FINE) + 0.5) / FINE, band.heights[:-1:2], np.diff(band.heights[::2])
    whole = (len(turned), levels, FINE, FINE)  # around the ring, then up, in every brick
    theta = np.broadcast_to(((turned[:, None] + part) * width)[:, None, :, None], whole).ravel()
    z = np.broadcast_to((low[:, None] + tall[:, None] * part)[None, :, None], whole).ravel()
    height = np.broadcast_to((tall / FINE)[None, :, None, None], whole).ravel()
    r = band.outer(z)
    place = r[:, None] * np.stack([np.cos(theta), np.sin(theta)], axis=-1)
    owners = np.repeat(owned, levels * FINE**2)
    return _Points(owners, place, z, width / FINE * r * height, nodes, index.reshape(-1, 9))


def _shape() -> Float[np.ndarray, "16 9"]:
    """Return the shape functions of a brick's nine outer nodes at its points of contact, (16, 9)."""
    at = 2.0 * (np.arange(FINE) + 0.5) / FINE
    line = np.stack([(at - 1) * (at - 2) / 2, at * (2 - at), at * (at - 1) / 2], axis=-1)
    return np.einsum("ai,bj->abij", line, line).reshape(FINE**2, 9)


SHAPE = _shape()
PAIRS = (SHAPE[:, :, None] * SHAPE[:, None, :]).reshape(FINE**2, 81)


def _placed(bodies: Sequence[Indenter], points: _Points, radius: float, down: float, aside: float) -> _Bodies:
    """Return the bodies after a share of their depth and of their slide."""
    axis = np.array([[np.cos(each.angle), np.sin(each.angle)] for each in bodies])
    size = np.array([0.0 if each.kind == "plate" else each.radius for each in bodies])
    depth, slide = np.array([each.depth for each in bodies]), np.array([each.slide for each in bodies])
    centre = (radius - down * depth + size)[:, None] * axis + (aside * slide)[:, None] * _turned(axis)
    ball = np.array([each.kind == "tip" for each in bodies])[points.owner]
    own = size[points.owner]
    at = np.where(ball, np.sqrt(np.maximum(own**2 - points.z**2, 0.0)), own)
    flat = np.array([each.kind == "plate" for each in bodies])[points.owner]
    half = np.array([each.width / 2 for each in bodies])[points.owner]
    return _Bodies(axis[points.owner], centre[points.owner], at, flat, half)


def _state(bodies: _Bodies, place: np.ndarray, anchor: np.ndarray, friction: float) -> _State:
    """Compute the contact at moved points (q, 2), which friction pulls towards the sideways places `anchor` (q,)."""
    apart = place - bodies.centre
    tangent = _turned(bodies.axis)
    ahead: Float[np.ndarray, " q"] = np.einsum("qa,qa->q", apart, bodies.axis)
    side: Float[np.ndarray, " q"] = np.einsum("qa,qa->q", apart, tangent)
    distance: Float[np.ndarray, " q"] = np.maximum(np.hypot(ahead, side), 1e-12)
    push = np.where(bodies.flat[:, None], -bodies.axis, apart / distance[:, None])
    over: Float[np.ndarray, " q"] = np.where(bodies.flat, ahead, bodies.radius - distance).astype(float)
    beyond: Bool[np.ndarray, " q"] = np.where(bodies.flat, np.abs(side) > bodies.half, ahead > 0.0)
    over = np.where(beyond, 0.0, np.maximum(over, 0.0))
    arc: Float[np.ndarray, " q"] = np.where(bodies.flat, side, bodies.radius * np.arctan2(side, -ahead))
    trial: Float[np.ndarray, " q"] = TANGENTIAL * (anchor - arc)
    limit = friction * STIFFNESS * over
    drag = np.clip(trial, -limit, limit)
    return _State(over, push, -_turned(push), arc, drag, (np.abs(trial) < limit) & (over > 0.0))


def _blocks(points: _Points, state: _State, friction: float) -> tuple[np.ndarray, np.ndarray]:
    """Return forces (q, 2) [N] on the skin, and minus their slopes (q, 2, 2) [N/m] by its movement."""
    push, along = state.push, state.along
    force = points.area[:, None] * (STIFFNESS * state.over[:, None] * push + state.drag[:, None] * along)
    slipping = np.where(state.stuck, 0.0, friction * np.sign(state.drag))[:, None]
    weight = (points.area * (state.over > 0.0))[:, None, None]
    slope = STIFFNESS * (push + slipping * along)[:, :, None] * push[:, None, :]
    slope = slope + TANGENTIAL * state.stuck[:, None, None] * along[:, :, None] * along[:, None, :]
    return force, weight * slope


def settle(
    band: Band,
    bodies: Sequence[Indenter],
    friction: float = 0.4,
    shares: Sequence[tuple[float, float]] | None = None,
) -> list[Settled]:
    """Compute the equilibria of bodies on the skin as they come down and then slide.

    Args:
        band: the skin.
        bodies: bodies on it.
        friction: Coulomb's coefficient.
        shares: share of their depths and share of their slides at each requested state, from an unloaded skin; None:
            down in one step, then aside in two if a body slides.

    Returns:
        A list with a `Settled` for each of `shares`.

    Raises:
        InputError: a depth or radius is impossible, or the bodies crowd the skin so that no equilibrium is found.
    """
    radius = float(band.outer(np.zeros(1))[0])
    _check(bodies, radius)
    if shares is None:
        shares = [(1.0, 0.0), (1.0, 0.5), (1.0, 1.0)] if any(each.slide for each in bodies) else [(1.0, 0.0)]
    if not bodies:
        return [Settled(np.zeros(len(band.compliance)), *np.zeros((3, 0)))] * len(shares)
    points = _points(band, bodies)
    freedom = (2 * points.nodes[:, None] + np.arange(2)).ravel()
    soft = band.compliance[np.ix_(freedom, freedom)]
    nodal = np.zeros(len(freedom))
    place, anchor = points.place, np.zeros(len(points.place))
    state: _State | None = None
    settled: list[Settled] = []
    for down, aside, asked in _finer(bodies, shares):
        placed = _placed(bodies, points, radius, down, aside)
        here = _state(placed, place, anchor, 0.0)
        anchor = here.side
        if state is not None:
            anchor = np.where(state.over > 0.0, state.side + state.drag / TANGENTIAL, here.side)
        nodal, place, state = _balanced(points, placed, soft, nodal, anchor, friction)
        if not asked:
            continue
        full = np.zeros(len(band.compliance))
        full[freedom] = nodal
        force = 2.0 * _blocks(points, state, friction)[0]  # both halves
        pressure = points.area * state.over
        settled.append(Settled(full, *_summed(points, place, force, pressure, len(bodies))))
    return settled


def _finer(bodies: Sequence[Indenter], shares: Sequence[tuple[float, float]]) -> list[tuple[float, float, bool]]:
    """Add steps between the requested ones, so that no round body moves further than half its radius.

    Returns depth share, slide share, and whether the step was requested.
    """
    steps: list[tuple[float, float, bool]] = []
    before = (0.0, 0.0)
    for down, aside in shares:
        way = [abs(down - before[0]) * b.depth / (0.5 * b.radius) for b in bodies if b.kind != "plate"]
        count = max(1, *(int(np.ceil(each - 1e-9)) for each in way)) if way else 1
        for at in range(1, count + 1):
            share = at / count
            steps.append((before[0] + share * (down - before[0]), before[1] + share * (aside - before[1]), at == count))
        before = (down, aside)
    return steps


def _balanced(
    points: _Points,
    bodies: _Bodies,
    soft: np.ndarray,
    nodal: np.ndarray,
    anchor: np.ndarray,
    friction: float,
) -> tuple[np.ndarray, np.ndarray, _State]:
    """Run Newton's iteration of one step, from the last step's nodal forces."""
    for turn in range(ROUNDS):
        moved = (soft @ nodal).reshape(-1, 2)
        place = points.place + (SHAPE @ moved[points.index]).reshape(-1, 2)
        state = _state(bodies, place, anchor, friction)
        force, slope = _blocks(points, state, friction)
        wrong = _gathered(points, force) - nodal
        if np.abs(wrong).max() < CLOSE:
            return nodal, place, state
        better = _newton(points, slope, _gathered(points, force), moved.ravel(), soft)
        nodal = better if turn < ROUNDS // 4 else 0.5 * (nodal + better)
    raise InputError(
        "no equilibrium of the pressing bodies was found.",
        hint="Use less depth, or larger distances between the bodies.",
    )


def _gathered(points: _Points, force: np.ndarray) -> np.ndarray:
    """Return the nodal forces (2 n,) of forces at the points (q, 2)."""
    spread, size = points.index.ravel(), len(points.nodes)
    sums = [np.bincount(spread, (force[:, a].reshape(-1, FINE**2) @ SHAPE).ravel(), size) for a in range(2)]
    return np.stack(sums, axis=-1).ravel()


def _newton(points: _Points, slope: np.ndarray, force: np.ndarray, moved: np.ndarray, soft: np.ndarray) -> np.ndarray:
    """Solve (I + A G) f = F + A u for nodal forces (2 n,), the linear balance on the nodes that A = N' a K N reaches.

    Args:
        points: points of contact.
        slope: (q, 2, 2) [N/m] slope at each.
        force: (2 n,) [N] present contact force.
        moved: (2 n,) [m] present movement of the nodes.
        soft: their compliance.
    """
    bricks = slope.reshape(-1, FINE**2, 4)
    active = np.flatnonzero(bricks.any(axis=(1, 2)))
    index = points.index[active]
    near = np.zeros(len(points.nodes), dtype=int)
    near[index.ravel()] = 1
    own = np.flatnonzero(np.repeat(near, 2))
    place = np.cumsum(np.repeat(near, 2)) - 1
    freedom = place[2 * index[:, :, None] + np.arange(2)]  # bricks, 9, 2
    block = (bricks[active].transpose(0, 2, 1) @ PAIRS).reshape(-1, 2, 2, 9, 9).transpose(0, 3, 1, 4, 2)
    rows, columns = np.broadcast_arrays(freedom[:, :, :, None, None], freedom[:, None, None])
    stiff = sparse.csr_matrix((block.ravel(), (rows.ravel(), columns.ravel())), shape=(len(own), len(own)))
    matrix = np.asarray(stiff @ soft[np.ix_(own, own)]) + np.eye(len(own))
    found = np.zeros(len(force))
    found[own] = np.linalg.solve(matrix, force[own] + stiff @ moved[own])
    return found


def _summed(
    points: _Points, place: np.ndarray, force: np.ndarray, pressure: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the angle of the centre of pressure, inward force there and shear, of each body (count,)."""
    weight = np.bincount(points.owner, pressure, count)
    touched = weight > 0.0
    scale = np.where(touched, weight, 1.0)
    centre = np.stack([np.bincount(points.owner, pressure * place[:, a], count) / scale for a in range(2)], axis=-1)
    total = np.stack([np.bincount(points.owner, force[:, a], count) for a in range(2)], axis=-1)
    angle = np.where(touched, np.arctan2(centre[:, 1], centre[:, 0]), np.nan)
    out = np.nan_to_num(np.stack([np.cos(angle), np.sin(angle)], axis=-1))
    return angle, -(total * out).sum(axis=1), (total * _turned(out)).sum(axis=1)
