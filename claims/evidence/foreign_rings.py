"""Contacts on rings of other mechanics than the barrel's, each calibrated by presses as a user makes them.

An elastic ring on a foundation and a half-space's surface (`palpate_lab.simulation.foreign_rings`); the calibration has
a plate and a tip of 10 mm at a friction of 0.4, the contacts are of tips of 6 and 15 mm at a friction of 0.1 to 0.8.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from claims.row import Row
from palpate.sensors.marker_ring.locator import RingLocator, turned
from palpate.sensors.marker_ring.response_fit import RingPresses, fit_response
from palpate_lab.simulation.foreign_rings import FOREIGN, MARKERS, OUTER, ForeignRing, PressedIn, Pressing

NOISE = np.full((len(MARKERS), 2), 0.02e-3)  # m
DEPTHS, DRAG, BENCH = (0.002, 0.004, 0.006, 0.008, 0.01), 0.002, 0.4  # m, m, friction of the calibration
FRICTIONS, RADII = (0.1, 0.4, 0.8), (0.006, 0.015)
KINDS = {  # angle [deg] and force [N] that are wanted, and the seed of what is drawn
    "one contact": (0.4, 0.05, 11),
    "one dragged": (0.4, 0.05, 11),
    "two with 30 degrees between them": (None, 0.1, 20),
}
WHAT = ("angle [deg]", "force [N]", "shear [N]")
Errors = Float[np.ndarray, "n 6"]  # angle [rad], force and shear [N], each with its deviation


def rows(small: bool) -> Iterator[Row]:
    """Each laboratory and kind: mean errors, how often intervals hold, and the number found; judged in full only."""
    for name in list(FOREIGN)[: 1 if small else None]:
        single = 0.0
        for kind, (most, newtons, _) in list(KINDS.items())[: 2 if small else None]:
            tried = [
                _tried(name, seed, kind, *((8, 1) if small else (24, 30))) for seed in ((1,) if small else (1, 2, 3))
            ]
            errors = np.concatenate([each for unit in tried for each, _ in unit])
            right = np.mean([each for unit in tried for _, each in unit])
            off = np.abs(errors[:, ::2]).mean(axis=0) * (180.0 / np.pi, 1.0, 1.0)
            single = single or off[0]
            bounds = (2.0 * single if most is None else most, newtons, None)
            for k, (what, bound) in enumerate(zip(WHAT, bounds, strict=True)):
                yield _row(f"{name}, {kind}: {what}", errors[:, 2 * k : 2 * k + 2], bound, off[k], small)
            number = f"{name}, {kind}: number right, {sum(map(len, tried))} frames"
            yield Row(number, ">= 99 %", f"{right:.1%}", small or bool(right >= 0.99))


def _row(what: str, errors: Float[np.ndarray, "n 2"], bound: float | None, off: float, small: bool) -> Row:
    held = float(np.mean(np.abs(errors[:, 0]) <= 1.96 * errors[:, 1]))
    target = ("" if bound is None else f"<= {bound:.2g}, ") + "intervals hold 90 to 97 %"
    met = (bound is None or off <= bound) and 0.9 <= held <= 0.97
    return Row(what, target, f"{off:.3f}, {held:.1%}", small or met)


@cache
def _unit(name: str, seed: int, angles: int) -> tuple[ForeignRing, RingLocator]:
    """Return a unit and what finds contacts on it, by ten presses an angle; deep ones of every fourth are dragged."""
    ring, rng = FOREIGN[name](seed), np.random.default_rng([51, seed])
    done, depths = list[PressedIn](), list[float]()
    for k in range(angles):
        for radius in (0.01, np.inf):
            angle = 2.0 * np.pi * (k + rng.random()) / angles
            for depth in DEPTHS[:: 1 if angles > 8 else 2]:
                slide = DRAG * float(rng.choice([-1.0, 1.0])) * (k % 4 == 0 and depth >= 0.006)
                done.append(ring.press([Pressing(angle, depth, radius, slide)], BENCH))
                depths.append(depth)
    angle, force, shear = (
        np.array([getattr(each, field)[0] for each in done]) for field in ("angle", "force", "shear")
    )
    seen = np.stack([_seen(each, rng) for each in done])
    response = fit_response(RingPresses(angle, np.array(depths), force, shear, seen, MARKERS, NOISE))
    return ring, RingLocator(response, MARKERS, NOISE, skin=(OUTER, ring.inner))


def _seen(pressed: PressedIn, rng: np.random.Generator) -> Float[np.ndarray, "m 2"]:
    return pressed.markers + NOISE * rng.standard_normal(NOISE.shape)


def _tried(name: str, seed: int, kind: str, angles: int, count: int) -> list[tuple[Errors, bool]]:
    """Return, frame by frame, errors of the contacts that were found and whether their number was right."""
    (ring, locator), rng = _unit(name, seed, angles), np.random.default_rng([52, seed, KINDS[kind][2]])
    found = list[tuple[Errors, bool]]()
    for friction in FRICTIONS:
        for radius in RADII:
            for _ in range(count):
                pressed = ring.press(_bodies(kind, radius, rng), friction)
                locator.reset()
                answer = locator.run(_seen(pressed, rng)[None])
                states = answer.states[0, : max(int(answer.counts[0]), 0)]
                found.append((_errors(states, pressed), len(states) == len(pressed.angle)))
    return found


def _bodies(kind: str, radius: float, rng: np.random.Generator) -> Sequence[Pressing]:
    angle, depths = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.003, 0.009, 2).tolist()
    if kind.startswith("two"):
        return [Pressing(angle + k * np.radians(30.0), depth, radius) for k, depth in enumerate(depths)]
    slide = rng.choice([-1.0, 1.0]) * rng.uniform(0.0005, 0.003) if kind.endswith("dragged") else 0.0
    return [Pressing(angle, depths[0], radius, slide)]


def _errors(states: Float[np.ndarray, "c 9"], pressed: PressedIn) -> Errors:
    off = turned(states[:, :1] - pressed.angle)
    mine, true = linear_sum_assignment(np.abs(off))
    states = states[mine]
    force, shear = states[:, 1] - pressed.force[true], states[:, 1] * states[:, 3] - pressed.shear[true]
    return np.stack([off[mine, true], states[:, 4], force, states[:, 5], shear, states[:, 8]], axis=1)
