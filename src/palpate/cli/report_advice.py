"""Suggest improvements of a run, a sentence each."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from palpate.contact.estimate import Status
from palpate.contact.plausibility import UNLOADED
from palpate.evaluation.evaluate import EvaluationReport
from palpate.viewer.report import percent

__all__ = ["coverage_advice", "status_advice"]

_REMEDY = {  # of a status that is common: from which share on, of the loaded samples or of all, and what to do
    Status.AMBIGUOUS: (0.05, "if only a part of the body can be touched, state it as surface.region."),
    Status.OFF_SURFACE: (0.02, "check pose, unit and mesh of the surface, the payload, and touches elsewhere."),
    Status.IMPLAUSIBLE: (0.02, "check payload and mounting; for a soft contact, estimate.friction and torsion."),
    Status.SATURATED: (0.0, "press less, or use a sensor of a larger range."),
    Status.INVALID: (0.0, "check the program that wrote the log."),
    Status.NO_POSE: (0.0, "poses are missing or too sparse: check orientation.max_gap, offset, and the poses' topic."),
}
ENOUGH = 50  # samples before their coverage means something


def status_advice(counts: Int[np.ndarray, " s"]) -> tuple[str, ...]:
    """Return sentences of advice on frequent statuses; `counts` (len(Status),) are those of all samples."""
    total = int(counts.sum())
    loaded = total - int(counts[list(UNLOADED)].sum())
    said: list[str] = []
    for kind, (least, remedy) in _REMEDY.items():
        whole, name = (total, "samples") if kind in (Status.INVALID, Status.NO_POSE) else (loaded, "loaded samples")
        if counts[kind] and counts[kind] >= least * whole:
            said.append(f"{percent(counts[kind] / whole)} of the {name} are {kind.words}: {remedy}")
    return tuple(said)


def coverage_advice(found: EvaluationReport | None, *, mounted: bool) -> tuple[str, ...]:
    """Return (sentence,) if ellipses are too large or small, else (); `mounted`: they hold the uncertain mounting."""
    if found is None or found.coverage.count < ENOUGH:
        return ()
    inside = found.coverage.inside
    if inside > 0.995:
        return (f"The 95 % ellipses hold the truth in {percent(inside)}: the noise in the rig is too large.",)
    if inside >= 0.85:
        return ()
    likely = "noise or mesh are worse than stated" if mounted else "the error of the mounting is not in them"
    return (f"The 95 % ellipses hold the truth in {percent(inside)} only: {likely}.",)
