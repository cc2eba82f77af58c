"""One simulated unit on the bench: bodies pressed into its barrel, and its frames read by both ways side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice

import numpy as np
from jaxtyping import Float, UInt8
from scipy.optimize import linear_sum_assignment

from claims.papers.marker_ring.theirs import Theirs
from palpate.contact.estimate import Status
from palpate.optical.fisheye import Fisheye
from palpate.optical.ring_response import RingResponse
from palpate.sensors.marker_ring.calibrate import RingTruth, calibrate_marker_ring
from palpate.sensors.marker_ring.estimator import RingEstimator
from palpate.sensors.marker_ring.locator import turned
from palpate.sensors.marker_ring.model import MarkerRing, RingBody
from palpate.signals.recording import IMAGE, Recording
from palpate_lab.simulation.barrel import Barrel, Indenter, Pressed
from palpate_lab.simulation.ring_camera import Look, RenderedCamera
from palpate_lab.simulation.ring_session import Protocol, RingSession, RingUnit, calibration_run

RATE = 30.0  # Hz
MARKERS, RADIUS, THICKNESS = 24, 0.055, 0.004  # as drawn: a unit's own wall is a few percent off
DRAGGED = 0.1  # shear over force, from which on a press was dragged: the paper has no such presses
BLOCK = 32  # frames in memory at once
WAYS = ("theirs", "ours")


@dataclass(frozen=True)
class Bench:
    """A unit.

    Args:
        unit: its barrel, camera and look.
        seed: of the frames' noise.
    """

    unit: RingUnit
    seed: int = 0

    @cached_property
    def barrel(self) -> Barrel:
        return Barrel.built(self.unit.barrel)

    @cached_property
    def rest(self) -> Pressed:
        return self.barrel.press([])

    def photographer(self, look: Look | None = None) -> RenderedCamera:
        return RenderedCamera(self.unit.camera, look or self.unit.look, np.random.default_rng([self.seed, 5]))

    def ladder(self, bodies: Sequence[Indenter], steps: int) -> list[Pressed]:
        return self.barrel.follow(bodies, [((k + 1) / steps, 0.0) for k in range(steps)])

    def pressed(self, made: Calibrated, camera: RenderedCamera, bodies: Sequence[Indenter], steps: int) -> list[Answer]:
        """What bodies that come down in so many steps are taken for, the unloaded barrel first."""
        states = [self.rest, *self.ladder(bodies, steps)]
        frames = [camera.frame([state.discs], k / RATE) for k, state in enumerate(states)]
        return answered(made, frames, states)

    def calibration(self, protocol: Protocol) -> RingSession:
        return calibration_run(self.unit, protocol)


@dataclass(frozen=True)
class Calibrated:
    """Both ways, calibrated on the same frames."""

    ours: MarkerRing
    theirs: Theirs

    @cached_property
    def estimator(self) -> RingEstimator:
        return RingEstimator(self.ours)


def calibrated(session: RingSession, look: Look, before: RingResponse | None = None) -> Calibrated:
    """Both ways from one session: ours from all of its presses, theirs from the plate's that were not dragged."""
    theirs = Theirs(MARKERS)
    camera = session.unit.camera
    lens = Fisheye(*camera.focal, *camera.middle, *camera.distortion, width=camera.width, height=camera.height)
    angle, depth, force, shear = (getattr(session, name)[:, 0] for name in ("angle", "depth", "force", "shear"))

    def blocks() -> Iterator[Recording]:
        frames = session.frames(look)
        for first in range(0, len(session.time), BLOCK):
            block = np.stack(list(islice(frames, BLOCK)))
            theirs.look(block)
            yield Recording(session.time[first : first + BLOCK], {IMAGE: block})

    truth = RingTruth(angle, depth, force, shear)
    ours = calibrate_marker_ring(blocks(), truth, RingBody(RADIUS, THICKNESS, MARKERS, lens), before)
    touched = session.contacts > 0
    body = np.cumsum(np.diff(touched, prepend=False) & touched)  # plate, tip, plate, ...
    plain = np.abs(np.nan_to_num(shear)) < DRAGGED * np.nan_to_num(force)
    theirs.fit(~touched, touched & (body % 2 == 1) & plain, angle, force)
    return Calibrated(ours, theirs)


@dataclass(frozen=True)
class Answer:
    """What both ways say of one frame, and the truth of it.

    Attributes:
        angle, force, depth: (k,) of the bodies that touch.
        ours: (n, 4) angle, force and their deviations. theirs: (n, 2) angle, force.
    """

    angle: Float[np.ndarray, " k"]
    force: Float[np.ndarray, " k"]
    depth: Float[np.ndarray, " k"]
    ours: Float[np.ndarray, "n 4"]
    theirs: Float[np.ndarray, "n 2"]

    def of(self, way: str) -> Float[np.ndarray, "n c"]:
        return self.ours if way == "ours" else self.theirs


def answered(
    made: Calibrated,
    frames: Sequence[UInt8[np.ndarray, "h w 3"]],
    truth: Sequence[Pressed],
    places: list[Float[np.ndarray, "m 2"]] | None = None,
) -> list[Answer]:
    """Frames of one touch in their order, as if nothing had been seen before; where ours sees markers into `places`."""
    made.estimator.reset()
    log = Recording(np.arange(len(frames)) / RATE, {IMAGE: np.stack(frames)})
    seen = list[np.ndarray]()
    _, found = next(made.estimator.pairs([log], lambda _, pixels: seen.extend(pixels)))
    if places is not None:
        places += seen
    there = found.estimate.status != Status.NO_CONTACT
    there &= found.estimate.status != Status.INVALID
    columns = [found.features[name] for name in ("angle", "angle_sd", "force_sd")]
    inward = -np.einsum("ni,ni->n", found.estimate.force, found.estimate.normal)
    rows = np.stack([columns[0], inward, columns[1], columns[2]], axis=1)
    answers = list[Answer]()
    for n, (frame, state) in enumerate(zip(frames, truth, strict=True)):
        touches = state.force > 0.0
        values = (state.angle[touches], state.force[touches], state.depth[touches])
        answers.append(Answer(*values, rows[there & (found.sample == n)], made.theirs(frame)))
    return answers


@dataclass(frozen=True)
class Error:
    """Of one true contact: [rad], [N]; how deep it is [m]; theirs have no deviations."""

    angle: float
    force: float
    depth: float
    sd: tuple[float, float] = (np.nan, np.nan)


def errors(answers: Sequence[Answer], way: str) -> list[Error]:
    """Of every true contact against the found one that stands for it; where nothing is left for it, none.

    The strongest stands for a single one; several are paired so that the angles between them are least.
    """
    made = list[Error]()
    for answer in answers:
        found = answer.of(way)
        if len(answer.angle) == 1 and len(found):
            found = found[[np.argmax(found[:, 1])]]
        off = turned(found[:, None, 0] - answer.angle[None, :])
        for i, j in zip(*linear_sum_assignment(np.abs(off)), strict=True):
            sd = (float(found[i, 2]), float(found[i, 3])) if found.shape[1] > 2 else (np.nan, np.nan)
            made.append(Error(float(off[i, j]), float(found[i, 1] - answer.force[j]), float(answer.depth[j]), sd))
    return made


def second(unit: RingUnit, *, coarse: bool) -> RingUnit:
    """Another one: wall, silicone, lens, tilt and offset differ."""
    return replace(RingUnit.drawn(unit.seed + 1, coarse=coarse), look=unit.look)
