"""What each status means in plain words, and what a run suggests to improve."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from palpate.cli.screen import percent
from palpate.contact.estimate import Status
from palpate.contact.plausibility import UNLOADED
from palpate.contact.wrench_estimator import WrenchEstimator
from palpate.evaluation.evaluate import Report
from palpate.io.rig import Rig

__all__ = ["MEANING", "advice"]

MEANING = {
    Status.CONTACT: "Located.",
    Status.AMBIGUOUS: "Located, but another place explains the wrench too and lies outside the 95 % ellipse.",
    Status.NO_CONTACT: "Nothing touches: the force is below the lower threshold.",
    Status.TOO_LIGHT: "Something touches, but too lightly to be located.",
    Status.OFF_SURFACE: "No point of the surface can make this wrench; the nearest is given.",
    Status.IMPLAUSIBLE: "Located, but with more friction or torsion than is allowed: do not believe the point.",
    Status.SATURATED: "A channel of the sensor is at its range, so that the wrench is not known.",
    Status.INVALID: "A reading is missing, or is no number.",
    Status.NO_POSE: "The orientation of the sensor, without which its payload cannot be taken off, is missing.",
}
_REMEDY = {  # of a status that is common: from which share on, of the loaded samples or of all, and what to do
    Status.AMBIGUOUS: (0.05, "if only a part of the body can be touched, say so as surface.region."),
    Status.OFF_SURFACE: (0.02, "look at pose, unit and mesh of the surface, at the payload, at touches elsewhere."),
    Status.IMPLAUSIBLE: (0.02, "look at payload and mounting; for a soft contact at estimate.friction, torsion."),
    Status.SATURATED: (0.0, "press less, or use a sensor of a larger range."),
    Status.INVALID: (0.0, "look at what wrote the log."),
    Status.NO_POSE: (0.0, "poses are missing or too far apart: see orientation.max_gap, offset, and the poses' topic."),
}
ENOUGH = 50  # samples before their coverage means something
BLURRED = 1e-3  # m: of a median ellipse that a filter is worth its lag for


def advice(
    rig: Rig, estimator: WrenchEstimator, counts: Int[np.ndarray, " s"], found: Report | None, radius: float
) -> tuple[str, ...]:
    """One sentence each, the models first; a sentence that there is nothing to say where there is not.

    Args:
        rig: with the options of the command line in it.
        estimator: that was run.
        counts: (len(Status),) of all samples.
        found: the comparison with the truth, where there is one.
        radius: [m] median of the 95 % ellipses; NaN where there is none.
    """
    said = [*_models(rig, estimator), *_statuses(counts), *_coverage(rig, found)]
    if estimator.filter is None and radius > BLURRED:
        said.append(
            f"Half of the 95 % ellipses are larger than {1e3 * radius:.2g} mm, and no filter is in force: "
            "palpate inspect LOG --rig RIG --spectrum FILE proposes one."
        )
    return tuple(said) or ("Nothing stands out: models are calibrated, and the samples are answered.",)


def _models(rig: Rig, estimator: WrenchEstimator) -> list[str]:
    said: list[str] = []
    if estimator.sensor.payload is None and rig.estimate.tare is None:
        said.append("Identify the payload (palpate calibrate payload): its weight and the sensor's zero are still in.")
    if rig.surface.pose_covariance is None:
        said.append(
            "Calibrate the mounting (palpate calibrate mounting): where the surface sits was taken as exact, and the "
            "ellipses do not hold how far off it may be."
        )
    if rig.force_torque.noise is None:
        said.append("State the noise of the sensor in the rig: it was taken from the steps of the log.")
    if rig.force_torque.range is None:
        said.append("State the range of the sensor in the rig: without it nobody notices a saturated channel.")
    return said


def _statuses(counts: Int[np.ndarray, " s"]) -> list[str]:
    total = int(counts.sum())
    loaded = total - int(counts[list(UNLOADED)].sum())
    said: list[str] = []
    for kind, (least, remedy) in _REMEDY.items():
        whole, name = (total, "samples") if kind in (Status.INVALID, Status.NO_POSE) else (loaded, "loaded samples")
        if counts[kind] and counts[kind] >= least * whole:
            said.append(f"{percent(counts[kind] / whole)} of the {name} are {kind.label}: {remedy}")
    return said


def _coverage(rig: Rig, found: Report | None) -> list[str]:
    if found is None or found.coverage.count < ENOUGH:
        return []
    inside = found.coverage.inside
    if inside > 0.995:
        return [f"The 95 % ellipses hold the truth in {percent(inside)}: the noise in the rig is too large."]
    if inside >= 0.85:
        return []
    likely = "the mounting is not in them" if rig.surface.pose_covariance is None else "noise or mesh are worse"
    return [f"The 95 % ellipses hold the truth in {percent(inside)} only: {likely}."]
