"""What a rig resolves to: the sensors on one link as values, and what a kind of sensor makes of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np

from palpate.contact.taxel_settings import TaxelSettings
from palpate.errors import InputError
from palpate.files.logs import LogContents
from palpate.files.logs.layout import LogLayout
from palpate.setup.body import GivenBody
from palpate.setup.built import FIRST, BuiltEstimator, Guess
from palpate.setup.drift import RigDrift
from palpate.setup.link import Link
from palpate.setup.pokes import RigPokes
from palpate.setup.tables import RigAcceleration, RigEstimate, RigFilter, RigOrientation, RigTime
from palpate.signals.drift import Drift
from palpate.signals.recording import CELLS, Recording

__all__ = ["NamedSensor", "SensorKind", "SensorSection", "Setup", "seen_first"]


class SensorSection:
    """A sensor as a value, made of its table in a rig; a subclass reads each file that the table names once.

    Args:
        table: what the rig says of it.
        link: that it is on.
    """

    name: ClassVar[str]
    """Name of the table."""
    called: ClassVar[str]
    """What the sensor is, in a sentence."""

    def __init__(self, table: Any, link: Link) -> None:
        self.table, self.link = table, link


Section = TypeVar("Section", bound=SensorSection)


@dataclass(frozen=True)
class NamedSensor:
    """One sensor on the link.

    Attributes:
        kind: what it is.
        table: what the rig says of it.
        link: that it is on.
    """

    kind: SensorKind
    table: Any
    link: Link

    @cached_property
    def section(self) -> Any:
        """The sensor as a value; its table where the kind needs no more."""
        return self.table if self.kind.section is None else self.kind.section(self.table, self.link)


@dataclass(frozen=True)
class Setup:
    """One link and the sensors on it, as values.

    Attributes:
        kind: of the sensor whose samples are answered; it may be made of several.
        sensors: on the link, by their names.
        link: what is touched, and where the sensors sit on it.
        time: where the time of a log is.
        orientation: where poses come from.
        acceleration: where accelerations come from.
        filter: of the readings.
        estimate: how wrenches are located.
        contacts: how contacts of taxels are found.
        drift: how the zero of a sensor drifts; None: it is not followed.
        pokes: of a skin whose taxels are to be found; None: there are none.
        head: the start of the log; None: a live loop.
    """

    kind: SensorKind
    sensors: Mapping[str, NamedSensor]
    link: Link
    time: RigTime = field(default_factory=RigTime)
    orientation: RigOrientation = field(default_factory=RigOrientation)
    acceleration: RigAcceleration = field(default_factory=RigAcceleration)
    filter: RigFilter = field(default_factory=RigFilter)
    estimate: RigEstimate = field(default_factory=RigEstimate)
    contacts: TaxelSettings = field(default_factory=TaxelSettings)
    drift: RigDrift | None = None
    pokes: RigPokes | None = None
    head: Recording | None = None

    def of(self, section: type[Section]) -> Section:
        """Return the sensor on the link whose table such a class reads.

        Raises:
            InputError: there is none.
        """
        if section.name not in self.sensors:
            hint = f"Add a [{section.name}]: what is to be said of {section.called}."
            raise InputError(f"the rig has no [{section.name}].", where="rig", hint=hint)
        return self.sensors[section.name].section

    @property
    def common(self) -> dict[str, Any]:
        """The part of a log's layout that every sensor has: the time, and where the sensor is and how it moves."""
        return {
            "time": self.time.column,
            "time_unit": self.time.unit,
            "rate": self.time.rate,
            "orientation": self.orientation.columns,
            "position": self.orientation.position,
            "acceleration": self.acceleration.columns,
            "acceleration_unit": self.acceleration.unit,
            "orientation_topic": self.orientation.topic,
            "frames": self.orientation.frames(),
            "urdf": None if self.orientation.urdf is None else self.link.folder / self.orientation.urdf,
            "joints_topic": self.orientation.joints,
            "acceleration_topic": self.acceleration.topic,
            "temperature": None if self.drift is None else self.drift.temperature,
            "offset": self.orientation.offset,
            "max_gap": self.orientation.max_gap,
        }

    def layout(self) -> LogLayout:
        """Return how a log of the sensor is read."""
        return self.kind.layout(self)

    def prepared(self) -> BuiltEstimator:
        """Return the estimator of the sensor, with notes and warnings about it.

        Raises:
            InputError: the rig says too little, a file that it names cannot be used, or the log does not begin at rest
                where it should.
        """
        return self.kind.build(self)

    def files(self) -> dict[str, Path]:
        """Return the files that the rig names for the sensor that answers: what each is -> where."""
        return self.link_files() | self.sensor_files((self.kind.name, *self.kind.parts))

    def link_files(self) -> dict[str, Path]:
        """Return the files of the surface and of the arm."""
        named = {} if self.link.stated is None else self.link.stated.files(self.link.folder)
        arm = self.orientation.urdf
        return named if arm is None else {**named, "kinematics": self.link.folder / arm}

    def sensor_files(self, names: Iterable[str]) -> dict[str, Path]:
        """Return the files that the tables of some sensors name."""
        sensors = [self.sensors[name] for name in names]
        stated = {key: getattr(sensor.table, key) for sensor in sensors for key in sensor.kind.paths}
        return {key: self.link.folder / path for key, path in stated.items() if path is not None}

    def answering(self, kind: SensorKind) -> Setup:
        """Return the same, with the samples of another of its sensors answered."""
        return replace(self, kind=kind)

    def start(self) -> float:
        """Return the seconds of a stream that are wanted before the first answer; 0: none."""
        return self.kind.start(self)

    def smoothing(self) -> tuple[RigFilter, float | None]:
        """Return the filter and the rate [Hz] of samples; no filter where there is too little to be filtered.

        Raises:
            InputError: the rate is wanted, and the times of the log do not say it.
        """
        stated, head = self.filter, self.head
        if stated.kind == "none" or stated.rate is not None or head is None:
            return stated, stated.rate
        if len(head) < 2:
            return RigFilter(), None
        steps = np.diff(head.time)
        if np.count_nonzero(steps > 0) <= len(steps) / 2:
            raise InputError(
                "most times repeat or are missing, so the rate that the filter needs is not known.",
                where=head.source,
                hint="Give the rate [Hz] in the rig's [filter], or use --filter none.",
            )
        return stated, head.rate()

    def followed(self, channels: int) -> Drift | None:
        """Return how the zero of a sensor of so many channels drifts; None where it is not followed.

        Raises:
            InputError: another number of channels is stated.
        """
        return None if self.drift is None else self.drift.drift(channels)

    def with_head(self, head: Recording | None) -> Setup:
        """Return the same with the start of a log."""
        return replace(self, head=head)


