"""Calibration of a soft ring with markers: presses of known angle, depth and force become a model."""
