"""Run `palpate calibrate servo`: identify how a robot follows commands from a log of its motion in free space."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

from tyro.conf import arg

from palpate.calibration.servo import identify_servo
from palpate.console.calibration import Calibration, CalibrationResult
from palpate.console.options import Log, Output
from palpate.errors import InputError
from palpate.files.logs.joint_motion import JOINT_VALUES, read_joint_motion
from palpate.files.models.servo import of_servo

Joints = Annotated[str, arg(metavar="NAME")]


@dataclass(frozen=True)
class CalibrateServo(Calibration):
    """Find the delay and lag with which a robot follows commands.

    Move some joints to and fro in free space for 20 s or more, quickly and slowly in turn. Log each command when it is
    sent, and the measured positions, by one clock.

    Args:
        log: of commands and measured positions [rad, m], in any format that `estimate` reads.
        output: servo.toml to write, for AlignController.
        commands: columns, in which * is any text, an array or a list; or a topic of joint states or arrays, or a topic
            with a field, such as /arm:points[0].positions.
        positions: measured ones, likewise.
    """

    log: Log
    output: Output
    commands: Joints = "command_*"
    positions: Joints = "position_*"

    def identify(self) -> CalibrationResult:
        """Return a `CalibrationResult` with the `Servo`.

        Raises:
            InputError: the log cannot be read, or its positions do not follow its commands.
            NotIdentifiable: the motion does not determine delay and lag.
            OSError: the log cannot be read for its digest.
        """
        given, order = read_joint_motion(self.log, self.commands)
        seen, names = read_joint_motion(self.log, self.positions)
        commands, positions = given.channels[JOINT_VALUES], seen.channels[JOINT_VALUES]
        if order and names:
            if not set(order) <= set(names):
                missing = ", ".join(name for name in order if name not in names)
                raise InputError(f"{self.positions} has no joint {missing}.", where=str(self.log))
            positions = positions[:, [names.index(name) for name in order]]
        if commands.shape[1] != positions.shape[1]:
            what = f"has {commands.shape[1]} columns of commands and {positions.shape[1]} of positions."
            raise InputError(what, where=str(self.log), hint="Name those of the same joints: --commands, --positions.")
        record = self.record(commands=self.commands, positions=self.positions)
        found = identify_servo(given.time, commands, seen.time, positions)
        delay, lag = (f"{1e3 * each:.2g}" for each in found.deviation)
        deviations = f"{delay} ms of delay, {lag} ms of lag"
        servo = replace(found.servo, provenance=record | {"deviations": deviations, "left_out": str(found.validation)})
        return CalibrationResult(
            [
                ("samples", f"{found.commands:,} commands, {found.lost:,} of them never came; {len(seen):,} positions"),
                *of_servo(servo),
                ("deviations", f"{deviations}; stated are at least 1 ms, by which robots differ from start to start"),
                ("residual", f"{found.residual:.2g} rad or m"),
            ],
            servo,
            notes=[*given.notes, *found.notes],
            next=[f'AlignController(..., servo=read_model("{self.output.name}")) uses it.'],
        )
