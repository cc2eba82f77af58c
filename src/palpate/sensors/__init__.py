"""One folder a sensor: its model, estimator, calibration, table in a rig, files, view and commands."""
