"""Contacts made of numbers that are all different, and what follows of them, written out."""

from dataclasses import dataclass

import numpy as np

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ContactEstimate, Status
from tests.support.pages import BODY, tangents

RATE, START = 128.0, 3.0  # Hz, s: sums of them are exact
STRONG = 1.7  # times its usual force a touch has at its peak
FREE = {  # statuses between touches -> rows
    Status.NO_CONTACT: 97,
    Status.TOO_LIGHT: 13,
    Status.OFF_SURFACE: 7,
    Status.IMPLAUSIBLE: 11,
    Status.SATURATED: 17,
    Status.INVALID: 3,
    Status.NO_POSE: 2,
}
FEATURES = ("area", "load", "peak", "pressure", "axis_long", "axis_short", "angle", "cells", "row", "column")
UNITS = (1e-4, 1.0, 1e3, 1e3, 1e-3, 1e-3, 0.01, 1.0, 1.0, 1.0)  # one that a person uses, of each, in SI


@dataclass(frozen=True)
class Felt:
    """One touch: from sample `first` on, `count` samples, which slides once; `late` of them are ambiguous."""

    first: int
    count: int
    force: float
    turn: float
    late: int
    number: int

    @property
    def peak_row(self) -> int:
        """Its row with the largest force."""
        return self.first + self.count - 4 - self.number

    @property
    def normal(self) -> np.ndarray:
        """Outward, at its place."""
        return BODY.normals(self.at[None])[0]

    @property
    def at(self) -> np.ndarray:
        """[m] where it ends up."""
        ray = np.array([[np.cos(self.turn), np.sin(self.turn), 0.3 + 0.1 * self.number]])
        return BODY.on_ray(ray)[0]

    @property
    def slid(self) -> float:
        """[m] along the surface."""
        return 1e-3 * (1.0 + 0.37 * self.number)

    @property
    def deviations(self) -> np.ndarray:
        """[m] along both tangents."""
        return np.array([4.3e-4, 2.2e-4]) * (1.0 + 0.6 * self.number)

    @property
    def torque(self) -> float:
        """[N m] about the normal."""
        return 0.0113 + 0.0057 * self.number

    @property
    def features(self) -> np.ndarray:
        """As FEATURES, in SI."""
        return (3.0 + 1.3 * np.arange(len(FEATURES)) + 31.0 * self.number) * UNITS

    def time(self, row: int) -> float:
        """[s] of a row."""
        return START + row / RATE


TOUCHES = (Felt(40, 30, 2.3, 0.4, 3, 0), Felt(110, 50, 4.1, 1.9, 10, 1), Felt(200, 40, 3.2, 3.7, 6, 2))


def felt() -> Contacts:
    """The touches, one row a sample, with other statuses between them."""
    count = sum(FREE.values()) + sum(each.count for each in TOUCHES)
    columns = {name: np.full((count, *shape), np.nan) for name, shape in (("p", (3,)), ("n", (3,)), ("c", (3, 3)))}
    torque, features = np.full(count, np.nan), np.full((count, len(FEATURES)), np.nan)
    force, status, identity = np.full((count, 3), np.nan), np.zeros(count, np.int8), np.zeros(count, np.int64)
    for each in TOUCHES:
        rows = slice(each.first, each.first + each.count)
        along, across = (axis[0] for axis in tangents(each.normal[None]))
        columns["p"][rows], columns["n"][rows] = each.at, each.normal
        columns["p"][each.first : each.first + 13] -= each.slid * along
        wide = each.deviations[:, None] * [along, across]
        columns["c"][rows] = wide.T @ wide
        force[rows], torque[rows], features[rows] = -each.force * each.normal, each.torque, each.features
        force[each.peak_row] *= STRONG
        status[rows.stop - each.late : rows.stop], identity[rows] = Status.AMBIGUOUS, each.number + 1
    between = np.flatnonzero(identity == 0)
    status[between] = np.concatenate([np.full(n, kind) for kind, n in FREE.items()])
    light = between[status[between] <= Status.TOO_LIGHT]
    force[light] = [0.0, 0.011, 0.023]
    candidates = (identity > 0).astype(np.int64) + (status == Status.AMBIGUOUS)
    place, normal, covariance = columns.values()
    estimate = ContactEstimate(place, normal, force, torque, covariance, np.full(count, np.nan), candidates, status)
    named = {name: features[:, k] for k, name in enumerate(FEATURES)}
    return Contacts(np.arange(count), START + np.arange(count) / RATE, identity, estimate, named)


def known() -> dict[str, np.ndarray]:
    """Of each touch what `Events` call so, in SI."""
    ends = [each.time(each.first + each.count - 1) for each in TOUCHES]
    share = [1.0 + (STRONG - 1.0) / each.count for each in TOUCHES]
    of = {
        "start": [each.time(each.first) for each in TOUCHES],
        "end": ends,
        "point": [each.at for each in TOUCHES],
        "normal": [each.normal for each in TOUCHES],
        "peak_force": [STRONG * each.force for each in TOUCHES],
        "peak_time": [each.time(each.peak_row) for each in TOUCHES],
        "mean_force": [each.force * more for each, more in zip(TOUCHES, share, strict=True)],
        "deviation": [each.deviations.max() for each in TOUCHES],
        "slid": [each.slid for each in TOUCHES],
        "samples": [each.count for each in TOUCHES],
        "ambiguous": [each.late / each.count for each in TOUCHES],
        "identity": [each.number + 1 for each in TOUCHES],
    }
    features = {name: [each.features[k] for each in TOUCHES] for k, name in enumerate(FEATURES)}
    return {name: np.array(values) for name, values in (of | features).items()}
