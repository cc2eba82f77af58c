"""`palpate calibrate payload` and `palpate calibrate clock`: identify payload, bias and clock offset."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from tyro.conf import FlagCreatePairsOff, arg

from palpate.calibration.clock import ClockOffset, identify_offset
from palpate.console.calibration import Calibration, CalibrationResult, origin
from palpate.console.options import FileOption, Log, Output, RigFile
from palpate.errors import InputError
from palpate.files.logs import LogContents, contents, read_poses, read_recording
from palpate.files.logs.layout import LogLayout
from palpate.files.units import measured
from palpate.sensors.force_torque.calibrate import identify_payload
from palpate.sensors.force_torque.calibrate_imu import identify_payload_with_imu
from palpate.sensors.force_torque.files import of_payload
from palpate.sensors.force_torque.poses import average_poses, average_rests
from palpate.sensors.force_torque.section import ForceTorqueSection
from palpate.setup.edit import update_offset
from palpate.setup.guess import imu_topics
from palpate.setup.names import acceleration_columns
from palpate.signals.noise import estimate_noise
from palpate.signals.payload import STANDARD_GRAVITY, Payload
from palpate.signals.recording import ACCELERATION, ORIENTATION, Recording
from palpate.spatial.pose import rotation_from_quaternion

ALONE = "each on its own"
MISFIT = 5.0, 0.01  # times the noise of a pose's mean, and share of the weight: larger residuals are the model's
SURE = 3.0  # standard deviations from which on two clocks differ


@dataclass(frozen=True)
class CalibratePayload(Calibration):
    """Identify mass, center of mass and bias: gravity compensation.

    Hold some seven poses that differ about more than one axis. Stretches at rest are averaged; where there are none,
    all samples are used. A log without orientations may have the accelerations of an IMU fixed to the sensor: hold some
    twelve orientations still, and the IMU's rotation and bias are identified too.

    Args:
        log: CSV or Parquet with time,fx,fy,fz,tx,ty,tz and qx,qy,qz,qw (sensor in base) or ax,ay,az; MCAP or a ROS bag
            with WrenchStamped and PoseStamped or Imu; or as the rig says.
        output: payload.toml to write.
        rig: TOML with the columns, topics and units of the log.
        gravity: its direction in the base as x,y,z (0,0,-1 when z points up), or free: identified too.
        magnitude: of gravity [m/s^2].
        base_frame: the wrenches are written in the base frame (a rig says it as frame = "base").
        force: write the payload although a known mistake explains the log better, or the fit leaves much of the weight;
            not without orientations.
    """

    replaces = "force_torque.payload"
    log: Log
    output: Output
    rig: FileOption = None
    gravity: Annotated[str, arg(metavar="X,Y,Z")] = "free"
    magnitude: Annotated[float, arg(metavar="X")] = STANDARD_GRAVITY
    base_frame: Annotated[bool, FlagCreatePairsOff] = False
    force: Annotated[bool, FlagCreatePairsOff] = False

    def identify(self) -> CalibrationResult:
        """Return a `CalibrationResult` with the payload that is fitted to the averages of poses at rest.

        Raises:
            InputError: rig or log cannot be read, the log has no orientation or no complete sample, `gravity` is not a
                direction, or `magnitude` is not positive.
            NotIdentifiable: the poses do not separate the payload's parameters.
            OSError: an input cannot be read for its digest.
        """
        layout = LogLayout() if self.rig is None else self.stated.layout("force_torque")
        recording = read_recording(self.log, layout)
        if self.rig is None and not {ORIENTATION, ACCELERATION} & set(recording.channels):
            recording = read_recording(self.log, _with_imu(layout, contents(self.log)))
        in_base = self.base_frame or layout.frame == "base"
        if ORIENTATION in recording.channels:
            payload, used = self._by_poses(recording, in_base)
        elif ACCELERATION in recording.channels:
            payload, used = self._by_imu(recording, in_base)
        else:
            raise InputError(
                "the log has no orientation, and without it the weight cannot be told from the bias.",
                where=str(self.log),
                hint="Add columns qx, qy, qz, qw (sensor in base) to a table, or a topic of poses or /tf to messages; "
                "name them in the rig's [orientation] (columns, file of a second table, topic, base and sensor). Or "
                "name the accelerations of an IMU on the sensor in its [acceleration] (columns, topic).",
            )
        return CalibrationResult(
            [
                ("samples", f"{len(recording):,}; used: {used}"),
                *of_payload(payload),
                ("left out", payload.provenance["left_out"]),
            ],
            payload,
            notes=[*recording.notes, *payload.notes],
        )

    def _by_poses(self, recording: Recording, in_base: bool) -> tuple[Payload, str]:
        rotations = rotation_from_quaternion(recording.channels[ORIENTATION])
        wrenches, poses, counts = average_poses(recording.wrenches(), rotations)
        averaged = bool(counts.max() > 1)
        payload = identify_payload(
            wrenches,
            poses,
            gravity=_direction(self.gravity),
            magnitude=self.magnitude,
            hypothesis="base frame" if in_base else "as is",
            unchecked=self.force,
            of="poses" if averaged else "samples",
            provenance=self.record(gravity=self.gravity),
        )
        if not averaged:
            return payload, ALONE
        used = f"{len(counts)} poses at rest of {int(counts.sum()):,} samples"
        sensed = estimate_noise(recording.wrenches())
        noise = 0.0 if sensed is None else float(np.sqrt((sensed.deviation[:3] ** 2).mean() / counts.mean()))
        force, weight = payload.residual[0], float(np.linalg.norm(payload.weight))
        if force <= max(MISFIT[0] * noise, MISFIT[1] * weight):
            return payload, used
        note = (
            f"The poses' forces are {1e3 * force:.3g} mN (rms) from the fit, and their noise is {1e3 * noise:.2g} mN: "
            f"deviations are {np.sqrt(len(counts)):.2g} times wider, as if all poses shared one error. Orientations "
            "that are late (`palpate calibrate clock`), the gain of an axis and touches cause it."
        )
        return replace(payload, covariance=len(counts) * payload.covariance, notes=(*payload.notes, note)), used

    def _by_imu(self, recording: Recording, in_base: bool) -> tuple[Payload, str]:
        if in_base or self.gravity != "free":
            what = "wrenches in the base frame need" if in_base else "--gravity is a direction in the base, and needs"
            raise InputError(f"{what} orientations, and the log has only accelerations.", where=str(self.log))
        wrenches, felt, counts, noise = average_rests(recording.wrenches(), recording.channels[ACCELERATION])
        payload = identify_payload_with_imu(
            wrenches,
            felt,
            magnitude=self.magnitude,
            noise=noise,
            of="samples" if noise is None else "rests",
            provenance=self.record(gravity="IMU"),
        )
        return payload, ALONE if noise is None else f"{len(counts)} rests of {int(counts.sum()):,} samples"


def _with_imu(layout: LogLayout, there: LogContents) -> LogLayout:
    """Return the layout with the only accelerations of an IMU that a log has, if any."""
    columns, topics = acceleration_columns(list(there.names)), imu_topics(there)
    return replace(layout, acceleration=columns, acceleration_topic=topics[0] if len(topics) == 1 else None)


def _direction(text: str) -> np.ndarray | None:
    if text == "free":
        return None
    try:
        direction = np.array([float(part) for part in text.split(",")])
    except ValueError:
        direction = np.zeros(0)
    if direction.shape != (3,) or not direction.any():
        raise InputError(
            f"--gravity must be a direction, not {text!r}.", hint="Write x,y,z, like 0,0,-1, or the word free."
        )
    return direction


@dataclass(frozen=True)
class CalibrateClock(Calibration):
    """Find the clock offset of the poses, and write it into the rig.

    The offset is how late or early the poses are stamped; it shows in how the payload's weight turns.

    Turn the loaded sensor to and fro by 30 degrees or more, with nothing touching it. Where the rig names a payload,
    its weight and bias are used, and the log may hold touches. Comments in the rig stay.

    Args:
        log: log with wrenches and poses, as topics or as columns.
        rig: TOML of the set-up.
        output: rig to write; it may be the same file.
        search: seconds to either side of the rig's offset that are searched; twice as far, and again, up to 4 s, while
            the best offset lies at the edge.
    """

    replaces = "rig"
    log: Log
    rig: RigFile
    output: Output
    search: Annotated[float, arg(metavar="X")] = 0.5

    def identify(self) -> CalibrationResult:
        """Return a `CalibrationResult` with the offset [s] of the poses' clock.

        Raises:
            InputError: rig or log cannot be read, the wrenches are written in the base frame, they and the poses do not
                overlap, or the best offset lies at the edge of the search.
            NotIdentifiable: the arm hardly turns, or the sensor has no payload.
        """
        setup = self.stated.resolve("force_torque")
        sensor = setup.of(ForceTorqueSection)
        if sensor.table.frame == "base":
            raise InputError(
                "the clock of the poses does not show in wrenches in the base frame, which those poses have rotated.",
                where=str(self.rig),
                hint='Record wrenches in the sensor\'s frame, with frame = "sensor" in [force_torque].',
            )
        path = setup.files().get("payload")
        there = path is not None and path.exists()  # a rig may name it before it is made, which the clock may precede
        layout, payload = setup.layout(), sensor.payload if there else None
        before, noise = setup.orientation.offset, sensor.table.noise
        recording = read_recording(self.log, layout)
        pose_time, quaternions, _ = read_poses(self.log, layout)
        found = identify_offset(
            recording.time,
            recording.wrenches(),
            pose_time,
            quaternions,
            payload=payload if payload is not None and payload.weight.any() and payload.imu is None else None,
            search=(before - self.search, before + self.search),
            max_gap=setup.orientation.max_gap,
            noise=None if noise is None else noise.six(),
        )
        known = measured([1e3 * found.offset], [1e3 * found.deviation], "ms")
        return CalibrationResult(
            [
                ("samples", f"{len(recording):,} wrenches, {len(pose_time):,} poses; used: {found.samples:,}"),
                ("offset", f"{known} added to the poses' stamps"),
                ("before", f"{1e3 * before:.3f} ms"),
                ("residual", f"{found.residual:.3g} N, of averages over 10 ms"),
                ("left out", str(found.validation)),
            ],
            found,
            notes=[*recording.notes, *found.notes, *_findings(found)],
        )

    def write(self, found: CalibrationResult) -> None:
        """Write the offset into the rig `output`.

        Raises:
            InputError: the rig cannot be edited in its form, or the output cannot be written.
            OSError: an input cannot be read for its digest.
        """
        comment = f"s, from {origin(self.record(), 'log')}"
        update_offset(self.rig, self.output, round(found.model.offset, 7), comment=comment, sensor=self.stated.name)


def _findings(found: ClockOffset) -> list[str]:
    said: list[str] = []
    if abs(found.offset) < SURE * found.deviation:
        said.append("poses and wrenches are on one clock, as far as this log can tell")
    if found.deviation > 2e-3:
        turning = "turn further, faster or longer to know it better"
        said.append(f"the offset is known to {np.ceil(1e3 * found.deviation):.0f} ms: {turning}")
    return said
