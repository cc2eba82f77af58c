"""Remember touched places with a belief in each, and find the cheapest way between them.

Places are points. Belief in each fades with time, because the touched object may have moved, and a place is removed if
the robot's body has passed there. A place is never forbidden, only costly, so that there is always a way.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, inf, sin

import numpy as np
from jaxtyping import Float

MOST = 1024  # places: beyond, the oldest are forgotten
CORNERS = 256  # of a way
LINE = 3  # places that make a wall


@dataclass(frozen=True)
class TouchMapSettings:
    """Settings of the memory of places and of the cost of ways.

    Attributes:
        cell: [m] size of a cell of the map in which ways are found.
        weight: cost, relative to its length, of a way through a place touched just now.
        fade: [s] in which belief in a place falls to 1/e.
        merge: [m] touches nearer than this are one place.
        again: [s] after which a further touch of a place counts again: each adds `weight`.
        clearance: [m] beyond the body, within which a way costs a little more.
        near: this extra cost, as a share of `weight`, where the body just touches.
        margin: [m] by which a way may go beyond all known places.
        slack: [m] by which a soft body may be pressed in.
    """

    cell: float = 0.02
    weight: float = 10.0
    fade: float = 250.0
    merge: float = 0.012
    clearance: float = 0.025
    near: float = 0.02
    margin: float = 0.5
    again: float = 2.0
    slack: float = 0.003


class TouchMap:
    """A map of places touched by a round body.

    Args:
        radius: [m] of the body.
        settings: of memory and costs; None: `TouchMapSettings()`.
    """

    def __init__(self, radius: float, settings: TouchMapSettings | None = None) -> None:
        self.radius, self.settings = radius, settings or TouchMapSettings()
        self.reset()

    def reset(self) -> None:
        """Forget all places."""
        self._places = np.zeros((MOST, 4))  # x, y, time of the last touch, belief of all touches
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def touch(self, time: float, x: float, y: float, belief: float = 1.0) -> None:
        """Remember a place (x, y) [m] touched at a time [s], with a belief (1: an ordinary touch)."""
        places, count = self._places, self._count
        if count:
            off = self._distances(x, y)
            near = int(off.argmin())
            if off[near] < self.settings.merge:
                places[near, 3] += belief * (time > places[near, 2] + self.settings.again)
                places[near, 2] = time
                return
        if count == MOST:
            places[int(places[:, 2].argmin())] = x, y, time, belief
            return
        places[count] = x, y, time, belief
        self._count = count + 1

    def clear(self, x: float, y: float, within: float) -> None:
        """Forget the places within a distance [m] of a point (x, y) [m]: the body is there."""
        kept = self._places[: self._count][self._distances(x, y) >= within]
        self._count = len(kept)
        self._places[: self._count] = kept

    def nearest(self, x: float, y: float) -> float:
        """Return the distance [m] from a point (x, y) [m] to the nearest place; inf if there is none."""
        return float(self._distances(x, y).min(initial=inf))

    def _distances(self, x: float, y: float) -> Float[np.ndarray, " n"]:
        """Return the distance [m] from a point to each place."""
        return np.hypot(*(self._places[: self._count, :2] - (x, y)).T)

    def in_line(self, x: float, y: float, normal: float) -> bool:
        """Return whether a wall with a normal [rad] may pass a point (x, y) [m]: 3 places near lie on its tangent."""
        places = self._places[: self._count, :2] - (x, y)
        off = np.abs(places @ np.array([cos(normal), sin(normal)]))
        aside = np.abs(places @ np.array([-sin(normal), cos(normal)]))
        return int(((off < self.settings.merge) & (aside < 2.0 * self.radius)).sum()) >= LINE

    def way(
        self, time: float, start: tuple[float, float], goal: tuple[float, float]
    ) -> tuple[Float[np.ndarray, "n 2"], float]:
        """Return the cheapest way at a time [s]: its corners after the start, (n, 2) [m], and its cost [m].

        The cost of a way without known places is its length.
        """
        from palpate.control._touch_map import fill, find_way  # compiled: loaded when first needed

        set_, places = self.settings, self._places[: self._count]
        known = np.concatenate([places[:, :2], [start, goal]])
        low, high = known.min(axis=0) - set_.margin, known.max(axis=0) + set_.margin
        columns, rows = (np.ceil((high - low) / set_.cell).astype(int) + 1).tolist()
        cost = np.empty((rows, columns))
        marks = places[:, :3].copy()
        marks[:, 2] = set_.weight * places[:, 3] * np.exp((places[:, 2] - time) / set_.fade)
        hard = self.radius - set_.slack
        fill(marks, low, *map(float, (set_.cell, hard, hard + set_.clearance, set_.near)), cost)
        at, to = (((np.array(each) - low) / set_.cell).astype(np.int64)[::-1].copy() for each in (start, goal))
        corners = np.empty((CORNERS, 2))
        count, price = find_way(cost, at, to, corners)
        if not count:
            return np.array([goal]), hypot(goal[0] - start[0], goal[1] - start[1])
        way = low + (corners[:count, ::-1] + 0.5) * set_.cell
        if count < CORNERS:
            way[-1] = goal
        return way, price * set_.cell
