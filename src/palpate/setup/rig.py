"""Read and check a rig, a TOML file with one table for each sensor, and build estimators from it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from os import PathLike
from pathlib import Path
from typing import Any, Protocol, cast, runtime_checkable

from palpate.calls import called_as
from palpate.contact.estimator import ContactEstimator
from palpate.errors import InputError
from palpate.files.logs.layout import LogLayout
from palpate.files.schema import parse
from palpate.files.units import SAMPLES, TIME_UNITS, near, to_si
from palpate.setup.drift import RigDrift
from palpate.setup.kinds import ASSUMED, KINDS
from palpate.setup.link import Link
from palpate.setup.setup import NamedSensor, SensorKind, Setup, SharedTables
from palpate.setup.source import RigSource
from palpate.setup.tables import OF_ANY_MESH, RigSurface
from palpate.signals.recording import FORCE, Recording
from palpate.spatial.pose import Pose

__all__ = ["ESTIMATE", "Rig", "check_rig", "with_mesh"]

ESTIMATE = 'palpate.estimate("log.csv", "rig.toml") or palpate.estimate("log.csv", mesh="probe.stl", unit="mm")'
"""Calls that find contacts in a log, for hints."""
_SLICED = {"columns", "position", "cells"}  # keys that name columns
_SLICE = re.compile(r"(.+)\[(\d+):(\d+)\]")
_LONGEST = 1 << 16  # columns of a slice


@runtime_checkable
class StartedLog(Protocol):
    """A log whose start can be read in advance, as `palpate.open_log` returns."""

    kind: SensorKind

    def head(self, seconds: float = 0.0) -> Recording:
        """Return the start of the log, of at least `seconds` [s].

        Raises:
            InputError: the log cannot be read, has no samples, or lacks something that the rig requests.
        """
        ...


@called_as('palpate.load_rig("rig.toml")', estimator='palpate.load_rig("rig.toml").estimator(rate=200.0)')
@dataclass(frozen=True)
class Rig(SharedTables):
    """A rig file as values, one attribute for each table.

    Attributes:
        surface: the surface that is touched; None if a skin alone is the body.
        sensors: name of a sensor's table -> its values, as the dataclass of `palpate.setup.kinds.KINDS`.
        source: source of live samples; None: the rig is for logs.
        folder: where relative paths start.
        name: name of the sensor among those of a robot; "": a rig of its own.
        time, orientation, acceleration, filter, estimate, contacts: the other tables.
        drift, pokes: tables that may be missing, which are None then.
    """

    surface: RigSurface | None = None
    sensors: Mapping[str, Any] = field(default_factory=dict[str, Any])
    source: RigSource | None = None
    folder: Path = field(default_factory=Path)
    name: str = ""

    @property
    def kinds(self) -> tuple[SensorKind, ...]:
        """Kinds of the rig's sensors and of their combinations; a six-axis force/torque sensor without any."""
        possible = KINDS.values() if len(self.sensors) > 1 else KINDS.among(self.sensors)  # several may be combined
        return tuple(kind for kind in possible if self._has(kind)) or (KINDS[ASSUMED],)

    def _has(self, kind: SensorKind) -> bool:
        """Return whether the rig has this kind; a combined kind needs all its parts, and no [pokes]."""
        return set(kind.parts) <= set(self.sensors) and self.pokes is None if kind.parts else kind.name in self.sensors

    def with_sensor(self, name: str, table: object) -> Rig:
        """Return the rig with the table of one sensor added or replaced."""
        return replace(self, sensors={**self.sensors, name: table})

    def with_topic(self, name: str, sensor: str | None = None) -> Rig:
        """Return the rig with the topic of one sensor's readings replaced.

        Raises:
            InputError: the rig has no sensor of this name, or several and none is named, or the sensor is combined.
        """
        kind = self.kind(sensor)
        if kind.parts:
            hint = f"Write topics in the rig's {' and '.join(f'[{part}]' for part in kind.parts)}."
            raise InputError(f"names the topic of one sensor, and this is {kind.called}.", where="--topic", hint=hint)
        return self.with_sensor(kind.name, replace(self.sensors.get(kind.name, kind.table()), topic=name))

    def kind(self, sensor: str | None = None) -> SensorKind:
        """Return the kind of the named sensor; without a name, of the combined sensor or else of the only one.

        Raises:
            InputError: the rig has no sensor of this name, or several that are not combined and none is named.
        """
        sensor = None if sensor == self.name else sensor
        named = {kind.name: kind for kind in self.kinds}
        together = [kind for kind in named.values() if kind.parts]
        if sensor is None and (together or len(named) == 1):
            return (together or list(named.values()))[0]
        if sensor is None:
            raise InputError(f"the rig has several sensors: {', '.join(named)}.", hint="Name one with --sensor.")
        if sensor not in named:
            raise InputError(f"the rig has no [{sensor}].", where="--sensor", hint=near(sensor, named))
        return named[sensor]

    def files(self) -> dict[str, Path]:
        """Return a dict, key -> path, of the files that the rig names; a key begins with its table ("skin.layout").

        Keys of the surface ("mesh", "urdf") and of the arm ("kinematics") have no table.
        """
        setup = self.resolve()
        pokes = dict[str, Path]() if self.pokes is None else self.pokes.files(self.folder)
        kinds = [kind.name for kind in self.kinds if kind.name in setup.sensors]
        named = {"pokes": pokes, **{kind: setup.sensor_files(kind) for kind in kinds}}
        of_tables = {f"{table}.{key}": path for table, files in named.items() for key, path in files.items()}
        return setup.link_files() | of_tables

    def stream(self) -> RigSource:
        """Return the source of live samples.

        Raises:
            InputError: the rig has no [source].
        """
        if self.source is None:
            hint = "Add a [source] with kind and address; `palpate rig new --source netft` writes one."
            raise InputError("the rig has no [source], from which live readings come.", where="rig", hint=hint)
        return self.source

    def resolve(self, sensor: SensorKind | str | None = None, head: Recording | None = None) -> Setup:
        """Return the link and its sensors; files that the rig names are read when they are first needed.

        Args:
            sensor: kind of the sensor whose samples are answered, or the name of its table; None: the first.
            head: the start of the log; None: a live loop.

        Raises:
            InputError: the rig has no such sensor.
        """
        kinds, link = self.kinds, Link(self.surface, self.folder)
        kind = kinds[0] if sensor is None else self.kind(sensor if isinstance(sensor, str) else sensor.name)
        stated = {each.name: self.sensors.get(each.name) or each.table() for each in kinds}
        sensors = {name: NamedSensor(KINDS[name], table, link) for name, table in {**stated, **self.sensors}.items()}
        shared = {each.name: getattr(self, each.name) for each in fields(SharedTables)}
        return Setup(kind, sensors, link, head, **shared)

    def mount(self) -> Pose:
        """Return T_sensor_surface; the identity without a surface."""
        return Link(self.surface, self.folder).mount

    def layout(self, sensor: str | None = None) -> LogLayout:
        """Return the layout by which a log of the named sensor, or of the only one, is read.

        Raises:
            InputError: the rig has no sensor of this name, or several and none is named, or a file that it names cannot
                be used.
        """
        return self.resolve(self.kind(sensor)).layout()

    def estimator(
        self, log: StartedLog | None = None, sensor: str | None = None, rate: float | None = None
    ) -> ContactEstimator:
        """Return the estimator that turns readings into contacts, the same that `palpate estimate` runs.

        Args:
            log: a log of `palpate.open_log`, from whose start come noise, rate, tare and rest that the rig does not
                state. None: a live loop.
            sensor: name of the sensor's table, if there are several and no log.
            rate: [Hz] of the samples of a live loop, which a filter needs; None: as the rig states.

        Raises:
            InputError: the rig lacks something, a file that it names cannot be used, a filter does not fit the rate, or
                the log cannot be read, has no samples, lacks something that the rig requests, or does not begin at rest
                although it must.
            GeometryError: the file of the surface has no usable surface.
            NotIdentifiable: the load cells that the rig uses do not determine a wrench.
        """
        rig = self if rate is None else replace(self, filter=replace(self.filter, rate=rate))
        if log is None:
            return rig.resolve(rig.kind(sensor)).prepared().estimator
        return rig.resolve(log.kind, log.head(rig.estimate.tare or 1.0)).prepared().estimator


