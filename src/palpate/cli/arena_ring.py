"""The skins of robots in the arena: a unit calibrated in memory, and what it feels by images or by markers alone."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from palpate.calibration.marker_ring.calibrate import RingTruth, calibrate_marker_ring
from palpate.contact.ring_estimator import RingEstimator
from palpate.sensors.fisheye import Fisheye
from palpate.sensors.marker_ring import MarkerRing, RingBody
from palpate.sensors.recording import IMAGE, Recording
from palpate.simulation.arena.camera import SwiftCamera
from palpate.simulation.arena.skin import RingSkin, disc_points
from palpate.simulation.ring_session import Protocol, RingSession, RingUnit, calibration_run

__all__ = ["PROTOCOL", "MarkerSense", "arena_ring"]

DEPTHS = (0.002, 0.005, 0.008, 0.012)  # m: up to 7.6 N of a wall, 3.6 N of an edge
PROTOCOL = Protocol(16, DEPTHS, tip=0.004, hold=1, pause=1, kinds=("plate", "cylinder"))  # what robots meet
BLOCK = 32  # frames in memory at once


def arena_ring(unit: RingUnit, protocol: Protocol = PROTOCOL) -> MarkerRing:
    """A unit of the arena, calibrated on quick frames of its own camera.

    Args:
        unit: that is calibrated.
        protocol: which presses.
    """
    session, barrel, camera = calibration_run(unit, protocol), unit.barrel, unit.camera
    truth = RingTruth(*(getattr(session, name)[:, 0] for name in ("angle", "depth", "force", "shear")))
    lens = Fisheye(*camera.focal, *camera.middle, *camera.distortion, width=camera.width, height=camera.height)
    body = RingBody(barrel.radius, barrel.thickness, barrel.markers, lens)
    return calibrate_marker_ring(_frames(session), truth, body)


def _frames(session: RingSession) -> Iterator[Recording]:
    """The frames of a session as the arena's camera sees them."""
    unit = session.unit
    camera = SwiftCamera(unit.camera, unit.look, np.random.default_rng([unit.seed, 42]))
    points = disc_points(unit.barrel, np.concatenate([session.markers[:, :, None], session.discs], axis=2))
    for first in range(0, len(points), BLOCK):
        block = slice(first, first + BLOCK)
        frames = np.stack([camera.frame(each).copy() for each in points[block]])
        yield Recording(session.time[block], {IMAGE: frames})


class MarkerSense:
    """What a ring feels without an image: its markers are where the camera would see them, but for noise.

    Args:
        ring: calibrated.
        skin: of the same unit.
        camera: of the same unit.
        rng: of noise.
        noise: [px] deviation of a centroid along each axis; None: as in the calibration's images.
    """

    def __init__(
        self,
        ring: MarkerRing,
        skin: RingSkin,
        camera: SwiftCamera,
        rng: np.random.Generator,
        noise: float | None = None,
    ) -> None:
        self.estimator, self.camera, self.rng = RingEstimator(ring), camera, rng
        self.noise = ring.jitter if noise is None else noise
        self._offset = ring.rest - camera.places(skin.rest)  # a centroid of an image is a little off the outline's

    def update_into(
        self, time: float, points: Float[np.ndarray, "m 3 3"] | None, out: Float[np.ndarray, "rows width"]
    ) -> int:
        """Rows of `estimator.empty`, as from an image: how many.

        Args:
            time: [s].
            points: of `RingSkin.markers`; None: nothing is seen.
            out: is written.
        """
        if points is None:
            return self.estimator.update_markers_into(time, np.full_like(self._offset, np.nan), out)
        noise = self.noise * self.rng.standard_normal(self._offset.shape)
        return self.estimator.update_markers_into(time, self.camera.places(points) + self._offset + noise, out)
