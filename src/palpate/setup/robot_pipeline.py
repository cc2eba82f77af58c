"""Estimate the contacts of all sensors of a robot in one log, each by its own estimator, merged in time."""

from __future__ import annotations

from collections.abc import Collection, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median_low
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ContactEstimate
from palpate.contact.frames import in_base
from palpate.contact.origins import EXPECTED, Origin, Origins
from palpate.errors import InputError, PalpateError
from palpate.files.logs import contents
from palpate.files.logs.opening import frames_named, messages_of
from palpate.files.logs.robot_motion import RobotMotion
from palpate.files.logs.stamp_delays import stamp_delays
from palpate.files.logs.topics import LIVE
from palpate.setup.pipeline import OpenedLog, Pipeline, open_log
from palpate.setup.rig import Rig
from palpate.setup.robot import Robot, RobotSensor
from palpate.signals.recording import IMAGE, Recording
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import skew

BYTES = 1 << 23  # of messages that are read for one sensor, then for the next
SILENT = 1.0  # s by which the samples of a sensor may end before those of the others
OFF = 0.02  # s by which the stamps of a sensor may differ from those of the others


@dataclass(frozen=True)
class SensorRun:
    """A sensor of a robot with the pipeline of its samples."""

    sensor: RobotSensor
    pipeline: Pipeline


