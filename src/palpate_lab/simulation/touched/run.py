"""Run the touched forearm: logs of both sensors and their truth, in memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.errors import InputError
from palpate.signals.recording import Recording
from palpate.spatial._arrays import Value, frozen
from palpate_lab.simulation.skin_bench import PaperSheet, paper_sheet
from palpate_lab.simulation.touched.body import Physics, simulate_physics
from palpate_lab.simulation.touched.plan import COMING, RAMP, PlannedTouch, period, plan_presses, plan_touches
from palpate_lab.simulation.touched.sensors import inertia, loads, motion, skin_frames, true_mass, wrench_log
from palpate_lab.simulation.touched.settings import GRAVITY, STEP_RATE, ForearmSettings

Watch = Callable[[int, float], None]


@dataclass(frozen=True, eq=False)
class ForearmTruth(Value):
    """True contacts, a row per contact and sample of the skin, in the link's frame, from the engine.

    Attributes:
        frame: (m,) number of the skin's sample.
        time: (m,) [s] on the clock of wrench and poses.
        touch: (m,) number of the touch: the same as long as it lasts.
        point: (m, 3) [m] the engine's contact point: below the surface by half of its indentation, < 0.2 mm.
        normal: (m, 3) out of the link.
        force: (m, 3) [N] on the link.
        share: (m,) share of the normal force that lies on cells.
        speed: (m,) [m/s] of the indenter along the surface.
    """

    frame: Int[np.ndarray, " m"]
    time: Float[np.ndarray, " m"]
    touch: Int[np.ndarray, " m"]
    point: Float[np.ndarray, "m 3"]
    normal: Float[np.ndarray, "m 3"]
    force: Float[np.ndarray, "m 3"]
    share: Float[np.ndarray, " m"]
    speed: Float[np.ndarray, " m"]

    @property
    def seen(self) -> Bool[np.ndarray, " m"]:
        """True for contacts that lie mostly on cells, (m,)."""
        return self.share > 0.5

    def at(self, frame: int) -> slice:
        """Return the slice of the rows of a sample of the skin."""
        first, last = np.searchsorted(self.frame, [frame, frame + 1]).tolist()
        return slice(first, last)


@dataclass(frozen=True, eq=False)
class ForearmRun(Value):
    """The recordings of a run, and their truth.

    Attributes:
        settings: settings as the user knows them: `mass` is that of the payload model.
        mass: true mass [kg].
        sheet: model of the readings of the skin's cells.
        touches: planned touches.
        wrench: FORCE, TORQUE and ORIENTATION, in the sensor's frame, at `wrench_rate`.
        skin: CELLS at `skin_rate`, with `clock_offset` added to its times.
        contacts: (n, 6) [N, N m] of all contacts about the sensor's origin, in its frame, at the times of `wrench`.
        zero: (n, 6) [N, N m] true bias of the sensor, drift included, at the times of `wrench`.
        truth: true contacts.
        stationary: (c,) samples in which configurations of `simulate_presses` are settled; else empty.
    """

    settings: ForearmSettings
    mass: float
    sheet: PaperSheet
    touches: tuple[PlannedTouch, ...]
    wrench: Recording
    skin: Recording
    contacts: Float[np.ndarray, "n 6"]
    zero: Float[np.ndarray, "n 6"]
    truth: ForearmTruth
    stationary: Int[np.ndarray, " c"]


def simulate_forearm(
    rng: np.random.Generator, settings: ForearmSettings | None = None, watch: Watch | None = None
) -> ForearmRun:
    """Simulate a log of `settings.seconds` with touches that begin, overlap, slide, are dragged and end.

    Returns a `ForearmRun`.

    Args:
        rng: random numbers of everything drawn: the same ones give the same run to the last bit.
        settings: None: the usual ones.
        watch: function called with the number of samples done, and the share that is done.

    Raises:
        InputError: MuJoCo is not installed.
        RuntimeError: the engine warned, and its results cannot be trusted.
    """
    settings = settings or ForearmSettings()
    return _run(settings, plan_touches(settings, rng), settings.seconds, rng, watch)


def simulate_presses(
    rng: np.random.Generator,
    configurations: int,
    settings: ForearmSettings | None = None,
    *,
    settle: float = 0.3,
    watch: Watch | None = None,
) -> ForearmRun:
    """Simulate configurations of `settings.touches` touches at once, one after the other, for `settle` [s] each.

    They are in one log, the `ForearmRun` returned, which begins with `quiet` seconds without touch; `stationary` has
    the sample in which each is settled, and `truth.at(frame)` the truth there. For Monte Carlo.

    Raises:
        InputError: MuJoCo is not installed, or `configurations` or `settle` is not positive.
        RuntimeError: the engine warned, and its results cannot be trusted.
    """
    settings = settings or ForearmSettings()
    if configurations < 1 or not settle > 0:
        raise InputError(f"configurations must be 1 or more and settle above 0 s, not {configurations} and {settle} s.")
    touches = plan_presses(settings, rng, configurations, settle)
    seconds = settings.quiet + configurations * period(settle) + 0.1
    made = _run(replace(settings, seconds=seconds), touches, seconds, rng, watch)
    starts = settings.quiet + COMING + period(settle) * np.arange(configurations)
    held: Int[np.ndarray, " c"] = np.floor((starts + RAMP + settle) * settings.skin_rate + 1e-6).astype(np.int64)
    return replace(made, stationary=held)


def simulate_free(
    rng: np.random.Generator, settings: ForearmSettings, seconds: float, mass: float | None = None
) -> Recording:
    """Simulate the force/torque sensor's log of a forearm without contact: weight, inertia, bias, drift and noise.

    Returns a `Recording` with channels FORCE [N], TORQUE [N m] and ORIENTATION (quaternions x, y, z, w).

    Args:
        rng: random numbers of everything drawn.
        settings: settings of the forearm.
        seconds: duration of the log [s].
        mass: true mass of the link [kg], as in `ForearmRun.mass`; None: drawn.
    """
    real = true_mass(settings, rng) if mass is None else replace(settings, mass=mass)
    rotations, quaternions = motion(settings, _steps(seconds), rng)
    return wrench_log(settings, _weight(real, rotations) + inertia(real, rotations), quaternions, rng)[0]


def _run(
    settings: ForearmSettings,
    touches: Sequence[PlannedTouch],
    seconds: float,
    rng: np.random.Generator,
    watch: Watch | None,
) -> ForearmRun:
    real = true_mass(settings, rng)
    model = paper_sheet(settings.sheet, rng, noise=settings.cell_noise, unequal=settings.unequal)
    steps = _steps(seconds)
    rotations, quaternions = motion(settings, steps, rng)
    physics = simulate_physics(real, touches, rotations, watch)
    frames = -(-steps * settings.skin_rate // STEP_RATE)
    radius = np.array([each.radius for each in touches])[physics.touch] if len(physics.touch) else np.zeros(0)
    pressed, share = loads(settings.sheet, physics, frames, modulus=settings.modulus, radius=radius)
    log, zero = wrench_log(settings, physics.wrench + inertia(real, rotations), quaternions, rng)
    contacts = physics.wrench - _weight(real, rotations)
    return ForearmRun(
        settings,
        real.mass,
        model,
        tuple(touches),
        log,
        skin_frames(settings, model, pressed, rng),
        frozen(contacts[:: STEP_RATE // settings.wrench_rate]),
        frozen(zero),
        _truth(physics, settings, share),
        np.zeros(0, dtype=np.int64),
    )


def _truth(physics: Physics, settings: ForearmSettings, share: Float[np.ndarray, " m"]) -> ForearmTruth:
    time = physics.frame / settings.skin_rate
    places = physics.point, physics.normal, physics.force
    return ForearmTruth(physics.frame, frozen(time), physics.touch, *places, frozen(share), physics.speed)


def _weight(settings: ForearmSettings, rotations: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 6"]:
    """Return the wrench of the link's weight, about the sensor's origin and in its frame."""
    weight = -GRAVITY * settings.mass * rotations[:, 2]
    return np.concatenate([weight, np.cross(settings.mount.apply(np.array(settings.centre)), weight)], axis=1)


def _steps(seconds: float) -> int:
    return max(2, round(seconds * STEP_RATE))
