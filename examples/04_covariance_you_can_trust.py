"""The 95 % ellipse is to hold the truth in 95 %: ten thousand simulated touches, each with noise of its own."""

import numpy as np

import palpate
from palpate_lab.simulation import EllipsoidBody, touch_wrenches

rng, body = np.random.default_rng(4), EllipsoidBody((0.030, 0.020, 0.015))
noise = np.repeat([0.02, 0.001], 3)  # N, N m

points = body.sample(10_000, rng)
wrenches = touch_wrenches(points, body.normals(points), rng, force=(2.0, 10.0), tan_theta=0.3)
wrenches += rng.normal(0.0, noise, wrenches.shape)

mesh = palpate.Mesh.from_arrays(*body.mesh(20_000))
found = palpate.Locator(mesh, noise=noise).run(wrenches)

# In the tangent plane the error is two numbers; their squared distance in standard deviations is chi-square of two
# degrees of freedom, whose 95 % is 5.991.
use = found.status == palpate.Status.CONTACT
error = found.point[use] - points[use]
square = np.einsum("ni,nij,nj->n", error, np.linalg.pinv(found.covariance[use], rcond=1e-6, hermitian=True), error)

print(f"{use.mean():.1%} are contacts, off by {1e3 * np.median(np.linalg.norm(error, axis=1)):.2f} mm (median)")
print(f"95 % ellipses hold the truth in {np.mean(square < 5.991):.1%}")