def seen_first(setup: Setup) -> float:
    """Return the seconds of a stream for its tare, or for the rate that a filter needs and the rig does not state."""
    measured = setup.filter.kind != "none" and setup.filter.rate is None
    return setup.estimate.tare or (FIRST if measured else 0.0)


@dataclass(frozen=True)
class SensorKind:
    """One sensor.

    Args:
        name: of its table in a rig.
        called: what it is, in a sentence.
        table: dataclass of its table.
        channels: of a Recording that it reads, the main one first.
        layout: where a log keeps them.
        build: an estimator.
        section: the sensor as a value, made of its table and the link; None: the table says all.
        guess: whether a log looks as if this sensor had written it; None: it does not. The body, where one is given.
        paths: keys of its table that name files.
        refused: option of the command line -> why it means nothing to this sensor.
        needs_surface: whether it locates on the rig's [surface].
        check: what else must hold of the table; raises InputError.
        parts: names of the sensors that it is made of, whose tables it reads; a rig with all of them is of this kind.
        start: seconds of a stream that `build` wants to see before the first answer; 0: none.
        view: module and class of what page and report show of the sensor: a `SensorView`.
        options: of the command line that are written over keys of its table of the same names.
        drift: module and name of a function that identifies how the zero drifts, for `palpate calibrate drift`:
            `(setup, recording, temperature, window) -> SensorDrift`; "": it has no [drift].
        warnings: what is wrong with a recording against the table, one sentence each.
    """

    name: str
    called: str
    table: type[Any]
    channels: tuple[str, ...]
    layout: Callable[[Setup], LogLayout]
    build: Callable[[Setup], BuiltEstimator]
    section: type[SensorSection] | None = None
    guess: Callable[[Path, LogContents, GivenBody | None], Guess | None] = lambda log, contents, body: None
    paths: tuple[str, ...] = ()
    refused: Mapping[str, str] = field(default_factory=lambda: {})
    needs_surface: bool = True
    check: Callable[[Any, Path], None] = lambda table, path: None
    parts: tuple[str, ...] = ()
    start: Callable[[Setup], float] = seen_first
    view: str = "palpate.setup.view.SensorView"
    options: tuple[str, ...] = ()
    drift: str = ""
    warnings: Callable[[Setup, Recording], list[str]] = lambda setup, recording: []

    @property
    def drift_hint(self) -> str:
        """Return what takes the place of a [drift] for a sensor of taxels, or ""."""
        return "A skin follows its zero by itself: walk or drift in [contacts]." if CELLS in self.channels else ""
