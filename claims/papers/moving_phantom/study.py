"""One run of the loop after another: what is set, what is recorded, and what is judged of it."""

import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float

from claims.clock import counted, timed
from claims.papers.moving_phantom.controllers import VARIANTS
from palpate.console.parallel import each_done
from palpate.control.align import AlignController
from palpate.control.supervisor import Limits
from palpate_lab.cli.phantom_run import FORCE, controller_for
from palpate_lab.simulation.phantom.lab import LabSettings, PhantomLab, Reading

SKIPPED = 1.0  # s after the motion's beginning that are judged apart
COLUMNS = ("time", "in_plane", "out_of_plane", "angle", "press", "surface", "probe", "drifted")


@dataclass(frozen=True)
class Condition:
    """One run.

    Attributes:
        name: in tables; runs that differ in the seed only share it.
        settings: of the lab, with the motion.
        judged: [s] how long it is judged, whole periods from `SKIPPED` after the beginning.
        method, variant: of the controller.
        direction: vertical, in-plane or out-of-plane: which angle counts.
        limits: of the loop.
        bias: [N] that the force gains after the payload was identified.
    """

    name: str
    settings: LabSettings
    judged: float
    method: str = "ours"
    variant: str = ""
    direction: str = "in-plane"
    limits: Limits = field(default_factory=Limits)
    bias: tuple[float, float] = (0.0, 0.0)

    @property
    def until(self) -> float:
        """[s] when it ends."""
        return self.settings.motion.begin + SKIPPED + self.judged


@dataclass(frozen=True, eq=False)
class Trace:
    """What happened.

    Attributes:
        condition: that was run.
        values: (n, 8) `COLUMNS` at the sensor's rate: s, rad, rad, rad, N, then height [m] or angle [rad] of the
            surface and of the probe in the direction of the motion, and the predicted error by drift [rad].
        states: when each state began, which, and why.
        cycle: [s] (2,) of the controller, median and 99 %.
        estimate: [s] of the contact alone, median.
    """

    condition: Condition
    values: Float[np.ndarray, "n 8"]
    states: tuple[tuple[float, str, str], ...]
    cycle: tuple[float, float]
    estimate: float

    def column(self, name: str) -> Float[np.ndarray, " n"]:
        return self.values[:, COLUMNS.index(name)]

    @property
    def since(self) -> Float[np.ndarray, " n"]:
        """[s] since the motion began."""
        return self.column("time") - self.condition.settings.motion.begin

    @property
    def steady(self) -> Bool[np.ndarray, " n"]:
        return self.since >= SKIPPED

    @property
    def error(self) -> Float[np.ndarray, " n"]:
        """[deg] of the angle in the plane of the motion, with its sign."""
        return np.degrees(self.column("out_of_plane" if self.condition.direction == "out-of-plane" else "in_plane"))

    def force(self, begin: float = SKIPPED, end: float = np.inf) -> tuple[float, float]:
        """Least and largest [N] from one time to another since the motion began."""
        there = self.column("press")[(self.since >= begin) & (self.since < end)]
        return float(there.min()), float(there.max())

    def off(self, begin: float = SKIPPED, end: float = np.inf) -> float:
        """[N] most that the force was off the wanted one."""
        return max(abs(force - FORCE) for force in self.force(begin, end))

    @property
    def lost(self) -> int:
        """How many times the contact was lost, or the loop left `hold`, after the motion began."""
        touching = (self.column("press") > 0)[self.since >= 0]
        begun = self.condition.settings.motion.begin
        left = sum(at >= begun and state not in ("contact", "hold", "follow") for at, state, _ in self.states)
        return left + int(np.sum(touching[:-1] & ~touching[1:]))

    @property
    def held(self) -> bool:
        """Whether it was in `hold` when the motion began."""
        begun = [state for at, state, _ in self.states if at < self.condition.settings.motion.begin]
        return begun[-1] == "hold"

    def settled(self, step: float, over: float = 0.0) -> float:
        """[s] after a step, from when on the angle stays below 1 deg for half a second; infinite if never.

        Args:
            step: [s] when it began, since the motion did.
            over: [s] about a moment, over which the angle is averaged first.
        """
        rate = self.condition.settings.sensor_rate
        wide, long = max(1, round(over * rate)), rate // 2
        error = np.convolve(self.error, np.full(wide, 1.0 / wide), mode="same")
        there = (self.since >= step) & (self.since < self.since[-1] - over / 2)
        times = self.since[there] - step
        runs = np.convolve(np.abs(error[there]) < 1.0, np.ones(long), mode="valid") > long - 0.5
        return float(times[np.argmax(runs)]) if runs.any() else float("inf")


