"""What to draw of contacts on a body at each moment: arrays and words, and nothing of how they reach a screen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from palpate.contact.estimate import ContactEstimate, Status
from palpate.spatial.pose import quaternion_from_rotation
from palpate.surfaces import Mesh, Surface
from palpate.viewer.heat import Skin, density, skin
from palpate.viewer.timeline import Timeline, thinned

__all__ = ["MAGNIFICATIONS", "Moment", "Scene", "ellipse", "nice", "prepare"]

INSIDE = 5.991464547107979  # chi-square of two degrees of freedom at 95 %
MAGNIFICATIONS = (1, 2, 5, 10, 20, 50, 100)
PLOTTED = 800  # rows of a plot: two a pixel
TRAIL = 300  # segments
_SAMPLED = 2_000  # contacts that a typical value is taken from
_WORDS = {
    Status.CONTACT: "touched",
    Status.AMBIGUOUS: "touched here, or elsewhere",
    Status.NO_CONTACT: "not touched",
    Status.TOO_LIGHT: "too light to locate",
    Status.OFF_SURFACE: "no place explains it",
    Status.IMPLAUSIBLE: "not plausible",
    Status.SATURATED: "sensor at its range",
    Status.INVALID: "no reading",
    Status.NO_POSE: "orientation missing",
}


@dataclass(frozen=True)
class Moment:
    """One sample, as it is drawn and said.

    Attributes:
        index: which sample; seconds: since the start; time: as recorded [s].
        status: of the estimate; words: the same, as one says it.
        point, normal: (3,) [m] and unit; NaN where there is none.
        force: (3,) [N] on the body; torque: [N m] about the normal.
        deviation: (3,) [m] of the point along x, y, z; NaN where no noise is known.
        axes: (2,) half-axes [m] of the 95 % ellipse, the longer first; NaN where there is none.
        turn: (4,) quaternion x, y, z, w of the frame of the long axis, the short axis and the normal.
    """

    index: int
    seconds: float
    time: float
    status: Status
    words: str
    point: Float[np.ndarray, "3"]
    normal: Float[np.ndarray, "3"]
    force: Float[np.ndarray, "3"]
    torque: float
    deviation: Float[np.ndarray, "3"]
    axes: Float[np.ndarray, "2"]
    turn: Float[np.ndarray, "4"]

    @property
    def located(self) -> bool:
        """There is a point to draw."""
        return bool(np.isfinite(self.point).all() and np.isfinite(self.normal).all())


@dataclass(frozen=True)
class Scene:
    """A body and its contacts, prepared so that any moment can be drawn at once.

    Attributes:
        title: what it is, such as the log's name.
        mesh: the body; skin: the same, ready to draw.
        time: (n,) [s] as recorded; timeline: the same from 0 and rising.
        estimate: batch of n, in the surface's frame.
        heat: (v,) time of touch per area at the skin's vertices [s/m^2].
        newton: [m] that an arrow is long for each newton.
        magnification: of the ellipse, so that a usual one can be seen; one of MAGNIFICATIONS.
    """

    title: str
    mesh: Mesh
    skin: Skin
    time: Float[np.ndarray, " n"]
    timeline: Timeline
    estimate: ContactEstimate
    heat: Float[np.ndarray, " v"]
    newton: float
    magnification: int

    def __len__(self) -> int:
        return len(self.time)

    def at(self, index: int) -> Moment:
        """What there is at one sample."""
        found = self.estimate
        covariance, normal = found.covariance[index], found.normal[index]
        axes, rotation = ellipse(covariance, normal)
        status = Status(int(found.status[index]))
        return Moment(
            index=index,
            seconds=float(self.timeline.clock[index]),
            time=float(self.time[index]),
            status=status,
            words=_WORDS[status],
            point=found.point[index],
            normal=normal,
            force=found.force[index],
            torque=float(found.torque[index]),
            deviation=np.sqrt(np.maximum(np.diag(covariance), 0.0)),
            axes=axes,
            turn=quaternion_from_rotation(rotation),
        )

    def trail(self, index: int, seconds: float) -> tuple[Float[np.ndarray, "m 2 3"], Float[np.ndarray, " m"]]:
        """Where the contact was in the last seconds: segments [m] and their ages (0 now, 1 oldest)."""
        now = self.timeline.clock[index]
        first = self.timeline.span(now - seconds, now).start
        stride = max(1, -(-(index - first) // TRAIL))
        rows = index - stride * np.arange((index - first) // stride + 1, dtype=np.int64)[::-1]
        known = self.timeline.touched[rows]
        joined = np.flatnonzero(known[:-1] & known[1:])
        points = self.estimate.point[rows] + 2e-3 * self.mesh.size * self.estimate.normal[rows]
        age = (now - self.timeline.clock[rows[joined + 1]]) / max(seconds, 1e-9)
        return np.stack([points[joined], points[joined + 1]], axis=1), age

    def courses(self, window: slice | None = None) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m 5"]]:
        """Seconds, and beside them pressing force [N], force [N] and x, y, z [mm], of all samples or of a window."""
        rows = slice(None) if window is None else window
        force, normal = self.estimate.force[rows], self.estimate.normal[rows]
        size, pressing = np.linalg.norm(force, axis=1), -np.einsum("ij,ij->i", force, normal)
        values = np.column_stack([pressing, size, 1e3 * self.estimate.point[rows]])
        values[~self.timeline.touched[rows], 2:] = np.nan
        return thinned(self.timeline.clock[rows], values, PLOTTED)


def prepare(surface: Surface, time: Float[np.ndarray, " n"], estimate: ContactEstimate, title: str = "") -> Scene:
    """A scene from contacts in the surface's frame.

    Args:
        surface: the body; one that is an equation is shown as a mesh.
        time: (n,) [s] as recorded.
        estimate: batch of n; at least one.
        title: what to call it.
    """
    answered = estimate.answered & np.isfinite(estimate.point).all(axis=1) & np.isfinite(estimate.normal).all(axis=1)
    timeline = Timeline.of(time, answered)
    points = estimate.point[answered]
    mesh = surface.drawn()
    width = _width(mesh, points)
    thin = np.unique((points / width).round(), axis=0) * width
    body = skin(mesh, thin, width)
    heat = density(body, points, estimate.normal[answered], timeline.seconds[answered], width)
    shown = _some(np.flatnonzero(answered))
    strong = np.nanquantile(np.linalg.norm(estimate.force[shown], axis=1), 0.95) if len(shown) else 1.0
    newton = 0.35 * mesh.size / max(float(strong), 1e-9)
    return Scene(title, mesh, body, time, timeline, estimate, heat, newton, _magnified(mesh, estimate, shown))


def ellipse(
    covariance: Float[np.ndarray, "3 3"], normal: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "3 3"]]:
    """The 95 % ellipse of a point in its tangent plane.

    With B two tangents, the half-axes are sqrt(5.991 eigenvalues of B^T C B).

    Returns:
        Half-axes [m], the longer first (NaN without a covariance), and the rotation whose columns are the long axis,
        the short axis and the normal.
    """
    if not np.isfinite(normal).all():
        return np.full(2, np.nan), np.eye(3)
    along = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    along /= np.linalg.norm(along)
    tangents = np.column_stack([along, np.cross(normal, along)])
    if not np.isfinite(covariance).all():
        return np.full(2, np.nan), np.column_stack([tangents, normal])
    values, vectors = np.linalg.eigh(tangents.T @ covariance @ tangents)
    long = tangents @ vectors[:, 1]
    return np.sqrt(INSIDE * np.maximum(values[::-1], 0.0)), np.column_stack([long, np.cross(normal, long), normal])


def nice(value: float) -> float:
    """The next of 1, 2, 5, 10, ... that is not less."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * next(step for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value * (1 - 1e-9)))


def _width(surface: Mesh, points: Float[np.ndarray, "n 3"]) -> float:
    """Of the spot that a touch leaves [m]: small beside the body, and beside what was touched of it."""
    extent = float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else surface.size
    return float(np.clip(extent / 40, surface.size / 300, surface.size / 50))


def _magnified(surface: Mesh, estimate: ContactEstimate, shown: np.ndarray) -> int:
    axes = np.array([ellipse(estimate.covariance[k], estimate.normal[k])[0][0] for k in shown])
    axes = axes[axes > 0]
    wanted = surface.size / 50 / float(np.median(axes)) if len(axes) else 1.0
    return next((times for times in MAGNIFICATIONS if times >= wanted), MAGNIFICATIONS[-1])


def _some(rows: np.ndarray) -> np.ndarray:
    return rows[:: 1 + len(rows) // _SAMPLED]
