"""What hangs on the sensor, and the sensor's own zero, from wrenches in some poses in which nothing is touched."""

import numpy as np

import palpate
from palpate.sensors.force_torque import average_poses
from palpate.spatial import rotation_from_quaternion
from palpate_lab.simulation import simulate_session

# A log of free motion: an arm holds a probe in 14 poses. `read_recording("free_motion.csv")` reads yours.
session = simulate_session(touches=2, facets=500)
log = session.free_motion
rotations = rotation_from_quaternion(log.channels["orientation"])  # the sensor in the base

means, turns, counts = average_poses(log.wrenches(), rotations)  # still ones, so that samples are independent
payload = palpate.identify_payload(means, turns)
spread = np.sqrt(np.diag(payload.covariance))
print(payload)
print(f"{len(counts)} poses: {payload.mass:.4f} kg (true: {session.load.mass:.4f})")
print(f"bias {payload.force_bias} +- {spread[3:6].max():.4f} N (true: {session.load.force_bias})")

# From now on it is taken off: what is left of the free motion is noise.
sensor = palpate.Compensation(palpate.ForceTorque(noise=(0.02, 0.001)), payload)
left = sensor.measure(log).wrench[:, :3]
print(f"force where nothing touches: {np.abs(log.wrenches()[:, :3]).mean():.2f} N before, {left.std():.3f} N after")
