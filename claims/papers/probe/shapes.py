"""Three ultrasound probes, known exactly: a flat outline in the plane of the image, rounded all around.

The outline D is what a disc and a box share; with g the distance from it in the plane x z, the body is

    (max(g, 0)/w)^2 + (y/b)^2 < 1,

so the section across the face is half an ellipse of depth w and half-width b, and flat sides y = +-b close it. The
frame is the sensor's: z through the crown of the face, x along the array (in plane), y across it (out of plane).
"""

from dataclasses import dataclass, field

import numpy as np

from claims.papers.probe.assumed import LEVER
from palpate import Mesh


@dataclass(frozen=True)
class Probe:
    """One probe's head, and its handle where that makes the T.

    Attributes:
        name: as the paper has it.
        face: [m] radius of the array's curve, at the surface; inf is straight.
        width, thickness, depth: [m] along x, y, z.
        round: [m] w, by which the face bulges over the outline.
        marks: (n, 2) x and y [m] of the marks on the face.
        handle: [m] width, thickness and length, or None.
    """

    name: str
    face: float
    width: float
    thickness: float
    depth: float
    round: float
    marks: np.ndarray = field(repr=False)
    handle: tuple[float, float, float] | None = None

    @property
    def _box(self) -> tuple[float, float, float]:
        return self.width / 2 - self.round, LEVER - self.depth + self.round, LEVER - self.round

    @property
    def _disc(self) -> tuple[float, float]:
        radius = self.face - self.round
        return self._box[2] - radius, radius

    @property
    def _corner(self) -> float:
        half, _, top = self._box
        if np.isinf(self.face):
            return top
        middle, radius = self._disc
        return middle + np.sqrt(radius**2 - half**2)

    def _off_outline(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Vectors from the nearest point of D, in the plane, and their lengths (0 inside)."""
        half, low, _top = self._box
        x, z = points[..., 0], points[..., 2]
        off = np.stack([x - np.clip(x, -half, half), z - np.clip(z, low, self._corner)], axis=-1)
        if np.isinf(self.face):
            return off, np.linalg.norm(off, axis=-1)
        middle, radius = self._disc
        out = np.stack([x, z - middle], axis=-1)
        length = np.linalg.norm(out, axis=-1)
        above = (z > self._corner) & (np.abs(x) * radius <= half * length)  # in the disc's sector
        radial = out * np.where(length > radius, 1 - radius / np.maximum(length, radius), 0.0)[..., None]
        off = np.where(above[..., None], radial, off)
        return off, np.linalg.norm(off, axis=-1)

    def value(self, points: np.ndarray) -> np.ndarray:
        _, off = self._off_outline(points)
        return np.hypot(off / self.round, 2 * points[..., 1] / self.thickness) - 1.0

    def gradient(self, points: np.ndarray) -> np.ndarray:
        """The derivative of `value`; outward."""
        vector, off = self._off_outline(points)
        b = self.thickness / 2
        length = np.maximum(np.hypot(off / self.round, points[..., 1] / b), 1e-12)[..., None]
        slope = np.stack(
            [vector[..., 0] / self.round**2, points[..., 1] / b**2, vector[..., 1] / self.round**2], axis=-1
        )
        return slope / length

    def normals(self, points: np.ndarray) -> np.ndarray:
        slope = self.gradient(points)
        return slope / np.linalg.norm(slope, axis=-1, keepdims=True)

    def land(self, points: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Where lines through points [m] meet the surface nearby: Newton along a direction."""
        for _ in range(30):
            slope = np.sum(self.gradient(points) * along, axis=-1)
            step = self.value(points) / np.where(np.abs(slope) > 1e-9, slope, np.inf)
            points = points - np.clip(step, -2e-3, 2e-3)[..., None] * along
            if np.max(np.abs(step)) < 1e-13:
                break
        return points

    def marked(self) -> tuple[np.ndarray, np.ndarray]:
        """The marks on the surface [m], and the outward normals there."""
        start = np.column_stack([self.marks, np.full(len(self.marks), LEVER)])
        points = self.land(start, np.array([0.0, 0.0, 1.0]))
        return points, self.normals(points)

    def mesh(self, edge: float, smooth: bool = True) -> Mesh:
        """With edges of about a length [m], vertices on the surface."""
        bases, outs = self._outline(edge)
        quarter = np.pi / 2 * np.hypot(self.round, self.thickness / 2) / np.sqrt(2)
        turns = np.linspace(-np.pi / 2, np.pi / 2, 2 * max(2, int(np.ceil(quarter / edge))) + 1)
        flat = bases[:, None] + self.round * np.cos(turns)[:, None] * outs[:, None]
        y = np.broadcast_to(self.thickness / 2 * np.sin(turns), flat.shape[:2])
        grid = np.stack([flat[..., 0], y, flat[..., 1]], axis=-1)
        vertices, faces = _wrapped(grid)
        caps = np.array([[0.0, side * self.thickness / 2, np.mean(self._box[1:])] for side in (-1, 1)])
        rows, columns = grid.shape[:2]
        ring, ahead = np.arange(rows) * columns, np.roll(np.arange(rows), -1) * columns
        low = np.column_stack([np.full(rows, len(vertices)), ring, ahead])
        high = np.column_stack([np.full(rows, len(vertices) + 1), ahead + columns - 1, ring + columns - 1])
        vertices, faces = np.concatenate([vertices, caps]), np.concatenate([faces, low, high])
        if self.handle is not None:
            tube, walls = self._tube()
            vertices, faces = np.concatenate([vertices, tube]), np.concatenate([faces, walls + len(vertices)])
        real = _area(vertices, faces) > 1e-14  # at the outline's corners the fans' ends are one point
        return Mesh.from_arrays(vertices, faces[real], smooth=smooth)

    def _outline(self, edge: float) -> tuple[np.ndarray, np.ndarray]:
        """Around D, counter-clockwise in x z: points, and the directions in which the surface bulges from them."""
        half, low, top = self._box
        corner = self._corner
        tilt = 0.0 if np.isinf(self.face) else np.arcsin(half / self._disc[1])
        points: list[np.ndarray] = []
        turns: list[np.ndarray] = []

        def straight(start: tuple[float, float], end: tuple[float, float], angle: float) -> None:
            count = max(1, round(float(np.hypot(end[0] - start[0], end[1] - start[1])) / edge))
            points.append(np.linspace(start, end, count, endpoint=False))
            turns.append(np.full(count, angle))

        def fan(at: tuple[float, float], first: float, last: float) -> None:
            count = max(2, round((last - first) * self.round / edge))
            points.append(np.full((count, 2), at))
            turns.append(np.linspace(first, last, count, endpoint=False))

        straight((half, low), (half, corner), 0.0)
        fan((half, corner), 0.0, np.pi / 2 - tilt)
        if np.isinf(self.face):
            straight((half, top), (-half, top), np.pi / 2)
        else:
            middle, radius = self._disc
            count = max(4, round(2 * tilt * radius / edge))
            angles = np.linspace(np.pi / 2 - tilt, np.pi / 2 + tilt, count, endpoint=False)
            points.append(np.array([0.0, middle]) + radius * np.column_stack([np.cos(angles), np.sin(angles)]))
            turns.append(angles)
        fan((-half, corner), np.pi / 2 + tilt, np.pi)
        straight((-half, corner), (-half, low), np.pi)
        fan((-half, low), np.pi, 1.5 * np.pi)
        straight((-half, low), (half, low), 1.5 * np.pi)
        fan((half, low), 1.5 * np.pi, 2 * np.pi)
        angle = np.concatenate(turns)
        return np.concatenate(points), np.column_stack([np.cos(angle), np.sin(angle)])

    def _tube(self) -> tuple[np.ndarray, np.ndarray]:
        """The handle's walls, open at both ends: four sides below the head."""
        width, thickness, length = self.handle or (0.0, 0.0, 0.0)
        corners = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]]) * [width / 2, thickness / 2]
        top = LEVER - self.depth + 1e-3
        heights = np.array([top - length, top])
        grid = np.concatenate(
            [np.repeat(corners[:, None], 2, axis=1), np.broadcast_to(heights[:, None], (4, 2, 1))], axis=2
        )
        return _wrapped(grid)


