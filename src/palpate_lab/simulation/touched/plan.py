"""Plan touches of the forearm: their places, times, forces, directions and drags.

The plan is not what happens: the engine lets an indenter slide, and the forces are those of its contacts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan, cos, pi, sin, tan

import numpy as np
from jaxtyping import Float

from palpate_lab.simulation.touched.settings import ForearmSettings

__all__ = ["COMING", "PlannedTouch", "course", "plan_presses", "plan_touches"]

COMING = 0.1  # s before its start, when an indenter hovers over its place
RAMP = 0.2  # s in which the force rises, and falls
HOVER = 0.004  # m
LONGEST, SHORTEST = 4.0, 1.5  # s
_TRIES = 300
_SETTLED = 0.2  # s of hold before a drag begins
_PAST_EDGE, _END = 0.014, 0.010  # m from the sheet's edge and from the cylinder's end: touches next to the sheet


@dataclass(frozen=True)
class PlannedTouch:
    """A planned touch.

    Attributes:
        number: number from 0, in the order of their starts; the identity of a contact in the truth.
        slot: number of its indenter.
        start, end: times [s] between which it pushes.
        angle, along: place aimed at: about z from x [rad], and z [m], in the link's frame.
        drag: (around, along) [m] by which that place moves during the touch.
        force: largest push along the inward normal [N].
        lean, heading: angle [rad] of the push off the normal, and its direction in the tangent plane: 0 around, pi/2
            along z.
        radius: radius of the indenter [m].
        off_sheet: True if it is aimed next to the sheet.
    """

    number: int
    slot: int
    start: float
    end: float
    angle: float
    along: float
    drag: tuple[float, float]
    force: float
    lean: float
    heading: float
    radius: float
    off_sheet: bool

    def path(self, radius: float) -> Float[np.ndarray, "5 2"]:
        """Return five points (5, 2) of its path on the unrolled surface [m]: around, along."""
        return np.array([radius * self.angle, self.along]) + np.linspace(0.0, 1.0, 5)[:, None] * np.array(self.drag)


def plan_touches(settings: ForearmSettings, rng: np.random.Generator) -> tuple[PlannedTouch, ...]:
    """Plan touches that begin, overlap and end at different times until the log ends, a tuple of `PlannedTouch`.

    A touch for which there is no room is omitted.
    """
    spans: list[tuple[float, float, int]] = []
    for slot in range(settings.touches):
        start = settings.quiet + COMING + float(rng.uniform(0.0, 1.0))
        while start + SHORTEST < settings.seconds - 0.5:
            end = min(start + float(rng.uniform(SHORTEST, LONGEST)), settings.seconds - 0.5)
            spans.append((start, end, slot))
            start = end + float(rng.uniform(0.4, 1.5))
    made: list[PlannedTouch] = []
    for start, end, slot in sorted(spans):
        others = [each for each in made if each.end + 0.3 > start]
        touch = _placed(settings, rng, (len(made), slot, start, end), others)
        made += [touch] if touch is not None else []
    return tuple(made)


def plan_presses(
    settings: ForearmSettings, rng: np.random.Generator, count: int, settle: float = 0.3
) -> tuple[PlannedTouch, ...]:
    """Plan `count` configurations one after the other, all of the indenters pressing at once and none dragged.

    Returns a tuple of `PlannedTouch`; a touch for which there is no room is omitted.

    Args:
        settings: number of touches at once, and their bounds; `seconds` and `drags` mean nothing.
        rng: random numbers of everything drawn.
        count: number of configurations.
        settle: duration [s] of the full force.
    """
    made: list[PlannedTouch] = []
    for k in range(count):
        start = settings.quiet + COMING + k * period(settle)
        group: list[PlannedTouch] = []
        for slot in range(settings.touches):
            touch = _placed(settings, rng, (len(made) + len(group), slot, start, start + 2 * RAMP + settle), group, 0.0)
            group += [touch] if touch is not None else []
        made += group
    return tuple(made)


def period(settle: float) -> float:
    """Return the time [s] between configurations of presses, rounded to 0.01 s.

    At 100 Hz and its multiples it is an integer number of samples.
    """
    return round(COMING + 2 * RAMP + settle + 0.2, 2)


def course(touch: PlannedTouch, settings: ForearmSettings, time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    """Return the hand's wanted positions (n, 3) [m] of the indenter's centre, in the link's frame: inside to push."""
    whole = max(touch.end - touch.start - 2 * RAMP - _SETTLED, 1e-6)
    moved = _ease((time - touch.start - RAMP - _SETTLED) / whole)
    angle = touch.angle + moved * touch.drag[0] / settings.sheet.radius
    zero = np.zeros_like(angle)
    normal = np.stack([np.cos(angle), np.sin(angle), zero], axis=-1)
    around = np.stack([-np.sin(angle), np.cos(angle), zero], axis=-1)
    aside = cos(touch.heading) * around + sin(touch.heading) * np.array([0.0, 0.0, 1.0])
    newtons = touch.force * _ease(np.minimum(time - touch.start, touch.end - time) / RAMP)
    hover = HOVER * np.clip(np.maximum(touch.start - time, time - touch.end) / COMING, 0.0, 1.0)
    height = settings.sheet.radius + touch.radius + hover
    place = height[:, None] * normal
    place[:, 2] += touch.along + moved * touch.drag[1]
    return place + (newtons / settings.stiffness)[:, None] * (tan(touch.lean) * aside - normal)


