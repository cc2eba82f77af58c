"""`palpate calibrate drift`: how the zero of a sensor wanders, from a log in which nothing touches it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from jaxtyping import Float
from tyro.conf import arg

from palpate.calibration.drift import DriftFit, identify_drift
from palpate.cli.calibration import Calibration, Found, origin
from palpate.cli.console import Figure
from palpate.cli.options import Log, Output, RigFile, require_positive
from palpate.errors import InputError
from palpate.io.logs import join
from palpate.io.pipeline import OpenedLog, open_log
from palpate.io.rig.drift import MINUTE, drift_table
from palpate.io.rig.edit import update_drift
from palpate.io.rig.force_torque import ForceTorqueSection, accelerated, free_wrenches
from palpate.io.rig.load_cells import LoadCellSection
from palpate.io.rig.setup import Setup
from palpate.sensors.force_torque import Payload
from palpate.sensors.recording import ORIENTATION, POSITION, TEMPERATURE, VOLTAGE, Recording
from palpate.spatial.pose import rotation_from_quaternion

__all__ = ["CalibrateDrift"]

CHI_95 = 2.795  # of three components: the length that 95 % stay below, in deviations of one
LONGEST_CONTACT = 60.0  # s, of which it is said how unsure the force becomes
TURNED = 2.0  # degrees that a sensor without a payload may turn: 0.35 N of 1 kg
AXES = ("fx", "fy", "fz", "tx", "ty", "tz")


@dataclass(frozen=True)
class CalibrateDrift(Calibration):
    """Find how the zero of a force/torque sensor or of load cells wanders, and write it into the rig.

    Leave the sensor untouched for five minutes, best from when it is switched on. With a payload in the rig the arm
    may move. With [drift] in the rig, `estimate` and `live` follow the zero wherever nothing is touched. Comments in
    the rig stay.

    Args:
        log: of the untouched sensor, in any format that `estimate` reads.
        rig: TOML of the set-up.
        output: rig to write; it may be the same file.
        window: seconds over which readings are averaged at first.
    """

    replaces = "rig"
    log: Log
    rig: RigFile
    output: Output
    window: Annotated[float, arg(metavar="X")] = 0.1

    def identify(self) -> Found:
        """Fit walk, warm-up and temperature to the readings of the free sensor."""
        require_positive(self.window, "--window")
        with open_log(self.log, self.stated) as opened:
            setup, recording, notes = _read(self.log, opened)
        kind = setup.kind.name
        _require_one(setup, self.rig)
        temperature = recording.channels[TEMPERATURE][:, 0] if TEMPERATURE in recording.channels else None
        if kind == "force_torque":
            setup, moves = _moving(setup, recording)
            notes = (*notes, *moves)
            found, said = _of_wrenches(setup, recording, temperature, self.window), _Wrench()
            payload = setup.of(ForceTorqueSection).payload
            if payload is None:
                notes = (*notes, "no payload is named: what is found holds if the sensor did not turn")
        else:
            found, said, payload = *_of_cells(setup, recording, temperature, self.window), None
        stated = setup.drift
        weight = stated.weight if stated is not None and stated.weight else _unsure_weight(payload)
        table = drift_table(found.drift, weight, None if stated is None else stated.temperature)
        return Found(_figures(found, said, weight), (table, said.comments), notes=[*notes, *found.notes])

    def write(self, found: Found) -> None:
        """Write the drift into the rig."""
        table, comments = found.model
        walk = f"{comments['walk']}, from {origin(self.record(), 'log')}"
        update_drift(self.rig, self.output, table, {**comments, "walk": walk})


def _read(log: Path, opened: OpenedLog) -> tuple[Setup, Recording, tuple[str, ...]]:
    """Return the setup of the log's sensor, the recording, and notes about the log."""
    kind = opened.kind.name
    if kind not in ("force_torque", "load_cells"):
        raise InputError(
            f"[{kind}] has no zero that is followed: [drift] is of a force/torque sensor or of load cells.",
            where=str(log),
            hint="A skin follows its zero by itself: walk or drift in [contacts]." if kind == "skin" else "",
        )
    blocks = list(opened)
    if not sum(map(len, blocks)):
        raise InputError("holds no samples.", where=str(log))
    return opened.setup, join(blocks), opened.notes()


