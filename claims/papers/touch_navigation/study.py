"""Runs of the closed loop, each kept on disk as soon as it is done, and what is counted of those of one name."""

from __future__ import annotations

import ast
import hashlib
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

import palpate
from claims.clock import counted
from claims.papers.touch_navigation.conditions import JUDGED, Condition, arena_settings
from palpate.console.parallel import begin_results, from_row, read_rows, run_kept
from palpate.sensors.marker_ring.estimator import RingEstimator
from palpate_lab.cli.arena_ring import RingWear
from palpate_lab.cli.arena_run import FELT, ArenaRun
from palpate_lab.simulation.arena.camera import TableCamera
from palpate_lab.simulation.arena.moment import ArenaMoment

BIN = 0.05  # N of the histogram of forces
BINS = 400
KEPT = 15  # frames from one kept pose of a traced run to the next
CODE = (  # what a run depends on most
    "palpate/control",
    "palpate_lab/simulation/arena",
    "palpate_lab/cli/arena_run.py",
    "palpate_lab/cli/arena_ring.py",
)


@dataclass(frozen=True)
class Outcome:
    """What came of a run; a value a robot where not said otherwise.

    Attributes:
        condition: that was run.
        stamp: of the code that ran it.
        arrived: [s], NaN: it did not.
        path: [m]. greatest: [N] that ever pressed on it. pushes, deadlocks: how often. states: with why, at the end.
        forces: of the whole run: how many moments of a robot the strongest of its contacts was in each bin of `BIN`.
        blocks: [m] the farthest that a box was moved.
        seconds: simulated. took: of the processor [s].
        digest: of all poses, to the last bit.
        ways: of a traced run: (k, 3) poses for each robot, flat; `boxes`, the movable ones first and last.
    """

    condition: Condition
    stamp: str
    arrived: tuple[float, ...]
    path: tuple[float, ...]
    greatest: tuple[float, ...]
    pushes: tuple[int, ...]
    deadlocks: tuple[int, ...]
    states: tuple[str, ...]
    forces: tuple[int, ...]
    blocks: float
    seconds: float
    took: float
    digest: str
    ways: tuple[tuple[float, ...], ...] = ()
    boxes: tuple[tuple[float, ...], ...] = ()

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> Outcome:
        """Of `asdict`, as `read_rows` has it."""
        return from_row(cls, {**row, "condition": Condition(**row["condition"])})

    @property
    def there(self) -> Float[np.ndarray, " n"]:
        return np.isfinite(self.arrived).astype(float)


@dataclass
class _Watch:
    """What is added up over a run beside what `ArenaResult` says."""

    traced: bool
    forces: np.ndarray = field(default_factory=lambda: np.zeros(BINS, dtype=np.int64))
    ways: list[np.ndarray] = field(default_factory=list[np.ndarray])
    boxes: list[np.ndarray] = field(default_factory=list[np.ndarray])
    frames: int = 0

    def __post_init__(self) -> None:
        self.digest = hashlib.sha256()

    def see(self, moment: ArenaMoment) -> None:
        self.digest.update(moment.poses.tobytes())
        for truth in moment.truths:
            if len(truth) and (strongest := float(truth[:, 1].max())) > FELT:
                self.forces[min(int(strongest / BIN), BINS - 1)] += 1
        if not self.boxes:
            self.boxes = [moment.blocks.copy(), moment.blocks]
        self.boxes[1] = moment.blocks
        if self.traced and self.frames % KEPT == 0:
            self.ways.append(moment.poses.copy())
        self.frames += 1


def run(condition: Condition) -> Outcome:
    made = ArenaRun(arena_settings(condition), _worn())
    watch = _Watch(condition.traced)
    begin = 0.0
    for moment in made:
        watch.see(moment)
        begin = begin or time.process_time()  # from the first moment on: it loads what is compiled
    took, result = time.process_time() - begin, made.result()
    moved = np.hypot(*(watch.boxes[1] - watch.boxes[0])[:, :2].T).max(initial=0.0)
    ways = np.round(np.array(watch.ways), 4) if watch.ways else np.empty((0, 0, 3))
    ways = tuple(tuple(each.ravel().tolist()) for each in np.moveaxis(ways, 1, 0))
    boxes = tuple(tuple(each.ravel().tolist()) for each in watch.boxes) if condition.traced else ()
    of_robots = result.arrived, result.path, result.greatest, result.pushes, result.deadlocks, result.state
    spent = result.seconds, took, watch.digest.hexdigest()
    forces = tuple(watch.forces.tolist())
    return Outcome(condition, stamp(), *of_robots, forces, float(moved), *spent, ways, boxes)


@cache
def _worn() -> RingWear:
    return RingWear.made()


