"""A body with an equation needs no mesh: every place that could have made a wrench, and the answer."""

import numpy as np

import palpate
from palpate.surfaces import Ellipsoid

tip = Ellipsoid((0.012, 0.010, 0.020))  # half axes [m]
locator = palpate.Locator(tip, noise=(0.02, 0.001))

# A touch at a known place, along the normal.
point = np.array([0.012 * np.cos(0.5), 0.010 * np.sin(0.5), 0.0])
normal = point / np.array([0.012, 0.010, 0.020]) ** 2
force = -3.0 * normal / np.linalg.norm(normal)
wrench = np.concatenate([force, np.cross(point, force)])

every = locator.candidates(wrench)
for place, plausible in zip(every.point, every.plausible, strict=True):
    print(f"{1e3 * place} mm: {'plausible' if plausible else 'friction or torsion beyond their bounds'}")

found = locator.run(wrench[None])
print(f"answer {1e3 * found.point[0]} mm, off by {1e6 * np.linalg.norm(found.point[0] - point):.3f} um")
