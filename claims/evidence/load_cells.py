"""Load cells: a fingertip calibrated on a simulated bench, verified on an independent run of it.

The bench (`palpate_lab.simulation.load_cell_bench`) makes voltages by the statics of a frame on springs and, for the
soft layer, by an elastic foundation; no estimator has a part in it. Positions are 3-D errors of samples loaded by 1 N
or more, forces those against the equally filtered truth. The zero is taken in the unloaded start of each trajectory.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

import palpate
from claims.evidence.covariance import CHI2_95, squared_distance
from claims.row import Row
from palpate.sensors.load_cells.array import LoadCellArray
from palpate.sensors.load_cells.calibrate import CalibrationOptions, LoadCellCalibration, identify_load_cells
from palpate.sensors.load_cells.faults import CellFault
from palpate.sensors.load_cells.model import VOLTAGE, LoadCells
from palpate.sensors.load_cells.resolution import WANTED, resolution
from palpate.sensors.load_cells.zero import Zero, take_zero
from palpate.spatial.pose import Pose
from palpate.surfaces import EllipticCylinder, Surface
from palpate.surfaces.implicit import superquadric
from palpate_lab.simulation.ball_on_ellipse import pressed_wrench
from palpate_lab.simulation.cell_array import in_line
from palpate_lab.simulation.contacts import contact_wrenches
from palpate_lab.simulation.load_cell_bench import BENCHES, REST, Bench, BenchRun

SURFACE = EllipticCylinder(a=14e-3, b=5e-3, half_length=16e-3, upper=True)
ALONG_Y = Pose.from_rotation_vector((np.pi / 2, 0.0, 0.0), (0.0, 0.0, 0.0))  # its own z
UNLOADED = REST - 0.1  # s of each trajectory from which the zero is taken
LEAST = 1.0  # N
RIGID, SOFT = BENCHES["rigid"], BENCHES["soft layer"]
QUIET = replace(RIGID, friction=(0.0, 0.01))


def rows(small: bool) -> Iterator[Row]:
    """Limits, starts, smallest force, faults; table I and torque are `papers.load_cells`."""
    runs = Runs(30 if small else 1)
    few = runs if small else Runs(10)
    yield Row("calibration with hardly any friction", "refused, or warned", *_said(runs, QUIET))
    yield from _limits(runs, small)
    yield from _effects(runs, small)
    yield from _starts(few, 2 if small else 20)
    yield from _smallest(runs, 2_000 if small else 20_000)
    yield from _faults(runs, small)
    yield from _channels(runs, small)
    yield from _surfaces(runs, small)
    yield from _sentences(few)


@dataclass(frozen=True, eq=False)
class Answer:
    """Contacts of a run, in its order, and what is wrong with the cells by them."""

    run: BenchRun
    found: palpate.ContactEstimate
    faults: list[CellFault]

    @cached_property
    def share(self) -> float:
        """Of the loaded samples, how many were answered."""
        return float(np.mean(self.found.answered[loaded(self.run)]))

    @cached_property
    def used(self) -> np.ndarray:
        """Loaded samples that were answered."""
        return np.flatnonzero(loaded(self.run) & self.found.answered)

    @cached_property
    def position(self) -> np.ndarray:
        """Errors [m] of the samples that are used."""
        return np.linalg.norm(self.found.point[self.used] - self.run.point[self.used], axis=1)

    @property
    def rmse(self) -> float:
        """[m] of the position."""
        return _rms(self.position)

    def inside(self, rows: np.ndarray) -> float:
        """How many of some samples have the truth in the 95 % ellipse."""
        return float(np.mean(squared_distance(self.found[rows], self.run.point[rows]) <= CHI2_95))

    def named(self) -> str:
        """The faults, as they are stated."""
        return "; ".join(fault.text for fault in self.faults)


@dataclass(frozen=True)
class Runs:
    """Runs of benches, every `thin`-th sample: the first calibrates, the second verifies."""

    thin: int

    @cache  # noqa: B019 - lives as long as the program, which asks for the same runs again and again
    def first(self, bench: Bench) -> BenchRun:
        return bench.run(0, thin=self.thin)

    @cache  # noqa: B019 - as above
    def calibrated(self, bench: Bench, indentation: bool = False) -> LoadCellCalibration:
        run = self.first(bench)
        return identify_load_cells(run.time, run.voltages, run.force, run.position, SURFACE, indentation=indentation)

    @cache  # noqa: B019 - as above
    def second(self, bench: Bench) -> BenchRun:
        return bench.run(1, thin=self.thin)

    @cache  # noqa: B019 - as above
    def answer(self, bench: Bench, law: bool = False, verified: Bench | None = None) -> Answer:
        """A second run, by default of the same bench, by the calibration of a first one."""
        return answered(self.calibrated(bench, law).cells, self.second(verified or bench))


def _recording(run: BenchRun, part: np.ndarray) -> palpate.Recording:
    return palpate.Recording(run.time[part], {VOLTAGE: run.voltages[part]})


def rest(run: BenchRun, part: np.ndarray) -> np.ndarray:
    """Return which samples of a part are those of its unloaded start."""
    return part & (run.time < run.time[part][0] + UNLOADED)


def answered(cells: LoadCells, run: BenchRun, method: str = "soft_finger", surface: Surface = SURFACE) -> Answer:
    """Return a run's contacts, each trajectory tared at its start."""
    sensor, found = LoadCellArray(cells), list[palpate.ContactEstimate]()
    locator = palpate.Locator(surface, method, indentation=cells.indentation)
    fingertip = palpate.WrenchEstimator(locator, sensor, live=False)
    for number in np.unique(run.trajectory):
        part = run.trajectory == number
        fingertip.tare(_recording(run, rest(run, part)))
        found.append(fingertip.run(_recording(run, part)).estimate)
    return Answer(run, palpate.ContactEstimate.joined(found), sensor.faults())


