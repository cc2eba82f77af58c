"""Compiled: compute the cost of each cell of a map of touched places, and find the cheapest way through it."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import inner, released

DIAGONAL = np.sqrt(2.0)


@released("marks k 3, origin 2, cell float, hard float, soft float, near float, cost out n m")
def fill(marks, origin, cell, hard, soft, near, cost):
    """Write the cost of a unit of length in every cell: 1 + the greatest contribution of a mark.

    A mark (x, y, weight) contributes its weight within `hard` [m], and `near` times its weight, falling to 0 at `soft`.
    """
    rows, columns = cost.shape
    cost[:] = 1.0
    reach = int(np.ceil(soft / cell)) + 1
    for m in range(len(marks)):
        x, y, weight = marks[m]
        column, row = int((x - origin[0]) / cell), int((y - origin[1]) / cell)
        for r in range(max(row - reach, 0), min(row + reach + 1, rows)):
            for c in range(max(column - reach, 0), min(column + reach + 1, columns)):
                off = np.hypot(origin[0] + (c + 0.5) * cell - x, origin[1] + (r + 0.5) * cell - y)
                if off < hard:
                    said = weight
                elif off < soft:
                    said = near * weight * (soft - off) / (soft - hard)
                else:
                    continue
                if 1.0 + said > cost[r, c]:
                    cost[r, c] = 1.0 + said


@inner
def _sift_up(keys, items, at):
    key, item = keys[at], items[at]
    while at > 0:
        above = (at - 1) // 2
        if keys[above] <= key:
            break
        keys[at], items[at] = keys[above], items[above]
        at = above
    keys[at], items[at] = key, item


@inner
def _sift_down(keys, items, size):
    key, item, at = keys[0], items[0], 0
    while True:
        below = 2 * at + 1
        if below >= size:
            break
        if below + 1 < size and keys[below + 1] < keys[below]:
            below += 1
        if keys[below] >= key:
            break
        keys[at], items[at] = keys[below], items[below]
        at = below
    keys[at], items[at] = key, item


@inner
def _octile(a, b, columns):
    """Return the length [cells] of the shortest way between two cells without obstacles."""
    rows_off, columns_off = abs(a // columns - b // columns), abs(a % columns - b % columns)
    return max(rows_off, columns_off) + (DIAGONAL - 1.0) * min(rows_off, columns_off)


@inner
def _search(cost, start, goal, before, total):
    """Search by A* over cells and their eight neighbours; a step costs its length times the mean cost of both cells."""
    rows, columns = cost.shape
    flat = cost.ravel()
    keys, items = np.empty(8 * rows * columns + 1), np.empty(8 * rows * columns + 1, np.int64)
    done = np.zeros(rows * columns, np.bool_)
    total[:] = np.inf
    before[:] = -1
    total[start] = 0.0
    keys[0], items[0], size = _octile(start, goal, columns), start, 1
    while size > 0:
        here = items[0]
        size -= 1
        keys[0], items[0] = keys[size], items[size]
        if size > 0:
            _sift_down(keys, items, size)
        if done[here]:
            continue
        if here == goal:
            return
        done[here] = True
        r, c = here // columns, here % columns
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                if (dr == 0 and dc == 0) or not (0 <= r + dr < rows and 0 <= c + dc < columns):
                    continue
                there = (r + dr) * columns + c + dc
                if done[there]:
                    continue
                length = DIAGONAL if dr != 0 and dc != 0 else 1.0
                sum_ = total[here] + 0.5 * length * (flat[here] + flat[there])
                if sum_ < total[there]:
                    total[there], before[there] = sum_, here
                    keys[size], items[size] = sum_ + _octile(there, goal, columns), there
                    _sift_up(keys, items, size)
                    size += 1


@inner
def _straight(cost, a, b):
    """Return the cost [cells] of the straight line between the middles of two cells, sampled twice per cell."""
    columns = cost.shape[1]
    ra, ca, rb, cb = a // columns, a % columns, b // columns, b % columns
    length = np.hypot(float(rb - ra), float(cb - ca))
    count = max(1, int(np.ceil(2.0 * length)))
    sum_ = 0.0
    for k in range(count):
        share = (k + 0.5) / count
        sum_ += cost[int(ra + share * (rb - ra) + 0.5), int(ca + share * (cb - ca) + 0.5)]
    return sum_ * length / count


@released("cost n m, start int64 2, goal int64 2, way out k 2")
def find_way(cost, start, goal, way):
    """Write the corners of the cheapest way from one cell (row, column) to another into `way` (n, 2).

    The number of corners and the cost of the way are returned; 0 corners: start and goal are one cell.

    Corners are left out if the straight line costs no more than the way between them. `way` keeps the first corners if
    there are more than it has room for. The cost is in cells.
    """
    columns = cost.shape[1]
    first, last = start[0] * columns + start[1], goal[0] * columns + goal[1]
    before, total = np.empty(cost.size, np.int64), np.empty(cost.size)
    _search(cost, first, last, before, total)
    count, at = 0, last
    while at != first:
        count += 1
        at = before[at]
    cells = np.empty(count + 1, np.int64)
    at = last
    for k in range(count, -1, -1):
        cells[k] = at
        at = before[at]
    kept, here = 0, 0
    while here < count and kept < len(way):
        there = here + 1
        for k in range(here + 2, count + 1):
            if _straight(cost, cells[here], cells[k]) > total[cells[k]] - total[cells[here]] + 1e-9:
                break
            there = k
        way[kept, 0], way[kept, 1] = cells[there] // columns, cells[there] % columns
        kept += 1
        here = there
    return kept, total[last]
