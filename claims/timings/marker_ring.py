"""From a decoded frame of a marker ring to contacts, beside the plain chain of OpenCV over the whole frame."""

from collections.abc import Iterator
from time import process_time

import numpy as np

from claims.row import Row
from palpate.opencv import opencv
from palpate.optical.fisheye import Fisheye
from palpate.sensors.marker_ring.calibrate import RingTruth, calibrate_marker_ring
from palpate.sensors.marker_ring.estimator import RingEstimator
from palpate.sensors.marker_ring.model import MarkerRing, RingBody
from palpate.signals.recording import IMAGE, Recording
from palpate_lab.simulation.ring_session import Protocol, RingSession, RingUnit, Touching, calibration_run, touching_run

ASKED, PAPER, ROUNDS = 1000.0, "18 to 23", 7  # frames a second, and the paper's on its board


def by_opencv(frames: np.ndarray) -> int:
    """Hue, saturation and value, a filter of red, connected components: centroids, neither labels nor contacts."""
    cv2, found = opencv(), 0
    for frame in frames:
        hsv = cv2.cvtColor(frame, cv2.COLOR_BGR2HSV)
        mask = cv2.inRange(hsv, (0, 80, 60), (12, 255, 255)) | cv2.inRange(hsv, (168, 80, 60), (180, 255, 255))
        found += cv2.connectedComponentsWithStats(mask)[0]
    return found


def _recording(session: RingSession) -> Recording:
    return Recording(session.time.copy(), {IMAGE: np.stack(list(session.frames()))})


def calibrated(unit: RingUnit, angles: int) -> MarkerRing:
    """From a plate and a tip at so many angles, three depths."""
    run, barrel, camera = (
        calibration_run(unit, Protocol(angles, (0.003, 0.006, 0.009), 0.01, 1, 1)),
        unit.barrel,
        unit.camera,
    )
    truth = RingTruth(*(each[:, 0].copy() for each in (run.angle, run.depth, run.force, run.shear)))
    lens = Fisheye(*camera.focal, *camera.middle, *camera.distortion, width=camera.width, height=camera.height)
    body = RingBody(barrel.radius, barrel.thickness, barrel.markers, lens)
    return calibrate_marker_ring([_recording(run)], truth, body)


def rows(small: bool) -> Iterator[Row]:
    """Both on the same frames in turns; of the rounds the median, in seconds of the processor."""
    unit = RingUnit.drawn(1, coarse=True)
    estimator = RingEstimator(calibrated(unit, 12))
    recording = _recording(touching_run(unit, Touching(touches=1 if small else 4, seed=1)))
    took: dict[str, list[float]] = {"ours": [], "opencv": []}
    for _ in range(2 if small else ROUNDS):  # the first compiles
        begin = process_time()
        estimator.run(recording)
        took["ours"].append(process_time() - begin)
        begin = process_time()
        by_opencv(recording.channels[IMAGE])
        took["opencv"].append(process_time() - begin)
    ours, chain = (len(recording) / float(np.median(each[1:])) for each in took.values())
    what = "from a decoded frame of 640 x 480 to contacts, frames a second on one core"
    got = f"{ours:,.0f} (OpenCV's chain to centroids alone {chain:,.0f}; the paper on its board {PAPER} Hz)"
    yield Row(what, f">= {ASKED:,.0f}", got, None if small else ours >= ASKED)
