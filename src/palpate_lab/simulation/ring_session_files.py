"""Write a session of the marker ring as a laboratory would have it: a video, a rig, the lens, and the truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from palpate.errors import InputError
from palpate.opencv import opencv
from palpate_lab.simulation.ring_camera import RingCamera
from palpate_lab.simulation.ring_session import RATE, RingSession, RingUnit
from palpate_lab.simulation.tables import formatted, write_rows

Images = Literal["video", "folder"]
RIG = """# A ring of markers inside a barrel of silicone, seen by a fisheye camera. Lengths in metres.
[marker_ring]
radius = {radius}          # of the barrel outside, where the ring is
thickness = {thickness}        # of its wall
markers = {markers}{rings}
camera = "camera.toml"     # of the lens alone; how it stands in the barrel is found in calibration
"""
CAMERA = """# Kannala and Brandt's model as OpenCV's fisheye has it, in pixels; as a calibration by a board gives it.
kind = "camera"
width = {width}
height = {height}
fx = {focal[0]!r}
fy = {focal[1]!r}
cx = {middle[0]!r}
cy = {middle[1]!r}
k1 = {distortion[0]!r}
k2 = {distortion[1]!r}
k3 = {distortion[2]!r}
k4 = {distortion[3]!r}
"""
CALIBRATION = ("time", "angle_deg", "depth_mm", "force_n", "shear_n")
TOUCHES = ("time", "px", "py", "pz", "nx", "ny", "nz", "fx", "fy", "fz", *CALIBRATION[1:])


def _nothing(_: int, __: float) -> None:
    """Ignore the progress."""


def write_calibration_run(
    session: RingSession, folder: Path, *, images: Images = "video", watch: Callable[[int, float], None] = _nothing
) -> None:
    """Write the images, truth.csv with a row per image (NaN where nothing touches), rig.toml and camera.toml.

    Args:
        session: session of one contact at a time.
        folder: created if it does not exist.
        images: frames.avi (Motion JPEG), or frames/000000.jpg and so on.
        watch: function called with the number of images written, and the share that is done.

    Raises:
        InputError: OpenCV is not installed, or a file cannot be written.
        FileExistsError: the folder has frames/ already.
    """
    _write_unit(session.unit, folder)
    numbers = np.column_stack([session.time, _units(session)[:, 0]])
    write_rows(folder / "truth.csv", CALIBRATION, formatted(numbers, ".6f"))
    _write_frames(session, folder, images, watch)


def write_touching_run(
    session: RingSession, folder: Path, *, images: Images = "video", watch: Callable[[int, float], None] = _nothing
) -> None:
    """Write a session as `write_calibration_run` does, with truth.csv of a row per contact and image.

    The rows have point, normal and force on the skin.

    Raises:
        InputError: OpenCV is not installed, or a file cannot be written.
        FileExistsError: the folder has frames/ already.
    """
    _write_unit(session.unit, folder)
    rows, contacts = np.nonzero(np.isfinite(session.angle))
    angle, zero = session.angle[rows, contacts], np.zeros(len(rows))
    out = np.stack([np.cos(angle), np.sin(angle), zero], axis=-1)
    along = np.stack([-np.sin(angle), np.cos(angle), zero], axis=-1)
    inward, shear = session.force[rows, contacts][:, None], session.shear[rows, contacts][:, None]
    place, force = session.unit.barrel.radius * out, shear * along - inward * out
    numbers = np.column_stack([session.time[rows], place, out, force, _units(session)[rows, contacts]])
    write_rows(folder / "truth.csv", TOUCHES, formatted(numbers, ".6f"))
    _write_frames(session, folder, images, watch)


def _units(session: RingSession) -> np.ndarray:
    """Return angle [deg], depth [mm], force and shear [N] of every contact, (n, k, 4)."""
    return np.stack([np.degrees(session.angle), 1e3 * session.depth, session.force, session.shear], axis=-1)


def _write_unit(unit: RingUnit, folder: Path) -> None:
    """Write the rig by the drawing, and the lens, but nothing that only a simulation knows."""
    folder.mkdir(parents=True, exist_ok=True)
    barrel = unit.barrel
    rings = f"               # in each ring\nrings = {list(barrel.rings)}   # their heights, towards the camera"
    more = rings if len(barrel.rings) > 1 else ""
    rig = RIG.format(radius=barrel.radius, thickness=type(barrel).thickness, markers=barrel.markers, rings=more)
    (folder / "rig.toml").write_text(rig, encoding="utf-8")
    camera: RingCamera = unit.camera
    (folder / "camera.toml").write_text(CAMERA.format(**vars(camera)), encoding="utf-8")


def _write_frames(session: RingSession, folder: Path, images: Images, watch: Callable[[int, float], None]) -> None:
    """Write the images, compressed once only, by the writer of the file."""
    cv2, look = opencv(), session.unit.look
    quality = 95 if look.quality is None else look.quality
    frames = session.frames(replace(look, quality=None))
    if images == "folder":
        (folder / "frames").mkdir()
        for at, frame in enumerate(frames):
            path = folder / "frames" / f"{at:06d}.jpg"
            if not cv2.imwrite(str(path), frame, [cv2.IMWRITE_JPEG_QUALITY, quality]):
                hint = "Check the folder and the free space."
                raise InputError("could not be written.", where=str(path), hint=hint)
            watch(at + 1, (at + 1) / len(session.time))
        return
    path, camera = folder / "frames.avi", session.unit.camera
    code = cv2.VideoWriter_fourcc(*"MJPG")
    writer = cv2.VideoWriter(str(path), cv2.CAP_OPENCV_MJPEG, code, RATE, (camera.width, camera.height))
    if not writer.isOpened():
        what = "OpenCV cannot open this file to write a video (Motion JPEG)."
        raise InputError(what, where=str(path), hint="Check the folder and the free space.")
    try:
        writer.set(cv2.VIDEOWRITER_PROP_QUALITY, quality)
        for at, frame in enumerate(frames):
            writer.write(frame)
            watch(at + 1, (at + 1) / len(session.time))
    finally:
        writer.release()
