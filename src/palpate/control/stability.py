"""Check the stability of a loop with delay by the spectral radius of one cycle, and reject unstable gains.

A cycle takes the state x (velocity, estimate, commands under way, servo) to A x. It decays if, and only if, every
eigenvalue of A lies inside the unit circle.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.spatial._arrays import Value, frozen
from palpate.spatial.arguments import frozen_value

Rows = Float[np.ndarray, "k n"]
_UNITS = {"force": ("N s/m", "N/m", "kg"), "orientation": ("m s/rad", "m/rad", "m s^2/rad")}
_FINE = 60  # halvings of a bracket: to rounding


@dataclass(frozen=True)
class Admittance:
    """A mass with a damper that an error pushes: M dv/dt + D v = error, (7) and (8) of `probe`.

    It is integrated by explicit Euler: v_k = v_{k-1} + dt/M (error - D v_{k-1}). In steady state v = error / D,
    reached with the time constant M/D if dt D/M < 2; `require_stable` checks it against an environment.

    Args:
        mass: [kg] for a force, [m s^2/rad] for a contact point.
        damping: [N s/m] for a force, [m s/rad] for a contact point.

    Raises:
        InputError: one of them is not positive and finite.
    """

    mass: float
    damping: float

    def __post_init__(self) -> None:
        if not (0 < self.mass < math.inf and 0 < self.damping < math.inf):
            raise InputError(f"mass ({self.mass}) and damping ({self.damping}) must be positive.")

    def step(self, velocity: float, error: float, dt: float) -> float:
        """Return the velocity of this cycle [m/s for a force, rad/s for a contact point]; 0 if it is not finite.

        Args:
            velocity: of the last cycle.
            error: [N] of the force, or [m] of the contact point.
            dt: [s] between two cycles.
        """
        found = velocity + dt / self.mass * (error - self.damping * velocity)
        return found if math.isfinite(found) else 0.0


@frozen_value
class DelayedRobot(Value):
    """Model of the path from a command to the reading that feels it, in cycles of the controller.

    Args:
        dt: length of a cycle [s].
        delay: cycles that a command waits; with 0 the next reading feels it fully.
        ramp: whether the robot moves linearly from one command to the next over a cycle, instead of at once.
        lag: [s] of the servo; 0: none.
        order: of the servo; 1, or 2: critically damped, with natural frequency 2/lag.
        smoothing: [s] time constant of a first-order low-pass over the measurement; 0: none.

    Raises:
        InputError: dt is not positive; delay, lag or smoothing is negative; a time is not finite; or another order.
    """

    dt: float
    delay: int = 0
    ramp: bool = False
    lag: float = 0.0
    order: int = 1
    smoothing: float = 0.0
    _servo: Float[np.ndarray, "m k"] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        finite = all(map(math.isfinite, (self.dt, self.lag, self.smoothing)))
        if not (finite and self.dt > 0 and self.delay >= 0 and self.lag >= 0 and self.smoothing >= 0):
            raise InputError("a loop needs a dt above 0, and a delay, a lag and a smoothing of 0 or more.")
        if self.order not in (1, 2):
            raise InputError(f"the order of a servo must be 1 or 2, not {self.order}.")
        object.__setattr__(self, "_servo", frozen(self._discrete()))

    def _discrete(self) -> Float[np.ndarray, "m k"]:
        """Return exact rows of the servo's next state, from its state and the commands at a cycle's start and end."""
        if self.lag == 0:
            return np.zeros((0, 2))
        from scipy.linalg import expm  # here: it takes 0.1 s to import

        m = self.order
        flow = np.zeros((m + 2, m + 2))  # of position (and speed), command, and the command's rate
        if m == 1:
            flow[0, 0], flow[0, 1] = -1.0 / self.lag, 1.0 / self.lag
        else:
            w = 2.0 / self.lag
            flow[0, 1], flow[1, 0], flow[1, 1], flow[1, 2] = 1.0, -w * w, -2.0 * w, w * w
        flow[m, m + 1] = 1.0
        cycle = np.asarray(expm(flow * self.dt))[:m]
        held, rate = cycle[:, m], cycle[:, m + 1] / self.dt
        ends = np.stack([held - rate, rate] if self.ramp else [np.zeros(m), held], axis=1)
        return np.hstack([cycle[:, :m], ends])

    @property
    def size(self) -> int:
        """Number n of states: the commands under way, the servo, the smoothed reading."""
        return self.delay + 1 + len(self._servo) + 1

    def read(self, state: Rows) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Return the position at a reading and its smoothed value, (n,) each, from states (`size`, n) in columns."""
        position = state[self.delay + 1] if len(self._servo) else state[self.delay]
        share = 1.0 if self.smoothing == 0 else -math.expm1(-self.dt / self.smoothing)
        return position, state[-1] + share * (position - state[-1])

    def move(self, state: Rows, command: Float[np.ndarray, " n"], smoothed: Float[np.ndarray, " n"]) -> Rows:
        """Return the states (`size`, n) at the next reading; commands and smoothed values are (n,).

        state[0] is the previous command, state[1] the one before that.

        Raises:
            InputError: command or smoothed have another shape.
        """
        commands = np.vstack([command, state[: self.delay]])
        parts = [commands]
        if len(self._servo):
            parts.append(self._servo @ np.vstack([state[self.delay + 1 : -1], state[self.delay], commands[self.delay]]))
        return np.vstack([*parts, smoothed])


