"""A ring as `palpate live` makes it, of a sphere that is touched along a circle, without a device or an estimator."""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ROW, Status
from palpate.live.source import Batch
from palpate.live.stream_buffer import SlotForm, StreamBuffer

RADIUS = 0.05  # m
TURN = 400  # samples of a turn; in the last fifth of it nothing touches
SPREAD = 3e-4  # m

_RIG = """\
[surface]
kind = "sphere"
radius = 0.05

[force_torque]

[source]
kind = "replay"
address = "log.csv"
"""


def sphere_rig(folder: Path) -> Path:
    """The rig's file."""
    path = folder / "rig.toml"
    path.write_text(_RIG)
    return path


def sphere_ring(path: Path, features: tuple[str, ...] = ()) -> StreamBuffer:
    """An empty one."""
    form = SlotForm("force_torque", (6,), False, features, ROW.length + len(features), 1, wrenches=True)
    return StreamBuffer.make(path, form, 1 << 22)


def rows(first: int, count: int) -> np.ndarray:
    """(count, ROW.length): pressed by 2 to 6 N along a circle, no contact in the last fifth of each turn."""
    share = (first + np.arange(count)) % TURN / TURN
    turn, tilt = 2 * np.pi * share, 0.4
    normal = np.stack([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.full(count, np.sin(tilt))], axis=1)
    made = np.full((count, ROW.length), np.nan)
    touched = share < 0.8
    flat = np.eye(3) - normal[:, :, None] * normal[:, None, :]
    force = np.where(touched, 4.0 + 2.0 * np.sin(2 * np.pi * share * 3), 0.01)
    made[:, ROW.force] = -force[:, None] * normal
    made[touched, ROW.point], made[touched, ROW.normal] = RADIUS * normal[touched], normal[touched]
    made[:, ROW.covariance] = np.where(touched[:, None], (SPREAD**2 * flat).reshape(count, 9), np.nan)
    made[:, ROW.residual], made[:, ROW.candidates] = 0.0, touched
    made[:, ROW.status] = np.where(touched, Status.CONTACT, Status.NO_CONTACT)
    return made


def touches(first: int, count: int) -> Contacts:
    """The same as contacts, a second every 200 samples."""
    sample = first + np.arange(count)
    return Contacts.of_rows(sample, sample / 200.0, rows(first, count), ())


def answered(ring: StreamBuffer, count: int, lost: int = 0) -> None:
    """The next samples pass through a ring, received and answered."""
    batch = Batch((6,), count)
    batch.stamp[:], batch.lost[0] = time.time_ns(), lost
    first = ring.take_in(batch, count, np.zeros(count))
    ring.answer(rows(first, count), np.ones(count, dtype=np.int64))


def slots(found: Contacts, form: SlotForm) -> np.ndarray:
    """Contacts as slots of a ring, with an identity if the form has room for it."""
    nothing = np.full(len(found), np.nan)
    found = replace(found, features={name: found.features.get(name, nothing) for name in form.features})
    first = np.flatnonzero(np.diff(found.sample, prepend=found.sample[:1] - 1))
    made, made_rows = np.zeros(len(first), form.slot()), found.rows()[:, : form.width]
    made["number"], made["stamp"], made["ready"] = found.sample[first] + 1, np.rint(1e9 * found.time[first]), 1
    made["rows"] = np.diff(first, append=len(found))
    for slot, begin in zip(made, first.tolist(), strict=True):
        slot["contacts"][: slot["rows"]] = made_rows[begin : begin + slot["rows"]]
    return made
