"""A control loop: each reading is answered into a row that is kept, and nothing is allocated."""

import numpy as np

import palpate
from palpate.contact import ROW
from palpate.sensors.force_torque import average_poses
from palpate.spatial import rotation_from_quaternion
from palpate_lab.simulation import simulate_session

# A probe on an arm, and the two logs of it: free motion, then touches.
session = simulate_session(touches=4, facets=4000)
noise = (0.02, 0.001)  # N, N m

free = session.free_motion
means, turns, _ = average_poses(free.wrenches(), rotation_from_quaternion(free.channels["orientation"]))
sensor = palpate.Compensation(palpate.ForceTorque(noise), palpate.identify_payload(means, turns))
mesh = palpate.Mesh.from_arrays(session.vertices, session.faces)
estimator = palpate.WrenchEstimator(mesh, sensor, mount=session.true)

# What would come from the robot, cycle by cycle: a time, a wrench, and how the sensor is turned in the base.
log = session.touches
times, wrenches = log.time.tolist(), log.wrenches()
rotations = rotation_from_quaternion(log.channels["orientation"])

row, touched, strongest = estimator.empty(), 0, 0.0
for k in range(len(times)):
    estimator.update_into(times[k], wrenches[k], row, rotations[k])
    if row[ROW.status] == palpate.Status.CONTACT:
        touched += 1
        strongest = max(strongest, float(np.linalg.norm(row[ROW.force])))

print(f"{touched} of {len(times)} cycles in contact, {strongest:.1f} N at most")
