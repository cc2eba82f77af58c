"""A robot's probe on a soft phantom that moves: the arm, the probes, the tissue, the motions and the physics."""

from __future__ import annotations

from palpate_lab.simulation.phantom.lab import LabSettings, PhantomLab, Reading, Truth
from palpate_lab.simulation.phantom.motion import MOTIONS, Motion, motion, unplanned
from palpate_lab.simulation.phantom.probes import PROBES, Probe, probe

__all__ = [
    "MOTIONS",
    "PROBES",
    "LabSettings",
    "Motion",
    "PhantomLab",
    "Probe",
    "Reading",
    "Truth",
    "motion",
    "probe",
    "unplanned",
]
