"""Simulate a skin in use: a round fingertip on it, one at a time or two at once, as samples with their truth.

Pressure is Hertz's, p sqrt(1 - r^2/a^2), on a disc that grows with the force, a = a1 F^(1/3) (Johnson, Contact
Mechanics, 4.2), and goes through the same layer as the tip of pokes. The truth is the middle of the disc.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError
from palpate.spatial._arrays import Value, frozen
from palpate_lab.simulation.forearm import Forearm, places_near
from palpate_lab.simulation.poke_bench import PokeBench

RATE = 50.0  # Hz, of frames
RADIUS = 3e-3  # m: a1, of the disc at 1 N: 4 to 6 mm from 2 to 8 N
FORCES = 2.0, 8.0  # N, bounds of a finger's force, evenly between, along the inward normal
REACH = 4e-3  # m from a taxel within which a finger lands
HOLD, PAUSE = 12, 8  # samples of each touch, and of rest before it
RAMP = 3  # samples at each end of a touch during which the force rises or falls
_TRIES = 400


@dataclass(frozen=True, eq=False)
class SkinTouches(Value):
    """Samples and their truth; m contacts in all, those of one touch one after the other.

    Attributes:
        time: (n,) [s] of each sample.
        frames: (n, k) counts of the samples, rest included.
        rest: (k,) counts without touch.
        touch: (m,) number of the touch that a contact belongs to, from 0.
        start, end: (m,) first and last sample with the full force.
        point, normal: (m, 3) point [m] and outward normal, in the frame of the link.
        force: (m, 3) [N] on the body, in the frame of the link.
    """

    time: Float[np.ndarray, " n"]
    frames: Float[np.ndarray, "n k"]
    rest: Float[np.ndarray, " k"]
    touch: Int[np.ndarray, " m"]
    start: Int[np.ndarray, " m"]
    end: Int[np.ndarray, " m"]
    point: Float[np.ndarray, "m 3"]
    normal: Float[np.ndarray, "m 3"]
    force: Float[np.ndarray, "m 3"]

    def __post_init__(self) -> None:
        for name in ("time", "frames", "rest", "point", "normal", "force"):
            object.__setattr__(self, name, frozen(getattr(self, name), name=name))

    def truth(self) -> Float[np.ndarray, "r 10"]:
        """Return rows of time [s], point [m], normal and force [N], (r, 10).

        There is a row for each contact in each sample with its full force.
        """
        sizes = self.end - self.start + 1
        which = np.repeat(np.arange(len(sizes)), sizes)
        frame = self.start[which] + np.arange(len(which)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        rows = np.column_stack([self.time[frame], self.point[which], self.normal[which], self.force[which]])
        return rows[np.argsort(frame, kind="stable")]


def simulate_touches(
    bench: PokeBench,
    rng: np.random.Generator,
    touches: int = 100,
    *,
    spacing: float | None = None,
    counts: bool = True,
) -> SkinTouches:
    """Simulate touches at random places all over the skin, and return the `SkinTouches`.

    Args:
        bench: bench with the skin, its layer and gains.
        rng: random numbers of places, forces, rest and noise.
        touches: number of touches.
        spacing: distance [m] between two at once, along the skin; None: one at a time.
        counts: True for integer counts of 8 bits, False for floats with noise, without a limit.

    Raises:
        InputError: no two places at this distance are both on the skin.
    """
    skin = bench.skin
    points = _pairs(skin, rng, touches, spacing) if spacing else places_near(skin, rng, touches, reach=REACH)
    touch = np.repeat(np.arange(touches), 2 if spacing else 1)
    newtons = rng.uniform(*FORCES, len(points))
    x, y, load = hertz_discs(RADIUS * np.cbrt(newtons), newtons)
    which, taxel, exact = bench.answers(points, x, y, load)
    peaks = np.zeros((touches, len(skin.places)))
    np.add.at(peaks, (touch[which], taxel), exact)
    period = HOLD + PAUSE
    phase = np.arange(period) - PAUSE
    share = np.clip(np.minimum(phase + 1, HOLD - phase) / (RAMP + 1), 0.0, 1.0)
    frames = np.concatenate([(peaks[:, None] * share[:, None]).reshape(touches * period, -1), 0 * peaks[:1]])
    rest = rng.integers(3, 9, peaks.shape[1]).astype(np.float64)
    frames = rest + frames + bench.layer.noise * rng.standard_normal(frames.shape)
    start = touch * period + PAUSE + RAMP
    normal = skin.frame(points)[0][:, 2]
    return SkinTouches(
        np.arange(len(frames)) / RATE,
        np.clip(np.rint(frames), 0.0, 255.0) if counts else frames,
        rest,
        touch,
        start,
        start + HOLD - 2 * RAMP - 1,
        points,
        normal,
        -newtons[:, None] * normal,
    )


def hertz_discs(
    radius: Float[np.ndarray, " n"], newtons: Float[np.ndarray, " n"], rings: int = 8
) -> tuple[Float[np.ndarray, "n c"], Float[np.ndarray, "n c"], Float[np.ndarray, "n c"]]:
    """Return points that bear equal areas of discs under Hertz's pressure, and the force on each.

    Args:
        radius: (n,) [m] of the discs.
        newtons: (n,) [N] force on each disc.
        rings: number of rings of points, twice as many points in each.
    """
    ring = np.repeat(np.sqrt((np.arange(rings) + 0.5) / rings), 2 * rings)
    angle = pi * np.arange(ring.size) / rings + 2.4 * np.repeat(np.arange(rings), 2 * rings)
    weight = np.sqrt(1.0 - ring**2)
    flat = np.stack([ring * np.cos(angle), ring * np.sin(angle)])
    x, y = flat[:, None] * radius[:, None]
    return x, y, newtons[:, None] * weight / weight.sum()


def _pairs(skin: Forearm, rng: np.random.Generator, count: int, apart: float) -> Float[np.ndarray, "m 3"]:
    """Draw pairs of points, both near a taxel, at the distance `apart` along the skin."""
    from scipy.spatial import cKDTree

    there = np.flatnonzero(skin.places.there)
    tree = cKDTree(skin.places.positions[there])
    kept: list[np.ndarray] = []
    for _ in range(_TRIES):
        taxel = there[rng.integers(len(there), size=4 * count)]
        angle, turn = rng.uniform(0.0, 2 * pi, (2, len(taxel)))
        near = (REACH * np.sqrt(rng.random(len(taxel))))[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        away = near + apart * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        pair = np.stack([skin.offset_from(taxel, near), skin.offset_from(taxel, away)], axis=1)
        kept.append(pair[np.asarray(tree.query(pair)[0]).max(axis=1) < REACH])
        if sum(map(len, kept)) >= count:
            return np.concatenate(kept)[:count].reshape(-1, 3)
    raise InputError(f"no two places of the skin have a distance of {1e3 * apart:.0f} mm.", where="touches")
