"""Values that a rig resolves to: the link, the sensors on it, and the functions of each kind of sensor."""

from __future__ import annotations

from collections.abc import Callable, Mapping
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


class SensorSection:
    """A sensor as a value, built from its table in a rig; subclasses read each file that the table names once.

    Args:
        table: the sensor's table in the rig.
        link: what the sensor is on.
    """

    name: ClassVar[str]
    """Name of the table."""
    called: ClassVar[str]
    """Words for the sensor in a sentence."""

    def __init__(self, table: Any, link: Link) -> None:
        self.table, self.link = table, link


Section = TypeVar("Section", bound=SensorSection)


@dataclass(frozen=True)
class NamedSensor:
    """A sensor on a link, with its table in the rig."""

    kind: SensorKind
    table: Any
    link: Link

    @cached_property
    def section(self) -> Any:
        """The sensor as a value: a `SensorSection`, or its table if the kind has no class of sections."""
        return self.table if self.kind.section is None else self.kind.section(self.table, self.link)


@dataclass(frozen=True, kw_only=True)
class SharedTables:
    """The tables of a rig that are not a sensor's.

    Attributes:
        time: the time's column in a log.
        orientation: the source of poses.
        acceleration: the source of accelerations.
        filter: the filter of the readings.
        estimate: settings by which wrenches are located.
        contacts: settings by which contacts of taxels are found.
        drift: drift of a sensor's bias; None: it is not followed.
        pokes: pokes of a skin, from which its taxels are located; None: there are none.
    """

    time: RigTime = field(default_factory=RigTime)
    orientation: RigOrientation = field(default_factory=RigOrientation)
    acceleration: RigAcceleration = field(default_factory=RigAcceleration)
    filter: RigFilter = field(default_factory=RigFilter)
    estimate: RigEstimate = field(default_factory=RigEstimate)
    contacts: TaxelSettings = field(default_factory=TaxelSettings)
    drift: RigDrift | None = None
    pokes: RigPokes | None = None


