"""The rig: one TOML that a person writes, and what it builds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from palpate.contact.locate import Locator
from palpate.contact.wrench_estimator import WrenchEstimator
from palpate.errors import InputError
from palpate.io.logs.layout import Layout, axis_matrix
from palpate.io.models import load_toml, read_payload
from palpate.io.rig.load_cells import RigLoadCells
from palpate.io.rig.surface import RigSurface
from palpate.io.rig.tables import RigAcceleration, RigEstimate, RigFilter, RigForceTorque, RigOrientation, RigTime
from palpate.io.strict import parse
from palpate.io.units import FORCE_UNITS, TIME_UNITS, TORQUE_UNITS, to_si
from palpate.sensors.compensation import Compensation
from palpate.sensors.force_torque import ForceTorque, Payload
from palpate.sensors.load_cells import LoadCells
from palpate.surfaces import Surface

__all__ = ["Rig", "build", "check_rig", "load_rig"]


@dataclass(frozen=True)
class Rig:
    """The whole file; `folder` is where relative paths start."""

    surface: RigSurface
    force_torque: RigForceTorque = field(default_factory=RigForceTorque)
    load_cells: RigLoadCells | None = None
    time: RigTime = field(default_factory=RigTime)
    orientation: RigOrientation = field(default_factory=RigOrientation)
    acceleration: RigAcceleration = field(default_factory=RigAcceleration)
    filter: RigFilter = field(default_factory=RigFilter)
    estimate: RigEstimate = field(default_factory=RigEstimate)
    folder: Path = field(default_factory=Path)

    def layout(self, *, bench: bool = False) -> Layout:
        """How to read a log of this rig; of load cells with their reference, if it is of their bench."""
        wrench, cells = self.force_torque, self.load_cells
        count = 0 if cells is None else cells.count(None if bench or cells.model is None else cells.cells(self.folder))
        return Layout(
            time=self.time.column,
            time_unit=self.time.unit,
            wrench=wrench.columns,
            force_unit=wrench.units.force,
            torque_unit=wrench.units.torque,
            axes=wrench.axes,
            left_handed=wrench.left_handed,
            frame=wrench.frame,
            orientation=self.orientation.columns,
            position=self.orientation.position,
            acceleration=self.acceleration.columns,
            wrench_topic=wrench.topic,
            orientation_topic=self.orientation.topic,
            acceleration_topic=self.acceleration.topic,
            offset=self.orientation.offset,
            max_gap=self.orientation.max_gap,
            voltages=() if cells is None else cells.names(count),
            volts=() if cells is None else cells.volts(count),
            voltage_topic=None if cells is None else cells.topic,
            reference=cells.reference if bench and cells is not None else (),
        )

    def cells_path(self) -> Path | None:
        """Of the model of load cells, if one is named."""
        return None if self.load_cells is None else self.load_cells.path(self.folder)

    def cells(self) -> LoadCells:
        """The calibrated load cells.

        Raises:
            InputError: there are none, or they are not calibrated.
        """
        return self._stated_cells().cells(self.folder)

    def nominal_cells(self) -> LoadCells:
        """The calibrated load cells, or what the rig says that they will be.

        Raises:
            InputError: the rig has none, or says too little of them.
        """
        return self._stated_cells().nominal(self.folder)

    def _stated_cells(self) -> RigLoadCells:
        if self.load_cells is None:
            raise InputError("the rig has no load cells.", where="rig", mend="Add a [load_cells].")
        return self.load_cells

    def payload_path(self) -> Path | None:
        """Of the payload model, if one is named."""
        return None if self.force_torque.payload is None else self.folder / self.force_torque.payload

    def mesh_path(self) -> Path | None:
        """Of the mesh, if there is one."""
        return self.folder / str(self.surface.mesh) if self.surface.kind == "mesh" else None

    def payload(self) -> Payload | None:
        """Read from its file, if one is named."""
        path = self.payload_path()
        return None if path is None else read_payload(path)

    def sensor(self, noise: Float[np.ndarray, "6"] | None = None) -> ForceTorque:
        """The sensor; `noise` is used where the rig states none."""
        wrench = self.force_torque
        stated = noise if wrench.noise is None else wrench.noise.six()
        return ForceTorque(stated, None if wrench.range is None else wrench.range.six(), wrench.frame)


def load_rig(path: Path) -> Rig:
    """Read a rig; what does not fit is named with the place and the nearest fit.

    Raises:
        InputError: not there, not TOML, a key misspelt or missing, a value of another kind or out of bounds.
    """
    return check_rig(load_toml(path), path)


def check_rig(table: Mapping[str, Any], path: Path) -> Rig:
    """A rig from what TOML says, as if it stood in `path`.

    Raises:
        InputError: a key misspelt or missing, a value of another kind or out of bounds.
    """
    if "folder" in table:
        raise InputError("unknown key 'folder'.", where=str(path))
    if "surface" not in table:
        raise InputError(
            "a rig needs a [surface].", where=str(path), mend="`palpate rig new` writes one to start from."
        )
    rig = replace(parse(table, Rig, file=str(path)), folder=path.parent)
    wrench = rig.force_torque
    axis_matrix(wrench.axes, left_handed=wrench.left_handed, where=f"{path}: force_torque.axes")
    to_si(wrench.units.force, FORCE_UNITS, where=f"{path}: force_torque.units.force")
    to_si(wrench.units.torque, TORQUE_UNITS, where=f"{path}: force_torque.units.torque")
    to_si(rig.time.unit, TIME_UNITS, where=f"{path}: time.unit")
    return rig


def build(
    rig: Rig, *, surface: Surface | None = None, noise: Float[np.ndarray, "6"] | None = None, rate: float | None = None
) -> WrenchEstimator:
    """The estimator of a rig.

    Args:
        rig: what the user wrote.
        surface: where it was loaded before.
        noise: (6,) standard deviations [N, N m], used where the rig states none.
        rate: [Hz] of the log, used where the rig states none; filters by frequency need one.
    """
    settings, sensor = rig.estimate, rig.sensor(noise)
    locator = Locator(
        rig.surface.load(rig.folder) if surface is None else surface,
        method=settings.method,
        friction=settings.friction,
        torsion=settings.torsion,
        noise=sensor.noise,
        on=None if settings.contact is None else settings.contact.on,
        off=None if settings.contact is None else settings.contact.off,
    )
    uncertain = rig.surface.pose_covariance
    return WrenchEstimator(
        locator,
        Compensation(sensor, rig.payload()),
        rig.surface.pose.pose(),
        None if uncertain is None else np.asarray(uncertain),
        filter=rig.filter.filter(),
        rate=rig.filter.rate or rate,
    )
