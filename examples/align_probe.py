"""A probe that keeps 7 N and stays perpendicular to skin that moves, by force sensing alone.

The robot is simulated; a real one would stand where `lab` does. Run: `python examples/align_probe.py [SECONDS]`.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

import palpate
from palpate.control import Limits, Servo
from palpate.files.arm import load_arm
from palpate_lab.simulation.phantom.elfin3 import urdf
from palpate_lab.simulation.phantom.lab import LabSettings, PhantomLab
from palpate_lab.simulation.phantom.motion import motion

SECONDS = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
NOISE = (0.04, 0.04, 0.04, 1.5e-3, 1.5e-3, 1.5e-3)  # N, N m: what the sensor's maker states

# The robot with its sensor and probe, and a phantom that turns by 10 degrees and back in 5 s.
lab = PhantomLab(LabSettings(motion=motion("in-plane", period=5.0, begin=4.0)))

# What one has of a robot: its URDF, the probe's mesh, and wrenches of it held free in some poses.
with tempfile.TemporaryDirectory() as folder:
    robot = Path(folder) / "robot.urdf"
    robot.write_text(urdf(lab.probe), encoding="utf-8")
    arm = load_arm(robot, base="base", sensor="ft_sensor")
mesh = palpate.Mesh.from_arrays(lab.probe.vertices, lab.probe.faces)
payload = palpate.identify_payload(*lab.free_wrenches())

sensor = palpate.Compensation(palpate.ForceTorque(NOISE), payload)
estimator = palpate.WrenchEstimator(palpate.Locator(mesh), sensor)
controller = palpate.AlignController(arm, estimator, force=7.0, servo=Servo(lag=0.03), limits=Limits(force=20.0))

reading, state, rows = lab.reading, None, []
while reading.time < SECONDS:
    lab.command(controller.update(reading.time, reading.wrench, reading.joints))
    if controller.state != state:
        state = controller.state
        print(f"{reading.time:6.2f} s  {state}: {controller.why}")
    truth = lab.truth()
    if reading.time > 5.0:
        rows.append((abs(truth.in_plane), truth.press))
    reading = lab.step()

angle, force = np.array(rows).T
print(f"angle off by {np.degrees(angle.mean()):.2f} deg on average, force {force.min():.2f} to {force.max():.2f} N")
