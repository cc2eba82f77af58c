"""The bench of `load_cells`: a ball slides over a fingertip on force cells, eight times, and everything is recorded.

The ball's geometry, the balance of the frame and an elastic foundation make the readings; no estimator does.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate_lab.simulation.ball_on_ellipse import FINGERTIP, Ellipse, pressed_wrench
from palpate_lab.simulation.cell_array import LAYOUTS, CellArray, random_cells
from palpate_lab.simulation.contacts import contact_wrenches

RATE, CUTOFF, ORDER = 1000.0, 100.0, 2  # Hz, Hz: of all signals
SPEED = 2.5e-3  # m/s: of the stages
REST, APPROACH, PRESS, HOLD, BREAK_AWAY, PAUSE = 2.0, 0.25, 1.0, 0.5, 0.3, 30.0  # s
HOVER = 0.5e-3  # m: of the ball, where it does not touch
LEAST, CANTILEVER = (
    1.0,
    2e3,
)  # N, N/m: pressed by the one, and by the other for every metre that the surface rises: to 5 N
REFERENCE_NOISE, RULER_NOISE = 17e-3, 1e-6  # N, m
BIAS = 20e-3  # V: of a channel when it was switched on
KNOTS = 25.0  # Hz: at which the pressure of a soft layer is summed; splines in between

PATHS = (  # mm: from (x, y) to (x, y) of the contact; three along y, three along x, and two across that meet them
    ((-9.0, -13.0), (-9.0, 13.0)),
    ((0.0, 13.0), (0.0, -13.0)),
    ((9.0, -13.0), (9.0, 13.0)),
    ((-10.0, -12.0), (10.0, -12.0)),
    ((10.0, 0.0), (-10.0, 0.0)),
    ((-10.0, 12.0), (10.0, 12.0)),
    ((-10.0, -13.0), (10.0, 13.0)),
    ((10.0, -13.0), (-10.0, 13.0)),
)


@dataclass(frozen=True)
class BenchRun:
    """Readings of the bench and their truth, passed through the same low-pass.

    Attributes:
        time: time [s]; it jumps where a trajectory ended and the next was set up.
        trajectory: number of the path that a sample belongs to.
        voltages: (n, 3k) [V], cell by cell, x, y, z in each.
        force: (n, 3) [N] on the fingertip, from the reference sensor, with its noise.
        position: (n, 3) [m] centre of the ball, from the stages, with their noise.
        loaded: True while the ball touches.
        point, normal: (n, 3) foot of the ball's centre on the undeformed surface, touching or not [m], and its normal.
        wrench: (n, 6) [N, N m] on the fingertip about the origin.
        torque: torque about the normal [N m].
        friction: coefficient of friction.
        indentation: indentation of the layer below the point [m].
    """

    time: Float[np.ndarray, " n"]
    trajectory: Int[np.ndarray, " n"]
    voltages: Float[np.ndarray, "n m"]
    force: Float[np.ndarray, "n 3"]
    position: Float[np.ndarray, "n 3"]
    loaded: Bool[np.ndarray, " n"]
    point: Float[np.ndarray, "n 3"]
    normal: Float[np.ndarray, "n 3"]
    wrench: Float[np.ndarray, "n 6"]
    torque: Float[np.ndarray, " n"]
    friction: Float[np.ndarray, " n"]
    indentation: Float[np.ndarray, " n"]

    def __post_init__(self) -> None:
        for value in vars(self).values():
            value.flags.writeable = False

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, which: slice | np.ndarray) -> BenchRun:
        """Return the samples that a slice, a mask or numbers select."""
        return BenchRun(**{name: value[which].copy() for name, value in vars(self).items()})


@dataclass(frozen=True, eq=False)
class Bench:
    """A fingertip on its bench; each run of it is independent of the others, and identified by its number.

    Args:
        noise: noise [N] an axis behind the filter, of the sum of all cells, or of one cell if `per_cell`.
        per_cell: True if the noise is that of one cell.
        reference_noise: noise [N] an axis behind the filter, of the reference sensor.
        layer: stiffness [N/m^3] of the soft layer, an elastic foundation; None is rigid.
        drift: standard deviation [V] of the channels' drift at the end of a trajectory.
        friction: bounds between which the coefficient varies while the ball slides.
        torsion: largest soft-finger torque [N m] about the normal, which varies too.
        layout: (k, 3) [m] positions of the cells; None is the paper's four.
        twist: stiffness of a cell against turning [N m/rad]; see `CellArray`.
        paths: trajectories of the contact [mm].
        ellipse: cross-section of the fingertip.
        radius: radius of the ball [m].
        seed: seed of the cells, and of all runs.
    """

    noise: float = 2e-3
    per_cell: bool = False
    reference_noise: float = REFERENCE_NOISE
    layer: float | None = None
    drift: float = 0.0
    friction: tuple[float, float] = (0.1, 0.6)
    torsion: float = 0.0
    layout: Float[np.ndarray, "k 3"] | None = None
    twist: float = 0.0
    paths: tuple[tuple[tuple[float, float], tuple[float, float]], ...] = PATHS
    ellipse: Ellipse = FINGERTIP
    radius: float = 2e-3
    seed: int = 0

    def cells(self) -> CellArray:
        """Return the cells, which only a simulation knows, as a `CellArray`."""
        position = LAYOUTS[4] if self.layout is None else self.layout
        return random_cells(position, np.random.default_rng([self.seed, 0]), twist=self.twist)

    def channel_noise(self) -> float:
        """Return the noise [V] of every channel behind the filter, as a data sheet would state it."""
        return self.cells().voltage_noise(self.noise, array=not self.per_cell)

    def run(self, number: int = 0, *, thin: int = 1) -> BenchRun:
        """Record all trajectories once, each from a new start, and return a `BenchRun`.

        It has every `thin`-th sample behind the filter.

        Raises:
            GeometryError: the cells of `layout` are in line, and have no `twist`.
        """
        parts: list[BenchRun] = []
        for k, path in enumerate(self.paths):
            rng = np.random.default_rng([self.seed, 1, number, k])
            begin = parts[-1].time[-1] + PAUSE if parts else 0.0
            parts.append(self._trajectory(k, path, begin, rng)[::thin])
        return BenchRun(**{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(BenchRun)})

    def _trajectory(
        self, number: int, path: tuple[tuple[float, float], tuple[float, float]], begin: float, rng: np.random.Generator
    ) -> BenchRun:
        course = _Course.along(self, path, rng)
        wrench, depth = course.rigid() if self.layer is None else course.soft(self.layer)
        gap = HOVER * np.clip((REST + APPROACH - course.time) / APPROACH, 0.0, 1.0)
        centre = course.point + (self.radius - depth + gap)[:, None] * course.normal
        cells, smooth = self.cells(), _LowPass()
        size = self.channel_noise()
        volts = smooth(cells.voltages(wrench)) + smooth.noise(rng, len(wrench), 3 * cells.count) * size
        wrench = smooth(wrench)
        return BenchRun(
            time=begin + course.time,
            trajectory=np.full(len(wrench), number),
            voltages=volts + self._bias(course.time, 3 * cells.count, rng),
            force=wrench[:, :3] + smooth.noise(rng, len(wrench), 3) * self.reference_noise,
            position=smooth(centre) + smooth.noise(rng, len(wrench), 3) * RULER_NOISE,
            loaded=course.time > REST + APPROACH,
            point=smooth(course.point),
            normal=smooth(course.normal),
            wrench=wrench,
            torque=smooth(course.torque),
            friction=smooth(course.friction),
            indentation=smooth(depth),
        )

    def _bias(self, time: Float[np.ndarray, " n"], channels: int, rng: np.random.Generator) -> np.ndarray:
        """Return every channel's initial bias, and its drift while a temperature settles at a new value."""
        warm = (1.0 - np.exp(-2.0 * time / time[-1])) / (1.0 - np.exp(-2.0))
        return rng.normal(0.0, BIAS, channels) + warm[:, None] * rng.normal(0.0, 1.0, channels) * self.drift


