"""The skins of robots in the arena: a unit calibrated in memory, and its readings by images or by markers alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.contact.estimate import ROW, Status
from palpate.files.atomic import replacing
from palpate.files.models import read_model, write_model
from palpate.optical.fisheye import Fisheye
from palpate.optical.markers import FrameProblem
from palpate.sensors.marker_ring.calibrate import RingTruth, calibrate_marker_ring
from palpate.sensors.marker_ring.estimator import RingEstimator
from palpate.sensors.marker_ring.model import MarkerRing, RingBody
from palpate.signals.recording import IMAGE, Recording
from palpate_lab.cli.kept import kept
from palpate_lab.simulation.arena.camera import TableCamera
from palpate_lab.simulation.arena.skin import RingSkin, disc_points
from palpate_lab.simulation.ring_session import Protocol, RingSession, RingUnit, calibration_run

DEPTHS = (0.002, 0.005, 0.008, 0.012)  # m: up to 7.6 N of a wall, 3.6 N of an edge
PROTOCOL = Protocol(16, DEPTHS, tip=0.004, hold=1, pause=1, kinds=("plate", "cylinder"))  # what robots meet
Touches = Float[np.ndarray, "k 2"]
BLOCK = 32  # frames in memory at once


def arena_ring(unit: RingUnit, protocol: Protocol = PROTOCOL) -> MarkerRing:
    """Calibrate a unit of the arena on quickly drawn images of its camera, and return the `MarkerRing`.

    Args:
        unit: unit to calibrate.
        protocol: presses of the calibration.

    Raises:
        InputError: scikit-fem or OpenCV is not installed, or the presses do not determine the response.
    """
    session, barrel, camera = calibration_run(unit, protocol), unit.barrel, unit.camera
    truth = RingTruth(*(getattr(session, name)[:, 0] for name in ("angle", "depth", "force", "shear")))
    lens = Fisheye(*camera.focal, *camera.middle, *camera.distortion, width=camera.width, height=camera.height)
    body = RingBody(barrel.radius, barrel.thickness, barrel.markers, lens)
    return calibrate_marker_ring(_frames(session), truth, body)


def _frames(session: RingSession) -> Iterator[Recording]:
    """Yield the images of a session as the arena's camera sees them, `BLOCK` at a time."""
    unit = session.unit
    camera = TableCamera(unit.camera, unit.look, np.random.default_rng([unit.seed, 42]))
    points = disc_points(unit.barrel, np.concatenate([session.markers[:, :, None], session.discs], axis=2))
    for first in range(0, len(points), BLOCK):
        block = slice(first, first + BLOCK)
        frames = np.stack([camera.frame(each).copy() for each in points[block]])
        yield Recording(session.time[block], {IMAGE: frames})


@dataclass(frozen=True, eq=False)
class RingWear:
    """The skin of all robots in an arena: one made unit, its calibration, and tables of its deformation."""

    unit: RingUnit
    ring: MarkerRing
    skin: RingSkin

    @staticmethod
    def made(seed: int = 0, ring: MarkerRing | None = None) -> RingWear:
        """Return a `RingWear` of a unit of the coarse barrel, calibrated (seconds, once) if no calibration is given.

        Raises:
            InputError: scikit-fem or OpenCV is not installed.
        """
        unit = RingUnit.drawn(seed, coarse=True)
        skin = kept("arena_skin.npz", seed, lambda: RingSkin.built(unit), _write_skin, _read_skin)
        ring = ring or kept("arena_ring.toml", seed, lambda: arena_ring(unit), write_model, _read_ring)
        return RingWear(unit, ring, skin)


def _write_skin(path: Path, skin: RingSkin) -> None:
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **vars(skin))


def _read_skin(path: Path) -> RingSkin:
    with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
        found = {name: arrays[name] for name in arrays.files}
    for array in found.values():
        array.flags.writeable = False
    return RingSkin(**found)


def _read_ring(path: Path) -> MarkerRing:
    return read_model(path, MarkerRing)


class RingSense:
    """The sense of touch of one robot: true contacts deform its skin, the estimator gets images or marker positions.

    Without images the markers are where the camera would see them, with the calibration's noise of a centroid.

    Args:
        wear: skin of the robot.
        seed: seed of the noise.
        images: False for marker positions only.
        torn: True if a third of the markers is missing, on the right of the front.

    Attributes:
        frame: newest image; black without images.
    """

    def __init__(self, wear: RingWear, seed: Sequence[int], *, images: bool, torn: bool = False) -> None:
        self._wear, self._images, self._rng = wear, images, np.random.default_rng(seed)
        self.camera = TableCamera(wear.unit.camera, wear.unit.look, self._rng)
        self.estimator = RingEstimator(wear.ring)
        count = wear.unit.barrel.markers
        self._gone = list(range(count - count // 3, count)) if torn else []
        self._rows = self.estimator.empty(self.estimator.most)
        self._offset = wear.ring.rest - self.camera.places(wear.skin.rest)  # of a centroid from the outline's
        self._pixels = wear.ring.rest.copy()
        self.frame = self.camera.black()

    def look(self, truth: Float[np.ndarray, "k 5"], *, dark: bool = False) -> None:
        """Deform the skin by the true contacts, and update `frame` and the marker positions that `feel` uses.

        Args:
            truth: (k, 5) angle [rad], force [N], shear [N], depth [m] and kind of each true contact.
            dark: True if the camera sees nothing.
        """
        if self._images:
            self.frame = self.camera.black() if dark else self.camera.frame(self._wear.skin.markers(truth), self._gone)
            self.estimator.tracker.track(self.frame, self._pixels)
        elif dark:
            self._pixels[:] = np.nan
        else:
            places = self.camera.places(self._wear.skin.markers(truth)) + self._offset
            self._pixels[:] = places + self._wear.ring.jitter * self._rng.standard_normal(places.shape)
            self._pixels[self._gone] = np.nan

    def feel(self, time: float) -> Touches | None:
        """Return angle [rad] and force [N] of each contact since `look`, (k, 2); None if the skin gives no reading.

        Without contact it is (0, 2).
        """
        state = self.estimator.tracker.frame if self._images else FrameProblem.OK
        rows = self._rows[: self.estimator.update_markers_into(time, self._pixels, self._rows, state)]
        status = int(rows[0, ROW.status])
        if status == Status.INVALID:
            return None
        if status == Status.NO_CONTACT:
            return np.zeros((0, 2))
        felt = np.empty((len(rows), 2))
        felt[:, 0] = rows[:, ROW.length]  # the first feature
        felt[:, 1] = np.hypot(rows[:, ROW.force.start], rows[:, ROW.force.start + 1])
        return felt
