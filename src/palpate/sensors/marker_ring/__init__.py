"""A soft ring of markers that a fisheye camera watches."""

from palpate.sensors.marker_ring.calibrate import RingTruth, calibrate_marker_ring
from palpate.sensors.marker_ring.estimator import RingEstimator
from palpate.sensors.marker_ring.model import MarkerRing, RingBody

__all__ = ["MarkerRing", "RingBody", "RingEstimator", "RingTruth", "calibrate_marker_ring"]
