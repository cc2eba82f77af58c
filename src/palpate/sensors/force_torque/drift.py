"""Identify how the bias of a force/torque sensor drifts, from a log in which nothing touches it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from palpate.calibration.drift import identify_drift
from palpate.console.sensor_drift import CHI_95, ChannelGroup, SensorDrift
from palpate.errors import InputError
from palpate.sensors.force_torque.section import ForceTorqueSection, accelerated, free_wrenches
from palpate.setup.setup import Setup
from palpate.signals.recording import ORIENTATION, POSITION, Recording
from palpate.spatial.pose import rotation_from_quaternion

__all__: list[str] = []  # for the registry alone

TURNED = 2.0  # degrees that a sensor without a payload may turn: 0.35 N of 1 kg
AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
GROUPS = (
    ChannelGroup("force", slice(0, 3), 1e3, "mN", 1.0, "N"),
    ChannelGroup("torque", slice(3, 6), 1e3, "N mm", 1e3, "N mm"),
)
COMMENTS = {
    "walk": "N/sqrt(s), N m/sqrt(s)",
    "warm_up": "N/min, N m/min at the start",
    "settle": "s",
    "weight": "N: by which the payload's may be off",
    "thermal": "N/K, N m/K",
    "thermal_deviation": "of it",
}


def wrench_drift(
    setup: Setup, recording: Recording, temperature: Float[np.ndarray, " n"] | None, window: float
) -> SensorDrift:
    """Return the drift of the sensor's bias [N, N m] as a `SensorDrift`.

    Args:
        setup: setup of the sensor.
        recording: log in which nothing touches it.
        temperature: (n,) [K or degrees C] of the samples; None: not recorded.
        window: [s] over which readings are averaged at first.

    Raises:
        InputError: the sensor turns and its payload is not known, there is a payload and no orientation, the payload's
            file cannot be read, the log is too short or touched, a channel never changes, or times run backwards.
    """
    setup, notes = _moving(setup, recording)
    sensor, rotations = setup.of(ForceTorqueSection), _rotations(recording)
    if sensor.payload is None:
        if (turned := _turned(rotations)) > TURNED:
            raise InputError(
                f"the sensor turns by {turned:.0f} degrees, and the rig names no payload whose weight could be taken "
                "off.",
                where=recording.source,
                hint="Run `palpate calibrate payload` and name its file in the rig, or record the sensor at rest.",
            )
        notes = (*notes, "the rig names no payload: the result is valid only if the sensor did not turn")
    noise = sensor.table.noise
    found = identify_drift(
        recording.time,
        free_wrenches(setup, recording),
        None if noise is None else noise.six(),
        temperature,
        None if rotations is None else -rotations[:, 2],  # gravity's direction
        names=AXES,
        window=window,
    )
    return SensorDrift(found, COMMENTS, GROUPS, _unsure, notes)


def _moving(setup: Setup, recording: Recording) -> tuple[Setup, tuple[str, ...]]:
    if not accelerated(setup, recording):
        return setup, ()
    if POSITION not in recording.channels or setup.acceleration.kind == "none":
        return setup, (
            "the arm moves, and its acceleration is not known: the payload's inertia counts as walk, so the walk may "
            "be smaller than stated. Record at rest, or slowly, or with positions or accelerations",
        )
    taken = replace(setup.acceleration, from_poses=True, columns=None, topic=None)
    return replace(setup, acceleration=taken), (
        "the arm moves: accelerations were taken from the poses (from_poses = true in the rig's [acceleration] does "
        "the same for other commands)",
    )


def _rotations(recording: Recording) -> Float[np.ndarray, "n 3 3"] | None:
    """Return sensor in base, NaN where it is not known; None without orientation."""
    if ORIENTATION not in recording.channels:
        return None
    quaternions = recording.channels[ORIENTATION]
    known = np.isfinite(quaternions).all(axis=1)
    made: Float[np.ndarray, "n 3 3"] = np.full((len(quaternions), 3, 3), np.nan)
    made[known] = rotation_from_quaternion(quaternions[known])
    return made


def _turned(rotations: Float[np.ndarray, "n 3 3"] | None) -> float:
    """Return the largest angle [degrees] between a known rotation and the first; 0 without any."""
    if rotations is None or not len(known := rotations[np.isfinite(rotations).all(axis=(1, 2))]):
        return 0.0
    cosine = (np.einsum("nij,ij->n", known, known[0]) - 1.0) / 2.0
    return float(np.degrees(np.arccos(np.clip(cosine.min(), -1.0, 1.0))))


def _unsure(deviation: Float[np.ndarray, "6"]) -> str:
    force, torque = (CHI_95 * float(np.sqrt(np.mean(deviation[group.channels] ** 2))) for group in GROUPS)
    return f"force by {force:.2g} N, torque by {torque:.2g} N m"