def frames_a_second() -> float:
    """Frames that the detector and the estimator answer in a second of a core, two touches wandering round the ring."""
    wear = _worn()
    camera = TableCamera(wear.unit.camera, wear.unit.look, np.random.default_rng(JUDGED))
    estimator = RingEstimator(wear.ring)
    rows, took, count = estimator.empty(estimator.most), 0.0, 200
    for k in range(count):
        truth = np.array([[0.02 * k, 1.5, 0.2, 0.003, 0.0], [0.02 * k + 2.5, 1.0, 0.0, 0.002, 0.0]])
        frame = camera.frame(wear.skin.markers(truth))
        begin = time.process_time()
        estimator.update_into(k / 30.0, frame, rows)
        took += (time.process_time() - begin) * (k >= count // 4)  # what is compiled is loaded by then
    return (count - count // 4) / took


@cache
def stamp() -> str:
    """Of the code that a run depends on most, without comments and docstrings: two runs of one stamp can be mixed."""
    root, seen = Path(palpate.__file__).parents[1], hashlib.sha256()
    for part in CODE:
        for file in sorted((root / part).glob("*.py")) if (root / part).is_dir() else [root / part]:
            seen.update(_bare(file.read_text(encoding="utf-8")).encode())
    return seen.hexdigest()[:12]


def _bare(source: str) -> str:
    tree = ast.parse(source)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            body[:] = [
                each for each in body if not (isinstance(each, ast.Expr) and isinstance(each.value, ast.Constant))
            ]
    return ast.dump(tree)


class Found:
    """Outcomes of one name: the same but for the seed; figures are NaN of none."""

    def __init__(self, outcomes: Sequence[Outcome]) -> None:
        self.outcomes = sorted(outcomes, key=lambda each: each.condition.seed)

    def __len__(self) -> int:
        return len(self.outcomes)

    def of(self, other: Found) -> Found:
        """Those with seeds that the other has too."""
        seeds = {each.condition.seed for each in other.outcomes}
        return Found([each for each in self.outcomes if each.condition.seed in seeds])

    @property
    def robots(self) -> float:
        """[%] that arrived."""
        return 100.0 * _mean(there for each in self.outcomes for there in each.there)

    @property
    def healthy(self) -> float:
        """[%] that arrived, of all but the first robot of each run."""
        return 100.0 * _mean(there for each in self.outcomes for there in each.there[1:])

    @property
    def whole(self) -> float:
        """[%] of runs in which all arrived."""
        return 100.0 * _mean(each.there.all() for each in self.outcomes)

    @property
    def times(self) -> Float[np.ndarray, " n"]:
        """[s] at which each robot arrived, of those that did, rising."""
        return np.sort([time for each in self.outcomes for time in each.arrived if np.isfinite(time)])

    @property
    def median(self) -> float:
        """[s] of those that arrived."""
        return _mean(self.times, np.median)

    def force(self, share: float = 0.99) -> float:
        """[N] that the strongest contact of a robot does not pass in a share of the time in which it is touched."""
        counts = np.sum([each.forces for each in self.outcomes], axis=0) if self.outcomes else np.zeros(BINS)
        within: np.ndarray = np.cumsum(counts) >= share * counts.sum()
        return BIN * (1 + int(within.argmax())) if counts.sum() else float("nan")

    @property
    def greatest(self) -> float:
        """[N] of all."""
        return max((max(each.greatest) for each in self.outcomes), default=float("nan"))

    @property
    def path(self) -> float:
        """[m] of a robot that arrived, median."""
        ways = [way for each in self.outcomes for way, there in zip(each.path, each.there, strict=True) if there]
        return _mean(ways, np.median)

    @property
    def pushes(self) -> float:
        return _mean(sum(each.pushes) for each in self.outcomes)

    @property
    def deadlocks(self) -> float:
        return _mean(sum(each.deadlocks) for each in self.outcomes)

    @property
    def speed(self) -> float:
        """Simulated seconds in one of a core."""
        took = sum(each.took for each in self.outcomes)
        return sum(each.seconds for each in self.outcomes) / took if took else float("nan")


class Runs(dict[str, Found]):
    """Runs by the name of their condition; none of one that was not run."""

    def __missing__(self, name: str) -> Found:
        return Found([])


def _mean(values: Iterable[float], of: Callable[[Any], Any] = np.mean) -> float:
    found = [*values]
    return float(of(found)) if found else float("nan")


def found(wanted: Sequence[Condition], kept: Path, *, workers: int = 1, any_code: bool = False) -> Runs:
    """All of them by their names: those that were run before from disk, and the others now.

    Args:
        wanted: conditions, in the order in which they are run.
        kept: file of one line a run, to which each is added as soon as it is done: whoever is stopped goes on there.
        workers: processes; 1: this one.
        any_code: runs of other code count as well.
    """
    before = [Outcome.of(row) for row in read_rows(kept, "runs of robots")[1]] if kept.exists() else []
    kept.parent.mkdir(parents=True, exist_ok=True)
    begin_results(kept, {}, map(asdict, before))  # without a last line that was cut off
    done = {each.condition.key: each for each in before if any_code or each.stamp == stamp()}
    todo = list({each.key: each for each in wanted if each.key not in done}.values())
    for outcome in counted(run_kept(run, todo, kept, (workers, "processes", "workers"), asdict), len(todo)):
        done[outcome.condition.key] = outcome
    by_name = defaultdict[str, list[Outcome]](list)
    for each in wanted:
        by_name[each.name].append(done[each.key])
    return Runs({name: Found(outcomes) for name, outcomes in by_name.items()})
