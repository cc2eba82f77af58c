"""A log of a force/torque sensor becomes touches: when, where, how hard; log and mesh are made here."""

import tempfile
from pathlib import Path

import numpy as np
import polars as pl
import trimesh

import palpate
from palpate_lab.simulation import EllipsoidBody, contact_wrenches

rng, body = np.random.default_rng(1), EllipsoidBody((0.030, 0.020, 0.015))
points = body.sample(3, rng)
forces = np.array([[3.0], [6.0], [9.0]]) * -body.normals(points)

# 8 s at 100 Hz: each point is held for a second, with a second of nothing before and behind.
time = np.arange(800) / 100.0
held = np.stack([(time > 1.0 + 2.0 * k) & (time < 2.0 + 2.0 * k) for k in range(3)], axis=1)
wrenches = held @ contact_wrenches(points, body.normals(points), forces, np.zeros(3))
wrenches += rng.normal(0.0, np.repeat([0.02, 0.001], 3), wrenches.shape)

columns = ("time", "fx", "fy", "fz", "tx", "ty", "tz")
log = pl.DataFrame(dict(zip(columns, np.column_stack([time, wrenches]).T, strict=True)))  # or the path of a file

with tempfile.TemporaryDirectory() as folder:
    tool = Path(folder) / "tool.stl"
    vertices, faces = body.mesh(8000)
    trimesh.Trimesh(1e3 * vertices, faces).export(tool)
    contacts = palpate.estimate(log, mesh=tool, unit="mm")

touches = contacts.touches()
for k in range(len(touches)):
    where = ", ".join(f"{1e3 * x:.1f}" for x in touches.point[k])
    print(f"{touches.start[k]:.2f} to {touches.end[k]:.2f} s at ({where}) mm, up to {touches.peak_force[k]:.1f} N")
off = np.linalg.norm(touches.point - points, axis=1)
print(f"{len(touches)} touches, off by {1e3 * off.max():.2f} mm at most")