class RobotPipeline:
    """The processing of a robot's log from the samples of its sensors to contacts, which can run once.

    A sensor whose samples cannot be read or located is left out and named in `failed`; the others are kept.

    Args:
        robot: the robot.
        log: file of the log.
        frame: frame of the contacts: "surface" or "sensor", each sensor's own, or "base", that of the robot.
        sensors: names of the sensors, as a tuple or with commas between; None: all.

    Attributes:
        runs: sensors that are estimated.
        failed: name of a sensor -> why it is left out, or was from some sample on.
        features: names of the features of all sensors.

    Raises:
        InputError: no sensor can be estimated, there is no sensor of a name, or the base frame needs joint states that
            the log does not have.
    """

    def __init__(
        self, robot: Robot, log: Path, frame: str = "surface", sensors: tuple[str, ...] | str | None = None
    ) -> None:
        self._robot, self.frame, self._log = robot, frame, log
        self.runs, picked = list[SensorRun](), robot.picked(sensors)
        self._ends = dict[str, float]()  # time [s] of the last sample of each sensor
        self.failed = {name: str(problem) for name, problem in robot.faulty.items() if sensors is None}
        self._motion = self._read_motion(log, picked) if frame == "base" else None
        recorded = {topic.name for topic in contents(log).topics}
        opened, heads = dict[str, OpenedLog](), dict[str, Iterator[Recording]]()
        for each in picked:
            with self._left_out(each.name):
                opened[each.name] = open_log(log, _recorded(each, recorded)).in_blocks_of(BYTES)
                heads[each.name] = opened[each.name].reading()
        while heads:  # a block of each in turn: what one of them unpacks is there for the others
            for name, head in list(heads.items()):
                with self._left_out(name):
                    if next(head, None) is not None:
                        continue
                del heads[name]
        for each in picked:
            if each.name not in self.failed:
                with self._left_out(each.name):
                    own = Pipeline.of(opened[each.name], "surface" if frame == "base" else frame)
                    self.runs.append(SensorRun(each, own))
        if not self.runs:
            raise InputError(" ".join(f"{name}: {why}" for name, why in self.failed.items()), where=str(log))
        named = (name for run in self.runs for name in run.pipeline.estimator.features)
        expected = [EXPECTED] if any(each.expected for each in picked) else []
        self.features = tuple(dict.fromkeys([*named, *expected]))

    @contextmanager
    def _left_out(self, name: str) -> Generator[None]:
        """Note the `PalpateError` that ends the block as the reason to leave a sensor out."""
        try:
            yield
        except PalpateError as problem:
            self.failed[name] = str(problem)

    @property
    def motion(self) -> RobotMotion | None:
        """Motion of the links; None unless the contacts are in the base frame."""
        return self._motion

    def frames(self) -> dict[Origin, str]:
        """Return a dict, origin -> name of the frame of its contacts."""
        sensors = [run.sensor for run in self.runs]
        if self.frame == "base":
            return dict.fromkeys((each.origin for each in sensors), self._robot.base)
        return {each.origin: (each.frame if self.frame == "sensor" else each.link) or self.frame for each in sensors}

    def stream(self) -> Iterator[Contacts]:
        """Yield the contacts of all sensors in the order of their times, in blocks."""
        return merged([self._contacts(run) for run in self.runs])

    @property
    def share(self) -> float:
        """Share (0 to 1) of the log that was read for all sensors."""
        return min(run.pipeline.log.share for run in self.runs)

    @property
    def torn(self) -> bool:
        """True if the log is cut off."""
        return any(run.pipeline.log.torn for run in self.runs)

    def notes(self) -> list[str]:
        """Return notes on the log and on the estimates so far, one sentence each, after the names of the sensors."""
        motion = [] if self._motion is None else list(self._motion.notes())
        return [*motion, *_named((run.sensor.name, run.pipeline.notes()) for run in self.runs)]

    def warnings(self) -> list[str]:
        """Return what may be wrong with the samples so far, one sentence each, after the names of the sensors."""
        motion = [] if self._motion is None else list(self._motion.warnings())
        lost = [f"{name} is left out: {why}" for name, why in self.failed.items()]
        first = [(run.pipeline.log.torn, run.pipeline.unbelievable()) for run in self.runs]
        own = [[*filter(None, said), *run.pipeline.warnings()] for said, run in zip(first, self.runs, strict=True)]
        named = _named(zip((run.sensor.name for run in self.runs), own, strict=True))
        return [*lost, *self._silent(), *self._clocks(), *self._elsewhere(), *motion, *named]

    def _silent(self) -> Iterator[str]:
        """Yield a sentence on each sensor that ends earlier than the others."""
        last = max(self._ends.values(), default=0.0)
        for name, end in self._ends.items():
            if last - end > SILENT:
                yield f"{name}: its samples end {last - end:.1f} s before those of the others, and so do its contacts"

    def _clocks(self) -> Iterator[str]:
        """Yield a sentence on each topic whose stamps are far from those of the others, by when they were recorded."""
        source, joints = messages_of(self._log), self._robot.table.joints
        topics = {
            table.topic: run.sensor.name
            for run in self.runs
            for table in run.sensor.rig.sensors.values()
            if getattr(table, "topic", None) is not None and IMAGE not in run.sensor.kind.channels
        }
        topics |= {joints: "joint states"} if isinstance(joints, str) else {}
        delays = {} if source is None else stamp_delays(source, list(topics))
        usual = median_low(delays.values()) if delays else 0.0
        for topic, delay in delays.items():
            if abs(late := usual - delay) > OFF:
                way = "later" if late > 0 else "earlier"
                yield (
                    f"{topics[topic]}: its stamps are {abs(1e3 * late):.0f} ms {way} than "
                    "those of the others, by when the messages were recorded: a clock that is off, or a slow driver"
                )

    def _elsewhere(self) -> Iterator[str]:
        """Yield a sentence on each sensor whose messages name a link that moves against the link of the rig."""
        if (urdf := self._robot.urdf) is None:
            return
        fixed, named = urdf.fixed(), frames_named(self._log, contents(self._log).topics)
        body = {link: fixed.up(link)[-1] if link in fixed.frames else link for link in urdf.links}
        for each in (run.sensor for run in self.runs):
            for table in each.rig.sensors.values():
                frame = named.get(getattr(table, "topic", None) or "")
                if frame in body and each.frame in body and body[frame] != body[each.frame]:
                    what = f"{each.name}: its messages name the frame {frame!r}, but the rig the link {each.frame!r}"
                    yield f"{what}: if two topics are exchanged, its contacts are those of another sensor"

    def _read_motion(self, log: Path, sensors: Sequence[RobotSensor]) -> RobotMotion:
        robot, table = self._robot, self._robot.table
        urdf, base = robot.urdf, robot.base
        if urdf is None:  # `base` has raised
            raise InputError("the robot has no URDF.", where=str(robot.path))
        links = list(dict.fromkeys(each.frame for each in sensors if each.frame is not None))
        return RobotMotion.read(
            log,
            urdf,
            base,
            links,
            joints=table.joints,
            max_gap=table.max_gap,
            encoder=np.radians(table.encoder),
        )

    def _contacts(self, run: SensorRun) -> Iterator[Contacts]:
        """Yield the contacts of one sensor, with the columns of the robot's."""
        sensor, names = run.sensor, list(self._robot.sensors)
        try:
            for block, _, placed in run.pipeline.stream():
                self._ends[sensor.name] = float(
                    np.fmax.reduce(block.time, initial=self._ends.get(sensor.name, -np.inf))
                )
                yield self._of_robot(self._in_base(placed, block, run), sensor, names.index(sensor.name), len(names))
        except PalpateError as problem:
            self.failed[sensor.name] = f"its samples cannot be read on: {problem}"

    def _of_robot(self, found: Contacts, sensor: RobotSensor, place: int, count: int) -> Contacts:
        """Return contacts with origins, identities that no other sensor has, and all features."""
        added = {EXPECTED: np.full(len(found), float(sensor.expected))} if EXPECTED in self.features else {}
        unknown = np.full(len(found), np.nan)
        return replace(
            found,
            identity=found.identity * count + place,
            features={name: added.get(name, found.features.get(name, unknown)) for name in self.features},
            origins=Origins.single(sensor.origin, len(found)),
        )

    def _in_base(self, found: Contacts, block: Recording, run: SensorRun) -> Contacts:
        """Return contacts in the base frame, their covariances with the error of the joints' positions."""
        if self._motion is None or not len(found):
            return found
        frame = run.sensor.require_frame()
        rows = found.sample - found.sample[0]
        time = block.time[rows]
        quaternion, position = self._motion.at(frame, time)
        placed = in_base(found.estimate, quaternion, position, run.pipeline.estimator.mount)
        error = self._motion.covariance(frame, time)
        return found.with_estimate(widened(placed, position, error) if error.any() else placed)


