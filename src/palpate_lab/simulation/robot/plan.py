"""Plan where, when and how hard a robot is touched: one place of each region at a time, several regions at once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from palpate.errors import InputError
from palpate_lab.simulation.robot.motion import QUIET
from palpate_lab.simulation.robot.sensors import LabRobot, SheetPatch

RATE = 100  # Hz of skins and of the truth
RAMP = 0.15  # s in which a force rises, and falls
FULL = (0.3, 0.6)  # s of the full force
REST = 0.35  # s after a touch in which its region is free
SLOT = 2 * RAMP + FULL[1] + REST + 0.05  # s: the least time for each touch of a region
LIGHT, HEAVY = 1.5, 10.0  # N, bounds of normal forces, evenly between their logarithms
SHEAR = 0.4  # largest ratio of shear to normal force
TOGETHER = 0.4  # share of slots in which several regions are touched at the same time
GRASPED = 0.4  # share of touches of a sheet round an arm that are grasps, by two opposite contacts
RADII = (8e-3, 15e-3)  # m, of what touches
_END = 0.5  # s without touch at the end


@dataclass(frozen=True)
class RobotTouch:
    """A touch: number, region and part of it, time, place (two draws from 0 to 1), force and direction.

    Attributes:
        start, full: frame at which it begins, and number of frames with the full force.
        force, shear, azimuth: normal force [N], its ratio to the shear, and the shear's direction [rad].
        radius: of what touches [m].
        kind: "push", "together" (with other regions), or "grasp" (by fingers, or of an arm from both sides).
    """

    number: int
    region: int
    part: int
    start: int
    full: int
    place: tuple[float, float]
    force: float
    shear: float
    azimuth: float
    radius: float
    kind: str

    @property
    def frames(self) -> np.ndarray:
        """Frames (n,) in which it acts."""
        return self.start + np.arange(self.full + 2 * round(RAMP * RATE) - 1)

    def shares(self) -> np.ndarray:
        """Return the share (n,) of the full force in each of its frames."""
        ramp = round(RAMP * RATE)
        rise = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, ramp) / ramp)
        return np.concatenate([rise, np.ones(self.full + 1), rise[::-1]])


def plan_touches(robot: LabRobot, rng: np.random.Generator, touches: int, seconds: float) -> list[RobotTouch]:
    """Draw touches, sorted by their start.

    Raises:
        InputError: so many do not fit into the time.
    """
    regions = len(robot.regions)
    slots = int((seconds - QUIET - _END) / SLOT)
    if touches > regions * slots:
        what = f"{touches} touches need {SLOT * -(-touches // regions) + QUIET + _END:.0f} s, not {seconds:g} s."
        raise InputError(what, where="--touches", hint=f"Give --seconds, or at most {regions * slots} touches.")
    needed = max(1, min(slots, -(-touches // 2)))  # so that there are often two at once
    length, planned = (seconds - QUIET - _END) / needed, list[RobotTouch]()
    for slot in range(needed):
        count = -(-(touches - len(planned)) // (needed - slot))
        planned += _of_slot(robot, rng, count, QUIET + slot * length, length)
    ordered = sorted(planned, key=lambda each: each.start)
    return [replace(each, number=k) for k, each in enumerate(ordered)]


def _of_slot(robot: LabRobot, rng: np.random.Generator, count: int, begin: float, length: float) -> list[RobotTouch]:
    """Draw `count` touches of different regions in a slot of time."""
    together, common = bool(rng.random() < TOGETHER) and count > 1, float(rng.random())
    found, regions = list[RobotTouch](), robot.regions
    kind = ("grasp" if robot.grasps else "together") if together else "push"
    order: list[int] = rng.permutation(len(regions)).tolist()
    for region in order:
        if len(found) >= count:
            break
        late = (common if together else float(rng.random())) * (length - SLOT)
        start = round((begin + late) * RATE)
        part = int(rng.integers(len(regions[region].parts)))
        found.append(_drawn(rng, region, part, start, kind))
        sheet = regions[region].parts[part]
        if isinstance(sheet, SheetPatch) and sheet.ring and rng.random() < GRASPED and len(found) < count:
            first, other = replace(found.pop(), kind="grasp"), _drawn(rng, region, part, start, "grasp")
            along, around = first.place
            found += [first, replace(other, place=(along, (around + 0.5) % 1.0), full=first.full)]
    return found


def _drawn(rng: np.random.Generator, region: int, part: int, start: int, kind: str) -> RobotTouch:
    along, around, hard, lean = rng.random(4).tolist()
    full, radius = round(float(rng.uniform(*FULL)) * RATE), float(rng.uniform(*RADII))
    push = LIGHT * (HEAVY / LIGHT) ** hard, SHEAR * lean, float(rng.uniform(0.0, 2 * np.pi))
    return RobotTouch(0, region, part, start, full, (along, around), *push, radius, kind)
