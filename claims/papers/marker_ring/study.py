"""The parts of the page: one contact, several, moving, trouble in the picture, intervals, another unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from claims.papers.marker_ring import bench as _bench
from claims.papers.marker_ring.bench import MARKERS, RATE, WAYS, Answer, Bench, Calibrated, Error, calibrated, errors
from palpate_lab.simulation.barrel import Indenter, Pressed
from palpate_lab.simulation.ring_camera import Look
from palpate_lab.simulation.ring_session import Protocol, RingSession, RingUnit

NOISE = 1.1  # of the camera
NOISES = (0.7, 1.0)  # at which the plate is judged as well
DEEP_FROM = 0.0015  # m: between the presses of 1 and of 2 mm
TIP, THIRD = 0.010, 0.025  # m, of the round tip of the calibration and of the one that judges
SEVERAL = (0.004, 0.008)  # m: how deep several press at once
SHUTTER = 0.5  # share of a frame during which it is open
INSTANTS = 5  # at which a moving skin is drawn while it is open
DEEP = 0.008  # m, of a moving plate
FINE = 0.0005  # m between the equilibria that a moving plate passes
READ = 200.0  # Hz, of the force sensor that the paper compares with
OFF = 3.0  # px from its true place, from which on a marker's label is wrong
FLICKER = "4 hidden, 10 blobs that flicker"  # the hardest for labels
TROUBLE = {
    "clean": Look(),
    "4 hidden, 10 blobs that stay": Look(),
    FLICKER: Look(),
    "light x0.5": Look(brightness=0.5),
    "light x2": Look(brightness=2.0),
    "hue +10": Look(hue=20.0),
    "hue -10": Look(hue=-20.0),
}


@dataclass(frozen=True)
class Sizes:
    """How much is done.

    Args:
        coarse: a barrel of few bricks.
        protocol: of the calibration.
        angles: at which one body presses, 10 depths at each (`steps`).
        pairs: touches a distance. apart: [deg] of two.
        plates: moving, a speed. speeds: [m/s].
        hidden, looks: touches with hidden markers, and with each other look; 12 frames each.
        short: touches of the short calibration.
    """

    coarse: bool
    protocol: Protocol
    angles: int
    steps: int
    pairs: int
    apart: tuple[int, ...]
    plates: int
    speeds: tuple[float, ...]
    hidden: int
    looks: int
    short: int


def one_contact(bench: Bench, made: Calibrated, body: Indenter, sizes: Sizes, rng: np.random.Generator) -> list[Answer]:
    """A body pressed at random angles, deeper step by step down to its depth."""
    camera, answers = bench.photographer(), list[Answer]()
    for angle in rng.uniform(0.0, 2.0 * np.pi, sizes.angles).tolist():
        answers += bench.pressed(made, camera, [replace(body, angle=angle)], sizes.steps)[1:]
    return answers


@dataclass(frozen=True)
class Numbers:
    """Frames of `count` contacts: how many found as many, and their errors, way by way."""

    name: str
    count: int
    right: dict[str, float]
    errors: dict[str, list[Error]]


def several(bench: Bench, made: Calibrated, sizes: Sizes, rng: np.random.Generator) -> list[Numbers]:
    """One tip, two at each distance, three and four 40 degrees apart."""
    kinds = [("one", 1, 0.0), *[(f"two, {apart} deg", 2, float(apart)) for apart in sizes.apart]]
    kinds += [("three, 40 deg", 3, 40.0), ("four, 40 deg", 4, 40.0)]
    camera, made_up = bench.photographer(), list[Numbers]()
    for name, count, apart in kinds:
        answers = list[Answer]()
        for _ in range(sizes.pairs * (2 if count == 1 else 1)):
            first, depths = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(*SEVERAL, count)
            angles = first + np.radians(apart) * np.arange(count)
            bodies = [Indenter("tip", *each, TIP) for each in zip(angles.tolist(), depths.tolist(), strict=True)]
            answers.append(bench.pressed(made, camera, bodies, 2)[-1])
        right = {way: float(np.mean([len(each.of(way)) == len(each.angle) for each in answers])) for way in WAYS}
        made_up.append(Numbers(name, count, right, {way: errors(answers, way) for way in WAYS}))
    return made_up


@dataclass(frozen=True)
class Moving:
    """Errors of force [N] at one speed [m/s].

    Attributes:
        middle: way -> of each frame while the plate moves, against the force in the middle of its exposure.
        held: way -> against the force at READ Hz of what the newest frame that is closed said.
    """

    speed: float
    middle: dict[str, Float[np.ndarray, " n"]]
    held: dict[str, Float[np.ndarray, " n"]]


@dataclass(frozen=True)
class _Way:
    """A plate's way down: equilibria at depths [m], from the unloaded one on."""

    depths: Float[np.ndarray, " s"]
    states: list[Pressed]

    def force(self, depth: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """[N]."""
        known = [float(state.force.sum()) for state in self.states]
        return np.asarray(np.interp(depth, self.depths, known))

    def at(self, depth: float) -> Pressed:
        k = min(max(int(np.searchsorted(self.depths, depth, side="right")) - 1, 0), len(self.depths) - 2)
        share = (depth - self.depths[k]) / (self.depths[k + 1] - self.depths[k])
        one, other = self.states[k], self.states[k + 1]
        discs = (1.0 - share) * one.discs + share * other.discs
        return replace(other, discs=discs, force=self.force(np.array([depth])), depth=np.array([depth]))


def moving(bench: Bench, made: Calibrated, sizes: Sizes, rng: np.random.Generator) -> list[Moving]:
    """A plate that comes down without a stop, seen at 30 frames a second while the shutter is open for half of each."""
    count = round(DEEP / FINE)
    ways = list[_Way]()
    for angle in rng.uniform(0.0, 2.0 * np.pi, sizes.plates).tolist():
        states = bench.ladder([Indenter("plate", angle, DEEP)], count)
        ways.append(_Way(np.arange(count + 1) * FINE, [bench.rest, *states]))
    found = list[Moving]()
    for speed in sizes.speeds:
        again = max(1, round(speed / 0.02))  # a fast plate is over after few frames: more of them
        runs = [_came_down(bench, made, way, speed, float(rng.uniform())) for way in ways * again]
        middle, held = ({way: np.concatenate([run[way][k] for run in runs]) for way in WAYS} for k in (0, 1))
        found.append(Moving(speed, middle, held))
    return found


def _came_down(
    bench: Bench, made: Calibrated, way: _Way, speed: float, phase: float
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Of both ways: the errors of force of each frame, and of what is read meanwhile."""
    lasts = DEEP / speed
    camera, time = bench.photographer(), np.arange(-1, int(lasts * RATE) + 2) / RATE + phase / RATE
    span = SHUTTER / RATE * np.linspace(-0.5, 0.5, INSTANTS)

    def depth(at: np.ndarray) -> np.ndarray:
        return np.clip(at * speed, 0.0, DEEP)

    frames = [camera.frame([way.at(float(d)).discs for d in depth(t + span)], float(t)) for t in time]
    answers = _bench.answered(made, frames, [way.at(float(d)) for d in depth(time)])
    inside = (time > 0.0) & (time < lasts)
    read = np.arange(0.0, lasts, 1.0 / READ)
    newest = np.searchsorted(time + 0.5 * SHUTTER / RATE, read, side="right") - 1
    known = {name: np.array([_strongest(answer.of(name)) for answer in answers]) for name in WAYS}
    told = {name: np.where(newest >= 0, force[np.maximum(newest, 0)], 0.0) for name, force in known.items()}
    return {
        name: ((force - way.force(depth(time)))[inside], told[name] - way.force(depth(read)))
        for name, force in known.items()
    }


def _strongest(found: Float[np.ndarray, "n c"]) -> float:
    """[N]; 0 without a contact."""
    return float(found[:, 1].max()) if len(found) else 0.0


@dataclass(frozen=True)
class Trouble:
    """Frames with something wrong in the picture.

    Attributes:
        frames: how many.
        right: way -> share whose labels are all right.
        seen: share of the visible markers that ours reports.
        angle: way -> errors [rad] at the end of each touch.
        answered: way -> share of the touches that have one.
    """

    name: str
    frames: int
    right: dict[str, float]
    seen: float
    angle: dict[str, Float[np.ndarray, " n"]]
    answered: dict[str, float]

    def times(self, clean: Trouble) -> float:
        """The angle's error of ours over that of the same touches on clean frames."""
        own, other = self.angle["ours"], clean.angle["ours"]
        return float(np.abs(own).mean() / np.abs(other[: len(own)]).mean()) if len(own) else float("nan")


def troubled(
    bench: Bench, made: Calibrated, sizes: Sizes, seed: int, names: Sequence[str] = tuple(TROUBLE)
) -> list[Trouble]:
    """The same touches by the third tip, 3 to 6 mm deep, in every trouble, coming down in 8 frames."""
    found, touches = list[Trouble](), list[list[Pressed]]()
    rng = np.random.default_rng([seed, 3])
    for _ in range(max(sizes.hidden, sizes.looks)):
        body = Indenter("tip", float(rng.uniform(0.0, 2.0 * np.pi)), float(rng.uniform(0.003, 0.006)), THIRD)
        touches.append([bench.rest] * 2 + bench.ladder([body], 7)[:-1] + [bench.ladder([body], 1)[0]] * 4)
    for name in names:
        look = TROUBLE[name]
        count = sizes.hidden if "hidden" in name or name == "clean" else sizes.looks
        found.append(_in_trouble(bench, made, name, replace(look, noise=bench.unit.look.noise), touches[:count]))
    return found


def _in_trouble(bench: Bench, made: Calibrated, name: str, look: Look, touches: Sequence[Sequence[Pressed]]) -> Trouble:
    rng, camera = np.random.default_rng(17), bench.photographer(look)
    right, last = {"ours": list[bool](), "theirs": list[bool]()}, list[Answer]()
    rest, seen = bench.unit.camera.project(bench.rest.markers), list[float]()
    number = {
        way: np.linalg.norm(own[:, None] - rest[None], axis=2).argmin(axis=1)  # of the barrel's, marker by marker
        for way, own in (("ours", made.ours.rest), ("theirs", made.theirs.rest))
    }
    for touch in touches:
        hidden: list[int] = rng.choice(MARKERS, 4, replace=False).tolist() if "hidden" in name else []
        stay = rng.uniform((0.0, 0.0, 2.0), (bench.unit.camera.width, bench.unit.camera.height, 10.0), (10, 3))
        blobs = stay if "stay" in name else 10 if "flicker" in name else 0
        frames = [camera.frame([state.discs], k / RATE, hidden=hidden, blobs=blobs) for k, state in enumerate(touch)]
        ours = list[np.ndarray]()
        last.append(_bench.answered(made, frames, touch, ours)[-1])
        for frame, state, found in zip(frames, touch, ours, strict=True):
            places = bench.unit.camera.project(state.markers)
            seen.append(np.isfinite(found[:, 0]).sum() / (MARKERS - len(hidden)))
            for way, each in (("ours", found), ("theirs", made.theirs.labelled(frame))):
                right[way].append(_right(each, places[number[way]], np.isin(number[way], hidden)))
    angle = {way: np.array([each.angle for each in errors(last, way)]) for way in right}
    shares = {way: float(np.mean(each)) for way, each in right.items()}
    there = {way: float(np.mean([len(each.of(way)) > 0 for each in last])) for way in right}
    return Trouble(name, len(seen), shares, float(np.mean(seen)), angle, there)


def _right(found: Float[np.ndarray, "m 2"], true: Float[np.ndarray, "m 2"], hidden: Bool[np.ndarray, " m"]) -> bool:
    """Whether half of the markers are reported, all of them where they are, and none that is hidden."""
    said = np.isfinite(found[:, 0])
    off = np.linalg.norm(found - true, axis=1)
    return bool(2 * said.sum() >= len(said) and not (said & hidden).any() and (off[said] <= OFF).all())


def short_session(session: RingSession, touches: int) -> RingSession:
    """A few touches of a calibration: at evenly spread angles, plate and tip, one depth each, in turns 4 and 8 mm."""
    touched = session.contacts > 0
    body = np.cumsum(np.diff(touched, prepend=False) & touched)
    every: list[Int[np.ndarray, " g"]] = [np.flatnonzero(touched & (body == k)) for k in range(1, int(body.max()) + 1)]
    usual = int(np.bincount([len(group) for group in every]).argmax())
    groups = [group for group in every if len(group) == usual]  # those that were not dragged
    rest = np.flatnonzero(~touched)
    rows = [int(row) for row in rest[: round(RATE)]]
    for k in range(touches):
        group = groups[k * len(groups) // touches]
        deep = session.depth[group, 0]
        rows += [int(group[np.argmin(np.abs(deep - (0.004, 0.008)[k % 2]))]), int(rest[-1])]
    names = ("markers", "discs", "angle", "depth", "force", "shear")
    return replace(session, time=np.arange(len(rows)) / RATE, **{name: getattr(session, name)[rows] for name in names})


def transfer(unit: RingUnit, first: Calibrated, sizes: Sizes, seed: int) -> dict[str, list[Error]]:
    """Errors of ours on a second unit: calibrated in full, with few touches from the first's response, and without."""
    other = Bench(_bench.second(unit, coarse=sizes.coarse), seed)
    session = other.calibration(sizes.protocol)
    short, look = short_session(session, sizes.short), other.unit.look
    ways = {
        "in full": calibrated(session, look),
        "few touches, from the first unit": calibrated(short, look, first.ours.response),
    }
    if not sizes.coarse:
        ways["few touches alone"] = calibrated(short, look)
    body, found = Indenter("tip", 0.0, 0.01, THIRD), dict[str, list[Error]]()
    for name, made in ways.items():
        found[name] = errors(one_contact(other, made, body, sizes, np.random.default_rng([seed, 8])), "ours")
    return found
