"""A skin and a force/torque sensor on one link."""

from palpate.sensors.fused.estimator import FusedEstimator
from palpate.sensors.fused.locator import FusedLocator

__all__ = ["FusedEstimator", "FusedLocator"]
