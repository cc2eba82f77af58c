"""Run `palpate calibrate drift`: identify the drift of a sensor's bias from a log in which nothing touches it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from jaxtyping import Float
from tyro.conf import arg

from palpate.calls import by_name
from palpate.console.calibration import Calibration, CalibrationResult, origin
from palpate.console.console import Quantity
from palpate.console.options import Log, Output, RigFile, require_positive
from palpate.console.sensor_drift import SensorDrift
from palpate.errors import InputError
from palpate.files.logs import join
from palpate.setup.drift import MINUTE, drift_table
from palpate.setup.edit import update_drift
from palpate.setup.pipeline import OpenedLog, open_log
from palpate.setup.setup import Setup
from palpate.signals.recording import TEMPERATURE, Recording

LONGEST_CONTACT = 60.0  # s, after which the uncertainty of the force is printed


@dataclass(frozen=True)
class CalibrateDrift(Calibration):
    """Find how the bias drifts, and write it into the rig.

    Leave the sensor untouched for five minutes, best from when it is switched on. With a payload in the rig the arm
    may move. With [drift] in the rig, `estimate` and `live` track the bias while nothing is touched. Comments in the
    rig stay.

    Args:
        log: recording of the untouched sensor, in any format that `estimate` reads.
        rig: TOML of the set-up.
        output: rig to write; it may be the same file.
        window: seconds over which readings are averaged at first.
    """

    replaces = "rig"
    log: Log
    rig: RigFile
    output: Output
    window: Annotated[float, arg(metavar="X")] = 0.1

    def identify(self) -> CalibrationResult:
        """Return a `CalibrationResult` with the random walk, warm-up and temperature dependence of the bias.

        Raises:
            InputError: `window` is not positive, the log or the rig cannot be used, the sensor cannot have [drift] or
                states its own, or the readings are not those of an untouched sensor.
        """
        require_positive(self.window, "--window")
        with open_log(self.log, self.stated) as opened:
            setup, recording, notes = _read(self.log, opened)
        _require_one(setup, self.rig)
        temperature = recording.channels[TEMPERATURE][:, 0] if TEMPERATURE in recording.channels else None
        drift: SensorDrift = by_name(setup.kind.drift)(setup, recording, temperature, self.window)
        stated = setup.drift
        weight = 0.0 if stated is None else stated.weight
        table = drift_table(drift.found.drift, weight, None if stated is None else stated.temperature)
        notes = [*notes, *drift.notes, *drift.found.notes]
        return CalibrationResult(_figures(drift, weight), (table, drift.comments), notes=notes)

    def write(self, found: CalibrationResult) -> None:
        """Write the drift into the rig.

        Raises:
            InputError: the rig cannot be edited, or the output cannot be written.
            OSError: an input cannot be read for its digest.
        """
        table, comments = found.model
        walk = f"{comments['walk']}, from {origin(self.record(), 'log')}"
        update_drift(self.rig, self.output, table, {**comments, "walk": walk}, self.stated.name)


def _read(log: Path, opened: OpenedLog) -> tuple[Setup, Recording, tuple[str, ...]]:
    """Return the setup of the log's sensor, the recording, and notes about the log."""
    kind = opened.kind
    if not kind.drift:
        raise InputError(
            f"is of {kind.called}, and only force/torque sensors and load cells have a [drift].",
            where=str(log),
            hint=kind.drift_hint or "Give a log of one of these.",
        )
    blocks = list(opened)
    if not any(map(len, blocks)):
        raise InputError("holds no samples.", where=str(log))
    recording = join(blocks)
    if not any(np.isfinite(recording.channels[name]).any() for name in kind.channels):
        raise InputError("no sample can be used.", where=str(log), hint=" ".join(opened.notes()))
    return opened.setup, recording, opened.notes()


def _require_one(setup: Setup, rig: Path) -> None:
    """Raise an InputError where the sensor's table states a drift already."""
    kind = setup.kind.name
    if getattr(setup.sensors[kind].table, "drift", None) is not None:
        hint = f"Remove drift from [{kind}], then run this again."
        raise InputError(f"[{kind}] already states a drift, which would contradict [drift].", where=str(rig), hint=hint)


def _figures(of: SensorDrift, weight: float) -> list[tuple[str, object]]:
    """Return names and values of the figures to print."""
    found = of.found
    drift, walks, rates, slopes, noises = found.drift, list[str](), list[str](), list[str](), list[str]()
    for name, part, small, tiny, large, unit in of.groups:
        walk, spread = small * _rms(drift.walk[part]), small * _rms(found.walk_deviation[part])
        least = "" if found.seen[part].all() else "at most "
        walks.append(f"{name} {least}{walk:.3g} +- {spread:.2g} {tiny}")
        rates.append(f"{name} {large * MINUTE * _rms(drift.warm_up[part]):.2g} {unit}/min")
        slope = f"{large * _rms(drift.thermal[part]):.2g} +- {large * _rms(drift.thermal_deviation[part]):.1g}"
        slopes.append(f"{name} {slope} {unit}/K")
        noises.append(f"{name} {small * _rms(found.noise[part]):.3g} {tiny}")
    settles = "at a steady rate" if np.isinf(drift.settling) else f"falling to a third in {drift.settling:.0f} s"
    warm = f"{', '.join(rates)} at the start, {settles}" if found.warm else f"none seen: at most {', '.join(rates)}"
    touched = f"; {found.touched:.1%} left out" if found.touched else ""
    walked = f"{', '.join(walks)} in one second, growing with the square root of time"
    return [
        ("samples", f"{found.samples:,} over {found.seconds:.0f} s{touched}"),
        ("walk", Quantity(walked, drift.walk.tolist())),
        ("warm-up", Quantity(warm, (MINUTE * drift.warm_up).tolist())),
        *([("temperature", ", ".join(slopes))] if drift.thermal.any() else []),
        *([("weight", f"of the payload: +- {weight:.2g} N, by the rig")] if weight else []),
        ("noise", f"{', '.join(noises)} of a mean over {found.window:.2g} s"),
        ("left out", str(found.validation)),
        ("in contact", f"after {LONGEST_CONTACT:.0f} s unsure (95 %): {of.unsure(found.unsure(LONGEST_CONTACT))}"),
    ]


def _rms(values: Float[np.ndarray, " k"]) -> float:
    return float(np.sqrt(np.mean(values**2)))
