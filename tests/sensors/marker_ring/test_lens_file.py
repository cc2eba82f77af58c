"""Lenses from the files that ROS and OpenCV write, and sentences on files that hold no fisheye."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from palpate.errors import InputError
from palpate.optical.fisheye import Fisheye
from palpate.sensors.marker_ring.lens_file import read_lens

LENS = Fisheye(230.0, 231.0, 479.5, 359.5, 0.02, -0.008, 0.002, -0.0003, 960, 720)
ROS = """\
image_width: 960
image_height: 720
camera_name: tip
camera_matrix:
  rows: 3
  cols: 3
  data: [230.0, 0.0, 479.5, 0, 231, 359.5, 0, 0, 1]
distortion_model: equidistant
distortion_coefficients:
  rows: 1
  cols: 4
  data: [0.02, -0.008, 0.002, -0.0003]
"""


def test_a_lens_of_ros(tmp_path: Path) -> None:
    (tmp_path / "tip.yaml").write_text(ROS)
    assert read_lens(tmp_path / "tip.yaml") == LENS


@pytest.mark.parametrize("turned", [False, True])
def test_a_lens_of_opencv(tmp_path: Path, turned: bool) -> None:
    bends = np.array([[LENS.k1, LENS.k2, LENS.k3, LENS.k4]])
    file = cv2.FileStorage(str(tmp_path / "tip.yml"), cv2.FILE_STORAGE_WRITE)
    for name, value in (("image_width", 960), ("image_height", 720), ("fisheye_model", 1)):
        file.write(name, value)
    file.write("camera_matrix", np.array([[LENS.fx, 0.0, LENS.cx], [0.0, LENS.fy, LENS.cy], [0.0, 0.0, 1.0]]))
    file.write("distortion_coefficients", bends.T if turned else bends)
    file.release()
    assert read_lens(tmp_path / "tip.yml") == LENS


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (ROS.replace("equidistant", "plumb_bob"), "'plumb_bob'.*Calibrate"),
        (ROS.replace("distortion_model: equidistant\n", ""), "distortion_model: equidistant"),
        (ROS.replace("-0.0003]", "-0.0003, 0]"), "yaml: .*distortion_coefficients"),
        (ROS.replace("width: 960", "width: .nan"), "yaml: .*image_width"),
        (ROS.replace("960", "-960"), "positive"),
        ("!!python/object/apply:os.getcwd []", "cannot be read"),
        ("[" * 10_000, "cannot be read"),
        ("", "fisheye.*Calibrate"),
    ],
)
def test_what_is_no_fisheye_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "tip.yaml").write_text(text)
    with pytest.raises(InputError, match=said):
        read_lens(tmp_path / "tip.yaml")