BENCHES = {
    "rigid": Bench(),
    "soft layer": Bench(layer=3e8),
    "drift": Bench(drift=0.5e-3),
}


@dataclass(frozen=True)
class _Course:
    """A trajectory, sample by sample: at rest, down, pressed, and off along the path."""

    time: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    motion: np.ndarray  # of the ball over the surface, a unit vector
    load: np.ndarray  # N, downward
    friction: np.ndarray
    torque: np.ndarray
    bench: Bench

    @classmethod
    def along(
        cls, bench: Bench, path: tuple[tuple[float, float], tuple[float, float]], rng: np.random.Generator
    ) -> _Course:
        """Create a course with friction and torque that vary between their bounds, each at a random pace."""
        start, end = 1e-3 * np.array(path)
        length = float(np.linalg.norm(end - start))
        before = REST + APPROACH + PRESS + HOLD
        time = np.arange(round((before + length / SPEED) * RATE)) / RATE
        slid = np.maximum(time - before, 0.0)
        at = start + (end - start) * (slid * SPEED / length)[:, None]
        point, normal = bench.ellipse.foot(at[:, 0], at[:, 1])
        motion = np.concatenate([np.broadcast_to(end - start, (len(time), 2)), np.zeros((len(time), 1))], axis=1)
        motion = motion + (-np.sum(motion * normal, axis=1) / normal[:, 2])[:, None] * [0.0, 0.0, 1.0]  # uphill too
        motion /= np.linalg.norm(motion, axis=1, keepdims=True)
        height = point[:, 2] + bench.radius * normal[:, 2]
        pressed = _ease((time - REST - APPROACH) / PRESS)
        low, high = bench.friction
        return cls(
            time,
            point,
            normal,
            motion,
            pressed * (LEAST + CANTILEVER * (height - height.min())),
            _ease(slid / BREAK_AWAY) * (low + (high - low) * (0.5 + 0.5 * _wander(slid, rng))),
            pressed * bench.torsion * _wander(slid, rng),
            bench,
        )

    def rigid(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the wrench of N (mu t - n) at the point with its torque, and no indentation."""
        direction = self.friction[:, None] * self.motion - self.normal
        force = (self.load / -direction[:, 2])[:, None] * direction
        return contact_wrenches(self.point, self.normal, force, self.torque), np.zeros(len(self.time))

    def soft(self, stiffness: float) -> tuple[np.ndarray, np.ndarray]:
        """Return wrench and indentation of a layer that is pressed until it carries the load."""
        from scipy.interpolate import CubicSpline

        step = round(RATE / KNOTS)
        knots = np.unique(np.r_[np.arange(0, len(self.time), step), len(self.time) - 1])
        knots = knots[self.load[knots] > 0.0]
        few = replace(self, **{f.name: getattr(self, f.name)[knots] for f in fields(self) if f.name != "bench"})
        depth = np.sqrt(few.load / (np.pi * stiffness * self.bench.radius))  # of a shallow touch on a flat layer
        for _ in range(3):  # what is carried grows about as depth squared: an error falls twentyfold
            wrench = few.pressed(stiffness, depth)
            depth = depth * np.sqrt(few.load / -wrench[:, 2])
        first = max(int(knots[0]) - 1, 0)
        time, later = np.r_[self.time[first], few.time], slice(first, None)
        values = np.concatenate([np.zeros((1, 7)), np.c_[few.pressed(stiffness, depth), depth]])
        filled = np.zeros((len(self.time), 7))
        filled[later] = CubicSpline(time, values)(self.time[later])
        filled[:, 3:6] += self.torque[:, None] * self.normal
        return filled[:, :6], filled[:, 6]

    def pressed(self, stiffness: float, depth: np.ndarray) -> np.ndarray:
        """Return the wrench of an elastic foundation, which is the same all along y."""
        x, y = self.point[:, 0], self.point[:, 1]
        wrench = pressed_wrench(self.bench.ellipse, self.bench.radius, stiffness, x, depth, self.friction, self.motion)
        aside = np.stack([np.zeros_like(y), y, np.zeros_like(y)], axis=1)
        wrench[:, 3:] += np.cross(aside, wrench[:, :3])
        return wrench


class _LowPass:
    """The Butterworth low-pass in front of the recorder, settled at the first sample."""

    def __init__(self) -> None:
        from scipy.signal import butter, sosfilt, sosfilt_zi

        self._sections: Any = butter(ORDER, CUTOFF, fs=RATE, output="sos")
        self._start: Any = sosfilt_zi(self._sections)
        self._filter: Any = sosfilt
        response = self._filter(self._sections, np.r_[1.0, np.zeros(1000)])
        self._passed = float(np.linalg.norm(response))

    def __call__(self, values: np.ndarray) -> np.ndarray:
        start = self._start.reshape(-1, 2, *([1] * (values.ndim - 1))) * values[0]
        return np.asarray(self._filter(self._sections, values, axis=0, zi=start)[0])

    def noise(self, rng: np.random.Generator, count: int, channels: int) -> np.ndarray:
        """Return noise that is white in front of the filter, and of standard deviation 1 behind it."""
        early = 100  # samples until it has forgotten how it began
        white = rng.normal(size=(count + early, channels)) / self._passed
        return np.asarray(self._filter(self._sections, white, axis=0))[early:]


def _ease(share: np.ndarray) -> np.ndarray:
    """Rise from 0 to 1 without a jolt."""
    return 0.5 - 0.5 * np.cos(np.pi * np.clip(share, 0.0, 1.0))


def _wander(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return a swing between -1 and 1 of a random pace and phase."""
    return np.sin(2 * np.pi * (rng.uniform(0.1, 0.4) * time + rng.uniform()))
