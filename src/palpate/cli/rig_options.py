"""Combine a rig with the options of the command line that override it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Optional, TypeVar, cast

from tyro.conf import arg

from palpate.console.options import FileOption, NameOption, Pair, Scalar
from palpate.contact.locate import OFF, ON
from palpate.errors import InputError
from palpate.setup import Rig, load_rig
from palpate.setup.pipeline import OpenedLog, open_log
from palpate.setup.rig import with_mesh
from palpate.setup.setup import SensorKind
from palpate.setup.tables import RigFilter, RigThresholds
from palpate.setup.wrench_table import RigNoise
from palpate.surfaces.collada import ColladaAsset

Made = TypeVar("Made")
_CONTACT = f"force [N] at which a contact begins, and below which it ends (default: {ON:g}, {OFF:g} times the noise)."
_PAIRS = {"noise": RigNoise, "contact": RigThresholds}  # options of two numbers, as the rig has them
METHODS = Literal["soft_finger", "wrench_axis"]
FILTERS = Literal["none", "kalman", "butterworth", "zero_phase"]


@dataclass(frozen=True)
class RigOptions:
    """The rig, and options that override it: body, sensor, method.

    Args:
        rig: TOML of the set-up.
        mesh: surface, in the sensor's frame unless a rig states its pose.
        unit: unit of the mesh file, unless it states its own: m, cm, mm, um or in.
        crease: degrees; facets that meet by less are smooth across their edge; 0 is faceted (default 30).
        payload: model written by `palpate calibrate payload`.
        noise: standard deviation of one reading, force [N] and torque [N m]. Estimated from the log when not given.
        method: soft_finger (default) or wrench_axis.
        friction: bound on the tangent of the angle between force and normal (default 1).
        torsion: bound on torque about the normal over normal force [m] (default 0.005).
        contact: force [N] at which a contact begins, and below which it ends; by default from the noise.
        filter: none (default), kalman, butterworth, or zero_phase (forward and backward); details in the rig.
        cutoff: cut-off frequency of a butterworth or zero_phase filter [Hz] (default 10).
        tare: seconds at the start of the log in which nothing is touched: their mean is subtracted.
        sensor: name of the sensor's table in the rig, where there are several that the log could be of; of a robot, the
            names of one or more of its sensors, with commas between.
        topic: topic of the sensor's readings, in place of the rig's, where the log has several.
    """

    rig: FileOption = None
    mesh: FileOption = None
    unit: Annotated[Optional[Literal["m", "cm", "mm", "um", "in"]], arg(metavar="UNIT", help_behavior_hint="")] = None
    crease: Scalar = None
    payload: FileOption = None
    noise: Pair = None
    method: Annotated[Optional[METHODS], arg(metavar="NAME", help_behavior_hint="")] = None
    friction: Scalar = None
    torsion: Scalar = None
    contact: Annotated[Pair, arg(help=_CONTACT)] = None
    filter: Annotated[Optional[FILTERS], arg(metavar="NAME", help_behavior_hint="")] = None
    cutoff: Scalar = None
    tare: Scalar = None
    sensor: NameOption = None
    topic: NameOption = None

    def load(self) -> Rig:
        """Return the `Rig` with all options applied.

        Raises:
            InputError: neither rig nor mesh is given, a file cannot be read, an option is out of bounds or does not fit
                the rig, or `mesh` is given without `unit` or `unit` without `mesh`.
        """
        rig = self._base()
        if self.crease is not None and rig.surface is not None:
            if rig.surface.kind != "mesh":
                raise InputError(f"applies only to a mesh, but the surface is a {rig.surface.kind}.", where="--crease")
            rig = replace(rig, surface=_over(rig.surface, crease=self.crease))
        for kind in rig.kinds:  # `open` refuses them for sensors to which they mean nothing
            given = {name: value for name in kind.options if (value := getattr(self, name)) is not None}
            given = {name: str(value.resolve()) if isinstance(value, Path) else value for name, value in given.items()}
            if given:
                rig = rig.with_sensor(kind.name, _over(rig.sensors.get(kind.name) or kind.table(), **given))
        estimate = {name: getattr(self, name) for name in ("method", "friction", "torsion", "contact", "tare")}
        return replace(rig, filter=self._filter(rig.filter), estimate=_over(rig.estimate, **estimate))

    def open(self, log: Path, rig: Rig) -> OpenedLog:
        """Open a log, and return it as an `OpenedLog`.

        Raises:
            InputError: the log cannot be read or fits no sensor of the rig, or an option has no effect on its sensor.
        """
        if self.sensor is not None or len(rig.kinds) == 1:
            self._require_meant(rig.kind(self.sensor))  # before the log is looked at
        opened = open_log(log, rig, self.sensor, self.topic)
        self._require_meant(opened.kind)
        return opened

    def _require_meant(self, kind: SensorKind) -> None:
        for option, why in kind.refused.items():
            if getattr(self, option) is not None:
                raise InputError(f"has no effect on {kind.called}: {why}.", where=f"--{option}")

    def _base(self) -> Rig:
        """Return the rig with the mesh, or the minimal rig of the mesh alone."""
        known = None if self.rig is None else load_rig(self.rig, self.sensor)
        if self.mesh is None:
            if self.unit is not None:
                raise InputError("is the unit of a mesh, but none is given.", where="--unit", hint="Add --mesh MESH.")
            if known is None:
                raise InputError("the touched body is not given.", hint="Give --rig RIG, or --mesh MESH --unit UNIT.")
            return known
        if self.unit is None and ColladaAsset.of(self.mesh).metres is None:
            hint = "Add --unit mm (or m, cm, um, in)."
            raise InputError("a mesh file does not state its unit.", where=str(self.mesh), hint=hint)
        return with_mesh(known, self.mesh, self.unit)

    def _filter(self, stated: RigFilter) -> RigFilter:
        filtered = _over(stated, filter=self.filter)
        if self.cutoff is not None and filtered.kind in ("none", "kalman"):
            hint = "Add --filter butterworth or --filter zero_phase."
            raise InputError(f"the filter is {filtered.kind!r}, which has no cut-off.", where="--cutoff", hint=hint)
        return _over(filtered, cutoff=self.cutoff)


def _over(table: Made, **options: object) -> Made:
    """Return a table of the rig with these options set; None changes nothing."""
    for option, value in options.items():
        key = "kind" if option == "filter" else option
        if value is not None:
            try:
                made = _PAIRS[option](*cast("tuple[float, float]", value)) if option in _PAIRS else value
                table = replace(cast("Any", table), **{key: made})
            except ValueError as problem:
                raise InputError(f"{problem}.", where=f"--{option}") from problem
    return table
