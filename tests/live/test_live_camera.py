"""A camera as a source: OpenCV opens a video as it opens a device."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.live.camera import CameraSource
from palpate.live.source import Batch

cv2: Any = pytest.importorskip("cv2", reason="no OpenCV")
GREYS = (20, 120, 220)  # of the frames, far apart beside what the codec changes
NEAR = 6


@pytest.fixture
def video(tmp_path: Path) -> Path:
    file = tmp_path / "camera.avi"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*"MJPG"), 30.0, (64, 48))
    for grey in GREYS:
        writer.write(np.full((48, 64, 3), grey, dtype=np.uint8))
    writer.release()
    return file


def test_every_frame_comes_in_order_and_a_lost_camera_is_opened_again(video: Path) -> None:
    camera = CameraSource(str(video))
    assert camera.shape == (48, 64, 3)
    batch, seen, said = Batch(camera.shape, 4, np.uint8), list[float](), list[str]()
    camera.open()
    while len(seen) < 2 * len(GREYS):
        if camera.receive(batch, 0.01):
            seen.append(float(batch.values[0].mean()))
        said += camera.events()
    camera.close()
    assert np.abs(np.array(seen) - np.tile(GREYS, 2)).max() < NEAR
    assert "sends no more frames" in said[0]
    assert said[1].endswith("sends frames again")


def test_no_camera_is_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"the camera cannot be opened.*Write"):
        CameraSource(str(tmp_path / "none.avi"))
