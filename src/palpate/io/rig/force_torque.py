"""A six-axis force/torque sensor in a rig: its payload, its inertia, its noise, and how a log of it is told."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from palpate.io.logs.layout import Layout, axis_matrix
from palpate.io.models import read_model
from palpate.io.rig.guess_force_torque import guess_force_torque
from palpate.io.rig.kind import Prepared, SensorKind
from palpate.io.rig.tables import RigForceTorque
from palpate.io.rig.wrench import wrench_estimator
from palpate.io.units import FORCE_UNITS, TORQUE_UNITS, to_si
from palpate.sensors.compensation import Compensation
from palpate.sensors.force_torque import ForceTorque, Payload
from palpate.sensors.motion import Motion
from palpate.sensors.noise import estimate_noise
from palpate.sensors.recording import ACCELERATION, FORCE, TORQUE, Recording

if TYPE_CHECKING:
    from palpate.io.rig.rig import Rig

__all__ = ["FORCE_TORQUE", "force_torque_layout", "rig_payload", "rig_sensor"]


def force_torque_layout(rig: Rig) -> Layout:
    """Where a log keeps wrenches and poses."""
    wrench = rig.force_torque
    return Layout(
        time=rig.time.column,
        time_unit=rig.time.unit,
        wrench=wrench.columns,
        force_unit=wrench.units.force,
        torque_unit=wrench.units.torque,
        axes=wrench.axes,
        left_handed=wrench.left_handed,
        frame=wrench.frame,
        wrench_topic=wrench.topic,
        **rig.poses(),
    )


def rig_payload(rig: Rig) -> Payload | None:
    """Read from its file, if one is named."""
    name = rig.force_torque.payload
    return None if name is None else read_model(rig.folder / name, Payload)


def rig_sensor(rig: Rig, noise: Float[np.ndarray, "6"] | None = None) -> ForceTorque:
    """The sensor; `noise` is used where the rig states none."""
    wrench = rig.force_torque
    stated = noise if wrench.noise is None else wrench.noise.six()
    return ForceTorque(stated, None if wrench.range is None else wrench.range.six(), wrench.frame)


def _build(rig: Rig, head: Recording | None) -> Prepared:
    noise = None if head is None or rig.force_torque.noise is not None else estimate_noise(head.wrenches())
    payload = rig_payload(rig)
    sensor = Compensation(rig_sensor(rig, noise), payload, _motion(rig, payload, head))
    made = wrench_estimator(rig, sensor, head, tare=rig.estimate.tare)
    stated = rig.force_torque.noise is not None
    made.facts["noise_source"] = "given" if stated else "unknown" if noise is None else "steps of the log"
    made.said[:0] = [*_noise_said(rig, noise), *_payload_said(rig, payload)]
    return made


def _noise_said(rig: Rig, noise: Float[np.ndarray, "6"] | None) -> list[str]:
    if noise is not None:
        force, torque = noise[:3].max(), noise[3:].max()
        return [f"noise taken from the log's steps: {force:.3g} N, {torque:.3g} N m (a filtered log looks too quiet)"]
    if rig.force_torque.noise is None:
        return ["the noise is not known, so there are no covariances: state it in the rig, or use a longer log"]
    return []


def _payload_said(rig: Rig, payload: Payload | None) -> list[str]:
    if payload is not None:
        return []
    tared = "the tare holds only while the sensor keeps its orientation"
    untared = "wrenches are taken as they are, so they must be tared"
    return [f"no payload model: {untared if rig.estimate.tare is None else tared}"]


def _motion(rig: Rig, payload: Payload | None, head: Recording | None) -> Motion | None:
    """How inertia is accounted for."""
    stated = rig.acceleration
    if payload is None or not payload.weight.any() or head is None:
        return None
    recorded = stated.kind if ACCELERATION in head.channels else "none"
    source = "poses" if stated.from_poses else recorded
    return Motion(source=source, window=stated.window, gravity=payload.gravity, lever=payload.center_of_mass)


def _check(rig: Rig, path: Path) -> None:
    wrench = rig.force_torque
    axis_matrix(wrench.axes, left_handed=wrench.left_handed, where=f"{path}: force_torque.axes")
    to_si(wrench.units.force, FORCE_UNITS, where=f"{path}: force_torque.units.force")
    to_si(wrench.units.torque, TORQUE_UNITS, where=f"{path}: force_torque.units.torque")


FORCE_TORQUE = SensorKind(
    name="force_torque",
    called="a six-axis force/torque sensor",
    table=RigForceTorque,
    channels=(FORCE, TORQUE),
    layout=force_torque_layout,
    build=_build,
    guess=guess_force_torque,
    paths=("payload",),
    check=_check,
)
