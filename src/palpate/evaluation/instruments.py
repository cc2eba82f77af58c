"""Compare touches with a force/torque sensor that carries the body, or with a tracked wand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import Status
from palpate.contact.ground_truth import TrueSamples
from palpate.contact.locate import Locator
from palpate.contact.touch_finder import find_touches
from palpate.evaluation.errors import ErrorSummary
from palpate.evaluation.evaluate import EvaluationReport, report
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.surfaces.mesh import Mesh

__all__ = ["InstrumentReport", "Reference", "judge", "perfect", "touches_of", "wand_points", "wrench_points"]

PITCH = 2e-3  # m: of a wrench, |F . N| / |F|^2; more is no single force
LIGHTEST = 0.5  # N
BESIDE = 0.2  # of its samples: a touch that has another one beside it for longer is not alone
TOUCHING = 1.5e-3  # m: between wand and link, still a touch of theirs
_MEAN_IN_CELL = 0.3825978  # mean distance of a point of the unit square from its middle
_MEASURED = ("point", "normal", "force", "torque", "covariance")


@frozen_value
class Reference:
    """Contact points of n touches as another instrument measured them.

    Attributes:
        point: (n, 3) [m] in the link's frame; NaN without a measurement.
        direction: (n, 3) outward, along which the force came; NaN where unknown.
        refused: n reasons why there is no measurement, or "".
        name: of the instrument.
    """

    point: Float[np.ndarray, "n 3"]
    direction: Float[np.ndarray, "n 3"]
    refused: tuple[str, ...]
    name: str


@frozen_value
class InstrumentReport:
    """Errors of touches against an instrument.

    Attributes:
        report: location, and normal against the instrument's direction.
        along: (3,) mean absolute error along x, y and z [m]; NaN without any.
        paper_position: with the errors along z set to zero, as the paper has it; None without any.
        paper_direction: mean absolute difference of the unit vectors' x and y [skin map, 4.3]; NaN without any.
        reference: the measurements.
    """

    report: EvaluationReport
    along: Float[np.ndarray, "3"]
    paper_position: ErrorSummary | None
    paper_direction: float
    reference: Reference


@takes_arrays
def wrench_points(surface: Mesh, wrenches: Float[np.ndarray, "n 6"], *, alone: Bool[np.ndarray, " n"]) -> Reference:
    """Return where the line of each force meets the link, and its direction [skin map, (6) to (9)].

    E = F x N / |F|^2 is the foot of the line. A wrench with torque along its force is refused: its line is off by up to
    |F . N| / |F|^2 times the tangent of the angle to the normal.

    Args:
        surface: mesh of the link.
        wrenches: (n, 6) [N, N m] about the link's origin, in its frame.
        alone: (n,) there was one touch.

    Raises:
        InputError: arrays of other shapes.
        GeometryError: the mesh has no usable facet.
    """
    force, torque = wrenches[:, :3], wrenches[:, 3:]
    size = np.linalg.norm(force, axis=1)
    pitch = np.sum(force * torque, axis=1) / np.maximum(size, 1e-12) ** 2
    found = Locator(surface, method="wrench_axis", friction=np.inf, torsion=np.inf).run(wrenches, sequential=False)
    met = found.status <= Status.AMBIGUOUS
    said = [_why(bool(alone[k]), float(size[k]), float(pitch[k]), bool(met[k])) for k in range(len(wrenches))]
    usable = np.array([not text for text in said])
    return Reference(
        np.where(usable[:, None], found.point, np.nan),
        np.where(usable[:, None], -force / np.maximum(size, 1e-12)[:, None], np.nan),
        tuple(said),
        "force/torque sensor",
    )


def _why(alone: bool, newtons: float, pitch: float, met: bool) -> str:
    """Return why a wrench is not one force; "" where it is."""
    if not np.isfinite(newtons):
        return "there is no wrench at its time"
    if not alone:
        return "several touches at once have one resultant force, which acts at none of them"
    if newtons < LIGHTEST:
        return f"{newtons:.2f} N is too light for a line of action, which needs {LIGHTEST:g} N"
    if abs(pitch) > PITCH:
        return (
            f"F . N / |F|^2 is {1e3 * pitch:.1f} mm, more than {1e3 * PITCH:g} mm: "
            "the torque along the force is too large for a single force"
        )
    return "" if met else "the line of the force misses the link"


@takes_arrays
def wand_points(
    surface: Mesh,
    wand: Float[np.ndarray, "v 3"],
    rotation: Float[np.ndarray, "n 3 3"],
    position: Float[np.ndarray, "n 3"],
) -> Reference:
    """Return where a tracked wand meets the link: the middle of the part inside, or the nearest point within 1.5 mm.

    Args:
        surface: mesh of the link.
        wand: (v, 3) [m] points of the wand's surface in its frame.
        rotation: (n, 3, 3) of the wand in the link's frame; NaN where it was lost.
        position: (n, 3) [m] of its origin there.

    Raises:
        InputError: arrays of other shapes.
    """
    points, said = np.full((len(position), 3), np.nan), list[str]()
    for k in range(len(position)):
        if not (np.isfinite(position[k]).all() and np.isfinite(rotation[k]).all()):
            said.append("the cameras lost the wand or the link")
            continue
        placed = wand @ rotation[k].T + position[k]
        near, normals, _ = surface.project(placed)
        height = np.sum((placed - near) * normals, axis=1)
        close = np.linalg.norm(placed - near, axis=1) < np.abs(height) * 1.5 + 1e-4  # beside it, not behind it
        inside = close & (height < 0) & (height > -10 * TOUCHING)
        lowest = int(np.argmin(np.where(close, np.abs(height), np.inf)))
        if inside.any():
            points[k] = np.average(near[inside], axis=0, weights=-height[inside])
        elif close.any() and height[lowest] <= TOUCHING:
            band = close & (height <= height[lowest] + 2e-5)
            points[k] = near[band].mean(axis=0)
        apart = 1e3 * float(np.linalg.norm(placed - near, axis=1).min())
        never = f"wand and link do not meet: their distance is {apart:.3g} mm (check the wand's unit and frame)"
        said.append("" if np.isfinite(points[k]).all() else never)
    nowhere = np.full((len(position), 3), np.nan)
    return Reference(points, nowhere, tuple(said), "wand tracked by motion capture")


def judge(touches: Contacts, reference: Reference) -> InstrumentReport:
    """Compare n touches, one contact each, with n measurements of an instrument."""
    apart = touches.point - reference.point
    components: Float[np.ndarray, "n 2"] = np.abs(touches.normal - reference.direction)[:, :2]
    known = np.isfinite(components).all(axis=1)
    compared = np.isfinite(apart).all(axis=1)
    truth = TrueSamples(touches.time, reference.point, reference.direction)
    return InstrumentReport(
        report=report(touches, truth, np.where(compared, np.arange(len(touches)), -1)),
        along=np.abs(apart[compared]).mean(axis=0) if compared.any() else np.full(3, np.nan),
        paper_position=ErrorSummary.of(np.linalg.norm(apart[:, :2], axis=1)),
        paper_direction=float(components[known].mean()) if known.any() else float("nan"),
        reference=reference,
    )


def perfect(pitch: tuple[float, float]) -> tuple[float, float]:
    """Return the errors [m] of a perfect map for touches smaller than a cell: mean distance, and mean along an axis.

    `pitch` has the sides of a cell [m]. A point in a square of side a lies on average 0.3826 a from its middle, a/4
    along each axis; other cells count as the square of the same area.
    """
    side = float(np.sqrt(pitch[0] * pitch[1]))
    return _MEAN_IN_CELL * side, side / 4


def touch_rows(contacts: Contacts) -> list[Int[np.ndarray, " _"]]:
    """Return the indices (k,) of the answered rows of each touch of three samples or more."""
    found, answered = find_touches(contacts, shortest=0.0), contacts.answered
    rows = [
        np.flatnonzero(answered & (contacts.identity == identity) & (contacts.time >= start) & (contacts.time <= end))
        for identity, start, end in zip(found.identity, found.start, found.end, strict=True)
    ]
    return [each for each in rows if len(each) >= 3]


def touches_of(contacts: Contacts) -> tuple[Contacts, Bool[np.ndarray, " k"]]:
    """Return each touch of three samples or more as the median of its rows, and a mask (k,) of those that are alone.

    Others accompany such a touch in at most 20 % of its rows.
    """
    touches, answered = touch_rows(contacts), np.flatnonzero(contacts.answered)
    _, sample, felt = np.unique(contacts.sample[answered], return_inverse=True, return_counts=True)
    several = np.zeros(len(contacts), dtype=bool)
    several[answered] = felt[sample] > 1
    alone = np.array([several[rows].mean() <= BESIDE for rows in touches], dtype=bool)
    return medians(contacts, touches), alone


@takes_arrays
def medians(contacts: Contacts, touches: list[Int[np.ndarray, " _"]]) -> Contacts:
    """Return one contact per touch, the median of its rows, of which `touches` has the indices.

    Raises:
        InputError: touches has another shape.
    """
    return Contacts.joined([contacts[:0], *(_median(contacts[rows]) for rows in touches)])


def _median(contacts: Contacts) -> Contacts:
    first, estimate = contacts[:1], contacts.estimate
    values = {name: np.median(getattr(estimate, name), axis=0, keepdims=True) for name in _MEASURED}
    values["normal"] /= np.linalg.norm(values["normal"])
    return replace(
        first,
        time=np.median(contacts.time, keepdims=True),
        estimate=replace(first.estimate, **values),
        features={name: np.median(column, keepdims=True) for name, column in contacts.features.items()},
    )
