"""Motions of the phantom: a height and angles over time, with their velocities, in closed form.

The phantom's frame has its origin in the middle of the flat surface and its z along the outward normal. At rest x and y
lie along the probe's long side and across it, so that turning about y is the paper's in-plane motion and turning about
x its out-of-plane motion. T_rest_phantom(t) = translation (0, 0, h), then R = Ry(a) Rx(b) Rz(c).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, pi, radians, sin

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError

Profile = Callable[[float], tuple[float, float]]  # seconds since the motion began -> value and rate


@dataclass(frozen=True)
class Still:
    """A profile that does not move."""

    def __call__(self, time: float) -> tuple[float, float]:
        """Return value and rate, both zero."""
        return 0.0, 0.0


@dataclass(frozen=True)
class Sine:
    """A sine, A sin(2 pi t / T), equation (11): it starts with its full velocity.

    Attributes:
        amplitude: A [m] or [rad].
        period: T [s].
    """

    amplitude: float
    period: float

    def __call__(self, time: float) -> tuple[float, float]:
        """Return value and rate at a time [s]."""
        rate = 2 * pi / self.period
        return self.amplitude * sin(rate * time), self.amplitude * rate * cos(rate * time)


@dataclass(frozen=True)
class Breathing:
    """A rise along a half cosine over two fifths of the period, a fall over three fifths; velocity without steps.

    Attributes:
        amplitude: difference of highest and lowest [m].
        period: period [s].
    """

    amplitude: float
    period: float = 4.0

    def __call__(self, time: float) -> tuple[float, float]:
        """Return value and rate at a time [s]."""
        within, rising = time % self.period, 0.4 * self.period
        up = within < rising
        length = rising if up else self.period - rising
        rate, phase = pi / length, pi * (within if up else within - rising) / length
        sign = 1.0 if up else -1.0
        return self.amplitude / 2 * (1.0 - sign * cos(phase)), sign * self.amplitude / 2 * rate * sin(phase)


@dataclass(frozen=True)
class Step:
    """A step from zero to a value along 10 s^3 - 15 s^4 + 6 s^5, the path of least jerk.

    Attributes:
        size: value after the step [m] or [rad].
        at: start of the step, seconds after the motion began.
        duration: duration [s].
    """

    size: float
    at: float
    duration: float = 0.1

    def __call__(self, time: float) -> tuple[float, float]:
        """Return value and rate at a time [s]."""
        s = min(max((time - self.at) / self.duration, 0.0), 1.0)
        return self.size * s**3 * (10 - 15 * s + 6 * s * s), self.size * 30 * s * s * (1 - s) ** 2 / self.duration


@dataclass(frozen=True)
class Sum:
    """A sum of several profiles."""

    parts: tuple[Profile, ...]

    def __call__(self, time: float) -> tuple[float, float]:
        """Return value and rate at a time [s]."""
        pairs = [part(time) for part in self.parts]
        return sum(pair[0] for pair in pairs), sum(pair[1] for pair in pairs)


@dataclass(frozen=True)
class SurfaceMotion:
    """Height [m] and angles [rad] of the surface over time; still before the motion begins.

    Attributes:
        height: along the base's z.
        in_plane, out_of_plane: about the surface's y and x.
        spin: about its normal.
        begin: start of the motion on the lab's clock [s].
    """

    height: Profile = Still()
    in_plane: Profile = Still()
    out_of_plane: Profile = Still()
    spin: Profile = Still()
    begin: float = 2.0

    def offset(self, time: float) -> Float[np.ndarray, "6 3"]:
        """Return pose and velocity of the phantom in its frame at rest, at a time [s].

        Returns:
            (6, 3): rows 0 to 2 the rotation, then the origin's place [m], its velocity [m/s], angular velocity [rad/s].
        """
        since = time - self.begin
        still = Still() if since < 0.0 else None
        profiles = (self.height, self.in_plane, self.out_of_plane, self.spin)
        (h, dh), (a, da), (b, db), (c, dc) = ((still or profile)(since) for profile in profiles)
        ca, sa, cb, sb, cc, sc = cos(a), sin(a), cos(b), sin(b), cos(c), sin(c)
        return np.array(
            [(ca * cc + sa * sb * sc, sa * sb * cc - ca * sc, sa * cb), (cb * sc, cb * cc, -sb),
             (ca * sb * sc - sa * cc, sa * sc + ca * sb * cc, ca * cb), (0.0, 0.0, h), (0.0, 0.0, dh),
             (db * ca + dc * sa * cb, da - dc * sb, dc * ca * cb - db * sa)]
        )  # fmt: skip


def unplanned(
    seed: int, *, direction: str = "in-plane", amplitude: float | None = None, step_at: float | None = None,
    begin: float = 2.0,
) -> SurfaceMotion:  # fmt: skip
    """Make a `SurfaceMotion` of three sines with random periods (2.5 to 9 s), shares and signs, and a step if wanted.

    Args:
        seed: seed of the periods and shares.
        direction: vertical, in-plane or out-of-plane.
        amplitude: most that the sines reach together [m] or [rad]; None: 8 mm or 8 deg.
        step_at: start of a step of 10 mm or 10 deg within 0.1 s, in seconds after the beginning; None: no step.
        begin: start of the motion on the lab's clock [s].

    Raises:
        InputError: no such direction.
    """
    rng = np.random.default_rng(seed)
    unit = 1e-3 if direction == "vertical" else radians(1.0)
    total = 8 * unit if amplitude is None else amplitude
    periods, shares = rng.uniform(2.5, 9.0, 3), rng.dirichlet(np.full(3, 4.0)) * rng.choice([-1.0, 1.0], 3)
    parts: list[Profile] = [Sine(total * s, p) for s, p in zip(shares.tolist(), periods.tolist(), strict=True)]
    if step_at is not None:
        parts.append(Step(10 * unit, step_at))
    return _along(direction, Sum(tuple(parts)), begin)


def _along(direction: str, profile: Profile, begin: float) -> SurfaceMotion:
    if direction == "vertical":
        return SurfaceMotion(height=profile, begin=begin)
    if direction == "in-plane":
        return SurfaceMotion(in_plane=profile, begin=begin)
    if direction == "out-of-plane":
        return SurfaceMotion(out_of_plane=profile, begin=begin)
    raise InputError(f"the direction {direction!r} is unknown.", hint="Use vertical, in-plane or out-of-plane.")


MOTIONS = ("still", "vertical", "in-plane", "out-of-plane", "breathing", "unplanned")


def motion(name: str, *, period: float | None = None, seed: int = 0, begin: float = 2.0) -> SurfaceMotion:
    """Make a `SurfaceMotion` by its name, with the paper's amplitudes: 10 mm or 10 deg.

    Args:
        name: one of `MOTIONS`.
        period: period of the sines and of breathing [s]; None: 10 and 4.
        seed: seed of the unplanned motion, which turns in-plane and steps after 10 s.
        begin: start of the motion on the lab's clock [s].

    Raises:
        InputError: no such motion, or a period that is not positive.
    """
    if period is not None and not 0.0 < period < np.inf:
        raise InputError(f"a period must be a positive number of seconds, not {period:g}.")
    if name == "still":
        return SurfaceMotion(begin=begin)
    if name == "breathing":
        return SurfaceMotion(height=Breathing(0.010, period or 4.0), begin=begin)
    if name == "unplanned":
        return unplanned(seed, step_at=10.0, begin=begin)
    if name not in MOTIONS:
        raise InputError(f"the motion {name!r} is unknown.", hint=f"Use one of {', '.join(MOTIONS)}.")
    amplitude = 0.010 if name == "vertical" else radians(10.0)
    return _along(name, Sine(amplitude, period or 10.0), begin)