def _ease(share: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    return 0.5 - 0.5 * np.cos(pi * np.clip(share, 0.0, 1.0))


def _placed(
    settings: ForearmSettings,
    rng: np.random.Generator,
    when: tuple[int, int, float, float],
    others: Sequence[PlannedTouch],
    drags: float | None = None,
) -> PlannedTouch | None:
    """Draw a touch that keeps its distance from others; return None if there was no room in `_TRIES` tries."""
    once = 2 * pi * settings.sheet.radius
    taken = [other.path(settings.sheet.radius) for other in others]
    for _ in range(_TRIES):
        touch = _drawn(settings, rng, when, settings.drags if drags is None else drags)
        path = touch.path(settings.sheet.radius)
        if not _on_cylinder(touch, path, settings):
            continue
        gaps = [path[:, None] - other[None] for other in taken]
        for gap in gaps:
            gap[..., 0] -= once * np.rint(gap[..., 0] / once)
        if all(np.linalg.norm(gap, axis=-1).min() >= settings.spacing for gap in gaps):
            return touch
    return None


def _drawn(
    settings: ForearmSettings, rng: np.random.Generator, when: tuple[int, int, float, float], drags: float
) -> PlannedTouch:
    sheet, (number, slot, start, end) = settings.sheet, when
    u = rng.random(10).tolist()
    beside = u[0] < settings.unseen
    row = settings.margin + u[1] * (sheet.rows - 1 - 2 * settings.margin)
    column = settings.margin + u[2] * (sheet.columns - 1 - 2 * settings.margin)
    along, angle = (row - (sheet.rows - 1) / 2) * sheet.pitch, column * sheet.pitch / sheet.radius
    if beside:
        least, most = settings.covered + _PAST_EDGE, settings.half_length - _END
        along, angle = (least + u[1] * (most - least)) * (1.0 if u[3] < 0.5 else -1.0), 2 * pi * u[2]
    drag = (0.0, 0.0)
    if u[4] < drags and end - start > 1.0:
        length, way = 0.010 + 0.030 * u[5], 2 * pi * u[6]
        drag = (length, 0.0) if beside else (length * cos(way), length * sin(way))
    light, heavy = settings.force
    small, large = settings.radius
    return PlannedTouch(
        number=number,
        slot=slot,
        start=start,
        end=end,
        angle=angle,
        along=along,
        drag=drag,
        force=light + u[7] * (heavy - light),
        lean=min(settings.lean * atan(settings.friction) * u[8], 1.2),
        heading=2 * pi * u[9],
        radius=float(rng.uniform(small, large)),
        off_sheet=beside,
    )


def _on_cylinder(touch: PlannedTouch, path: Float[np.ndarray, "5 2"], settings: ForearmSettings) -> bool:
    """Tell whether a drag stays where it began: on the sheet, or next to it."""
    if touch.off_sheet:
        return True
    half = settings.covered - (settings.margin + 0.5) * settings.sheet.pitch
    last = (settings.sheet.columns - 1 - settings.margin) * settings.sheet.pitch
    first = settings.margin * settings.sheet.pitch
    on = (np.abs(path[:, 1]) <= half + 1e-9) & (path[:, 0] >= first - 1e-9) & (path[:, 0] <= last + 1e-9)
    return bool(on.all())
