"""Make images of a marker ring: a barrel by finite elements, seen by a fisheye camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate_lab.benchmark.task import MadeTask, TaskTruth
from palpate_lab.simulation.ring_camera import Look
from palpate_lab.simulation.ring_session import Protocol, RingUnit, Touching, calibration_run, touching_run
from palpate_lab.simulation.ring_session_files import write_calibration_run, write_touching_run

LEAST = 0.2  # N: a frame with a lighter contact is not judged
QUALITY = 50  # of JPEG: 20 kB a frame
DEPTHS = (0.003, 0.006, 0.009)  # m: of the calibration


def marker_ring(folder: Path, rng: np.random.Generator, *, small: bool) -> MadeTask:
    """Make images of one to three contacts at once on the barrel, still or rolling, and a calibration of it.

    Returns a `MadeTask`; the files are written into `folder`.

    Raises:
        InputError: scikit-fem or OpenCV is not installed.
    """
    seed = int(rng.integers(2**31))
    unit = RingUnit.drawn(seed, coarse=True, look=Look(quality=QUALITY))
    write_calibration_run(
        calibration_run(unit, Protocol(12, DEPTHS, hold=1, pause=1)), folder / "calibration", images="folder"
    )
    session = touching_run(unit, Touching(touches=2 if small else 6, most=3, seed=seed))
    write_touching_run(session, folder, images="folder")
    rig = (folder / "rig.toml").read_text(encoding="utf-8")
    (folder / "rig.toml").write_text(f'{rig}model = "ring.toml"\n', encoding="utf-8")
    touched = np.isfinite(session.angle)
    light: np.ndarray = np.any(touched & (np.nan_to_num(session.force) < LEAST), axis=1, keepdims=True)
    frame, which = np.nonzero(touched & ~light)
    angle, inward, shear = (values[frame, which] for values in (session.angle, session.force, session.shear))
    outward = np.stack([np.cos(angle), np.sin(angle), np.zeros(len(frame))], axis=1)
    along = np.stack([-outward[:, 1], outward[:, 0], outward[:, 2]], axis=1)
    near = np.convolve(touched.any(axis=1), np.ones(3), mode="same") > 0.5
    truth = TaskTruth.of(
        frame,
        unit.barrel.radius * outward,
        shear[:, None] * along - inward[:, None] * outward,
        np.flatnonzero(~near),
    )
    return MadeTask(
        "marker_ring",
        "a soft barrel with a ring of red markers inside, seen by a fisheye camera and pressed by up to three round "
        f"tips at once, some of them rolling; frames with a contact below {LEAST:g} N are not judged. A contact is a "
        "place on the ring: the point is the centre of pressure, on the circle of the barrel's radius in z = 0",
        "of the barrel: z along its axis, z = 0 where the ring is; x is where the calibration's angles begin",
        len(session.time),
        3,
        {
            "frames/": "000000.jpg and so on: a sample is an image, 30 a second; the first second is untouched",
            "calibration/frames/": "the same unit pressed by one body at a time",
            "calibration/truth.csv": "a row a frame: time, angle, depth, force and shear; nan where nothing touches",
            "camera.toml": "the lens (Kannala and Brandt)",
            "rig.toml": "radius, wall and count of markers, as a rig of Palpate",
        },
        truth,
        {"radius": unit.barrel.radius, "rest": 1.0, "markers": unit.barrel.markers},
    )