@dataclass(frozen=True)
class Tracker:
    """An estimator with fading memory and a prediction, which models a Kalman filter in steady state.

    Value and derivatives are predicted over a cycle and corrected by gains times the innovation. With
    p = exp(-bandwidth dt) the gains are 1 - p; 1 - p^2, (1 - p)^2; or 1 - p^3, 1.5 (1 - p)^2 (1 + p), (1 - p)^3: all
    poles lie at p (Morrison 1969). The command is the value `prediction` seconds later.

    Args:
        bandwidth: [rad/s] of the poles.
        prediction: [s] time over which the value is predicted.
        order: 0: constant value, 1: constant rate, 2: constant acceleration.

    Raises:
        InputError: another order, a bandwidth that is not positive, or a negative prediction.
    """

    bandwidth: float
    prediction: float = 0.0
    order: int = 1

    def __post_init__(self) -> None:
        if self.order not in (0, 1, 2) or not (0 < self.bandwidth < math.inf and 0 <= self.prediction < math.inf):
            raise InputError("a tracker needs order 0, 1 or 2, a bandwidth above 0 and a prediction of 0 s or more.")

    def gains(self, dt: float) -> Float[np.ndarray, " m"]:
        """Return the gains (order + 1,) of the value and its derivatives [1, 1/s, 1/s^2] for a cycle of dt > 0 [s]."""
        p = math.exp(-self.bandwidth * dt)
        q = 1.0 - p
        every = ((q,), (1 - p**2, q**2 / dt), (1 - p**3, 1.5 * q**2 * (1 + p) / dt, q**3 / dt**2))
        return np.array(every[self.order])

    def transition(self, time: float) -> Float[np.ndarray, "m m"]:
        """Return the matrix (order + 1, order + 1) that advances the value and its derivatives by `time` [s]."""
        whole = np.array([[1.0, time, 0.5 * time * time], [0.0, 1.0, time], [0.0, 0.0, 1.0]])
        return whole[: self.order + 1, : self.order + 1]


def _radius(size: int, cycle: Callable[[Rows], Rows]) -> float:
    """Return the spectral radius of a linear cycle."""
    return float(np.abs(np.linalg.eigvals(cycle(np.eye(size)))).max())


def admittance_radius(robot: DelayedRobot, admittance: Admittance, stiffness: float) -> float:
    """Compute the spectral radius of admittance (7) of `probe` against a spring, or of (8) on a round probe.

    The loop is stable below 1. One cycle reads y (smoothed: m), and with error = -K m

        v <- v + dt/M (-K m - D v),   command <- command + dt v

    For (8), K is the contact's offset per angle [m/rad], the probe's radius if it is round.

    Args:
        robot: its delay and lag.
        admittance: mass and damping.
        stiffness: K [N/m], or [m/rad].
    """
    dt = robot.dt

    def cycle(state: Rows) -> Rows:
        _, smoothed = robot.read(state[1:])
        speed = state[0] + dt / admittance.mass * (-stiffness * smoothed - admittance.damping * state[0])
        return np.vstack([speed, robot.move(state[1:], state[1] + dt * speed, smoothed)])

    return _radius(1 + robot.size, cycle)