def _require_one(setup: Setup, rig: Path) -> None:
    """Raise an InputError where the sensor's table states a drift already."""
    kind = setup.kind.name
    if getattr(setup.sensors[kind].table, "drift", None) is not None:
        raise InputError(
            f"[{kind}] states a drift too, and only one of both can hold.",
            where=str(rig),
            hint=f"Remove drift from [{kind}], then run this again.",
        )


def _moving(setup: Setup, recording: Recording) -> tuple[Setup, tuple[str, ...]]:
    """Return the setup, with accelerations from the poses where the arm moves and the log has none, and notes."""
    if not accelerated(setup, recording):
        return setup, ()
    if POSITION not in recording.channels or setup.acceleration.kind == "none":
        return setup, (
            "the arm moves, and how much it is accelerated is not known: what inertia does to the payload counts as "
            "walk, which may be smaller than is said. Record at rest, or slowly, or with positions or accelerations",
        )
    taken = replace(setup.acceleration, from_poses=True, columns=None, topic=None)
    said = "the arm moves: accelerations were taken from the poses ([acceleration] from_poses = true does so elsewhere)"
    return replace(setup, acceleration=taken), (said,)


def _of_wrenches(
    setup: Setup, recording: Recording, temperature: Float[np.ndarray, " n"] | None, window: float
) -> DriftFit:
    """Of what is left when the payload is taken off."""
    if setup.of(ForceTorqueSection).payload is None and (turned := _turned(recording)) > TURNED:
        raise InputError(
            f"the sensor turns by {turned:.0f} degrees, and the rig names no payload whose weight could be taken off.",
            where=recording.source,
            hint="Run `palpate calibrate payload` and name its file in the rig, or record the sensor at rest.",
        )
    noise = setup.of(ForceTorqueSection).table.noise
    return identify_drift(
        recording.time,
        free_wrenches(setup, recording),
        None if noise is None else noise.six(),
        temperature,
        _down(recording),
        names=AXES,
        window=window,
    )


def _down(recording: Recording) -> Float[np.ndarray, "n 3"] | None:
    """Direction of gravity in the sensor's frame, NaN where it is not known; None: nowhere."""
    if ORIENTATION not in recording.channels:
        return None
    quaternions = recording.channels[ORIENTATION]
    known = np.isfinite(quaternions).all(axis=1)
    made: Float[np.ndarray, "n 3"] = np.full((len(quaternions), 3), np.nan)
    made[known] = -rotation_from_quaternion(quaternions[known])[:, 2]
    return made


def _turned(recording: Recording) -> float:
    """Degrees between the orientations that are furthest from the first."""
    if ORIENTATION not in recording.channels:
        return 0.0
    quaternions = recording.channels[ORIENTATION]
    known = quaternions[np.isfinite(quaternions).all(axis=1)]
    if not len(known):
        return 0.0
    rotations = rotation_from_quaternion(known)
    cosine = (np.einsum("nij,ij->n", rotations, rotations[0]) - 1.0) / 2.0
    return float(np.degrees(np.arccos(np.clip(cosine.min(), -1.0, 1.0))))


def _of_cells(
    setup: Setup, recording: Recording, temperature: Float[np.ndarray, " n"] | None, window: float
) -> tuple[DriftFit, _Cells]:
    """Of the voltages of the cells that are used; one that is left out drifts as the others do."""
    table, cells = setup.of(LoadCellSection).table, setup.of(LoadCellSection).cells
    sound = cells.channels(~np.isin(np.arange(cells.cells) + 1, table.without))
    voltages = recording.channels[VOLTAGE]
    beyond = (voltages <= cells.limits[:, 0]) | (voltages >= cells.limits[:, 1])
    picked = np.where(beyond, np.nan, voltages)[:, sound]
    names = [name for name, used in zip(table.names(cells.cells), sound, strict=True) if used]
    noise = np.sqrt(np.diag(cells.noise))[sound]
    found = identify_drift(recording.time, picked, noise, temperature, names=names, window=window)
    return found.spread(sound), _Cells(cells.inverse(sound)[0])


