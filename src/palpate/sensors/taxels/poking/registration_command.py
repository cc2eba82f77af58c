"""Define `palpate calibrate registration`, which finds the pose of a mesh among places of taxels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.console.calibration import Calibration, CalibrationResult, origin
from palpate.console.console import wait
from palpate.console.options import Log, Output, RigFile
from palpate.errors import InputError
from palpate.files.units import measured
from palpate.sensors.taxels.place_formats import read_taxel_places
from palpate.sensors.taxels.poking.registration import ALIKE, ELSEWHERE, Registration, register_places
from palpate.setup.edit import update_pose
from palpate.setup.tables import RigPose

POOR = 0.05  # rms over the extent of the places: the surface of another link


@dataclass(frozen=True)
class CalibrateRegistration(Calibration):
    """Find the surface's pose among places of taxels.

    The places lie as near to the [surface] as a rigid motion brings them. Of several poses that fit as well, the one
    nearest to the rig's pose is written. Comments in the rig stay.

    Args:
        log: file of taxel places: .toml, .txt (iCub), .csv or .urdf.
        rig: TOML with [surface], and in it a rough pose if the link looks the same from several sides.
        output: rig to write; it may be the same file.
    """

    replaces = "rig"
    log: Log
    rig: RigFile
    output: Output

    def identify(self) -> CalibrationResult:
        """Return a `CalibrationResult` with the pose of the surface in the frame of the places.

        Raises:
            InputError: a file cannot be read, the rig has no [surface], or unit or handedness are wrong.
            NotIdentifiable: fewer than seven places, or all on one line.
        """
        places, setup = read_taxel_places(self.log), self.stated.resolve()
        if setup.link.stated is None:
            hint = 'Add it, with mesh = "FILE" and its unit.'
            raise InputError("the rig has no [surface].", where=str(self.rig), hint=hint)
        surface = setup.link.surface()
        wait("preparing the surface")
        rough = None if setup.link.stated.pose == RigPose() else setup.link.mount
        found = register_places(places, surface, initial=rough)
        extent = float(np.linalg.norm(np.ptp(places.positions[places.there], axis=0)))
        notes = [*places.notes, *surface.notes]
        if found.mirrored < ALIKE * found.rms:
            notes.append("their mirror image fits as well: distances do not show whether the places are mirrored")
        return CalibrationResult(
            _figures(found), found, notes=notes, warnings=_doubts(found, extent, chosen=rough is not None)
        )

    def write(self, found: CalibrationResult) -> None:
        """Write the pose and its covariance into the rig.

        Raises:
            InputError: the rig cannot be edited in its form, or the output cannot be written.
        """
        record = self.record()
        comment = f"T_places_surface, from {origin(record, 'log')}, palpate {record['palpate']}"
        update_pose(
            self.rig, self.output, found.model.pose, found.model.covariance, comment=comment, sensor=self.stated.name
        )


def _figures(found: Registration) -> list[tuple[str, object]]:
    pose, worst = found.pose, int(np.nanargmax(found.distances))
    moved = np.sqrt(np.diag(pose.inverse().wrench_matrix() @ found.covariance @ pose.inverse().wrench_matrix().T))
    turned = np.degrees(np.sqrt(np.diag(found.covariance)[:3]))
    return [
        ("places", f"{np.count_nonzero(np.isfinite(found.distances))}"),
        (
            "from the surface",
            f"{1e3 * found.rms:.2f} mm rms, {1e3 * found.distances[worst]:.2f} mm worst (taxel {worst})",
        ),
        ("position", measured(1e3 * pose.translation, 1e3 * moved[3:], "mm")),
        ("rotation vector", measured(np.degrees(pose.rotation_vector()), turned, "deg")),
        ("deviation", f"{1e3 * found.spread:.2g} mm of the surface at the places, without errors of its mesh"),
        ("left out", str(found.validation)),
    ]


def _doubts(found: Registration, extent: float, *, chosen: bool) -> list[str]:
    said = list[str]()
    if found.rms > POOR * extent:
        said.append("the places lie far from the surface wherever it is: check that it is the mesh of their link")
    if found.uncertain:
        motions = "; ".join(found.uncertain)
        said.append(
            f"the places do not show to {1e3 * ELSEWHERE:g} mm: {motions}. Such motions stay as they were found"
        )
    if found.others:
        rms, far = (1e3 * max(each) for each in zip(*found.others, strict=True))
        pick = (
            "the one nearest to the rig's [surface] pose is written"
            if chosen
            else "the best is written; state a rough pose in the rig's [surface] to choose"
        )
        said.append(
            f"at least {len(found.others)} other poses fit as well (to {rms:.2f} mm), with places up to {far:.0f} mm "
            f"elsewhere: {pick}"
        )
    return said