@takes_arrays
def widened(
    estimate: ContactEstimate, origin: Float[np.ndarray, "n 3"], covariance: Float[np.ndarray, "n 6 6"]
) -> ContactEstimate:
    """Return n estimates in the base whose covariances have the errors of the link's poses added.

    Args:
        estimate: (n,) in the base.
        origin: (n, 3) [m] of the link's frame in the base.
        covariance: (n, 6, 6) of the rotation vector [rad] and the translation [m] of the link's pose, in the base.

    Raises:
        InputError: arrays of other shapes.
    """
    shifted = np.broadcast_to(np.eye(3), (len(covariance), 3, 3))
    moved = np.concatenate([-skew(estimate.point - origin), shifted], axis=2)
    return replace(estimate, covariance=estimate.covariance + moved @ covariance @ np.swapaxes(moved, 1, 2))


def merged(streams: Sequence[Iterator[Contacts]]) -> Iterator[Contacts]:
    """Yield the rows of several streams of contacts in the order of their times, in blocks.

    The rows of one stream stay in their order: where its times go back or are missing, its latest time so far counts.
    Rows of equal times are in the order of the streams.
    """
    buffers = [_Buffer(each) for each in streams]
    while running := [each for each in buffers if not each.ended]:
        min(running, key=lambda each: each.latest).advance()
        horizon = min((each.latest for each in buffers if not each.ended), default=np.inf)
        parts = [part for each in buffers for part in each.before(horizon)]
        if parts:
            rows, keys = Contacts.joined([part.rows for part in parts]), np.concatenate([part.keys for part in parts])
            yield rows[np.argsort(keys, kind="stable")]


class _Part(NamedTuple):
    rows: Contacts
    keys: Float[np.ndarray, " n"]


class _Buffer:
    """Rows of one stream that wait for those of others."""

    def __init__(self, stream: Iterator[Contacts]) -> None:
        self._stream, self._parts = stream, list[_Part]()
        self.latest, self.ended = -np.inf, False

    def advance(self) -> None:
        """Take the next block of the stream."""
        rows = next(self._stream, None)
        self.ended = rows is None
        if rows is not None and len(rows):
            times = np.where(np.isfinite(rows.time), rows.time, -np.inf)
            keys = np.maximum.accumulate(np.maximum(times, self.latest))
            self.latest = float(keys[-1])
            self._parts.append(_Part(rows, keys))

    def before(self, horizon: float) -> list[_Part]:
        """Return and remove the rows with times before the horizon; all if that is infinite."""
        taken = list[_Part]()
        while self._parts:
            rows, keys = self._parts[0]
            count = len(keys) if horizon == np.inf else int(np.searchsorted(keys, horizon))
            if not count:
                break
            taken.append(_Part(rows[:count], keys[:count]))
            if count < len(keys):
                self._parts[0] = _Part(rows[count:], keys[count:])
                break
            del self._parts[0]
        return taken


def _recorded(sensor: RobotSensor, topics: Collection[str]) -> Rig:
    """Return the rig of a sensor; it names the topic of a live record that is called after the sensor, if there."""
    own = f"{LIVE}{sensor.name}"
    return sensor.rig.with_topic(own) if own in topics else sensor.rig


def _named(said: Iterable[tuple[str, Sequence[str]]]) -> list[str]:
    """Return sentences after the names of the sensors that they are about; one that several have, once."""
    names = dict[str, list[str]]()
    for name, sentences in said:
        for sentence in sentences:
            names.setdefault(sentence, []).append(name)
    return [f"{', '.join(of)}: {sentence}" for sentence, of in names.items()]
