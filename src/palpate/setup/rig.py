"""The rig: one TOML that a person writes, with a table a sensor, and what it builds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from os import PathLike
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from palpate.calls import called_as
from palpate.contact.estimator import ContactEstimator
from palpate.contact.taxel_settings import TaxelSettings
from palpate.errors import InputError
from palpate.files.logs.layout import LogLayout
from palpate.files.models import load_toml
from palpate.files.schema import parse
from palpate.files.units import SAMPLES, TIME_UNITS, near, to_si
from palpate.setup.drift import RigDrift
from palpate.setup.kinds import ASSUMED, KINDS
from palpate.setup.link import Link
from palpate.setup.pokes import RigPokes
from palpate.setup.setup import NamedSensor, SensorKind, Setup
from palpate.setup.source import RigSource
from palpate.setup.surface import RigSurface
from palpate.setup.tables import RigAcceleration, RigEstimate, RigFilter, RigOrientation, RigTime
from palpate.signals.recording import FORCE, Recording
from palpate.spatial.pose import Pose

__all__ = ["Rig", "check_rig", "load_rig", "with_mesh"]

_NO_RIG = {
    "a mesh": (".stl", ".obj", ".ply", ".dae"),
    "a log": (".csv", ".parquet", ".npy", ".npz", ".mcap", ".bag", ".db3"),
}


@runtime_checkable
class StartedLog(Protocol):
    """A log whose start is known, such as `palpate.open_log` opens."""

    kind: SensorKind

    def head(self, seconds: float = 0.0) -> Recording:
        """Return its start."""
        ...


@called_as('palpate.load_rig("rig.toml")', estimator='palpate.load_rig("rig.toml").estimator(rate=200.0)')
@dataclass(frozen=True)
class Rig:
    """The whole file.

    Attributes:
        surface: what is touched; None where a skin alone is the body.
        sensors: name of a sensor's table -> what it says, as the dataclass of `palpate.setup.kinds.KINDS`.
        time, orientation, acceleration, filter, estimate, contacts: the other tables.
        drift: how the zero of a sensor of wrenches wanders; None: it is not followed.
        pokes: of a skin whose taxels are to be found; None: there are none.
        source: of live samples; None: the rig is for logs.
        folder: where relative paths start.
    """

    surface: RigSurface | None = None
    sensors: Mapping[str, Any] = field(default_factory=lambda: {})
    time: RigTime = field(default_factory=RigTime)
    orientation: RigOrientation = field(default_factory=RigOrientation)
    acceleration: RigAcceleration = field(default_factory=RigAcceleration)
    filter: RigFilter = field(default_factory=RigFilter)
    estimate: RigEstimate = field(default_factory=RigEstimate)
    contacts: TaxelSettings = field(default_factory=TaxelSettings)
    drift: RigDrift | None = None
    pokes: RigPokes | None = None
    source: RigSource | None = None
    folder: Path = field(default_factory=Path)

    @property
    def kinds(self) -> tuple[SensorKind, ...]:
        """The sensors that are stated, and what they are together; a six-axis force/torque sensor where none is."""
        several = len(self.sensors) > 1  # which may be one together
        possible = KINDS.values() if several else KINDS.among(self.sensors)
        return tuple(kind for kind in possible if self._has(kind)) or (KINDS[ASSUMED],)

    def _has(self, kind: SensorKind) -> bool:
        """Of sensors that are there to find each other by pokes, nothing together."""
        return set(kind.parts) <= set(self.sensors) and self.pokes is None if kind.parts else kind.name in self.sensors

    def with_sensor(self, name: str, table: object) -> Rig:
        """The same rig with another table of a sensor."""
        return replace(self, sensors={**self.sensors, name: table})

    def with_topic(self, name: str | None, sensor: str | None = None) -> Rig:
        """The same rig, the rows of its log taken from another topic.

        Raises:
            InputError: it has several sensors, and none is named.
        """
        if name is None:
            return self
        kind = self.kind(sensor)
        if kind.parts:
            tables = " and ".join(f"[{part}]" for part in kind.parts)
            raise InputError(
                f"is of one sensor, and this is {kind.called}.", where="--topic", hint=f"Name topics in {tables}."
            )
        return self.with_sensor(kind.name, replace(self.sensors.get(kind.name, kind.table()), topic=name))

    def kind(self, sensor: str | None = None) -> SensorKind:
        """The sensor of this name, or the only one.

        Raises:
            InputError: the rig has no such sensor, or several and none is named.
        """
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
        """Return every file that the rig names: what it is -> where; of a table's own files with the table's name."""
        setup, pokes = self.resolve(), RigPokes() if self.pokes is None else self.pokes
        named = {f"pokes.{key}": path for key, path in pokes.files(self.folder).items()}
        for kind in self.kinds:
            if kind.name in setup.sensors:
                named |= {f"{kind.name}.{key}": path for key, path in setup.sensor_files([kind.name]).items()}
        return {**setup.link_files(), **named}

    def stream(self) -> RigSource:
        """Where live samples come from.

        Raises:
            InputError: the rig does not say.
        """
        if self.source is None:
            hint = "Add a [source] with kind and address; `palpate rig new --source netft` writes one."
            raise InputError("the rig has no [source], so there is nothing live.", where="rig", hint=hint)
        return self.source

    def resolve(self, sensor: SensorKind | str | None = None, head: Recording | None = None) -> Setup:
        """Return the link and the sensors on it as values, with the files that the rig names read when first needed.

        Args:
            sensor: whose samples are answered, or the name of its table; None: the first.
            head: the start of the log; None: a live loop.

        Raises:
            InputError: the rig has no such sensor.
        """
        kinds, link = self.kinds, Link(self.surface, self.folder)
        kind = kinds[0] if sensor is None else self.kind(sensor if isinstance(sensor, str) else sensor.name)
        stated = {each.name: self.sensors.get(each.name) or each.table() for each in kinds}
        sensors = {name: NamedSensor(KINDS[name], table, link) for name, table in {**stated, **self.sensors}.items()}
        shared = {each.name for each in fields(Setup)} & {each.name for each in fields(self)} - {"sensors"}
        return Setup(kind, sensors, link, head=head, **{name: getattr(self, name) for name in shared})

    def mount(self) -> Pose:
        """Return T_sensor_surface; the identity where there is no surface."""
        return Link(self.surface, self.folder).mount

    def layout(self, sensor: str | None = None) -> LogLayout:
        """Return how a log of one of the sensors is read."""
        return self.resolve(self.kind(sensor)).layout()

    def estimator(
        self, log: StartedLog | None = None, sensor: str | None = None, rate: float | None = None
    ) -> ContactEstimator:
        """What turns readings into contacts: the same that `palpate estimate` runs.

        Args:
            log: of `palpate.open_log`; noise, rate, tare and rest are taken from its start where the rig does not state
                them. None: for a live loop.
            sensor: name of the sensor's table, where there are several.
            rate: [Hz] of the samples of a live loop, which a filter needs, in place of the one that the rig states.

        Raises:
            InputError: the rig says too little, a file that it names cannot be used, or the log does not begin at rest
                where it should.
        """
        rig = self if rate is None else replace(self, filter=replace(self.filter, rate=rate))
        if log is None:
            return rig.resolve(rig.kind(sensor)).prepared().estimator
        return rig.resolve(log.kind, log.head(rig.estimate.tare or 1.0)).prepared().estimator


def with_mesh(rig: Rig | None, mesh: str | PathLike[str], unit: str | None) -> Rig:
    """Return the rig with the mesh of a file as its surface; of none, the mesh in the frame of a tared six-axis sensor.

    Raises:
        InputError: no unit, or one that is not known.
    """
    try:
        surface = RigSurface(mesh=str(mesh), unit=unit)
    except ValueError as problem:
        raise InputError(f"{problem}.", where=str(mesh)) from problem
    if rig is None:
        return Rig(surface)
    told = {"kind": "mesh", "mesh": str(Path(mesh).resolve()), "unit": unit}
    alone: dict[str, Any] = {"urdf": None, "link": None, "geometry": None, "packages": {}}
    return replace(rig, surface=replace(rig.surface or surface, **told, **alone))


@called_as('palpate.load_rig("rig.toml")')
def load_rig(path: str | PathLike[str]) -> Rig:
    """Read a rig; what does not fit is named with the place and the nearest fit.

    Raises:
        InputError: not there, not TOML, a key misspelt or missing, a value of another kind or out of bounds.
    """
    path = Path(path)
    for what, suffixes in _NO_RIG.items():
        if path.suffix.lower() in suffixes:
            line = 'palpate.estimate("log.csv", "rig.toml") or palpate.estimate("log.csv", mesh="probe.stl", unit="mm")'
            raise InputError(f"is {what}, not a rig.", where=str(path), hint=f"Write {line}.")
    return check_rig(load_toml(path), path)


def check_rig(table: Mapping[str, Any], path: Path) -> Rig:
    """A rig from what TOML says, as if it stood in `path`.

    Raises:
        InputError: a key misspelt or missing, a value of another kind or out of bounds.
    """
    common = [each.name for each in fields(Rig) if each.name not in ("sensors", "folder")]
    for name in table:
        if name not in common and name not in KINDS:
            raise InputError(f"unknown key {name!r}.", where=str(path), hint=near(name, [*common, *KINDS]))
    shared = {name: value for name, value in table.items() if name in common}
    sensors = dict(_sensors({name: each for name, each in table.items() if name not in common}, path))
    rig = replace(parse(shared, Rig, file=str(path)), sensors=sensors, folder=path.parent)
    to_si(rig.time.unit, {**TIME_UNITS, SAMPLES: 1.0}, where=f"{path}: time.unit")
    for kind in rig.kinds:
        if rig.surface is None and kind.needs_surface and rig.pokes is None:
            raise InputError(
                "a rig needs a [surface].", where=str(path), hint="`palpate rig new` writes one to start from."
            )
        kind.check(rig.sensors.get(kind.name), path)
    if rig.drift is not None:
        _check_drift(rig.drift, rig.kinds, rig.sensors, path)
    return rig


def _sensors(table: Mapping[str, Any], path: Path) -> Iterator[tuple[str, Any]]:
    for kind in KINDS.among(table):
        if not isinstance(table[kind.name], dict):
            raise InputError(f"[{kind.name}] must be a table.", where=str(path))
        yield kind.name, parse(table[kind.name], kind.table, file=str(path), key=kind.name)


def _check_drift(stated: RigDrift, kinds: Sequence[SensorKind], sensors: Mapping[str, Any], path: Path) -> None:
    """Refuse a [drift] beside an older statement of the same, or of a sensor that has none."""
    first, followed = kinds[0].name, {FORCE in kind.channels: kind.name for kind in kinds if kind.drift}
    if not followed:
        raise InputError(
            f"a [drift] is of a force/torque sensor or of load cells, not of [{first}].",
            where=str(path),
            hint="".join(kind.drift_hint for kind in kinds),
        )
    wanted = followed.get(stated.of_wrench)
    if wanted is None:
        pair = "{ force = ..., torque = ... }"
        needs = pair if True in followed else "a number, or a list of them, in V/sqrt(s)"
        raise InputError(f"drift.walk of [{first}] is {needs}.", where=str(path))
    if getattr(sensors.get(wanted), "drift", None) is not None:
        raise InputError(
            f"[{wanted}] drift and [drift] exclude each other: both say how the zero drifts.",
            where=str(path),
            hint=f"Remove drift from [{wanted}]; with [drift] the zero is followed while nothing is touched.",
        )
