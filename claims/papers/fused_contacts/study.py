"""Touches by the thousand, and how far each way of reading them is off."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from claims.papers.fused_contacts.bench import Body, Conditions, Touch, box, forearm, touch
from claims.papers.fused_contacts.theirs import IDynTree
from palpate.sensors.fused.lasting_unseen import fuse_with_unseen
from palpate.sensors.fused.locator import Fused, FusedLocator, FusionSettings
from palpate_lab.peers.skin_peers import minimum_norm

BODIES: dict[str, Callable[[np.random.Generator], Body]] = {"forearm": forearm, "box": box}
_HELD = 7.814727903251179  # squared distance within which a Gaussian force in three axes is in 95 % of cases
_CHI = 16.811893829770927  # the same of a wrench, 99 %


@dataclass(frozen=True)
class Sizes:
    """How much is drawn: bodies, touches of each; for unseen places bodies and touches."""

    bodies: int = 50
    touches: int = 30
    searched: int = 50
    searches: int = 20


@dataclass(frozen=True)
class Forces:
    """Errors of contacts [N]: ours, the skin's, minimum norm's, iDynTree's; shares held and where cones bind."""

    ours: np.ndarray
    skin: np.ndarray
    shortest: np.ndarray
    idyntree: np.ndarray
    held: float
    bound: float


@dataclass(frozen=True)
class Alarms:
    """Shares: of false alarms, ours and of a chi-square; of unseen contacts found, newtons -> share."""

    false: float
    chi: float
    found: dict[float, float]


@dataclass(frozen=True)
class Places:
    """One unseen contact: share that the 95 % region holds, its share of the area, errors of place [m] and forces.

    `inside` is the share of the seen contacts' 95 % ellipsoids of force that hold it.
    """

    count: int
    force: float
    held: float
    area: float
    off: np.ndarray
    seen: np.ndarray
    unseen: np.ndarray
    inside: float


def _settings(now: Conditions) -> FusionSettings:
    """The skin's own error is told; that forces are uniform in a disc of 0.5 and bound by 0.6 is assumed throughout."""
    return FusionSettings(friction=0.6, tangential=0.25, gain=now.gain)


def forces(kind: str, count: int, now: Conditions, sizes: Sizes, seed: int, others: bool = True) -> Forces:
    """Forces of `count` contacts that are all seen."""
    rng, theirs = np.random.default_rng([seed, count]), IDynTree() if others else None
    errors: list[list[np.ndarray]] = [[], [], [], []]
    held, bound = list[bool](), list[bool]()
    for _ in range(sizes.bodies):
        body = BODIES[kind](rng)
        locator = FusedLocator(body.mesh(), _settings(now))
        for _ in range(sizes.touches):
            made = touch(body, count, rng, now)
            found = locator.fuse(*made.seen(count))
            ways = [found.force, -made.normals * made.felt[:, None]]
            if theirs is not None:
                ways += [minimum_norm(made.points, made.wrench), theirs.forces(made.points, made.wrench)]
            for kept, way in zip(errors, ways, strict=False):
                kept.append(np.linalg.norm(way - made.forces, axis=1))
            held += _inside(found, made)
            bound.append(bool(found.bound.any()))
    every = [np.concatenate(each) if each else np.full(1, np.nan) for each in errors]
    return Forces(*every, float(np.mean(held)), float(np.mean(bound)))


def _inside(found: Fused, made: Touch) -> list[bool]:
    off = found.force - made.forces
    blocks = [found.covariance[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] for i in range(len(off))]
    return [float(e @ np.linalg.solve(block, e)) < _HELD for e, block in zip(off, blocks, strict=True)]


def alarms(kind: str, count: int, extra: tuple[float, ...], now: Conditions, sizes: Sizes, seed: int) -> Alarms:
    """Alarms beside `count` contacts that are seen, without and with one that is not."""
    rng = np.random.default_rng([seed, count, 1])
    told: dict[float | None, list[Fused]] = {force: [] for force in (None, *extra)}
    for _ in range(sizes.bodies):
        body = BODIES[kind](rng)
        locator = FusedLocator(body.mesh(), _settings(now))
        for _ in range(sizes.touches):
            for force, kept in (*told.items(), (None, told[None])):  # twice without: false alarms are rare
                kept.append(locator.fuse(*touch(body, count, rng, now, force).seen(count)))
    share = {force: float(np.mean([found.alarm for found in kept])) for force, kept in told.items()}
    chi = float(np.mean([found.surprise[0] > _CHI for found in told[None]]))
    return Alarms(share[None], chi, {force: share[force] for force in extra})


def places(kind: str, count: int, force: float, now: Conditions, sizes: Sizes, seed: int) -> Places:
    """Where an unseen contact of `force` [N] is found beside `count` that are seen."""
    rng = np.random.default_rng([seed, count, 2])
    rows = list[tuple[bool, float, float]]()
    seen, unseen, inside = list[np.ndarray](), list[float](), list[bool]()
    for _ in range(sizes.searched):
        body = BODIES[kind](rng)
        locator = FusedLocator(body.mesh(), _settings(now))
        for _ in range(sizes.searches):
            made = touch(body, count, rng, now, force)
            contacts, wrench = locator.rows(*made.seen(count)[:5]), made.seen(count)[5:]
            found = locator.fuse_frames(contacts, np.array([count]), *wrench)
            ranked = locator.unseen_by(found.whitened[0], found.factors[0])
            apart = np.linalg.norm(ranked.points - made.places[-1], axis=1)
            off = float(apart[0])
            apart[ranked.normals @ made.normals[-1] < 0.5] = np.inf  # round an edge: another contact, however near
            rows.append((bool(ranked.region[apart.argmin()]), float(ranked.region.mean()), off))
            both = fuse_with_unseen(locator, contacts, np.array([count]), locator.unseen_rows(ranked)[None], *wrench)
            off = both.force - made.forces
            spreads = both.spread[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
            square = np.einsum("ni,ni->n", off, np.linalg.solve(spreads, off[..., None])[..., 0])
            inside += (square[:-1] <= _HELD).tolist()
            wrong = np.linalg.norm(off, axis=1)
            seen.append(wrong[:-1])
            unseen.append(float(wrong[-1]))
    held, area, distance = (np.array(each) for each in zip(*rows, strict=True))
    off = distance, np.concatenate(seen), np.array(unseen)
    return Places(count, force, float(held.mean()), float(area.mean()), *off, float(np.mean(inside)))