@dataclass(frozen=True)
class Setup(SharedTables):
    """A link and the sensors on it, as values, with the rig's `SharedTables`.

    Attributes:
        kind: kind of the sensor whose samples are answered; it may combine several sensors.
        sensors: name -> sensor on the link.
        link: the surface that is touched, and its pose in the sensors' frame.
        head: the start of the log; None: a live loop.
    """

    kind: SensorKind
    sensors: Mapping[str, NamedSensor]
    link: Link
    head: Recording | None = None

    def of(self, section: type[Section]) -> Section:
        """Return the sensor whose table the class `section` reads, as an instance of that class.

        Raises:
            InputError: the rig has no table of that name.
        """
        if section.name not in self.sensors:
            hint = f"Add a [{section.name}], the table of {section.called}."
            raise InputError(f"the rig has no [{section.name}].", where="rig", hint=hint)
        return self.sensors[section.name].section

    @property
    def common(self) -> dict[str, Any]:
        """Arguments of `LogLayout` that all sensors share, a dict: time, pose, acceleration and temperature."""
        moved = self.orientation.joints
        columns = dict(moved) if isinstance(moved, Mapping) else {}
        return {
            "time": self.time.column,
            "time_unit": self.time.unit,
            "rate": self.time.rate,
            "episode": self.time.episode,
            "orientation": tuple(columns.values()) or self.orientation.columns,
            "orientation_form": self.orientation.form,
            "joints": tuple(columns),
            "inverse": self.orientation.inverse,
            "sensor_rotation": self.orientation.sensor_rotation or (),
            "position": self.orientation.position,
            "acceleration": self.acceleration.columns,
            "acceleration_unit": self.acceleration.unit,
            "pose_file": self.orientation.file,
            "pose_time": self.orientation.time,
            "pose_time_unit": self.orientation.time_unit,
            "orientation_topic": self.orientation.topic,
            "frames": self.orientation.frames(),
            "urdf": None if self.orientation.urdf is None else self.link.folder / self.orientation.urdf,
            "joints_topic": moved if isinstance(moved, str) else None,
            "imu_topic": self.orientation.imu,
            "acceleration_topic": self.acceleration.topic,
            "temperature": None if self.drift is None else self.drift.temperature,
            "offset": self.orientation.offset,
            "max_gap": self.orientation.max_gap,
        }

    def layout(self) -> LogLayout:
        """Return the `LogLayout` by which a log of the sensor is read.

        Raises:
            InputError: a file that the rig names cannot be used.
        """
        return self.kind.layout(self)

    def prepared(self) -> BuiltEstimator:
        """Return the estimator of the sensor, with notes and warnings about it.

        Raises:
            InputError: the rig lacks something, a file that it names cannot be used, a filter does not fit the rate, or
                the log does not begin at rest although it must.
            GeometryError: the file of the surface has no usable surface.
            NotIdentifiable: the load cells that the rig uses do not determine a wrench.
        """
        return self.kind.build(self)

    def files(self) -> dict[str, Path]:
        """Return a dict, key -> path, of the files of the surface, the arm and the answering sensor."""
        return self.link_files() | self.sensor_files(self.kind.name, *self.kind.parts)

    def link_files(self) -> dict[str, Path]:
        """Return a dict, key -> path, of the files of the surface and of the arm ("kinematics", a URDF)."""
        named = self.link.files()
        arm = self.orientation.urdf
        return named if arm is None else {**named, "kinematics": self.link.folder / arm}

    def sensor_files(self, *names: str) -> dict[str, Path]:
        """Return a dict, key -> path, of the files that the tables of the named sensors name.

        Raises:
            KeyError: the rig has no table of one of the names.
        """
        stated = (
            (key, getattr(self.sensors[name].table, key)) for name in names for key in self.sensors[name].kind.paths
        )
        return {key: self.link.folder / path for key, path in stated if path is not None}

    def answering(self, kind: SensorKind) -> Setup:
        """Return the setup with `kind` as the sensor whose samples are answered."""
        return replace(self, kind=kind)

    def start(self) -> float:
        """Return the time [s] at the start of a stream that the first answer needs; 0: none."""
        return self.kind.start(self)

    def smoothing(self) -> tuple[RigFilter, float | None]:
        """Return the filter's table and the rate [Hz] or None; no filter for fewer than two samples.

        Raises:
            InputError: the filter needs the rate, and most times of the log repeat or are missing.
        """
        stated, head = self.filter, self.head
        if stated.kind == "none" or stated.rate is not None or head is None:
            return stated, stated.rate
        if len(head) < 2:
            return RigFilter(), None
        steps = np.diff(head.time)
        if np.count_nonzero(steps > 0) <= len(steps) / 2:
            what = "most times repeat or are missing, so the rate that the filter needs is not known."
            hint = "Write rate [Hz] in the rig's [filter], or use --filter none."
            raise InputError(what, where=head.source, hint=hint)
        return stated, head.rate()

    def followed(self, channels: int) -> Drift | None:
        """Return the drift of the bias of a sensor with a number of channels; None: it is not followed.

        Raises:
            InputError: the rig states another number of channels, or no force and torque for six.
        """
        return None if self.drift is None else self.drift.drift(channels)

    def with_head(self, head: Recording | None) -> Setup:
        """Return the setup with the start of a log, or with None for a live loop."""
        return replace(self, head=head)


def seen_first(setup: Setup) -> float:
    """Return the time [s] of a stream for its tare, or to measure a filter's rate; 0: neither applies."""
    measured = setup.filter.kind != "none" and setup.filter.rate is None
    return setup.estimate.tare or (FIRST if measured else 0.0)


@dataclass(frozen=True)
class SensorKind:
    """A kind of sensor: its table in a rig, and the functions that read, build, guess and check it.

    Args:
        name: name of its table.
        called: words for the sensor in a sentence.
        table: dataclass of its table.
        channels: channels of a Recording that it reads, the main one first.
        layout: returns the layout of a log with these channels.
        build: returns the estimator.
        section: class of the sensor as a value; None: the table is enough.
        guess: `(path, contents, body)` -> how to read a log that looks like this sensor's, else None.
        paths: keys of its table that name files.
        refused: option of the command line -> why it means nothing to this sensor.
        needs_surface: whether contacts are located on the rig's [surface].
        check: checks the table further; raises InputError.
        parts: names of the sensors that it combines; a rig with all their tables is of this kind.
        start: time [s] of a stream that `build` needs; 0: none.
        view: module and class of its `SensorView`.
        options: options of the command line that replace values in its table under the same names.
        drift: module and name of the function of `palpate calibrate drift`,
            `(setup, recording, temperature, window) -> SensorDrift`; "": it has no [drift].
        warnings: returns where a recording contradicts the table, one sentence each.
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
        """Hint for a rig with a [drift] and a sensor of taxels, which needs none; "" for other sensors."""
        return "A skin tracks its own drift: set walk or drift in [contacts]." if CELLS in self.channels else ""
