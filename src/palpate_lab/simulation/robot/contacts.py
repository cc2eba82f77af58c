"""Contacts of planned touches in each frame, by the mechanics of what is touched, and the readings that they cause."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Float, Int

from palpate.signals.recording import CELLS
from palpate_lab.simulation.contacts import contact_wrenches, directed_forces
from palpate_lab.simulation.robot.plan import RATE, RobotTouch
from palpate_lab.simulation.robot.sensors import LabRobot, PadPatch, SheetPatch
from palpate_lab.simulation.skin_bench import PaperSheet, read_out
from palpate_lab.simulation.three_axis_touches import Loads
from palpate_lab.simulation.touched.body import Physics
from palpate_lab.simulation.touched.sensors import loads as sheet_loads

MODULUS = 1e5  # Pa, of a sheet's foam: radius of the pressed disc by Hertz, 5 to 9 mm
_EDGE = 10e-3  # m: of what touches a pad: round up to here


@dataclass(frozen=True)
class RobotContacts:
    """True contacts, m in all, in the order of their frames; in the frame of the link that is touched.

    Attributes:
        frame, touch: (m,) number of the frame, at `RATE`, and of the touch.
        point, normal, force: (m, 3) point [m], normal out of the link, and force [N] on it.
        torsion: (m,) [N m] torque about the normal.
        share: (m,) of the full force.
    """

    frame: Int[np.ndarray, " m"]
    touch: Int[np.ndarray, " m"]
    point: Float[np.ndarray, "m 3"]
    normal: Float[np.ndarray, "m 3"]
    force: Float[np.ndarray, "m 3"]
    torsion: Float[np.ndarray, " m"]
    share: Float[np.ndarray, " m"]

    def of(self, chosen: np.ndarray) -> RobotContacts:
        """Return some of the contacts."""
        return RobotContacts(*(getattr(self, each.name)[chosen] for each in fields(self)))

    def put(self, chosen: np.ndarray, others: RobotContacts) -> RobotContacts:
        """Return the contacts with others in place of those chosen."""
        made = {name: np.array(values) for name, values in vars(self).items()}
        for name, values in vars(others).items():
            made[name][chosen] = values
        return RobotContacts(**made)

    def wrenches(self, frames: int) -> Float[np.ndarray, "n 6"]:
        """Return the sum of all contacts in each frame about the link's origin, (frames, 6) [N, N m]."""
        total = np.zeros((frames, 6))
        np.add.at(total, self.frame, contact_wrenches(self.point, self.normal, self.force, self.torsion))
        return total


def planned_contacts(robot: LabRobot, touches: Sequence[RobotTouch]) -> RobotContacts:
    """Return the contacts of touches by their plan, exact where the touched part is rigid."""
    rows = list[tuple[np.ndarray, ...]]()
    for touch in touches:
        part, shares = robot.regions[touch.region].parts[touch.part], touch.shares()
        point, normal = part.places(np.array([touch.place]))
        full = directed_forces(normal, np.ones(1), np.array([touch.shear]), np.array([touch.azimuth]))
        force = touch.force * shares[:, None] * full / -np.sum(full * normal)
        count = len(shares)
        same = np.full(count, touch.number), *(np.tile(each, (count, 1)) for each in (point, normal))
        rows.append((touch.frames, *same, force, np.zeros(count), shares))
    if not rows:
        none = np.zeros(0, dtype=np.int64)
        return RobotContacts(none, none, *np.zeros((3, 0, 3)), *np.zeros((2, 0)))
    made = RobotContacts(*(np.concatenate(each) for each in zip(*rows, strict=True)))
    return made.of(np.argsort(made.frame, kind="stable"))


def pad_readings(
    pad: PadPatch, contacts: RobotContacts, radius: Float[np.ndarray, " m"], frames: int, seed: int
) -> tuple[Float[np.ndarray, "n k 3"], RobotContacts]:
    """Return counts (frames, k, 3) of a pad, and its contacts with the resultant and centre that act in truth."""
    into = pad.pose.inverse()
    tip = np.column_stack([radius, np.full(len(radius), _EDGE)])
    place, force = into.apply(contacts.point), into.rotate(contacts.force)
    drawn = Loads(frames, contacts.frame, contacts.touch, place, force, contacts.torsion, tip, contacts.share == 1.0)
    counts, truth = pad.skin.readings(drawn, seed)
    acting = pad.pose.apply(truth.place), pad.pose.rotate(truth.force)
    return counts, replace(contacts, point=acting[0], force=acting[1], torsion=truth.torque)


def sheet_readings(
    sheet: SheetPatch,
    model: PaperSheet,
    contacts: RobotContacts,
    radius: Float[np.ndarray, " m"],
    frames: int,
    rng: np.random.Generator,
) -> Float[np.ndarray, "n r c"]:
    """Return counts (frames, rows, columns) of a sheet."""
    into, count = sheet.pose.inverse(), len(contacts.frame)
    point, normal, force = into.apply(contacts.point), into.rotate(contacts.normal), into.rotate(contacts.force)
    none = np.zeros(0), np.zeros((0, 6))
    pressed = Physics(*none, contacts.frame, contacts.touch, point, normal, force, np.zeros(count))
    newtons, _ = sheet_loads(sheet.sheet, pressed, frames, modulus=MODULUS, radius=radius)
    return read_out(model, newtons, rng, rate=float(RATE)).channels[CELLS]
