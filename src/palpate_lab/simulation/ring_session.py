"""Sessions of the simulated marker ring: the calibration of the paper, with two bodies, and touches that move.

Protocol [marker ring, IV]: a plate pressed at many angles and depths of 1 to 10 mm. Here a narrow round tip as well,
and some of the bodies are dragged sideways, so that the record includes friction.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float, Int, UInt8

from palpate_lab.simulation.barrel import Barrel, Indenter, Pressed
from palpate_lab.simulation.barrel_elasticity import COARSE_ROWS, BarrelSettings
from palpate_lab.simulation.ring_camera import Look, RenderedCamera, RingCamera

RATE = 30.0  # Hz
REST = 1.0  # s without load before anything else
DRAG = 0.002  # m
RAMP = 0.2  # s from the first touch to the full depth
APART = np.radians(30.0)  # between touches at once
SPEED = (0.01, 0.1)  # m/s
RINGS = (0.0, 0.01, -0.01)  # m, heights of rings of markers
STILL = 1e-5  # m a frame: less is not smeared


@dataclass(frozen=True)
class RingUnit:
    """A made unit: its barrel, its camera, and the look of the scene."""

    barrel: BarrelSettings
    camera: RingCamera
    look: Look
    seed: int

    @staticmethod
    def drawn(seed: int, *, coarse: bool = False, look: Look | None = None, rings: int = 1) -> RingUnit:
        """Draw a `RingUnit` as it leaves the mould: wall, silicone and camera differ a little from the next.

        Args:
            seed: seed of the differences.
            coarse: fewer bricks.
            look: look of the scene; None: the usual one.
            rings: number of rings of markers, 1 to 3, at distances of 10 mm.
        """
        rng = np.random.default_rng([seed, 14])
        settings = BarrelSettings(seed=seed, rings=RINGS[:rings])
        if coarse:
            settings = replace(settings, around=48, rows=COARSE_ROWS)
        wall, stiff = 1.0 + 0.03 * rng.standard_normal(), 1.0 + 0.05 * rng.standard_normal()
        settings = replace(settings, thickness=wall * settings.thickness, modulus=stiff * settings.modulus)
        return RingUnit(settings, RingCamera.drawn(rng), look or Look(), seed)


@dataclass(frozen=True)
class Faults:
    """Faults of images.

    Attributes:
        hidden: number of markers behind something dark, other ones in every image.
        blobs: number of spurious red blobs, elsewhere in every image.
        black: numbers of images without light.
        frozen: number of the image that is repeated from then on; None: none.
    """

    hidden: int = 0
    blobs: int = 0
    black: tuple[int, ...] = ()
    frozen: int | None = None


@dataclass(frozen=True)
class Protocol:
    """The presses of a calibration.

    Attributes:
        angles: number of angles around the ring, for each body.
        depths: depths [m] at each, from the shallowest.
        tip: radius of the narrow bodies [m].
        hold: number of images at each depth.
        pause: number of images without load between touches.
        dragged: one in this many touches ends with a drag of 2 mm to either side; 0: none.
        kinds: kinds of the bodies, in turns; see `Indenter`.
    """

    angles: int = 36
    depths: tuple[float, ...] = tuple(0.001 * at for at in range(1, 11))
    tip: float = 0.01
    hold: int = 2
    pause: int = 2
    dragged: int = 4
    kinds: tuple[Literal["plate", "tip", "cylinder"], ...] = ("plate", "tip")

    @staticmethod
    def sized(*, small: bool = False, angles: int | None = None) -> Protocol:
        """Return the usual `Protocol`, or a small one of half the depths at two thirds of the angles."""
        if small:
            return Protocol(angles or 24, (0.002, 0.004, 0.006, 0.008, 0.01), hold=1, pause=1)
        return Protocol(angles or 36)


@dataclass(frozen=True)
class Touching:
    """Touches by round tips, some of them rolling along the ring.

    Attributes:
        touches: number of touches, each by one tip or by several at once.
        most: largest number of tips at once.
        tip: radius of a tip [m].
        depth: least and largest depth [m].
        moving: share of the touches that move, at 10 to 100 mm/s.
        seed: seed of everything drawn.
    """

    touches: int = 12
    most: int = 2
    tip: float = 0.01
    depth: tuple[float, float] = (0.003, 0.008)
    moving: float = 0.5
    seed: int = 0


@dataclass(frozen=True, eq=False)
class RingSession:
    """A session with its truth.

    Attributes:
        unit: unit that was touched.
        time: (n,) [s] middle of each exposure.
        markers: (n, m, 3) [m] centres.
        discs: (n, m, p, 3) [m] outlines.
        angle, depth, force, shear: (n, k) [rad], [m], [N], [N] of each contact; NaN where there is none.
        shutter: share of an image's period during which the shutter is open.
    """

    unit: RingUnit
    time: Float[np.ndarray, " n"]
    markers: Float[np.ndarray, "n m 3"]
    discs: Float[np.ndarray, "n m p 3"]
    angle: Float[np.ndarray, "n k"]
    depth: Float[np.ndarray, "n k"]
    force: Float[np.ndarray, "n k"]
    shear: Float[np.ndarray, "n k"]
    shutter: float = 0.0

    @property
    def contacts(self) -> Int[np.ndarray, " n"]:
        """Number of contacts in each image, (n,)."""
        return np.isfinite(self.angle).sum(axis=1, dtype=int)

    @property
    def strongest(self) -> float:
        """The largest force [N] of a contact."""
        return float(np.nan_to_num(self.force).max())

    def frames(self, look: Look | None = None, faults: Faults | None = None) -> Iterator[UInt8[np.ndarray, "h w 3"]]:
        """Yield the images (h, w, 3), blue first; they are the same every time.

        Args:
            look: look of the scene; None: the unit's.
            faults: faults of the images; None: none.

        Raises:
            InputError: OpenCV is not installed.
        """
        faults = faults or Faults()
        rng = np.random.default_rng([self.unit.seed, 41])
        seen = RenderedCamera(self.unit.camera, look or self.unit.look, rng)
        frame = seen.black()
        for at, time in enumerate(self.time.tolist()):
            if at in faults.black:
                frame = seen.black()
            elif faults.frozen is None or at <= faults.frozen:
                hidden = rng.choice(self.markers.shape[1], faults.hidden, replace=False).tolist()
                frame = seen.frame(self._exposed(at), time, hidden=hidden, blobs=faults.blobs)
            yield frame

    def _exposed(self, at: int) -> list[Float[np.ndarray, "m p 3"]]:
        """Return outlines at instants while the shutter is open: one if nothing moves."""
        discs, last = self.discs[at], len(self.time) - 1
        change = (self.discs[min(at + 1, last)] - self.discs[max(at - 1, 0)]) / 2.0
        moved = self.shutter > 0.0 and float(np.abs(change).max()) > STILL
        return [discs + part * self.shutter * change for part in ((-1 / 3, 0.0, 1 / 3) if moved else (0.0,))]


def _nothing(_: int, __: float) -> None:
    """Ignore the progress."""


def calibration_run(
    unit: RingUnit, protocol: Protocol | None = None, watch: Callable[[int, float], None] = _nothing
) -> RingSession:
    """Simulate one second of rest, then each kind of body at every angle, from the shallowest depth to the deepest.

    Returns a `RingSession`.

    Args:
        unit: unit to calibrate.
        protocol: None: 36 angles, 10 depths.
        watch: function called with the number of images so far, and the share that is done.

    Raises:
        InputError: scikit-fem is not installed, or a depth is impossible.
    """
    protocol = protocol or Protocol()
    barrel = Barrel.built(unit.barrel)
    rest = barrel.press([])
    states = [rest] * round(REST * RATE)
    kinds = len(protocol.kinds)
    count = kinds * protocol.angles
    for at in range(count):
        place, which = divmod(at, kinds)
        kind, turn = protocol.kinds[which], 2.0 * np.pi * (place + which / kinds) / protocol.angles
        drag = bool(protocol.dragged) and place % protocol.dragged == which
        # a dragged touch ends at one depth or another, so that shear is seen at all of them
        depths = protocol.depths[: 1 + place % len(protocol.depths)] if drag else protocol.depths
        body = Indenter(kind, turn, depths[-1], protocol.tip, DRAG if drag else 0.0)
        shares = [(depth / depths[-1], 0.0) for depth in depths]
        if drag:
            shares += [(1.0, aside) for aside in (0.5, 1.0, 0.0, -1.0)]
        states += [each for each in barrel.follow([body], shares) for _ in range(protocol.hold)]
        states += [rest] * protocol.pause
        watch(len(states), (at + 1) / count)
    return _recorded(unit, states, 1, 0.0)


def touching_run(
    unit: RingUnit, touching: Touching | None = None, watch: Callable[[int, float], None] = _nothing
) -> RingSession:
    """Simulate one second of rest, then touches by round tips, with pauses; moving tips roll, without friction.

    Returns a `RingSession`.

    Args:
        unit: unit to touch.
        touching: settings of the touches; None: twelve touches, two at once at most.
        watch: function called with the number of images so far, and the share that is done.

    Raises:
        InputError: scikit-fem is not installed, a depth is impossible, or the tips crowd the skin.
    """
    touching = touching or Touching()
    rng = np.random.default_rng([touching.seed, 77])
    barrel = Barrel.built(unit.barrel)
    rest = barrel.press([])
    states = [rest] * round(REST * RATE)
    for at in range(touching.touches):
        states += _touched(barrel, unit.barrel.radius, touching, rng)
        states += [rest] * int(rng.integers(5, 15))
        watch(len(states), (at + 1) / touching.touches)
    return _recorded(unit, states, touching.most, 0.5)


def _touched(barrel: Barrel, radius: float, touching: Touching, rng: np.random.Generator) -> list[Pressed]:
    """Simulate a group of tips that comes down, stays or rolls along the ring, and leaves."""
    count = int(rng.integers(1, touching.most + 1))
    spare = 2.0 * np.pi - count * APART
    gaps = APART + spare * rng.dirichlet(np.ones(count))
    angles = rng.uniform(0.0, 2.0 * np.pi) + np.cumsum(gaps)
    depths = rng.uniform(*touching.depth, count)
    moving = rng.uniform() < touching.moving
    speed = rng.choice([-1.0, 1.0]) * SPEED[0] * (SPEED[1] / SPEED[0]) ** rng.uniform() / radius if moving else 0.0
    stay = rng.uniform(0.4, 1.0)
    states: list[Pressed] = []
    for time in np.arange(1.0 / RATE, 2 * RAMP + stay, 1.0 / RATE).tolist():
        share = min(1.0, time / RAMP, (2 * RAMP + stay - time) / RAMP)
        bodies = [
            Indenter("tip", float(angle + speed * time), float(share * depth), touching.tip)
            for angle, depth in zip(angles, depths, strict=True)
        ]
        states.append(barrel.press(bodies, 0.0 if moving else 0.4))
    return states


def _recorded(unit: RingUnit, states: list[Pressed], most: int, shutter: float) -> RingSession:
    """Return states as a session, a row per state; contacts are in the order of their bodies."""
    truth: Float[np.ndarray, "4 n k"] = np.full((4, len(states), most), np.nan)
    for at, each in enumerate(states):
        here = each.force > 0.0
        turn = each.angle % (2.0 * np.pi)
        rows = np.stack([turn, each.depth, each.force, each.shear])
        truth[:, at, : len(here)] = np.where(here, rows, np.nan)
    return RingSession(
        unit,
        np.arange(len(states)) / RATE,
        np.stack([each.markers for each in states]),
        np.stack([each.discs for each in states]),
        *truth,
        shutter=shutter,
    )
