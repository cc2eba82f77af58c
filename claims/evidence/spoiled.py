"""Spoiled calibrations: each sensor's assumptions broken one by one.

Of every fault some logs are made, forwards. A calibration is right to refuse a log, or to state a covariance that
holds: `distance` is the rms distance of the truth in stated deviations, over all that were not refused.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import palpate
from claims.evidence.bodies import touched
from claims.evidence.clock import LOAD, PAYLOAD
from claims.evidence.moving import Swing, moving_wrenches
from claims.evidence.payload import hundred_poses
from claims.evidence.skin_contacts import taxel_force_runs
from claims.evidence.taxel_limit import priors_of
from claims.row import Row, shared, skipped
from palpate.calibration.clock import identify_offset
from palpate.calibration.drift import identify_drift
from palpate.calibration.mounting import identify_mounting
from palpate.errors import PalpateError
from palpate.optical.fisheye import Fisheye
from palpate.sensors.load_cells.calibrate import identify_load_cells
from palpate.sensors.marker_ring.calibrate_camera import fit_lens
from palpate.sensors.marker_ring.locator import RingLocator
from palpate.sensors.marker_ring.response_fit import RingPresses, fit_response
from palpate.sensors.taxels.calibrate import identify_intensity
from palpate.sensors.taxels.modules import ModuleLayout
from palpate.sensors.taxels.poking import calibrate_taxels
from palpate.sensors.taxels.poking.pokes import Pokes
from palpate.spatial.pose import Pose
from palpate.surfaces import EllipticCylinder, Mesh
from palpate_lab.simulation.barrel import Barrel, Indenter
from palpate_lab.simulation.barrel_elasticity import COARSE_ROWS, BarrelSettings
from palpate_lab.simulation.forearm import Forearm
from palpate_lab.simulation.load_cell_bench import BENCHES
from palpate_lab.simulation.poke_bench import HAND, MIX, PokeBench
from palpate_lab.simulation.shapes import EllipsoidBody

TARGET = "the truth 1/3 to 2 stated deviations away"
NOISE = np.array([0.02] * 3 + [0.001] * 3)  # N, N m
AGAINST = [1, 1, 1, -1, -1, -1]  # a wrench whose torque has the other sign
Trial = Callable[..., float]
"""From dice, and what spoils the log, to the mean squared distance of the truth, in stated deviations."""


def rows(small: bool) -> Iterator[Row]:
    """Each fault on a few logs, and each calibration on logs without one; few: of the quick calibrations."""
    for name, (trial, faults) in CALIBRATIONS.items():
        if not small or name in QUICK:
            yield _row(f"{name}, nothing wrong", _bent if name == "intensity" else trial, (), 1 if small else 8)
            for what, spoil in faults.items():
                yield _row(f"{name}, {what}", trial, (spoil,), 1 if small else 8)
    yield from _real()


def _row(what: str, trial: Trial, spoil: tuple[object, ...], count: int) -> Row:
    squares, sentences = list[float](), list[str]()
    for seed in range(count):
        try:
            squares.append(trial(np.random.default_rng(seed), *spoil))
        except PalpateError as refused:
            sentences.append(str(refused))
    distance = float(np.sqrt(np.mean(squares))) if squares else np.nan
    got = [f"refused {len(sentences)} of {count}: {sentences[0]}"] if sentences else []
    got += [f"{distance:.2f} deviations away in {len(squares)} of {count}"] if squares else []
    least, most = (1.0 / 3.0, 2.0) if count > 1 else (0.0, 5.0)  # one log may be near the truth by chance
    met = (not squares or least <= distance <= most) and bool(spoil or not sentences)
    return Row(what, f"refused, or {TARGET}" if spoil else f"0 refused, {TARGET}", "; ".join(got), met)


def _real() -> Iterator[Row]:
    """Halves of real logs: how far what the second says is from what the first does, in stated deviations."""
    folder, poses = shared(), hundred_poses()
    target, what = "0.5 to 2", "{}: squared difference of the two halves' results over its covariance, per number"
    if folder is None or poses is None:
        yield from skipped(what.format("real logs"), target)
        return
    wrenches, rotations = poses
    first, second = (palpate.identify_payload(wrenches[rows], rotations[rows]) for rows in (slice(50), slice(50, 100)))
    names = ("weight", "center_of_mass", "force_bias", "torque_bias")
    error = np.concatenate([getattr(first, name) - getattr(second, name) for name in names])
    order = np.array([0, 1, 2, 6, 7, 8, 3, 4, 5, 9, 10, 11])
    covariance = (first.covariance + second.covariance)[np.ix_(order, order)]
    square, every = (_squared(error[:count], covariance[:count, :count]) for count in (6, 12))
    got = f"{square:.2f}; {every:.2f} with the biases, which jump in a pause after pose 50"
    yield Row(what.format("a hundred poses (payload)"), target, got, 0.5 <= square <= 2.0)
    force, reading, *_, block = taxel_force_runs(folder)
    runs = np.split(np.arange(len(force)), np.flatnonzero(np.diff(block) < 0) + 1)
    for name, run in zip(("10 kOhm", "bare", "thin"), runs, strict=True):
        halves = np.array_split(run, 2)
        curves = [identify_intensity(force[half], reading[half], kind="monotone").curves[0] for half in halves]
        at = np.linspace(0.1, 0.9, 5) * min(curve.largest for curve in curves)
        error = curves[0].intensity(at) - curves[1].intensity(at)
        slopes = [curve.jacobian(at) for curve in curves]
        spread = [slope @ curve.covariance @ slope.T for slope, curve in zip(slopes, curves, strict=True)]
        square = _squared(error, spread[0] + spread[1])
        yield Row(what.format(f"taxel_force, {name}"), target, f"{square:.2f}", 0.5 <= square <= 2.0)


def _squared(error: np.ndarray, covariance: np.ndarray) -> float:
    return float(error @ np.linalg.solve(covariance, error)) / len(error)


# --- payload: thirty poses

WEIGHT, CENTRE = np.array([0.0, 0.0, -12.0]), np.array([0.004, -0.01, 0.05])
BIAS = np.array([-3.0, 4.0, -9.0, 0.1, -0.2, 0.3])


def _payload(rng: np.random.Generator, spoil: Callable[..., tuple] = lambda log, turns, rng: (log, turns)) -> float:
    turns = Rotation.random(30, random_state=int(rng.integers(2**31))).as_matrix()
    hung = np.einsum("nji,j->ni", turns, WEIGHT)
    log = np.concatenate([hung, np.cross(CENTRE, hung)], axis=1) + BIAS + NOISE * rng.normal(size=(30, 6))
    found = palpate.identify_payload(*spoil(log, turns, rng))
    error = np.concatenate([found.weight - WEIGHT, found.center_of_mass - CENTRE])
    rows = [0, 1, 2, 6, 7, 8]
    return _squared(error, found.covariance[np.ix_(rows, rows)])


def _loose(log: np.ndarray, turns: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    turned = Rotation.from_rotvec(rng.normal(0.0, 0.03, 3)).as_matrix()
    return log, np.concatenate([turns[:15], turns[15:] @ turned])


def _tilted(log: np.ndarray, turns: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    return log, turns @ Rotation.from_rotvec(rng.normal(0.0, 0.03, (30, 3))).as_matrix()


POSES = {
    "a third of the poses touched": lambda log, turns, rng: (
        log + (rng.random((30, 1)) < 0.3) * rng.normal(0.0, 3.0, (30, 6)),
        turns,
    ),
    "the bias drifts by 0.2 N from pose to pose": lambda log, turns, rng: (
        log + np.cumsum(10.0 * NOISE * rng.normal(size=log.shape), axis=0),
        turns,
    ),
    "the sensor turns on its flange by some 3 degrees half-way": _loose,
    "orientations that err by 1.7 degrees": _tilted,
    "each wrench paired with the pose before it": lambda log, turns, rng: (log, np.roll(turns, 1, axis=0)),
}

# --- mounting: sixteen touches at marks

BODY = EllipsoidBody((0.03, 0.0125, 0.02))
NOMINAL = Pose(np.eye(3), np.array([0.0, 0.0, 0.085]))
TRUE = Pose.from_rotation_vector(np.array([0.02, -0.01, 0.03]), np.array([0.001, -0.0005, 0.0862]))


@cache
def _mesh() -> Mesh:
    return Mesh.from_arrays(*BODY.mesh(2000))


def _mounting(rng: np.random.Generator, spoil: Callable[..., tuple] = lambda w, marks, rng: (w, marks)) -> float:
    points, touches = touched(BODY, 16, rng, force=(2.0, 8.0), tan_theta=0.4, pitch=1e-3)
    wrenches = touches @ TRUE.wrench_matrix().T + 0.1 * NOISE * rng.normal(size=(16, 6))
    wrenches, marks = spoil(wrenches, points + rng.normal(0.0, 0.5e-3, points.shape), rng)
    found = identify_mounting(wrenches, _mesh(), initial=NOMINAL, points=marks, noise=0.1 * NOISE)
    turn = TRUE.rotation @ found.pose.rotation.T
    moved = TRUE.translation - turn @ found.pose.translation
    return _squared(np.concatenate([Rotation.from_matrix(turn).as_rotvec(), moved]), found.covariance)


MARKED = {
    "marks mirrored": lambda w, marks, rng: (w, marks * [1.0, -1.0, 1.0]),
    "marks in the order of another run": lambda w, marks, rng: (w, rng.permutation(marks)),
    "the sign of the torque reversed": lambda w, marks, rng: (w * AGAINST, marks),
    "a surface that gives by a millimetre in the second half": lambda w, marks, rng: (
        w,
        marks + np.repeat([0.0, 1e-3], 8)[:, None] * [1.0, 0.0, 0.0],
    ),
}

# --- clock: twenty seconds of turning

HEAVY = replace(PAYLOAD, weight=1.5 * PAYLOAD.weight)


def _clock(rng: np.random.Generator, spoil: tuple[float, float, palpate.Payload | None] = (0.04, 0.0, None)) -> float:
    """Of an offset that does not grow, or one that grows, another payload, or a hand that leans on the sensor."""
    (begin, growth, payload), touched = spoil[:3], spoil[3] if len(spoil) > 3 else 0.0
    swing = Swing(swing=tuple(rng.uniform(0.3, 0.6, 3)), swing_rate=tuple(rng.uniform(0.1, 0.25, 3)))
    time, posed = np.arange(4000) / 200.0, np.arange(-1.0, 21.0, 0.05)
    wrenches = moving_wrenches(LOAD, swing.at(time)) + NOISE * rng.normal(size=(4000, 6))
    wrenches[:, :3] += touched * np.sin(2.0 * np.pi * time[:, None] / 7.0)
    late = begin + growth * posed
    found = identify_offset(time, wrenches, posed - late, swing.at(posed).quaternion, payload=payload)
    return float(np.mean((found.offset - begin - growth * time) ** 2)) / found.deviation**2


TIMES = {
    "an offset that grows from 0 to 80 ms": (0.0, 0.004, None),
    "another tool's payload": (0.04, 0.0, HEAVY),
    "a hand that leans on the sensor by 2 N": (0.04, 0.0, None, 2.0),
}

# --- drift: three minutes at 50 Hz


def _drift(rng: np.random.Generator, spoil: np.ndarray | float = 0.0) -> float:
    time, walk = np.arange(9000) / 50.0, 0.02
    zero = np.cumsum(walk / 50.0**0.5 * rng.normal(size=(9000, 3)), axis=0)
    found = identify_drift(time, zero + 0.02 * rng.normal(size=(9000, 3)) + spoil, names="xyz")
    return float((found.drift.walk[0] - walk) / found.walk_deviation[0]) ** 2


MOVED = {
    "an arm that swings": np.sin(2.0 * np.pi * np.arange(9000)[:, None] / 400.0),
    "touched for a third of the log": 3.0 * (np.arange(9000)[:, None] > 6000),
}

# --- load cells: runs of the paper's bench

TIP = EllipticCylinder(a=14e-3, b=5e-3, half_length=16e-3, upper=True)
Log = dict[str, np.ndarray]


def _cells(rng: np.random.Generator, spoil: Callable[[Log], object] = lambda log: None) -> float:
    bench = replace(BENCHES["rigid"], seed=int(rng.integers(2**31)))
    run = bench.run(0, thin=20)
    log = {name: getattr(run, name).copy() for name in ("time", "voltages", "force", "position")}
    spoil(log)
    found = identify_load_cells(*log.values(), TIP).cells
    error = np.linalg.lstsq(found.matrix, bench.cells().forward())[0] - np.eye(6)
    return _squared(error.ravel(), found.covariance)


def _exchanged(log: Log) -> None:
    half = len(log["time"]) // 2
    log["voltages"][half:, :6] = log["voltages"][half:, [3, 4, 5, 0, 1, 2]]


BENCH = {
    "two of them swapped half-way": _exchanged,
    "the reference late by 0.1 s": lambda log: log.update(
        {name: np.roll(log[name], 5, axis=0) for name in ("force", "position")}
    ),
    "the reference's force is what the tip does to the ball": lambda log: log.update(force=-log["force"]),
    "the reference's z mirrored": lambda log: log.update(
        {name: log[name] * [1.0, 1.0, -1.0] for name in ("force", "position")}
    ),
}

# --- marker ring: presses of the coarse barrel; forces of forty others are judged

MARKERS = 2.0 * np.pi * np.arange(24) / 24
SHAKE = np.tile([0.1e-3, 0.05e-3], (24, 1))  # m: of 0.2 px


@cache
def _presses() -> tuple[RingPresses, RingPresses]:
    """A calibration with a plate and a dragged tip, and tips to judge by, without noise."""
    barrel = Barrel.built(BarrelSettings(around=48, rows=COARSE_ROWS, seed=1))
    rng = np.random.default_rng(1)
    known = list[Indenter]()
    for k in range(24):
        at, slide = 2.0 * np.pi * (k + rng.random()) / 24, (0.0, 0.002, -0.002)[k % 3]
        known += [Indenter("plate", at, depth) for depth in (0.002, 0.005, 0.009)]
        known += [Indenter("tip", at, depth, radius=0.01, slide=slide) for depth in (0.002, 0.005, 0.009)]
    judged = [Indenter("tip", 2.0 * np.pi * rng.random(), rng.uniform(0.003, 0.008), radius=0.01) for _ in range(40)]
    made = list[RingPresses]()
    for bodies in (known, judged):
        done = [barrel.press([body]) for body in bodies]
        names = ("angle", "depth", "force", "shear")
        angle, depth, force, shear = (np.array([getattr(each, name)[0] for each in done]) for name in names)
        way = np.stack([each.markers for each in done]) - barrel.rest[:, 0]
        c, s = np.cos(MARKERS), np.sin(MARKERS)
        seen = np.stack([way[..., 0] * c + way[..., 1] * s, way[..., 1] * c - way[..., 0] * s], axis=2)
        made.append(RingPresses(np.mod(angle, 2.0 * np.pi), depth, force, shear, seen, MARKERS, SHAKE))
    return made[0], made[1]


def _ring(rng: np.random.Generator, spoil: Callable[..., RingPresses] = lambda known, rng: known) -> float:
    shaken = [each.displacements + SHAKE * rng.normal(size=each.displacements.shape) for each in _presses()]
    known, judged = (replace(each, displacements=seen) for each, seen in zip(_presses(), shaken, strict=True))
    response, squares = fit_response(spoil(known, rng)), list[float]()
    locator = RingLocator(response, MARKERS, SHAKE)
    for k in range(len(judged)):
        locator.reset()
        found = locator.run(judged.displacements[k : k + 1])
        force, deviation = found.states[0, 0, [1, 5]] if found.counts[0] == 1 else (0.0, np.nan)
        spread = np.hypot(deviation, response.spread[1] * force)
        squares.append(((force - judged.force[k]) / spread) ** 2)
    return float(np.mean(squares)) if np.isfinite(squares).all() else np.inf


PRESSED = {
    "shear ten times too large": lambda known, rng: replace(known, shear=10.0 * known.shear),
    "truth shifted by one frame": lambda known, rng: replace(
        known, displacements=np.roll(known.displacements, 1, axis=0)
    ),
    "forces that err by 17 %": lambda known, rng: replace(known, force=known.force * rng.uniform(0.7, 1.3, len(known))),
    "angles counted clockwise": lambda known, rng: replace(known, angle=np.mod(-known.angle, 2 * np.pi)),
}

# --- intensity: ten presses and releases, of a taxel whose curve bends

PRESS = 6.0 * (1.0 - np.cos(2.0 * np.pi * np.arange(800) / 80.0))  # N


def _reading(force: np.ndarray) -> np.ndarray:
    return 7.0 + 60.0 * force / (1.0 + 0.1 * force)


def _curve(rng: np.random.Generator, spoil: Callable[[np.ndarray], np.ndarray]) -> float:
    counts = _reading(PRESS) + rng.normal(size=800)
    curve = identify_intensity(spoil(PRESS), counts, kind="polynomial", degree=3).curves[0]
    at = np.linspace(2.0, 11.0, 10)
    error = curve.intensity(at) - (_reading(at) - _reading(np.zeros(1)))
    return float(np.mean((error / (curve.deviation(at) * curve.slope(at))) ** 2))


def _bent(rng: np.random.Generator) -> float:
    reading, at = 7.0 + 40.0 * PRESS - PRESS**2 + rng.normal(size=800), np.array([6.0])
    curve = identify_intensity(PRESS, reading, degree=2).curves[0]
    error = curve.intensity(at) - 40.0 * at + at**2
    return float(np.mean((error / (curve.deviation(at) * curve.slope(at))) ** 2))


LOADED = {
    "the load cell late by a twentieth of a press": lambda force: np.roll(force, 4),
    "the load cell not tared, 2 N off": lambda force: force - 2.0,
}

# --- taxels: three hundred pokes of the simulated forearm, started from CAD

SKIN = Forearm.of()


def _taxels(
    rng: np.random.Generator, spoil: Callable[[Pokes], Pokes] | None = None, layout: ModuleLayout = SKIN.layout
) -> float:
    if spoil is _mirrored:
        layout = ModuleLayout(layout.places * [1.0, -1.0], layout.module)
    link = Mesh.from_arrays(*SKIN.cone.mesh())
    pokes = PokeBench.drawn(rng, skin=SKIN, errors=MIX, tip=HAND).session(rng, 300).pokes
    start, priors = SKIN.cad(rng), priors_of(MIX)
    given = spoil(pokes) if spoil else pokes
    found = calibrate_taxels(given, surface=link, start=start, layout=layout, priors=priors).places
    error, own = found.positions - SKIN.places.positions, link.project(found.positions)[1]
    along = error - np.einsum("ki,ki->k", error, own)[:, None] * own
    known = np.linalg.pinv(found.covariance, rcond=1e-6, hermitian=True)
    return float(np.mean(np.einsum("ki,kij,kj->k", along, known, along))) / 2.0


def _two_pokers(pokes: Pokes) -> Pokes:
    """Every other wrench has half of the wrench of the poke before, whose taxels do not answer."""
    wrench = pokes.wrench.copy()
    wrench[1::2] += 0.5 * wrench[:-1:2][: len(wrench[1::2])]
    return replace(pokes, wrench=wrench)


def _mirrored(pokes: Pokes) -> Pokes:
    """Leave the pokes: the layout is mirrored."""
    return pokes


POKED = {
    "a mirrored layout": _mirrored,
    "two pokers at once": _two_pokers,
    "the torque's sign reversed": lambda pokes: replace(pokes, wrench=pokes.wrench * AGAINST),
}

# --- camera: twelve boards of 9 x 6 corners with 0.1 px of noise

LENS = Fisheye(204.0, 204.0, 320.0, 240.0, 0.01, -0.003, 0.001, 0.0, 640, 480)


def _lens(rng: np.random.Generator, spoil: tuple[float, tuple[int, ...]] = (0.6, ())) -> float:
    """Of boards that are tilted so far [rad], some of them with wrong corners."""
    x, y = np.meshgrid(np.arange(9), np.arange(6))
    grid = 0.01 * np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3) - [0.04, 0.025, 0.0]
    (tilt, wrong), seen = spoil, list[np.ndarray]()
    for _ in range(12):
        place = np.array([*(rng.uniform(-0.08, 0.08, 2) * (tilt > 0)), rng.uniform(0.06, 0.12)])
        pose = Pose.from_rotation_vector(rng.uniform(-tilt, tilt, 3), place)
        seen.append(LENS.project(pose.apply(grid)) + rng.normal(0.0, 0.1, (54, 2)))
    for k in wrong:
        seen[k] = seen[k] + rng.normal(0.0, 6.0, (54, 2))
    fit = fit_lens(seen, (9, 6), 0.01, (640, 480))
    return ((fit.camera.fx - LENS.fx) / (fit.deviation * fit.validation.widening**0.5)) ** 2


BOARDS = {"a board held flat": (0.0, ()), "two pictures with wrong corners": (0.6, (2, 7))}
QUICK = ("payload", "mounting", "intensity", "camera")
CALIBRATIONS: dict[str, tuple[Trial, dict[str, Any]]] = {
    "payload": (_payload, POSES),
    "mounting": (_mounting, MARKED),
    "intensity": (_curve, LOADED),
    "camera": (_lens, BOARDS),
    "clock": (_clock, TIMES),
    "drift": (_drift, MOVED),
    "load cells": (_cells, BENCH),
    "marker ring": (_ring, PRESSED),
    "taxels": (_taxels, POKED),
}
