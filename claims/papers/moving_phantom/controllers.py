"""The controller of a condition: the product's, or one with something left out, late, wrong or older in it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.contact import Locator, Status, WrenchEstimator
from palpate.contact.estimate import ROW
from palpate.control.align import AlignController
from palpate.sensors.force_torque.compensation import Compensation
from palpate.surfaces.mesh import Mesh
from palpate_lab.papers.iterative import fit_paraboloid, locate_iteratively

REGION = 0.010  # m about the tip, to which the paraboloid is fitted
OFF = 1.05  # of the payload's weight and centre


class Iterative(WrenchEstimator):
    """As it was, but the point is that of the iteration on a paraboloid; where that fails, the last one."""

    def __init__(self, like: WrenchEstimator, place: Float[np.ndarray, "3"]) -> None:
        super().__init__(like.locator, like.sensor, filter=like.filter, rate=like.rate)
        surface = like.locator.surface
        assert isinstance(surface, Mesh)
        self._paraboloid = fit_paraboloid(surface, place, REGION)
        self._last = np.array(place)

    def update_into(
        self,
        time: float,
        reading: ArrayLike,
        out: Float[np.ndarray, "*rows width"],
        rotation: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> int:
        """The contact's wrench (F, p x F + torque n) of the row, and its new point."""
        count = super().update_into(time, reading, out, rotation, acceleration)
        row = out if out.ndim == 1 else out[0]
        if row[ROW.status] <= Status.AMBIGUOUS:
            force, torque = row[ROW.force].copy(), row[ROW.torque] * row[ROW.normal]
            wrench = np.concatenate([force, np.cross(row[ROW.point], force) + torque])
            found = locate_iteratively(wrench, self._paraboloid, self._paraboloid.origin)
            if found.converged:
                self._last = found.point
            row[ROW.point] = self._last
        return count


class Uncompensated(AlignController):
    """Takes what the probe's own motion does to the sensor for contact."""

    def _acceleration(self, said: ArrayLike | None) -> Float[np.ndarray, " 3"]:
        super()._acceleration(None)
        self._felt[:], self._spent[:] = self._wrench, 0.0
        return np.zeros(3)


class Late(AlignController):
    """Takes speeds and accelerations from differences of the joints' feedback, a cycle of the robot late and more."""

    _history: Float[np.ndarray, "3 n"] | None = None

    def _acceleration(self, said: ArrayLike | None) -> Float[np.ndarray, " 3"]:
        fed = np.array(self._fed)
        if self._history is None:
            self._history = np.tile(fed, (3, 1))
        if not np.array_equal(self._history[0], fed):
            self._history = np.vstack([fed, self._history[:2]])
        newest, before, first = self._history
        period = self.servo.period
        speeds, accelerations = (newest - before) / period, (newest - 2.0 * before + first) / period**2
        self.arm.motion_into(newest, speeds, accelerations, self._centre, self._motion)
        wrenches = (self._wrench, self._felt)
        self._kernel.felt(self._motion, self._sensor, self._inertia, self._load, *wrenches, self._moved, self._spent)
        return self._moved


def _again(
    made: AlignController, kind: type[AlignController] = AlignController, estimator: WrenchEstimator | None = None
) -> AlignController:
    seen = made.estimator if estimator is None else estimator
    return kind(made.arm, seen, made.force, face=made.face, servo=made.servo, limits=made.limits, law=made.law)


def _wrench_axis(made: AlignController) -> AlignController:
    old = made.estimator
    locator = Locator(old.locator.surface, "wrench_axis")
    return _again(made, estimator=WrenchEstimator(locator, old.sensor, filter=old.filter, rate=old.rate))


def _misjudged(made: AlignController) -> AlignController:
    """Weight and centre of the payload 5 % too large; the biases as identified with the right ones."""
    old = made.estimator
    assert isinstance(old.sensor, Compensation)
    assert old.sensor.payload is not None
    payload = old.sensor.payload
    wrong = replace(payload, weight=OFF * payload.weight, center_of_mass=OFF * payload.center_of_mass)
    sensor = Compensation(old.sensor.sensor, wrong)
    locator = Locator(old.locator.surface)
    return _again(made, estimator=WrenchEstimator(locator, sensor, filter=old.filter, rate=old.rate))


VARIANTS: dict[str, Callable[[AlignController], AlignController]] = {
    "": lambda made: made,
    "wrench axis": _wrench_axis,
    "iterative": lambda made: _again(made, estimator=Iterative(made.estimator, made.face.place)),
    "accelerometer": lambda made: made,
    "no inertia": lambda made: _again(made, Uncompensated),
    "late inertia": lambda made: _again(made, Late),
    "payload": _misjudged,
}