def _wrapped(grid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of a grid of points (rows, columns, 3) whose last row meets the first."""
    rows, columns = grid.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b = index[:, :-1].ravel(), np.roll(index, -1, axis=0)[:, :-1].ravel()
    c, d = np.roll(index, -1, axis=0)[:, 1:].ravel(), index[:, 1:].ravel()
    return grid.reshape(-1, 3), np.concatenate([np.column_stack([a, c, b]), np.column_stack([a, d, c])])


def _area(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def _rows(middle: np.ndarray, sides: np.ndarray, off: float) -> np.ndarray:
    """A row of marks on the mid-line, and one on either side of it [mm] -> [m]."""
    line = np.column_stack([middle, np.zeros(len(middle))])
    flanks = [np.column_stack([sides, np.full(len(sides), y)]) for y in (off, -off)]
    return np.concatenate([line, *flanks]) * 1e-3


FIVE, SIX = np.linspace(-1, 1, 5), np.linspace(-1, 1, 6)
PROBES: dict[str, Probe] = {
    "T-shaped": Probe(
        "T-shaped", 0.060, 0.066, 0.022, 0.024, 0.006, _rows(22 * FIVE, 22 * SIX, 6.0), (0.034, 0.018, 0.06)
    ),
    "linear": Probe("linear", np.inf, 0.048, 0.018, 0.040, 0.005, _rows(16 * FIVE, 16 * FIVE, 4.5)),
    "convex": Probe("convex", 0.050, 0.060, 0.020, 0.040, 0.005, _rows(20 * FIVE, 20 * FIVE, 5.0)),
}
