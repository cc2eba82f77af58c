"""Simulate a forearm with a taxel skin and a force/torque sensor, touched at several places, in a physics engine."""

from __future__ import annotations

from palpate_lab.simulation.touched.plan import PlannedTouch, plan_presses, plan_touches
from palpate_lab.simulation.touched.run import (
    ForearmRun,
    ForearmTruth,
    simulate_forearm,
    simulate_free,
    simulate_presses,
)
from palpate_lab.simulation.touched.settings import MILD_DRIFT, ForearmSettings

__all__ = [
    "MILD_DRIFT",
    "ForearmRun",
    "ForearmSettings",
    "ForearmTruth",
    "PlannedTouch",
    "plan_presses",
    "plan_touches",
    "simulate_forearm",
    "simulate_free",
    "simulate_presses",
]
