"""A ring of markers watched by a camera: calibrated from presses, then one image becomes a contact."""

import numpy as np

import palpate
from palpate.sensors.marker_ring import RingBody, RingTruth, calibrate_marker_ring
from palpate_lab.simulation.ring_session import Protocol, RingUnit, calibration_run

# A barrel of silicone by finite elements, seen by a fisheye camera: a second of rest, then presses all round.
unit = RingUnit.drawn(3, coarse=True)
session = calibration_run(unit, Protocol(12, (0.003, 0.006, 0.009), hold=1, pause=1))
images = palpate.Recording(session.time, {"image": np.stack(list(session.frames()))})

truth = RingTruth(*(column[:, 0] for column in (session.angle, session.depth, session.force, session.shear)))
body = RingBody(radius=0.055, thickness=0.004, markers=24)
ring = calibrate_marker_ring([images], truth, body)

# In use: the first second says where markers rest, then frame by frame. (A real judgement takes another recording.)
estimator = palpate.RingEstimator(ring)
estimator.tare(images.picked(session.time < 0.8))
contacts = estimator.run(images)

deepest = int(np.nanargmax(session.depth[:, 0]))
row = int(np.flatnonzero(contacts.sample == deepest)[0])
angle = np.degrees(contacts.features["angle"][row] - session.angle[deepest, 0])
status = palpate.Status(contacts.status[row]).label
print(f"image {deepest}: {contacts.features['markers'][row]:.0f} markers, status {status}")
print(f"depth {1e3 * contacts.features['depth'][row]:.2f} mm (true: {1e3 * session.depth[deepest, 0]:.2f})")
print(f"angle off by {(angle + 180.0) % 360.0 - 180.0:.2f} degrees")
