"""The table of a camera's lens in a file, and its summary."""

from __future__ import annotations

from palpate.files.models.model import Lines, Model
from palpate.files.schema import Key, TableForm
from palpate.optical.fisheye import Fisheye

__all__ = ["CAMERA", "of_camera"]


def of_camera(camera: Fisheye) -> Lines:
    """Return two (name, text) pairs: the lens's image size [px] and focal lengths [px/rad]."""
    return [
        ("image", f"{camera.width} x {camera.height}"),
        ("focal length", f"{camera.fx:.5g}, {camera.fy:.5g} px/rad"),
    ]


CAMERA = Model(
    Fisheye,
    "a camera's lens",
    "A fisheye lens, in OpenCV's model.",
    "palpate calibrate camera",
    of_camera,
    {
        Fisheye: TableForm(
            {
                "fx": Key("px/rad at the centre"),
                "cx": Key("px, of the principal point"),
                "k1": Key("of the angle's powers [Kannala-Brandt], as OpenCV's fisheye model has them"),
                "width": Key("px, of the image"),
            }
        ),
    },
)
