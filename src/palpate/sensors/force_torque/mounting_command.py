"""`palpate calibrate mounting`: find the pose of the surface in the sensor's frame from touches."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from tyro.conf import arg

from palpate.calibration.mounting import Mounting, Spreads, identify_mounting, mean_touches
from palpate.calibration.presses import find_presses
from palpate.calibration.touch_error import TouchError
from palpate.console.calibration import Calibration, CalibrationResult, origin
from palpate.console.console import wait
from palpate.console.options import FileOption, Log, Output, RigFile
from palpate.contact.ground_truth import TrueTouches
from palpate.contact.locate import Locator
from palpate.contact.wrench_estimator import WrenchEstimator
from palpate.errors import InputError
from palpate.files.ground_truth import read_touches
from palpate.files.logs import read_recording
from palpate.files.units import measured
from palpate.sensors.force_torque.compensation import Compensation
from palpate.sensors.force_torque.section import ForceTorqueSection, stated_sensor
from palpate.setup.edit import update_pose
from palpate.setup.setup import Setup
from palpate.signals.recording import Recording
from palpate.spatial.pose import Pose
from palpate.surfaces.mesh import Mesh

POOR = 3.0  # times the expected residual: beyond it the model, not the noise, is what is left


@dataclass(frozen=True)
class CalibrateMounting(Calibration):
    """Find the surface's pose in the sensor's frame from touches.

    With marks, each touch was at a known point. Without, each press in the log is a touch somewhere on the surface,
    which tells less and believes that presses are mostly along the normal. Comments in the rig stay.

    Args:
        log: log in which marked points, or many different places, are pressed.
        rig: TOML of the set-up, with payload and a rough pose.
        output: rig to write; it may be the same file.
        marks: start,end,px,py,pz[,label] of each touch, in the surface's frame.
        placement: standard deviation [m] of how well marks are hit, along each axis.
    """

    replaces = "rig"
    log: Log
    rig: RigFile
    output: Output
    marks: FileOption = None
    placement: Annotated[float, arg(metavar="X")] = 0.5e-3

    def identify(self) -> CalibrationResult:
        """Return a `CalibrationResult` with the pose under which the wrenches act at the touched points.

        Raises:
            InputError: rig, log or marks cannot be read, the rig has no surface, the log has no press, no touch lies in
                the log, or no pose explains the touches.
            NotIdentifiable: the touches determine no direction of the pose.
            GeometryError: the file of the surface has no usable surface.
        """
        setup, marks = self.stated.resolve("force_torque"), self.marks
        recording = read_recording(self.log, setup.layout())
        if setup.link.stated is None:
            hint = 'Add it, with mesh = "FILE" of what was touched.'
            raise InputError("the rig has no [surface].", where=str(self.rig), hint=hint)
        surface = setup.link.surface().drawn()  # an equation as its fine mesh: evidence counts facets
        wait("preparing the surface")
        wrenches, covariances, estimator = _in_sensor(recording, setup, surface)
        touches = _presses(recording, wrenches, estimator) if marks is None else read_touches(marks)
        _require_overlap(recording, touches, marks or self.log)
        means, spreads = mean_touches(
            recording.time, wrenches, touches.start, touches.end, estimator.sensor.noise, covariances
        )
        initial = setup.link.mount
        mounting = identify_mounting(
            means,
            surface,
            initial=initial,
            points=None if marks is None else touches.point,
            noise=spreads,
            spreads=Spreads(placement=self.placement),
            labels=touches.label,
        )
        error = None if marks is None else mounting.error
        kind = "presses somewhere on the surface" if marks is None else f"touches at the points of {marks}"
        payload = setup.of(ForceTorqueSection).table.payload is not None
        return CalibrationResult(
            [
                ("touches", f"{len(mounting.touches)} used of {len(touches)} {kind}"),
                *_figures(mounting, initial),
                ("left out", str(mounting.validation)),
                *([] if error is None else [("touches err by", _err_by(error, self.placement))]),
            ],
            (mounting, None if error is None else error.placement(self.placement)),
            notes=[*surface.notes, *recording.notes, *mounting.notes],
            warnings=_doubts(mounting, initial, payload=payload, anywhere=marks is None),
        )

    def write(self, found: CalibrationResult) -> None:
        """Write the pose, its covariance and the placement error of touches into the rig `output`.

        Raises:
            InputError: the rig cannot be edited in its form, or the output cannot be written.
            OSError: an input cannot be read for its digest.
        """
        mounting, added = found.model
        record = self.record()
        comment = f"from {len(mounting.touches)} touches of {origin(record, 'log')}, palpate {record['palpate']}"
        update_pose(
            self.rig,
            self.output,
            mounting.pose,
            mounting.covariance,
            placement=added,
            comment=comment,
            sensor=self.stated.name,
        )


def _doubts(mounting: Mounting, initial: Pose, *, payload: bool, anywhere: bool) -> list[str]:
    said: list[str] = []
    if not payload:
        said.append("the rig names no payload: weight and bias that were not taken off falsify the pose")
    if mounting.residual > POOR:
        said.append(
            f"the touches fit {mounting.residual:.1f} times worse than they should: "
            "check payload, units, marks and the initial pose before using the result"
        )
    moved = float(np.linalg.norm(mounting.pose.translation - initial.translation))
    sure = float(np.sqrt(np.trace(mounting.position_covariance)))
    if anywhere and moved < sure:
        said.append(
            f"the pose moved by {1e3 * moved:.2g} mm and is known to {1e3 * sure:.2g} mm: "
            "the pose from the drawing may be as good; touch known marks to find a better one"
        )
    return said


def _in_sensor(
    recording: Recording, setup: Setup, surface: Mesh
) -> tuple[np.ndarray, np.ndarray | None, WrenchEstimator]:
    """Return compensated wrenches (n, 6) in the sensor's frame, the payload's covariances, and the estimator.

    Wrenches of samples that cannot be used are NaN.
    """
    sensor = stated_sensor(setup, recording)
    settings = setup.estimate.contact
    on, off = (None, None) if settings is None else (settings.on, settings.off)
    locator = Locator(surface, noise=sensor.noise, on=on, off=off)
    load = setup.of(ForceTorqueSection).payload
    estimator = WrenchEstimator(locator, Compensation(sensor, load), live=False)  # surface frame = sensor frame
    wrenches, covariances, statuses = estimator.contact_wrenches(recording)
    usable = np.where((statuses < 0)[:, None], wrenches, np.nan)
    added = None if covariances is None or covariances.ndim == 2 else covariances - sensor.noise
    return usable, added, estimator


def _err_by(error: TouchError, marks: float) -> str:
    drift = f" and {1e3 * error.drift:.2g} mm in common over some {error.lasting:.0f}" if error.drift else ""
    errors, added = f"{1e3 * error.jitter:.2g} mm each{drift}, in addition to their noise", error.placement(marks)
    if not added:
        return f"{errors}: no more than the {1e3 * marks:.2g} mm that marks are hit by"
    return f"{errors}; {1e3 * added:.2g} mm of it is not how marks are hit, and is in the covariance (placement)"


def _presses(recording: Recording, wrenches: np.ndarray, estimator: WrenchEstimator) -> TrueTouches:
    on, off = estimator.locator.on, estimator.locator.off
    start, end = find_presses(recording.time, wrenches, on=on, off=off)
    if not len(start):
        raise InputError(
            f"the log has no press above {on:.3g} N.",
            where=recording.source,
            hint="Name the payload in the rig, or lower contact in [estimate].",
        )
    if not np.all(start <= end):  # NaN too
        hint = "Sort the rows of the log by time, and remove those without one."
        raise InputError("times run backwards, or are missing, within a press.", where=recording.source, hint=hint)
    labels = tuple(f"press {k + 1} at {begin:.2f} s" for k, begin in enumerate(start))
    return TrueTouches(start, end, np.full((len(start), 3), np.nan), labels)


def _require_overlap(recording: Recording, touches: TrueTouches, source: Path) -> None:
    """Raise InputError unless some touch lies in the log: else the two are not on one clock."""
    known = recording.time[np.isfinite(recording.time)]
    first, last = (known.min(), known.max()) if len(known) else (np.nan, np.nan)
    if not np.any((touches.start <= last) & (touches.end >= first)):
        span = f"from {first:.3f} to {last:.3f} s" if len(known) else "without any time"
        raise InputError(
            f"all {len(touches)} touches are outside the log, which is {span}.",
            where=str(source),
            hint="Write the times of both by one clock, in seconds.",
        )


def _figures(mounting: Mounting, initial: Pose) -> list[tuple[str, str]]:
    pose, blind = mounting.pose, "; ".join(mounting.unobservable)
    turned = np.degrees(np.linalg.norm((initial.inverse() @ pose).rotation_vector()))
    spread = np.degrees(np.sqrt(np.diag(mounting.covariance)[:3]))
    place = np.sqrt(np.diag(mounting.position_covariance))
    shift = pose.translation - initial.translation
    return [
        ("position", measured(1e3 * pose.translation, 1e3 * place, "mm")),
        ("rotation vector", measured(np.degrees(pose.rotation_vector()), spread, "deg")),
        ("moved by", f"{1e3 * np.linalg.norm(shift):.2f} mm and {turned:.2f} deg"),
        ("residual", f"{mounting.residual:.2f} of what was expected of noise and marks"),
        ("determined", "all six directions" if not blind else "; ".join(mounting.observable) or "nothing"),
        *([("not determined", blind)] if blind else []),
    ]
