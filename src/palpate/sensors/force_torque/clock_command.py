"""`palpate calibrate clock`: find the offset between the clocks of poses and wrenches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from tyro.conf import arg

from palpate.calibration.clock import ClockOffset, identify_offset
from palpate.console.calibration import Calibration, CalibrationResult, origin
from palpate.console.options import Log, Output, RigFile
from palpate.errors import InputError
from palpate.files.logs import contents, read_poses, read_recording
from palpate.files.units import measured
from palpate.sensors.force_torque.section import ForceTorqueSection
from palpate.setup.edit import update_offset

__all__ = ["CalibrateClock"]

SURE = 3.0  # standard deviations from which on two clocks differ


@dataclass(frozen=True)
class CalibrateClock(Calibration):
    """Find the clock offset of the poses, and write it into the rig.

    The offset is how late or early the poses are stamped; it shows in how the payload's weight turns.

    Turn the loaded sensor to and fro by 30 degrees or more, with nothing touching it. Where the rig names a payload,
    its weight and bias are used, and the log may hold touches. Comments in the rig stay.

    Args:
        log: MCAP or bag with topics of wrenches and poses; a log of columns is judged too.
        rig: TOML of the set-up.
        output: rig to write; it may be the same file.
        search: seconds to either side of the rig's offset that are searched.
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
                "wrenches in the base frame were rotated with the poses whose clock is to be checked.",
                where=str(self.rig),
                hint="Record them in the sensor's frame.",
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
            payload=payload if payload is not None and payload.weight.any() else None,
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
            notes=[*recording.notes, *found.notes, *_findings(found, columns=not contents(self.log).topics)],
        )

    def write(self, found: CalibrationResult) -> None:
        """Write the offset into the rig `output`.

        Raises:
            InputError: the rig cannot be edited in its form, or the output cannot be written.
        """
        comment = f"s, from {origin(self.record(), 'log')}"
        update_offset(self.rig, self.output, round(found.model.offset, 7), comment=comment)


def _findings(found: ClockOffset, *, columns: bool) -> list[str]:
    said: list[str] = []
    if abs(found.offset) < SURE * found.deviation:
        said.append("poses and wrenches are on one clock, as far as this log can tell")
    elif columns:
        size, way = 1e3 * abs(found.offset), "late" if found.offset < 0 else "early"
        said.append(
            f"the orientations of this log are {size:.1f} ms {way}, "
            "and a rig's offset is not applied to orientations in columns: shift them before writing the log"
        )
    if found.deviation > 2e-3:
        turning = "turn further, faster or longer to know it better"
        said.append(f"the offset is known to {np.ceil(1e3 * found.deviation):.0f} ms: {turning}")
    return said