def loaded(run: BenchRun, least: float = LEAST) -> np.ndarray:
    """Return the samples from that force on [N]."""
    return np.linalg.norm(run.wrench[:, :3], axis=1) >= least


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _said(runs: Runs, bench: Bench) -> tuple[str, bool]:
    try:
        notes = runs.calibrated(bench).cells.notes
    except palpate.NotIdentifiable as refusal:
        return f"refused: {refusal}", True
    return "; ".join(notes) or "nothing", any("riction" in text for text in notes)


def _limits(runs: Runs, small: bool) -> Iterator[Row]:
    slack = 0.03 if small else 0.0  # a few hundred samples
    for what, bench, law in (("rigid", RIGID, False), ("soft layer, its law fitted", SOFT, True)):
        run, cells = runs.second(bench), runs.calibrated(bench, law).cells
        for method, torque in (("soft_finger", True), ("wrench_axis", False))[: 1 if small and law else 2]:
            answer = answered(cells, run, method)
            step = max(1, (301 if law else 41) // runs.thin) * (10 if small else 1)
            use = answer.used[::step]
            least = np.sqrt(np.mean([_bound(bench, run, int(k), torque) for k in use]))
            off = answer.found.point[use] - run.point[use]
            ratio = _rms(np.linalg.norm(off, axis=1)) / least
            inside = answer.inside(answer.used[:: max(1, 11 // runs.thin)])
            name = f"{what}, {method}"
            got = f"{ratio:.3f} ({1e6 * ratio * least:.1f} um, bound {1e6 * least:.1f} um; {len(use):,} samples)"
            yield Row(f"{name}: RMSE of position over the Cramer-Rao bound", "1.25", got, ratio <= 1.25)
            met = 0.93 - slack <= inside <= 0.97 + slack
            yield Row(f"{name}: truth in the 95 % ellipse", "93 to 97 %", f"{inside:.1%}", met)


def _bound(bench: Bench, run: BenchRun, k: int, torque: bool) -> float:
    """Trace of the Cramer-Rao bound of the point [m^2] of a sample: of the simulation's voltages, by differences."""
    forward, spread = bench.cells().forward(), bench.channel_noise()
    x, y = run.point[k, :2]
    state = np.array([x, y, *run.wrench[k, :3], run.torque[k]])
    steps = np.array([1e-7, 1e-7, 1e-5, 1e-5, 1e-5, 1e-8])

    def made(values: np.ndarray) -> np.ndarray:
        point, normal = (each[0] for each in bench.ellipse.foot(values[:1], values[1:2]))
        if bench.layer:
            return forward @ _soft(bench, values, normal) / spread
        return forward @ contact_wrenches(point[None], normal[None], values[None, 2:5], values[None, 5])[0] / spread

    unknown = 6 if torque else 5
    slopes = [(made(state + d) - made(state - d)) / (2 * d[i]) for i, d in enumerate(np.diag(steps))]
    slopes = np.stack(slopes[:unknown], axis=1)
    least = np.linalg.inv(slopes.T @ slopes)[:2, :2]
    ahead, _ = bench.ellipse.foot(np.array([x + 1e-7, x, x - 1e-7]), np.array([y, y + 1e-7, y]))
    along = np.stack([(ahead[0] - ahead[2]) / 2e-7, [0.0, 1.0, 0.0]], axis=1)
    return float(np.trace(along @ least @ along.T))


def _soft(bench: Bench, values: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The elastic foundation's wrench whose force is the one of the state, with a torque about the normal beside it."""
    force = values[2:5]
    pressing = -float(force @ normal)
    side = force + pressing * normal
    mu = float(np.linalg.norm(side)) / pressing
    motion = side / max(float(np.linalg.norm(side)), 1e-12) if mu > 1e-9 else np.array([0.0, 1.0, 0.0])
    tip = (bench.ellipse, bench.radius, float(bench.layer or 1.0), values[:1])
    depth, wrench = np.sqrt(pressing / (np.pi * tip[2] * bench.radius)), np.zeros(6)
    for _ in range(4):
        wrench = pressed_wrench(*tip, np.array([depth]), np.array([mu]), motion[None])[0]
        depth *= np.sqrt(pressing / -float(wrench[:3] @ normal))
    acts = wrench[:3]
    lever = np.cross(acts, wrench[3:]) / (acts @ acts)  # the line of action; the small rest of the force goes there too
    aside = np.array([0.0, values[1], 0.0])
    moment = np.cross(lever + aside, force) + values[5] * normal
    return np.concatenate([force, moment])


def _effects(runs: Runs, small: bool) -> Iterator[Row]:
    base = runs.answer(RIGID).rmse
    effects = (
        ("none", RIGID, False, RIGID),
        ("soft layer, its law fitted", SOFT, True, SOFT),
        ("soft layer, no law", SOFT, False, SOFT),
        ("drift of 0.5 mV while verified only", RIGID, False, replace(RIGID, drift=0.5e-3)),
        ("drift of 0.5 mV in both runs", BENCHES["drift"], False, BENCHES["drift"]),
        ("torque up to 5 N mm while calibrated, not told", replace(RIGID, torsion=5e-3), False, RIGID),
        ("reference noise 170 mN", replace(RIGID, reference_noise=0.17), False, RIGID),
    )
    for what, bench, law, second in effects[: 1 if small else None]:
        answer = runs.answer(bench, law, second)
        got = f"{1e6 * answer.rmse:.0f} / {1e6 * answer.position.max():.0f} um, {answer.rmse / base:.2f} of without"
        yield Row(f"one systematic effect: {what}", "", got)


def _starts(runs: Runs, count: int) -> Iterator[Row]:
    """Sensitivities drawn anew, cells 2 mm off: a map from voltages to wrenches to start from."""
    run, rng = runs.first(RIGID), np.random.default_rng(41)
    array = RIGID.cells()
    points, costs, failed, led = list[np.ndarray](), list[float](), 0, 0
    grid = np.meshgrid(np.linspace(-9e-3, 9e-3, 7), np.linspace(-12e-3, 12e-3, 7))
    spots, normals = (each.reshape(-1, 3) for each in RIGID.ellipse.foot(*grid))
    wrenches = contact_wrenches(spots, normals, -1.5 * normals, np.zeros(49)) @ array.forward().T
    for _ in range(count):
        gains = rng.uniform(2.0, 30.0, (4, 1, 1)) * (np.eye(3) + 0.2 * rng.standard_normal((4, 3, 3)))
        places = array.position + 2e-3 * rng.standard_normal((4, 3)) / 3**0.5
        maps = [np.concatenate([gain, np.cross(place, gain.T).T]) for gain, place in zip(gains, places, strict=True)]
        try:
            options = CalibrationOptions(start=np.concatenate(maps, axis=1))
            found = identify_load_cells(run.time, run.voltages, run.force, run.position, SURFACE, options=options)
        except palpate.PalpateError:
            failed += 1
            continue
        sensor = LoadCellArray(found.cells, zero=Zero(np.zeros(12)))
        fingertip = palpate.WrenchEstimator(palpate.Locator(SURFACE), sensor)
        led += any("was not used" in note for note in found.cells.notes)
        points.append(fingertip.run(palpate.Recording(np.zeros(49), {VOLTAGE: wrenches})).point)
        costs.append(found.fit.cost)
    spread = float(np.linalg.norm(np.ptp(points, axis=0), axis=1).max())
    relative = float(np.ptp(costs) / np.min(costs))
    got = f"{1e9 * spread:.3g} nm, cost to {relative:.1e}; {count - failed} of {count} settle, "
    got += f"{count - failed - led} by themselves and {led} by the linear start"
    met = failed == 0 and spread <= 1e-6 and relative <= 1e-6
    what = f"{count} starts, sensitivities 2 to 30 N/V drawn, cells 2 mm off: predicted contacts, cost"
    yield Row(what, "within 1 um, 1e-6", got, met)


def _smallest(runs: Runs, trials: int) -> Iterator[Row]:
    """The force at which the RMSE of many touches, each just tared, is 2 mm; found by halving."""
    array, cells = RIGID.cells(), runs.calibrated(RIGID).cells
    spread, rng = RIGID.channel_noise(), np.random.default_rng(43)
    run = runs.second(RIGID)
    share = take_zero(cells, run.voltages[rest(run, run.trajectory == 0)]).share
    sensor = LoadCellArray(cells, zero=Zero(np.zeros(12), share))
    fingertip = palpate.WrenchEstimator(palpate.Locator(SURFACE, on=0.0, off=0.0), sensor)
    time = np.arange(trials) / 1000
    noise = spread * rng.standard_normal((trials, 12)) * np.sqrt(1.0 + share)
    for x, y in ((0.0, 0.0), (6e-3, 8e-3), (-9e-3, -10e-3)):
        point, normal = RIGID.ellipse.foot(np.array(x), np.array(y))
        predicted = float(resolution(cells, point[None], normal[None], tare=1.0 / share).smallest(WANTED)[0])

        def error(force: float, point: np.ndarray = point, normal: np.ndarray = normal) -> float:
            clean = array.forward() @ contact_wrenches(point[None], normal[None], -force * normal[None], np.zeros(1))[0]
            found = fingertip.run(palpate.Recording(time, {VOLTAGE: clean + noise}))
            return _rms(np.linalg.norm(found.point - point, axis=1))

        low, high = 0.3 * predicted, 3.0 * predicted
        for _ in range(12):
            middle = np.sqrt(low * high)
            low, high = (middle, high) if error(middle) > WANTED else (low, middle)
        ratio = predicted / high
        got = f"{1e3 * predicted:.1f} mN predicted, {1e3 * high:.1f} mN measured: {ratio - 1:+.0%}"
        what = f"smallest force for 2 mm at x = {1e3 * x:.0f}, y = {1e3 * y:.0f} mm"
        yield Row(what, "within 15 %", got, abs(ratio - 1) <= 0.15)


def _faults(runs: Runs, small: bool) -> Iterator[Row]:
    run, cells, sound = runs.second(RIGID), runs.calibrated(RIGID).cells, runs.answer(RIGID).rmse
    for kind, most in (("dead", 1.6), ("saturated, range not stated", None), ("drifting by 1 mV/s", None)):
        for cell in range(1 if small else 4):
            answer = answered(cells, spoilt(run, of_cell(cell), kind, level=0.0, limit=0.06))
            named = answer.faults
            right = [fault.kind for fault in named] == [kind.split(",")[0].split(" ")[0]] and named[0].cells == (cell,)
            ratio = answer.rmse / sound
            got = f"{ratio:.2f}, {answer.share:.1%} answered; {answer.named() or 'nothing named'}"
            met = right and answer.share > 0.99 and (most is None or ratio <= most)
            target = "named" + (f", {most}" if most else ", goes on")
            yield Row(f"cell {cell + 1} {kind}: error over the sound one", target, got, met)
    for one, other in [(0, 1)] if small else [(0, 1), (0, 2), (1, 3), (2, 3)]:
        answer = answered(cells, spoilt(run, of_cell(one) + of_cell(other), "swapped"))
        got = f"{answer.share:.1%} answered; {answer.named()}"
        met = [fault.kind for fault in answer.faults] == ["swapped"] and answer.faults[0].cells == (one, other)
        yield Row(f"cells {one + 1} and {other + 1} exchanged", "named, and says that it cannot", got, met)


def _channels(runs: Runs, small: bool) -> Iterator[Row]:
    """One channel at a time; vertical ones share one redundancy, so that any of them may be the one."""
    run, cells = runs.second(RIGID), runs.calibrated(RIGID).cells
    for kind in ("drifting by 1 mV/s", "dead", "saturated, range not stated"):
        for axis in "z" if small else "xyz":
            inside, worst, named = list[float](), 0.0, 0
            channels = range("xyz".index(axis), 12, 3)
            for channel in channels:
                limit = 0.5 * np.abs(run.voltages[:, channel]).max()
                answer = answered(cells, spoilt(run, [channel], kind, level=0.01, limit=limit))
                inside.append(answer.inside(answer.used))
                worst = max(worst, float(answer.position.max()))
                named += not answer.faults or channel in answer.faults[0].channels
            got = f"{min(inside):.1%} at least, worst error {1e3 * worst:.2f} mm; {named} of {len(channels)} named"
            met = min(inside) >= 0.9 and named == len(channels)
            what = f"one channel {axis} {kind}: truth in the 95 % ellipse, the channel among those named"
            yield Row(what, "90 %, all", got, met)


def spoilt(run: BenchRun, channels: list[int], kind: str, level: float = 0.0, limit: float = 0.0) -> BenchRun:
    """Some channels dead at a level [V], clipped at a limit [V], drifting since each trajectory's start, or swapped."""
    volts, since = run.voltages.copy(), run.time - run.time[np.searchsorted(run.trajectory, run.trajectory)]
    ways: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "dead": lambda own: np.full_like(own, level),
        "saturated": lambda own: np.clip(own, -limit, limit),
        "drifting": lambda own: own + 1e-3 * since[:, None],
        "swapped": lambda own: np.roll(own, 3, axis=1),
    }
    volts[:, channels] = ways[kind.split(",")[0].split(" ")[0]](volts[:, channels])
    return replace(run, voltages=volts)


def of_cell(cell: int) -> list[int]:
    return [3 * cell, 3 * cell + 1, 3 * cell + 2]


def _surfaces(runs: Runs, small: bool) -> Iterator[Row]:
    """The same logs on other descriptions of the same surface, as a user has it who has no elliptic cylinder."""
    fine = SURFACE.mesh(20_000)
    others: list[tuple[str, Surface]] = [(f"mesh of {len(fine.faces):,} facets", fine)]
    if not small:  # the tests of contacts try it; within 3 um of the surface where the ball goes
        others.insert(0, ("superquadric", superquadric((14e-3, 5e-3, 24e-3), (0.2, 1.0), pose=ALONG_Y)))
    for what, bench, law in (("rigid", RIGID, False), ("soft layer, its law fitted", SOFT, True)):
        run, cells = runs.second(bench), runs.calibrated(bench, law).cells
        least = runs.answer(bench, law).rmse
        for name, surface in others:
            answer = answered(cells, run, surface=surface)
            ratio = answer.rmse / least
            got = f"{ratio:.3f} ({1e6 * ratio * least:.1f} um; {answer.share:.1%} answered)"
            met = ratio <= 1.2 and answer.share > 0.99
            yield Row(f"{what}, on a {name}: RMSE over the elliptic cylinder's", "1.2", got, met)


def _sentences(runs: Runs) -> Iterator[Row]:
    line, run = replace(RIGID, layout=in_line(3), twist=1.0), runs.first(RIGID)
    lined, quiet = runs.first(line), runs.first(QUIET)
    late = (run.time > 3.5) & (run.trajectory == 0)
    wrong = run.voltages.copy()
    wrong[:, 5] *= 1e3
    still = spoilt(run, of_cell(1), "dead").voltages
    every, few = slice(None), slice(0, 12_000 // runs.thin)
    for what, log, part, volts, places in (
        ("three cells in line, places stated", lined, every, lined.voltages, line.cells().position),
        ("three cells in line, places not stated", lined, every, lined.voltages, None),
        ("no unloaded start", run, late, run.voltages, None),
        ("too few directions: one path, hardly any friction", quiet, few, quiet.voltages, None),
        ("a column in mV", run, every, wrong, None),
        ("a dead cell on the bench", run, every, still, None),
    ):
        given = log.time[part], volts[part], log.force[part], log.position[part], SURFACE
        try:
            identify_load_cells(*given, options=CalibrationOptions(positions=places))
            got, met = "accepted", False
        except palpate.PalpateError as refusal:
            got, met = str(refusal), True
        yield Row(f"calibration, {what}", "a sentence", got, met)