def with_mesh(rig: Rig | None, mesh: str | PathLike[str], unit: str | None) -> Rig:
    """Return a rig with a mesh file as its surface; without a rig, the mesh in a tared six-axis sensor's frame.

    Raises:
        InputError: the unit is missing or unknown, or the path is blank.
    """
    try:
        surface = RigSurface(mesh=str(mesh), unit=unit)
    except ValueError as problem:
        raise InputError(f"{problem}.", where=str(mesh)) from problem
    if rig is None:
        return Rig(surface)
    kept = {} if rig.surface is None else {name: getattr(rig.surface, name) for name in OF_ANY_MESH}
    return replace(rig, surface=replace(surface, mesh=str(Path(mesh).resolve()), **kept))


def check_rig(table: Mapping[str, Any], path: Path, name: str = "") -> Rig:
    """Return the rig of a parsed TOML table, as if it were read from `path`; `name`: of a robot's sensor.

    Raises:
        InputError: a key or a needed table is misspelt or missing, a value has another type or is out of bounds, or
            tables contradict each other.
    """
    common = [each.name for each in fields(Rig) if each.name not in ("sensors", "folder", "name")]
    table = {key: _spread(value, path) for key, value in table.items()}
    shared = {key: value for key, value in table.items() if key in common}
    own = {key: value for key, value in table.items() if key not in common}
    for key in own:
        if key not in KINDS:
            raise InputError(f"unknown key {key!r}.", where=str(path), hint=near(key, [*common, *KINDS]))
    sensors = {kind.name: _sensor(own[kind.name], kind, path) for kind in KINDS.among(own)}
    rig = replace(parse(shared, Rig, file=str(path)), sensors=sensors, folder=path.parent, name=name)
    if rig.time.unit is not None:
        to_si(rig.time.unit, {**TIME_UNITS, SAMPLES: 1.0}, where=f"{path}: time.unit")
    for kind in rig.kinds:
        if rig.surface is None and kind.needs_surface and rig.pokes is None:
            hint = "`palpate rig new` writes one to start from."
            raise InputError("a rig needs a [surface].", where=str(path), hint=hint)
        kind.check(rig.sensors.get(kind.name), path)
    if rig.drift is not None:
        _check_drift(rig.drift, rig.kinds, rig.sensors, path)
    return rig


