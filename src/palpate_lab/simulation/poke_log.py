"""Simulate a session of pokes over time: the arm goes to each configuration, rests, and is poked.

In addition to the pokes the sensor reads its bias, the weight of the forearm, the bias of the configuration (at rest as
in touch: the reading before a poke is subtracted), and white noise. The arm moves slowly: inertia is neglected.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8

from palpate.spatial._arrays import Value, frozen
from palpate_lab.simulation.poke_bench import PokeSession

RATE = 200.0  # Hz, of wrenches
EVERY = 4  # samples: taxels come at 50 Hz
_GRAVITY = np.array([4.9, -2.9, 7.98])  # m/s^2 in the sensor's frame: the upper arm stands still
_MASS, _MIDDLE = 0.9, np.array([0.004, -0.003, 0.11])  # kg, m in the link's frame, of forearm and hand
_HOME = np.radians([60.0, -30.0])  # of the elbow, between configurations
_CHUNK = 1024  # frames at once


@dataclass(frozen=True)
class Timing:
    """Times [s] of a session, and the noise of its readings.

    Args:
        period: time from poke to poke; the paper's is 3.
        ramp: time in which the force rises, and falls.
        hold: time at full force between the ramps.
        rest: time untouched in each configuration before its first poke, and at the start.
        move: time of the motion from home to a configuration, and back.
        force, torque: white noise of one reading [N], [N m].
    """

    period: float = 1.5
    ramp: float = 0.15
    hold: float = 0.3
    rest: float = 2.0
    move: float = 1.5
    force: float = 0.05
    torque: float = 0.002

    def __post_init__(self) -> None:
        if not self.period > 2 * self.ramp + self.hold:
            raise ValueError("a period must be longer than a poke")


@dataclass(frozen=True, eq=False)
class PokeLog(Value):
    """The record that a robot makes of a session.

    Attributes:
        time: (n,) [s] at 200 Hz.
        wrench: (n, 6) [N, N m] as read.
        joints: (n, 2) [rad] j3 and j4.
        taxels: (m, k) counts of every fourth sample, rest included.
        rest: (k,) counts without touch.
        start, end: (p,) [s] between which each poke has its full force.
        session: the session, with the truth.
    """

    time: Float[np.ndarray, " n"]
    wrench: Float[np.ndarray, "n 6"]
    joints: Float[np.ndarray, "n 2"]
    taxels: UInt8[np.ndarray, "m k"]
    rest: Float[np.ndarray, " k"]
    start: Float[np.ndarray, " p"]
    end: Float[np.ndarray, " p"]
    session: PokeSession

    def __post_init__(self) -> None:
        for name in ("time", "wrench", "joints", "rest", "start", "end"):
            object.__setattr__(self, name, frozen(getattr(self, name), name=name))
        self.taxels.flags.writeable = False

    def table(self) -> tuple[tuple[str, ...], Float[np.ndarray, "m c"]]:
        """Return the log at 50 Hz: a tuple of the columns' names, and a row per time (m, c).

        The columns are time [s], wrench [N, N m], joints [rad], and counts of the taxels.
        """
        names = ("time", *("fx", "fy", "fz", "tx", "ty", "tz"), "elbow_pitch", "elbow_roll")
        rows = slice(None, None, EVERY)
        numbers = np.column_stack([self.time[rows], self.wrench[rows], self.joints[rows], self.taxels])
        return (*names, *(f"t{k}" for k in range(self.taxels.shape[1]))), numbers


def simulate_poke_log(session: PokeSession, rng: np.random.Generator, timing: Timing | None = None) -> PokeLog:
    """Simulate a session's pokes one after the other, configuration by configuration, and return the `PokeLog`.

    Args:
        session: session whose pokes are in the order of their configurations.
        rng: random numbers of noise, bias and rest.
        timing: None: quicker than the paper's.

    Raises:
        ValueError: a configuration comes back after another one.
    """
    timing = timing or Timing()
    row = session.pokes.configuration
    if np.any(np.diff(row) < 0):
        raise ValueError("pokes must be in the order of their configurations")
    joints, configuration, begin = _journey(session, timing)
    time = np.arange(len(joints)) / RATE
    start, end = begin + timing.ramp, begin + timing.ramp + timing.hold
    poke = np.clip(np.searchsorted(begin, time, side="right") - 1, 0, max(len(row) - 1, 0))
    share = np.minimum((time - begin[poke]) / timing.ramp, (end[poke] + timing.ramp - time) / timing.ramp)
    share = np.clip(share, 0.0, 1.0)
    bench = session.bench
    pose = bench.arm.pose(joints[:, 0], joints[:, 1])
    wrench = rng.normal(0.0, np.repeat([2.0, 0.2], 3)) + bench.bias[configuration]
    wrench[:, :3] += _MASS * _GRAVITY
    wrench[:, 3:] += np.cross(pose.apply(_MIDDLE), _MASS * _GRAVITY)
    wrench += share[:, None] * (session.pokes.wrench - bench.bias[row])[poke]
    wrench += rng.standard_normal(wrench.shape) * np.repeat([timing.force, timing.torque], 3)
    rest = rng.integers(3, 9, session.pokes.taxels).astype(np.float64)
    taxels = _frames(session, rest, poke[::EVERY], share[::EVERY], rng)
    return PokeLog(time, wrench, joints, taxels, rest, start, end, session)


def _journey(
    session: PokeSession, timing: Timing
) -> tuple[Float[np.ndarray, "n 2"], Int[np.ndarray, " n"], Float[np.ndarray, " p"]]:
    """Return joints and configuration at each sample, and the time at which each poke begins."""
    counts = np.bincount(session.pokes.configuration, minlength=1)
    rest, period = round(timing.rest * RATE), round(timing.period * RATE)
    ease = (1 - np.cos(np.pi * np.arange(1, round(timing.move * RATE) + 1) / round(timing.move * RATE)))[:, None] / 2
    at, configuration = [np.tile(_HOME, (rest, 1))], [np.zeros(rest, dtype=np.int64)]
    begin: list[np.ndarray] = [np.zeros(0)]
    length = rest
    for number in np.flatnonzero(counts).tolist():
        there = session.bench.arm.joints[number]
        still = rest + period * int(counts[number])
        first = length + len(ease) + rest
        begin.append(first + period * np.arange(int(counts[number])))
        at += [_HOME + ease * (there - _HOME), np.tile(there, (still, 1)), there + ease * (_HOME - there)]
        length = first + period * int(counts[number]) + len(ease)
        configuration.append(np.full(still + 2 * len(ease), number))
    return np.concatenate(at), np.concatenate(configuration), np.concatenate(begin) / RATE


def _frames(
    session: PokeSession,
    rest: Float[np.ndarray, " k"],
    poke: Int[np.ndarray, " m"],
    share: Float[np.ndarray, " m"],
    rng: np.random.Generator,
) -> UInt8[np.ndarray, "m k"]:
    """Compute the counts, some thousand samples at a time, because a large skin's do not fit in memory as floats."""
    touches, noise = session.touches, session.bench.layer.noise
    order = np.argsort(touches.poke, kind="stable")
    bounds = np.searchsorted(touches.poke[order], np.arange(len(session.pokes) + 1))
    frames = np.empty((len(poke), len(rest)), dtype=np.uint8)
    for first in range(0, len(poke), _CHUNK):
        rows = slice(first, first + _CHUNK)
        exact = rest + noise * rng.standard_normal((len(poke[rows]), len(rest)), dtype=np.float32)
        for k in np.flatnonzero(share[rows] > 0).tolist():
            pairs = order[bounds[poke[first + k]] : bounds[poke[first + k] + 1]]
            exact[k, touches.taxel[pairs]] += share[first + k] * touches.response[pairs]
        frames[rows] = np.clip(np.rint(exact), 0, 255)
    return frames
