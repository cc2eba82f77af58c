"""Compiled: the point of a mesh nearest to a line, and nearest to a point; the edges near a contact's line."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._bvh import STACK, WIDTH, axis_view, push_children, start_view, test_children
from palpate.surfaces._jit import inner, released
from palpate.surfaces._patches import KIND


@inner
def _origin_to_triangle(q, out):
    """Return the squared distance from the origin to a triangle in the plane; write barycentric coordinates to out."""
    det = (q[1, 0] - q[0, 0]) * (q[2, 1] - q[0, 1]) - (q[2, 0] - q[0, 0]) * (q[1, 1] - q[0, 1])
    if det != 0.0:
        b0 = (q[1, 0] * q[2, 1] - q[2, 0] * q[1, 1]) / det
        b1 = (q[2, 0] * q[0, 1] - q[0, 0] * q[2, 1]) / det
        if b0 >= 0.0 and b1 >= 0.0 and b0 + b1 <= 1.0:
            out[0], out[1], out[2] = b0, b1, 1.0 - b0 - b1
            return 0.0
    best = np.inf
    for i in range(3):
        j = (i + 1) % 3
        dx, dy = q[j, 0] - q[i, 0], q[j, 1] - q[i, 1]
        square = dx * dx + dy * dy
        t = 0.0 if square == 0.0 else min(1.0, max(0.0, -(q[i, 0] * dx + q[i, 1] * dy) / square))
        x, y = q[i, 0] + t * dx, q[i, 1] + t * dy
        if x * x + y * y < best:
            best = x * x + y * y
            out[i], out[j], out[(j + 1) % 3] = 1.0 - t, t, 0.0
    return best


@inner
def nearest_to_axis(wrench, nodes, corners, found):
    """Find the point nearest to the wrench axis, on a facet that faces the force.

    Write it as a row of `search` into found (CANDIDATE,); return the distance, or inf when no facet faces the force.
    Nearest to the axis is nearest in the metric of a wrench whose torque noise is the same in all directions.
    """
    (fx, fy, fz), (ux, uy, uz), (vx, vy, vz), (px, py, pz), _ = axis_view(wrench)
    view = np.empty(14, dtype=np.float32)
    start_view((fx, fy, fz), (px, py, pz), 0.0, np.inf, view)
    q, b = np.empty((3, 2)), np.empty(3)
    pending = np.empty((STACK, 2), dtype=np.int64)
    pending[0, 0], pending[0, 1] = 0, 0
    depth, best = 1, np.inf
    while depth > 0:
        depth -= 1
        first, size = pending[depth, 0], pending[depth, 1]
        if size == 0:
            view[12] = np.sqrt(best)
            mask = test_children(nodes[first], view)
            depth = push_children(mask, nodes[first], pending, depth)
            continue
        for patch in range(first, first + size):
            row = corners[patch]
            if corners[patch, KIND] > 1.0 or fx * _sum(row, 3) + fy * _sum(row, 4) + fz * _sum(row, 5) >= 0.0:
                continue
            for i in range(3):
                x, y, z = row[6 * i] - px, row[6 * i + 1] - py, row[6 * i + 2] - pz
                q[i, 0], q[i, 1] = ux * x + uy * y + uz * z, vx * x + vy * y + vz * z
            square = _origin_to_triangle(q, b)
            if square < best:
                best = square
                found[0], found[1], found[2], found[3] = patch, b[0], b[1], b[2]
    if best < np.inf:
        _place(corners, int(found[0]), found[1], found[2], found[3], found[8:14])
    return np.sqrt(best)


@inner
def _sum(row, k):
    return row[k] + row[6 + k] + row[12 + k]


@inner
def _place(corners, patch, b0, b1, b2, out):
    """Write position 0-2 and unit normal 3-5 at barycentric coordinates of a patch into out."""
    row = corners[patch]
    for k in range(6):
        out[k] = b0 * row[k] + b1 * row[6 + k] + b2 * row[12 + k]
    length = np.sqrt(out[3] * out[3] + out[4] * out[4] + out[5] * out[5])
    for k in range(3, 6):
        out[k] /= length


@inner
def point_to_triangle(row, point, out):
    """Return the squared distance from a point to a triangle in space; write barycentric coordinates to out."""
    ax, ay, az = row[0] - point[0], row[1] - point[1], row[2] - point[2]
    ux, uy, uz = row[6] - row[0], row[7] - row[1], row[8] - row[2]
    vx, vy, vz = row[12] - row[0], row[13] - row[1], row[14] - row[2]
    # In the triangle's plane this is the planar problem: an orthonormal pair (s, t) of that plane.
    lu = np.sqrt(ux * ux + uy * uy + uz * uz)
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    ln = np.sqrt(nx * nx + ny * ny + nz * nz)
    if ln == 0.0:
        return np.inf
    sx, sy, sz = ux / lu, uy / lu, uz / lu
    nx, ny, nz = nx / ln, ny / ln, nz / ln
    tx, ty, tz = ny * sz - nz * sy, nz * sx - nx * sz, nx * sy - ny * sx
    q = np.empty((3, 2))
    q[0, 0], q[0, 1] = ax * sx + ay * sy + az * sz, ax * tx + ay * ty + az * tz
    q[1, 0], q[1, 1] = q[0, 0] + lu, q[0, 1]
    q[2, 0] = q[0, 0] + vx * sx + vy * sy + vz * sz
    q[2, 1] = q[0, 1] + vx * tx + vy * ty + vz * tz
    height = ax * nx + ay * ny + az * nz
    return _origin_to_triangle(q, out) + height * height


@released("points n 3, nodes float32 k 14 8, corners p 20, found out n 4")
def nearest_to_point(points, nodes, corners, found):
    """Find the facets' nearest point to each point (n, 3), in unit size: patch, b0, b1, b2 into found (n, 4)."""
    bary = np.empty(3)
    pending = np.empty((STACK, 2), dtype=np.int64)
    gaps = np.empty(STACK)
    for n in range(len(points)):
        point = points[n]
        pending[0, 0], pending[0, 1], gaps[0] = 0, 0, 0.0
        depth, best = 1, np.inf
        while depth > 0:
            depth -= 1
            if gaps[depth] >= best:
                continue
            first, size = pending[depth, 0], pending[depth, 1]
            if size == 0:
                begin, closest = depth, depth
                for i in range(WIDTH):
                    gap = _gap(nodes[first], i, point)
                    if nodes[first, 11, i] >= 0.0 and gap < best:
                        pending[depth, 0], pending[depth, 1] = int(nodes[first, 10, i]), int(nodes[first, 11, i])
                        gaps[depth] = gap
                        if gap < gaps[closest]:
                            closest = depth
                        depth += 1
                if depth > begin:  # the closest child is looked into first
                    for k in range(2):
                        pending[closest, k], pending[depth - 1, k] = pending[depth - 1, k], pending[closest, k]
                    gaps[closest], gaps[depth - 1] = gaps[depth - 1], gaps[closest]
                continue
            for patch in range(first, first + size):
                if corners[patch, KIND] > 1.0:
                    continue
                square = point_to_triangle(corners[patch], point, bary)
                if square < best:
                    best = square
                    found[n, 0], found[n, 1], found[n, 2], found[n, 3] = patch, bary[0], bary[1], bary[2]