class Found:
    """Traces of one name: the same but for the seed."""

    def __init__(self, traces: Sequence[Trace]) -> None:
        self.traces = list(traces)

    @property
    def mean(self) -> float:
        """[deg] of the absolute angle in the plane, over all."""
        return float(np.mean([np.abs(each.error[each.steady]).mean() for each in self.traces]))

    @property
    def deviation(self) -> float:
        """[deg] of the absolute angle over time."""
        return float(np.mean([np.abs(each.error[each.steady]).std() for each in self.traces]))

    @property
    def signed(self) -> float:
        """[deg] the mean with its sign."""
        return float(np.mean([each.error[each.steady].mean() for each in self.traces]))

    @property
    def whole(self) -> float:
        """[deg] mean angle between probe and normal."""
        return float(np.degrees(np.mean([each.column("angle")[each.steady].mean() for each in self.traces])))

    def force(self, begin: float = SKIPPED, end: float = np.inf) -> tuple[float, float]:
        """Least and largest [N] of all."""
        ranges = [each.force(begin, end) for each in self.traces]
        return min(low for low, _ in ranges), max(high for _, high in ranges)

    def off(self, begin: float = SKIPPED, end: float = np.inf) -> float:
        """[N] most that the force was off the wanted one in any."""
        return max(each.off(begin, end) for each in self.traces)

    @property
    def lost(self) -> int:
        return sum(each.lost for each in self.traces)


def run(condition: Condition) -> Trace:
    lab = PhantomLab(condition.settings)
    controller = VARIANTS[condition.variant](controller_for(lab, condition.method, condition.limits))
    bias = np.array([*condition.bias, 0.0, 0.0, 0.0, 0.0])
    rows, states, cycles = list[list[float]](), list[tuple[float, str, str]](), list[float]()
    reading = lab.reading
    while reading.time < condition.until:
        moved = reading.acceleration if condition.variant == "accelerometer" else None
        begin = time.perf_counter()
        command = controller.update(reading.time, reading.wrench + bias, reading.joints, moved)
        cycles.append(time.perf_counter() - begin)
        lab.command(command)
        if not states or states[-1][1] != controller.state.value:
            states.append((reading.time, controller.state.value, controller.why))
        rows.append(_row(lab, condition.direction, controller))
        reading = lab.step()
    took = np.array(cycles[len(cycles) // 4 :])
    cycle = float(np.median(took)), float(np.percentile(took, 99))
    return Trace(condition, np.array(rows), tuple(states), cycle, _timed(controller, reading))


def _row(lab: PhantomLab, direction: str, controller: AlignController) -> list[float]:
    """`COLUMNS`."""
    truth, heading = lab.truth(), lab.settings.heading
    if direction == "vertical":
        surface, probe = truth.phantom.translation[2] - lab.settings.place[2], truth.tip[2]
    else:
        across = np.array([np.cos(heading), np.sin(heading), 0.0])
        if direction == "out-of-plane":
            across = np.array([np.sin(heading), -np.cos(heading), 0.0])
        surface, probe = (
            float(np.arctan2(each @ across, each[2])) for each in (truth.normal, -truth.sensor.rotation[:, 2])
        )
    angles = truth.in_plane, truth.out_of_plane, truth.angle
    return [truth.time, *angles, truth.press, float(surface), float(probe), controller.drifted]


def _timed(controller: AlignController, reading: Reading, times: int = 200) -> float:
    """[s] median time of an estimate."""
    estimator, rotation, still = controller.estimator, np.diag([1.0, -1.0, -1.0]), np.zeros(3)
    row, wrench = estimator.empty(1)[0], reading.wrench

    def estimate(k: int) -> None:
        estimator.update_into(reading.time + 0.005 * (k + 1), wrench, row, rotation, still)

    return 1e-6 * float(np.median(timed(estimate, times)))


def traces(conditions: Sequence[Condition], workers: int = 2) -> dict[str, Found]:
    """All of them by their names, in so many processes; 1: this one."""
    made = defaultdict[str, list[Trace]](list)
    for trace in counted(each_done(run, conditions, workers, "processes", "workers"), len(conditions)):
        made[trace.condition.name].append(trace)
    return {name: Found(sorted(found, key=lambda each: each.condition.settings.seed)) for name, found in made.items()}
