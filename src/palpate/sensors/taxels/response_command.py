"""Define `palpate calibrate response`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from palpate.console.calibration import Calibration, CalibrationResult
from palpate.console.options import FileOption, Log, Output, RigFile
from palpate.contact.ground_truth import TrueSamples
from palpate.errors import InputError
from palpate.files.contacts import read_contacts
from palpate.files.ground_truth import read_ground_truth
from palpate.files.logs import read_recording
from palpate.files.tables.table import read_table
from palpate.sensors.taxels.calibrate_response import identify_response
from palpate.sensors.taxels.files import of_response
from palpate.sensors.taxels.section import SKIN, SkinSection


@dataclass(frozen=True)
class CalibrateResponse(Calibration):
    """Fit what taxels with three axes read under known forces.

    Press at 100 places or more, up to the outer taxels, with tips of different size, from light to hard, and move the
    tip sideways in all directions; nothing touches between two presses.

    Args:
        log: of the skin.
        output: response.toml to write.
        rig: TOML with the [skin], its places and axes.
        truth: CSV with time, px, py, pz, fx, fy, fz: point and force on the skin, in the surface's frame, while any
            force acts; or the contacts that a force/torque sensor below the skin gives (palpate estimate).
    """

    log: Log
    output: Output
    rig: RigFile
    truth: FileOption = None

    def identify(self) -> CalibrationResult:
        """Return the `CalibrationResult` of the presses of the log, with their `TaxelResponse`.

        Raises:
            InputError: a file cannot be read, or states no forces, or the skin has one axis.
            NotIdentifiable: the presses do not determine the response.
            OSError: an input cannot be read for its digest.
        """
        if self.truth is None:
            hint = "Give --truth CSV with time, px, py, pz, fx, fy, fz, or the contacts of a force/torque sensor below."
            raise InputError("the forces of the presses are not known.", where="--truth", hint=hint)
        setup = self.stated.resolve("skin")
        body = setup.of(SkinSection).body
        if body.response is None:
            hint = 'Write axes = ["x", "y", "z"] in [skin]; for one axis there is palpate calibrate intensity.'
            raise InputError("the rig's taxels have one axis.", where="skin.axes", hint=hint)
        recording = read_recording(self.log, SKIN.layout(setup))
        found = identify_response(replace(body, response=None), recording, _known(self.truth), provenance=self.record())
        return CalibrationResult(
            of_response(found),
            found,
            notes=[*recording.notes, *found.notes],
            next=[f'name it in the rig: response = "{self.output.name}" under [skin]'],
        )


def _known(path: Path) -> TrueSamples:
    """Read points and forces: of a truth, or of the contacts in a file that `palpate estimate` wrote."""
    if "status" in read_table(path).names:
        contacts = read_contacts(path)
        there = contacts.located
        return TrueSamples(contacts.time[there], contacts.point[there], None, contacts.force[there])
    truth = read_ground_truth(path)
    if not isinstance(truth, TrueSamples):
        hint = "Write a row for each instant: time, px, py, pz, fx, fy, fz."
        raise InputError("states touches without forces.", where=str(path), hint=hint)
    return truth
