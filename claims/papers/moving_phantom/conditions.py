"""Everything that is run, by section of the page."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

from claims.papers.moving_phantom.study import Condition
from palpate.control.supervisor import Limits
from palpate_lab.simulation.phantom.lab import LabSettings
from palpate_lab.simulation.phantom.motion import Sine, motion, unplanned

SEED = 100  # the first: nothing was chosen on these
DIRECTIONS = ("in-plane", "out-of-plane")
PERIODS = (10, 5, 2)  # s
BEGIN = 3.0  # s: ours and the paper's law hold after 1.3 to 2.1
SOFT = 6.0  # s, the same on tissue that yields more
METHODS = {"soft finger": "", "iterative": "iterative", "wrench axis": "wrench axis"}
SPIN = Sine(0.35, 4.0)  # rad, about the normal
INERTIA = {
    "servo's model": "",
    "accelerometer": "accelerometer",
    "none": "no inertia",
    "late differences": "late inertia",
}
BOUNDED = "servo's model, joints that reach 30 rad/s^2 only"
BIAS = 0.02  # N, sideways
QUIET = {"force_noise": 0.01, "torque_noise": 0.375e-3}  # N, N m: a quarter of the noise
STEP = 4.0  # s after the unplanned motion began
DRIFT = 0.5 / 60.0  # N/s, sideways
PROBES = ("convex", "linear", "t-shaped")
HARD: dict[str, dict[str, Any]] = {
    "stiffness x0.3": {"stiffness": 0.6e6},
    "stiffness x3": {"stiffness": 6e6},
    "friction 0.1": {"friction": 0.1},
    "friction 0.8": {"friction": 0.8},
    "payload 5 % off": {},
    "5 % of cycles lost": {"lost": 0.05},
    "200 ms of silence": {"silence": (BEGIN + 2.5, 0.2)},
}


@dataclass(frozen=True)
class Sizes:
    """How much is done.

    Args:
        seeds: of ours and of the unplanned motion.
        few: of what is compared with them.
        periods: [s] of the sines of ours.
    """

    seeds: int
    few: int
    periods: tuple[int, ...] = PERIODS


FULL = Sizes(20, 3)


def sections(sizes: Sizes) -> list[Condition]:
    """Those that last longest first, so that no process waits for the last."""
    made = [*_sines(sizes), *_methods(), *_unplanned(sizes), *_still()]
    slow = {"iterative": 3.0}
    return sorted(made, key=lambda each: -each.until * slow.get(each.variant, 1.0))


def sine(
    name: str, direction: str, period: float, *, judged: float | None = None, begin: float = BEGIN, seed: int = SEED,
    lab: dict[str, Any] | None = None, **options: Any,
) -> Condition:  # fmt: skip
    """The paper's motion; judged over one period of 5 s and more, over two of less, if not told."""
    moving = motion(direction, period=float(period), begin=begin)
    span = float(period if period >= 5 else 2 * period) if judged is None else judged
    settings = LabSettings(motion=moving, seed=seed, **(lab or {}))
    return Condition(name, settings, span, direction=direction, **options)


def _seeds(count: int) -> range:
    return range(SEED, SEED + count)


def _sines(sizes: Sizes) -> Iterator[Condition]:
    def seeded(count: int, *given: Any, **options: Any) -> Iterator[Condition]:
        return (sine(*given, seed=seed, **options) for seed in _seeds(count))

    kinds: dict[str, dict[str, Any]] = {name: {"variant": variant} for name, variant in INERTIA.items() if variant}
    kinds[BOUNDED] = {"lab": {"acceleration": 30.0}}
    for way in DIRECTIONS:
        for period in PERIODS:
            yield from seeded(sizes.few, f"paper {way} {period}", way, period, method="paper")
        for period in sizes.periods:
            yield from seeded(sizes.seeds, f"ours {way} {period}", way, period)
        for name, lab in HARD.items():
            begin, variant = (SOFT if "x0.3" in name else BEGIN), ("payload" if "payload" in name else "")
            yield from seeded(sizes.few, f"{name} {way}", way, 5, begin=begin, lab=lab, variant=variant)
        for name, kind in kinds.items():
            yield from seeded(sizes.few, f"inertia {name} {way}", way, 2, **kind)
        for probe, method in product(PROBES, ("paper", "ours")):
            yield sine(f"{probe} {method} {way}", way, 10, method=method, lab={"probe": probe}, begin=4.0)
    yield sine("paper vertical 10", "vertical", 10, method="paper")
    for name, stiffness in (("", 2e6), (" stiff", 6e6)):
        yield from seeded(sizes.few, f"ours vertical{name}", "vertical", 10, lab={"stiffness": stiffness})


def _methods() -> Iterator[Condition]:
    for name, variant in METHODS.items():
        for way in DIRECTIONS:
            for period in (10, 5) if variant else ():
                yield sine(f"{name} {way} {period}", way, period, method="paper", variant=variant)
            spun = sine(f"{name} {way} spun", way, 10, method="paper", variant=variant)
            moving = replace(spun.settings.motion, spin=SPIN)
            yield replace(spun, settings=replace(spun.settings, motion=moving))


def _unplanned(sizes: Sizes) -> Iterator[Condition]:
    for name, noise in (("unplanned", {}), ("unplanned, quiet,", QUIET)):
        for way, seed in product(DIRECTIONS, _seeds(sizes.seeds)):
            moving = unplanned(seed, direction=way, step_at=STEP, begin=BEGIN)
            settings = LabSettings(motion=moving, seed=seed, **noise)
            yield Condition(f"{name} {way}", settings, STEP + 1.0, direction=way)


def _still() -> Iterator[Condition]:
    for sign in (-1.0, 1.0):
        for way, bias in zip(DIRECTIONS, ((sign * BIAS, 0.0), (0.0, sign * BIAS)), strict=True):
            still = LabSettings(motion=motion("still", begin=BEGIN), seed=SEED)
            yield Condition(f"bias {sign:+.0f} {way}", still, 4.0, direction=way, bias=bias)
    for name, bound in (("stops", 3.0), ("goes on", 30.0)):
        for way, drift in zip(DIRECTIONS, ((DRIFT, 0.0), (0.0, DRIFT)), strict=True):
            settings = LabSettings(motion=motion("still", begin=BEGIN), seed=SEED, drift=(*drift, 0.0, 0.0, 0.0, 0.0))
            limits = Limits(drift=(DRIFT, 0.0), drift_angle=bound * 0.0174533)
            yield Condition(f"drift {name} {way}", settings, 10.0, direction=way, limits=limits)