def _spread(table: Any, path: Path) -> Any:
    """Return a table in which the columns of a slice, as "observation.state[6:12]", are named one by one."""
    if not isinstance(table, dict):
        return table
    made = dict(cast("dict[str, Any]", table))
    for key in _SLICED & made.keys():
        given: list[Any] = made[key] if isinstance(made[key], list) else [made[key]]
        slices = [_SLICE.fullmatch(each) if isinstance(each, str) else None for each in given]
        if any(slices):
            made[key] = [name for each, found in zip(given, slices, strict=True) for name in _names(each, found, path)]
    return made


def _names(given: Any, found: re.Match[str] | None, path: Path) -> list[Any]:
    if found is None:
        return [given]
    first, end = int(found[2]), int(found[3])
    if not 0 < end - first <= _LONGEST:
        what = f"{given!r} names {max(end - first, 0)} columns."
        raise InputError(what, where=str(path), hint="Write NAME[FIRST:END], from FIRST up to but not including END.")
    return [f"{found[1]}[{k}]" for k in range(first, end)]


def _sensor(table: Any, kind: SensorKind, path: Path) -> Any:
    if not isinstance(table, dict):
        raise InputError(f"[{kind.name}] must be a table.", where=str(path))
    return parse(cast("dict[str, Any]", table), kind.table, file=str(path), key=kind.name)


def _check_drift(stated: RigDrift, kinds: Sequence[SensorKind], sensors: Mapping[str, Any], path: Path) -> None:
    """Raise InputError if no sensor can use the [drift], or the sensor states its own."""
    first, followed = kinds[0].name, {FORCE in kind.channels: kind.name for kind in kinds if kind.drift}
    if not followed:
        what = f"a [drift] is for a force/torque sensor or for load cells, not for [{first}]."
        raise InputError(what, where=str(path), hint="".join(kind.drift_hint for kind in kinds))
    wanted = followed.get(stated.of_wrench)
    if wanted is None:
        pair = "{ force = ..., torque = ... }, in N/sqrt(s) and N m/sqrt(s)"
        needs = pair if True in followed else "a number, or a list of them, in V/sqrt(s)"
        raise InputError(f"drift.walk of [{first}] must be {needs}.", where=str(path))
    if getattr(sensors.get(wanted), "drift", None) is not None:
        what = f"[{wanted}] drift and [drift] exclude each other: both state how the bias drifts."
        hint = f"Remove drift from [{wanted}]; with [drift] the bias is tracked while nothing is touched."
        raise InputError(what, where=str(path), hint=hint)
