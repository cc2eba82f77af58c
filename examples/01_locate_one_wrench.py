"""One wrench on a mesh: where is the body touched, and how sure is that?"""

import numpy as np

import palpate
from palpate_lab.simulation import EllipsoidBody

# A body of 60 x 40 x 30 mm; of your own it is palpate.Mesh.load("tool.stl", unit="mm").
body = EllipsoidBody((0.030, 0.020, 0.015))
mesh = palpate.Mesh.from_arrays(*body.mesh(8000))

# A finger presses at a known place with 5 N, a little aslant: what the sensor, at the body's origin, would read.
point = body.on_ray(np.array([0.6, 0.3, 0.8]))
normal = body.normals(point)
force = -5.0 * normal + np.array([0.3, -0.5, 0.2])
wrench = palpate.Wrench(force=force, torque=np.cross(point, force))

contact = palpate.locate(wrench, mesh, noise=(0.02, 0.001))  # standard deviations of force [N] and torque [N m]

print(f"status  {contact.status}")
print(f"point   {1e3 * contact.point} mm, +- {1e3 * np.sqrt(contact.covariance.trace()):.2f} mm")
print(f"force   {contact.force} N")
print(f"off by {1e3 * np.linalg.norm(contact.point - point):.3f} mm")
