"""Compiled: the angle from a fisheye lens's axis at which a pixel looks, and the point where its ray meets a plane."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import released


@released("bent n, lens 4, reach float, steps int, theta out n, low out n, high out n")
def angles(bent, lens, reach, steps, theta, low, high):
    """Compute theta from theta_d by Newton's steps, halving where one leaves the bracket, until all have settled.

    Args:
        bent: (n,) theta_d, of the pixels.
        lens: (4,) k1 to k4.
        reach: the largest theta [rad].
        steps: largest number of steps.
        theta: (n,) is filled [rad]; NaN where theta_d is NaN.
        low: (n,) scratch, the bracket.
        high: (n,) scratch.
    """
    k1, k2, k3, k4 = lens[0], lens[1], lens[2], lens[3]
    for i in range(len(bent)):
        low[i], high[i] = 0.0, reach
        theta[i] = min(bent[i], reach) if bent[i] == bent[i] else bent[i]
    step = theta.copy()
    for _ in range(steps):
        settled = True
        for i in range(len(bent)):
            at = theta[i]
            t = at * at
            value = at * (1.0 + t * (k1 + t * (k2 + t * (k3 + t * k4))))
            slope = 1.0 + t * (3 * k1 + t * (5 * k2 + t * (7 * k3 + t * 9 * k4)))
            if value <= bent[i]:
                low[i] = at
            if value >= bent[i]:
                high[i] = at
            new = at - (value - bent[i]) / slope
            if not (new >= low[i] and new <= high[i]):
                new = (low[i] + high[i]) / 2
            step[i] = new
            if not abs(new - at) <= 1e-15 * (1.0 + at):
                settled = False
        if settled:
            break
        for i in range(len(bent)):
            theta[i] = step[i]


@released("pixels n 2, lens 10, pose 12, heights m, steps int, out out n 2")
def to_plane(pixels, lens, pose, heights, steps, out):
    """Compute `RingView.to_plane` without arrays between its steps.

    Args:
        pixels: (n, 2).
        lens: (10,) fx, fy, cx, cy, k1 to k4, the largest theta and theta_d.
        pose: (12,) rotation, row after row, and translation of the camera in the plane's frame.
        heights: (m,) of the planes [m], for one pixel after the other, over and over.
        steps: largest number of steps, of `angles`.
        out: (n, 2) is filled [m]; NaN where the pixel's ray does not meet the plane.
    """
    x, y, bent, theta, low, high = np.empty((6, len(pixels)))
    for i in range(len(pixels)):
        x[i], y[i] = (pixels[i, 0] - lens[2]) / lens[0], (pixels[i, 1] - lens[3]) / lens[1]
        bent[i] = np.sqrt(x[i] * x[i] + y[i] * y[i])
    angles(bent, lens[4:8], lens[8], steps, theta, low, high)
    for i in range(len(pixels)):
        out[i, 0] = out[i, 1] = np.nan
        if not bent[i] <= lens[9]:
            continue
        ratio = 1.0 if bent[i] < 1e-9 else np.sin(theta[i]) / bent[i]  # there it is 1 to the last bit
        a, b, c = ratio * x[i], ratio * y[i], np.cos(theta[i])
        high = heights[i % len(heights)] - pose[11]
        length = high / ((pose[6] * a + pose[8] * c) + pose[7] * b)  # added up as NumPy's einsum does
        if length > 0.0:
            out[i, 0] = pose[9] + length * ((pose[0] * a + pose[2] * c) + pose[1] * b)
            out[i, 1] = pose[10] + length * ((pose[3] * a + pose[5] * c) + pose[4] * b)


@released("pixels n 2, lens 10, pose 12, heights m, steps int, resting m 2, axes m 2 2, out out n 2")
def displaced(pixels, lens, pose, heights, steps, resting, axes, out):
    """Compute `MarkerRing.displacements`: `to_plane` less the places at rest (m, 2), along the axes (m, 2, 2)."""
    to_plane(pixels, lens, pose, heights, steps, out)
    for i in range(len(pixels)):
        m = i % len(resting)
        x, y = out[i, 0] - resting[m, 0], out[i, 1] - resting[m, 1]
        out[i, 0], out[i, 1] = x * axes[m, 0, 0] + y * axes[m, 1, 0], x * axes[m, 0, 1] + y * axes[m, 1, 1]