def observer_radius(robot: DelayedRobot, tracker: Tracker, ratio: float) -> float:
    """Compute the spectral radius, stable below 1, of a loop that observes the surface and moves there.

    The surface's angle is taken as z = y - offset/R, with y the probe's angle and offset = R_true (y - surface): with
    g = R_true/R, z = (1 - g) y + g surface. Smoothing acts on the offset alone: y - g m. A command is the tracker's
    prediction from z. For heights, g is the true stiffness over the assumed one.

    Args:
        robot: its delay and lag.
        tracker: bandwidth and prediction.
        ratio: g, true over assumed.
    """
    predict, gains = tracker.transition(robot.dt), tracker.gains(robot.dt)
    known, out = len(gains), tracker.transition(tracker.prediction)[0]

    def cycle(state: Rows) -> Rows:
        position, smoothed = robot.read(state[known:])
        estimate = predict @ state[:known]
        estimate = estimate + np.outer(gains, position - ratio * smoothed - estimate[0])
        return np.vstack([estimate, robot.move(state[known:], out @ estimate, smoothed)])

    return _radius(known + robot.size, cycle)


def stiffest(robot: DelayedRobot, admittance: Admittance) -> float:
    """Return the stiffness at which the loop just ceases to be stable [N/m, m/rad]; 0 if no stiffness is stable."""
    first = 1e-4 * admittance.damping / robot.dt
    return _edge(first, 1e9 * first, lambda k: admittance_radius(robot, admittance, k) < 1.0)


def least_damping(robot: DelayedRobot, mass: float, stiffness: float) -> float:
    """Return the damping [N s/m, m s/rad] above which the loop is stable; infinite if no damping is enough.

    Raises:
        InputError: the mass is not positive.
    """
    most = 2.0 * mass / robot.dt  # beyond it the admittance alone is unstable

    def unstable(damping: float) -> bool:
        return admittance_radius(robot, Admittance(mass, damping), stiffness) >= 1.0

    found = _edge(1e-4 * most, most, unstable)
    return found if found < most else math.inf


def _edge(first: float, last: float, holds: Callable[[float], bool]) -> float:
    """Return where `holds` ceases; 0 if at once, `last` if nowhere."""
    if not holds(first):
        return 0.0
    low = first
    while holds(high := min(1.1 * low, last)):
        if high >= last:
            return last
        low = high
    for _ in range(_FINE):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return high


def require_stable(robot: DelayedRobot, admittance: Admittance, stiffness: float, what: str = "force") -> None:
    """Check that an admittance is stable against the stiffest environment.

    Args:
        robot: its delay and lag.
        admittance: mass and damping.
        stiffness: greatest of the environment [N/m] for a force; for an orientation, the displacement of the contact
            per angle [m/rad], the radius of a round probe.
        what: "force" or "orientation", for the units of the message.

    Raises:
        InputError: the loop is unstable (the message has the bound), or the stiffness is not positive.
        KeyError: the loop is unstable, and `what` is another word.
    """
    if not (0 < stiffness < math.inf):
        raise InputError(f"the stiffness of the {what} loop must be positive, not {stiffness}.")
    if admittance_radius(robot, admittance, stiffness) < 1.0:
        return
    of_damping, of_stiffness, of_mass = _UNITS[what]
    cycles = "1 cycle" if robot.delay == 1 else f"{robot.delay} cycles"
    said = (
        f"with a damping of {admittance.damping:g} {of_damping} and a mass of {admittance.mass:g} {of_mass} the {what} "
        f"loop is unstable against {stiffness:g} {of_stiffness} with {cycles} of delay"
    )
    if robot.lag:
        said += f" and {1e3 * robot.lag:g} ms of lag"
    raise InputError(f"{said}.", hint=_advice(robot, admittance, stiffness, what))


def _advice(robot: DelayedRobot, admittance: Admittance, stiffness: float, what: str) -> str:
    """Return a sentence that proposes a damping and, if needed, a mass."""
    of_damping, _, of_mass = _UNITS[what]
    least = least_damping(robot, admittance.mass, stiffness)
    if admittance.damping < least < math.inf:
        return f"Use a damping of at least {_up(least)} {of_damping}."
    most = stiffest(robot, admittance)
    if most == 0.0:
        return f"Use a mass above {_up(0.5 * robot.dt * admittance.damping)} {of_mass}: dt D/M must be below 2."
    scale = stiffness / most  # the radius depends on dt D/M and K dt^2/M alone
    return (
        f"Use a damping of at least {_up(scale * admittance.damping)} {of_damping} with a mass of "
        f"{_up(scale * admittance.mass)} {of_mass}."
    )


def _up(value: float) -> str:
    """Return a number as text with three digits, rounded up."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return f"{math.ceil(value / unit - 1e-9) * unit:.3g}"
