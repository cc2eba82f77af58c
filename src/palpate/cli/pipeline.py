"""A log opened and everything set up to locate in it: what `estimate` and `view` have in common."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from time import perf_counter

import numpy as np
from jaxtyping import Float

from palpate.cli.interrupts import import_mesh_reader
from palpate.cli.screen import wait
from palpate.contact.estimate import ContactEstimate
from palpate.contact.wrench_estimator import WrenchEstimator
from palpate.errors import InputError
from palpate.io.logs import Log, join, open_log
from palpate.io.rig import Rig, build
from palpate.io.rig.tables import RigFilter
from palpate.sensors.motion import Motion
from palpate.sensors.noise import estimate_noise
from palpate.sensors.recording import ACCELERATION, Recording
from palpate.surfaces import Surface

__all__ = ["Pipeline", "open_pipeline"]

HEAD = 20_000  # samples from which noise and rate are taken


@dataclass
class Pipeline:
    """A log on its way through sensor, payload, filter and surface, once.

    Attributes:
        log, rig, surface, estimator: what it is made of.
        motion: what inertia adds; None where the payload weighs nothing.
        noise: (6,) taken from the log's steps, None where the rig states it or the log cannot tell.
        channels: names of what the log has.
        said: sentences on what was done before the first sample, such as the tare.
        doubted: what may be wrong about it.
        seconds: spent so far on preparing, reading and locating.
    """

    log: Log
    rig: Rig
    surface: Surface
    estimator: WrenchEstimator
    motion: Motion | None
    noise: Float[np.ndarray, "6"] | None
    channels: frozenset[str]
    said: list[str]
    doubted: list[str]
    _blocks: Iterator[Recording]
    seconds: dict[str, float] = field(default_factory=lambda: {"prepare": 0.0, "read": 0.0, "locate": 0.0})

    def stream(self) -> Iterator[tuple[Recording, ContactEstimate]]:
        """Blocks of the log with their contacts in the surface's frame, row for row."""
        blocks = self._timed() if self.motion is None else self.motion.stream(self._timed())
        located = ((block, found.estimate) for block, found in self.estimator.pairs(blocks))
        while True:
            begin, reading = perf_counter(), self.seconds["read"]
            pair = next(located, None)
            self.seconds["locate"] += perf_counter() - begin - (self.seconds["read"] - reading)
            if pair is None:
                return
            yield pair

    def notes(self) -> list[str]:
        """What was met on the way, so far."""
        motion, payload = self.motion, self.estimator.sensor.payload
        moved = () if motion is None or payload is None else motion.notes(payload.mass)
        return [*self.surface.notes, *self.log.notes(), *moved]

    def remarks(self) -> list[str]:
        """What was assumed for want of being told."""
        rig, said = self.rig, list[str]()
        if self.noise is not None:
            force, torque = self.noise[:3].max(), self.noise[3:].max()
            said.append(
                f"noise taken from the log's steps: {force:.3g} N, {torque:.3g} N m (a filtered log looks too quiet)"
            )
        elif rig.force_torque.noise is None:
            said.append("the noise is not known and the log too short to tell it: no covariances")
        if self.estimator.sensor.payload is None:
            tared = "the tare holds only while the sensor keeps its orientation"
            untared = "wrenches are taken as they are, so they must be tared"
            said.append(f"no payload model: {untared if rig.estimate.tare is None else tared}")
        if rig.surface.pose_covariance is None and self.estimator.sensor.noise is not None:
            said.append(
                "ellipses hold noise and payload only: where the surface sits is taken as exact (calibrate mounting)"
            )
        if rig.estimate.contact is None:
            locator = self.estimator.locator
            said.append(f"a contact begins at {locator.on:.3g} N and ends at {locator.off:.3g} N (from the noise)")
        return said

    def _timed(self) -> Iterator[Recording]:
        while True:
            begin = perf_counter()
            block = next(self._blocks, None)
            self.seconds["read"] += perf_counter() - begin
            if block is None:
                return
            yield block


def open_pipeline(path: Path, rig: Rig) -> Pipeline:
    """Open a log and prepare everything that its samples go through.

    Raises:
        InputError: the log, the mesh or the payload cannot be used, or the start to tare at is not unloaded.
    """
    log = open_log(path, rig.layout())
    if rig.mesh_path() is not None:
        import_mesh_reader()
    wait("preparing the surface and compiling kernels (compiling happens once)")
    begin = perf_counter()
    surface = rig.surface.load(rig.folder)
    surface.prepared()  # compiled loops are loaded here, and not on the time of reading
    blocks, loaded = log.blocks(), perf_counter()
    first = list(_head(blocks, rig.estimate.tare or 0.0))
    read = perf_counter() - loaded
    head = join(first)
    noise = None if rig.force_torque.noise is not None else estimate_noise(head.wrenches())
    rate = _rate(rig.filter, head)
    estimator = build(rig if rate else replace(rig, filter=RigFilter()), surface=surface, noise=noise, rate=rate)
    said = [] if estimator.filter is None or rate is None else [estimator.filter.describe(rate)]
    doubted: list[str] = []
    if rig.estimate.tare is not None:
        tared = estimator.tare(_start(head, rig.estimate.tare))
        said.append(tared.said)
        doubted += [tared.doubt] if tared.doubt else []
    motion, channels = _motion(rig, estimator, head), frozenset(head.channels)
    pipeline = Pipeline(log, rig, surface, estimator, motion, noise, channels, said, doubted, chain(first, blocks))
    pipeline.seconds.update(prepare=perf_counter() - begin - read, read=read)
    return pipeline


def _head(blocks: Iterable[Recording], seconds: float) -> Iterator[Recording]:
    """The first blocks: at least HEAD samples and so many seconds, if there are."""
    count, begin, end = 0, np.inf, -np.inf
    for block in blocks:
        yield block
        count += len(block)
        begin = min(begin, np.nanmin(block.time, initial=np.inf))
        end = max(end, np.nanmax(block.time, initial=-np.inf))
        if count >= HEAD and end - begin > seconds:
            return


def _rate(stated: RigFilter, head: Recording) -> float | None:
    """Samples a second; None where a filter has nothing to smooth."""
    if stated.rate is not None or stated.kind == "none":
        return stated.rate or head.rate()
    if len(head) < 2:
        return None
    steps = np.diff(head.time)
    if np.count_nonzero(steps > 0) <= len(steps) / 2:
        raise InputError(
            "most times repeat or are missing, so the rate that the filter needs is not known.",
            where=head.source,
            mend="Give the rate [Hz] in the rig's [filter], or use --filter none.",
        )
    return head.rate()


def _start(head: Recording, seconds: float) -> Recording:
    """The first seconds."""
    known = head.time[np.isfinite(head.time)]
    if not len(known):
        raise InputError("has no times, so its first seconds are not known.", where=head.source)
    return head.picked(head.time <= known[0] + seconds)


def _motion(rig: Rig, estimator: WrenchEstimator, head: Recording) -> Motion | None:
    """How inertia is accounted for."""
    stated, payload = rig.acceleration, estimator.sensor.payload
    if payload is None or not payload.weight.any():
        return None
    recorded = stated.kind if ACCELERATION in head.channels else "none"
    source = "poses" if stated.from_poses else recorded
    return Motion(source=source, window=stated.window, gravity=payload.gravity, lever=payload.center_of_mass)
