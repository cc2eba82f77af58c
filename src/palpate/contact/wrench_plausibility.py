"""Check whether the wrenches of a log fit the body on which they are located."""

from __future__ import annotations

from palpate.contact.contacts import Contacts
from palpate.contact.locate import Locator
from palpate.contact.plausibility import RequiredBounds, lines_of_action, never_at_rest
from palpate.contact.surface_wrenches import SurfaceWrenches
from palpate.signals.recording import Recording
from palpate.spatial.pose import Pose

__all__ = ["WrenchPlausibility"]


class WrenchPlausibility:
    """Check of the wrenches of an estimator by some samples of a log.

    Args:
        locator: on the surface.
        wrenches: turns readings of the sensor into wrenches about the surface's frame.
        mount: T_sensor_surface.
    """

    def __init__(self, locator: Locator, wrenches: SurfaceWrenches, mount: Pose) -> None:
        self._locator, self._wrenches, self._mount = locator, wrenches, mount

    @property
    def size(self) -> float:
        """Size of the body [m]."""
        return self._locator.surface.size

    def required_bounds(self, contacts: Contacts) -> RequiredBounds:
        """Return the friction and torsion that the contacts would need, as `RequiredBounds`."""
        return RequiredBounds.of(contacts, (self._locator.friction, self._locator.torsion), self.size)

    def warnings(self, recording: Recording) -> list[str]:
        """Return warnings of wrong units, bias or mounting, a list of sentences or [].

        Raises:
            InputError: a channel is missing or has another shape.
        """
        surface = self._locator.surface
        wrenches = self._wrenches.unfiltered(recording).wrench
        sensed = wrenches @ self._mount.wrench_matrix().T  # saturated ones too: a wrong unit saturates a sensor
        judged = (
            lines_of_action(sensed, self._mount.apply(surface.centre), surface.size).doubt,
            never_at_rest(sensed, self._locator.on),
        )
        return [doubt for doubt in judged if doubt]
