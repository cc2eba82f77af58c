"""Sensors, a folder each: its model, estimator, calibration, table in a rig, files, view and commands."""
