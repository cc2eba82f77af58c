"""Simulate a robot's probe on a soft phantom that moves: arm, probes, tissue, motions and physics."""

from __future__ import annotations

from palpate_lab.simulation.phantom.lab import LabSettings, PhantomLab, PhantomTruth, Reading
from palpate_lab.simulation.phantom.motion import MOTIONS, SurfaceMotion, motion, unplanned
from palpate_lab.simulation.phantom.probes import PROBES, Probe, probe

__all__ = [
    "MOTIONS",
    "PROBES",
    "LabSettings",
    "PhantomLab",
    "PhantomTruth",
    "Probe",
    "Reading",
    "SurfaceMotion",
    "motion",
    "probe",
    "unplanned",
]
