"""Compiled: compute the force of a soft flat phantom on a rigid probe that is pressed into it, cell by cell."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import entry


@entry("cells n 7, law 5, probe 6 3, phantom 6 3, bristles out n 3, out out 11")
def press(cells, law, probe, phantom, bristles, out):
    """Compute force, moment and pressure of an elastic foundation with friction.

    Args:
        cells: (n, 7) points, outward normals and areas, in the sensor's frame.
        law: (5,) stiffness [N/m^3], loss [s], friction, tangential stiffness [N/m^3], tangential loss [s].
        probe: (6, 3) rotation to the base, origin, its velocity, angular velocity, in base axes.
        phantom: (6, 3) the same of the phantom.
        bristles: (n, 3) place to which friction pulls each cell, in the surface's x and y, and 1 while it touches;
            changed in place.
        out: (11,) force and moment about the sensor's origin in base axes, normal force, centre of pressure in the
            sensor's frame, greatest depth.
    """
    # pose and velocity of the probe as seen from the phantom, which moves: turn c + at, v + w x (turn c)
    turn, at, v, w = np.zeros((3, 3)), np.zeros(3), np.zeros(3), np.zeros(3)
    apart, along = probe[3] - phantom[3], probe[4] - phantom[4]
    a = phantom[5]
    along[0] -= a[1] * apart[2] - a[2] * apart[1]
    along[1] -= a[2] * apart[0] - a[0] * apart[2]
    along[2] -= a[0] * apart[1] - a[1] * apart[0]
    for i in range(3):
        for j in range(3):
            for k in range(3):
                turn[i, j] += phantom[k, i] * probe[k, j]
            at[i] += phantom[j, i] * apart[j]
            v[i] += phantom[j, i] * along[j]
            w[i] += phantom[j, i] * (probe[5, j] - phantom[5, j])
    out[:] = 0.0
    fx = fy = fz = mx = my = mz = cx = cy = cz = deepest = 0.0
    for n in range(cells.shape[0]):
        x, y, z = cells[n, 0], cells[n, 1], cells[n, 2]
        rz = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z
        depth = -(rz + at[2])
        facing = -(turn[2, 0] * cells[n, 3] + turn[2, 1] * cells[n, 4] + turn[2, 2] * cells[n, 5])
        if depth <= 0.0 or facing <= 0.0:
            bristles[n, 2] = 0.0
            continue
        deepest = max(deepest, depth)
        rx = turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z
        ry = turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z
        vx = v[0] + w[1] * rz - w[2] * ry
        vy = v[1] + w[2] * rx - w[0] * rz
        vz = v[2] + w[0] * ry - w[1] * rx
        pressure = max(law[0] * (depth - law[1] * vz), 0.0)
        px, py = rx + at[0], ry + at[1]
        if bristles[n, 2] == 0.0:
            bristles[n, 0], bristles[n, 1], bristles[n, 2] = px, py, 1.0
        most = law[2] * pressure
        sx, sy = law[3] * (bristles[n, 0] - px), law[3] * (bristles[n, 1] - py)
        size = (sx * sx + sy * sy) ** 0.5
        if size > most:  # it slips: held where the spring pulls just as hard as friction can
            sx, sy = sx * most / size, sy * most / size
            bristles[n, 0], bristles[n, 1] = px + sx / law[3], py + sy / law[3]
        sx -= law[3] * law[4] * vx
        sy -= law[3] * law[4] * vy
        size = (sx * sx + sy * sy) ** 0.5
        if size > most:
            sx, sy = sx * most / size, sy * most / size
        area = facing * cells[n, 6]
        sx, sy, sz = sx * area, sy * area, pressure * area
        fx, fy, fz = fx + sx, fy + sy, fz + sz
        mx += ry * sz - rz * sy
        my += rz * sx - rx * sz
        mz += rx * sy - ry * sx
        cx, cy, cz = cx + sz * x, cy + sz * y, cz + sz * z
    for i in range(3):
        out[i] = phantom[i, 0] * fx + phantom[i, 1] * fy + phantom[i, 2] * fz
        out[3 + i] = phantom[i, 0] * mx + phantom[i, 1] * my + phantom[i, 2] * mz
    out[6], out[10] = fz, deepest
    if fz > 0.0:
        out[7], out[8], out[9] = cx / fz, cy / fz, cz / fz