@inner
def _gap(node, child, point):
    """Return the squared distance from a point to a child's box."""
    total = 0.0
    for k in range(3):
        beyond = abs(point[k] - node[k, child]) - node[3 + k, child]
        if beyond > 0.0:
            total += beyond * beyond
    return total


@inner
def edges_near(wrench, tan_limit, wider, least, nodes, corners, found):
    """Find sharp edges and corners at which this wrench, or one that moves its line by `wider`, can be a contact.

    Args:
        wrench: (6,) in unit size, as for `search`.
        tan_limit: largest tan(theta) wanted.
        wider: in unit size.
        least: kind from which rows count: SHARP takes edges alone.
        nodes: of the tree.
        corners: of the tree.
        found: (k,) integers to write the rows into; rows beyond k are left out.

    Returns:
        the number of rows.
    """
    root = int(nodes[len(nodes) - 1, 10, 0])
    if root < 0:
        return 0
    f, _, _, point, pitch = axis_view(wrench)
    view = np.empty(14, dtype=np.float32)
    start_view(f, point, pitch, tan_limit, view)
    view[12] = wider
    pending = np.empty((STACK, 2), dtype=np.int64)
    pending[0, 0], pending[0, 1] = root, 0
    depth, count = 1, 0
    while depth > 0:
        depth -= 1
        first, size = pending[depth, 0], pending[depth, 1]
        if size > 0:
            for row in range(first, first + size):
                if corners[row, KIND] >= least and count < len(found):
                    found[count] = row
                    count += 1
            continue
        mask = test_children(nodes[first], view)
        depth = push_children(mask, nodes[first], pending, depth)
    return count