def _unsure_weight(payload: Payload | None) -> float:
    """[N] deviation of the weight, by its calibration."""
    if payload is None:
        return 0.0
    return float(np.sqrt(max(0.0, np.linalg.eigvalsh(payload.covariance[:3, :3]).max())))


class _Wrench:
    """How a drift of forces and torques is said."""

    comments: Mapping[str, str] = {
        "walk": "N/sqrt(s), N m/sqrt(s)",
        "warm_up": "N/min, N m/min at the start",
        "settle": "s",
        "weight": "N: by which the payload's may be off",
        "thermal": "N/K, N m/K",
        "thermal_deviation": "of it",
    }
    parts = (("force", slice(0, 3), 1e3, "mN", 1.0, "N"), ("torque", slice(3, 6), 1e3, "N mm", 1e3, "N mm"))

    def unsure(self, deviation: Float[np.ndarray, "6"]) -> str:
        """Force and torque, 95 %."""
        force, torque = (CHI_95 * float(np.sqrt(np.mean(deviation[part] ** 2))) for _, part, *_ in self.parts)
        return f"force by {force:.2g} N, torque by {torque:.2g} N m"


class _Cells:
    """How a drift of voltages is said; `inverse` (6, m) makes wrenches of them."""

    comments: Mapping[str, str] = {
        "walk": "V/sqrt(s)",
        "warm_up": "V/min at the start",
        "settle": "s",
        "thermal": "V/K",
        "thermal_deviation": "of it",
    }
    parts = (("voltage", slice(None), 1e6, "uV", 1e3, "mV"),)

    def __init__(self, inverse: Float[np.ndarray, "6 m"]) -> None:
        self._inverse = inverse

    def unsure(self, deviation: Float[np.ndarray, " m"]) -> str:
        """The force, 95 %."""
        spread = np.sum((self._inverse[:3] * deviation) ** 2) / 3.0
        return f"force by {CHI_95 * float(np.sqrt(spread)):.2g} N"


def _figures(found: DriftFit, said: _Wrench | _Cells, weight: float) -> list[tuple[str, object]]:
    """Names and values."""
    drift, walks, rates = found.drift, list[str](), list[str]()
    kelvin, noises = list[str](), list[str]()
    for name, part, small, tiny, large, unit in said.parts:
        walk, spread = small * _rms(drift.walk[part]), small * _rms(found.walk_deviation[part])
        least = "" if found.seen[part].all() else "at most "
        walks.append(f"{name} {least}{walk:.3g} +- {spread:.2g} {tiny}")
        rates.append(f"{name} {large * MINUTE * _rms(drift.warm_up[part]):.2g} {unit}/min")
        slope = f"{large * _rms(drift.thermal[part]):.2g} +- {large * _rms(drift.thermal_deviation[part]):.1g}"
        kelvin.append(f"{name} {slope} {unit}/K")
        noises.append(f"{name} {small * _rms(found.noise[part]):.3g} {tiny}")
    settles = "at a steady rate" if np.isinf(drift.settling) else f"falling to a third in {drift.settling:.0f} s"
    warm = f"{', '.join(rates)} at the start, {settles}" if found.warm else f"none seen: at most {', '.join(rates)}"
    left = f"; {found.touched:.1%} left out" if found.touched else ""
    unsure = said.unsure(found.unsure(LONGEST_CONTACT))
    return [
        ("samples", f"{found.samples:,} over {found.seconds:.0f} s{left}"),
        ("walk", Figure(f"{', '.join(walks)} in one second, growing as the root of time", drift.walk.tolist())),
        ("warm-up", Figure(warm, (MINUTE * drift.warm_up).tolist())),
        *([("temperature", ", ".join(kelvin))] if drift.thermal.any() else []),
        *([("weight", f"of the payload: +- {weight:.2g} N, by its calibration or the rig")] if weight else []),
        ("noise", f"{', '.join(noises)} of a mean over {found.window:.2g} s"),
        ("left out", str(found.left_out)),
        ("in contact", f"after {LONGEST_CONTACT:.0f} s unsure (95 %): {unsure}"),
    ]


def _rms(values: Float[np.ndarray, " k"]) -> float:
    return float(np.sqrt(np.mean(values**2)))
