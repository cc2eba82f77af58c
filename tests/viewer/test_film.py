"""Pictures for films: a ball is as large as geometry says, the nearer hides the farther, and a touch is drawn."""

from pathlib import Path

import numpy as np
import pytest

from palpate.viewer.film import SIZE, ScenePicture
from palpate.viewer.rendered import ViewPoint, rendered
from palpate.viewer.scene import prepare
from palpate.viewer.video import Video
from palpate_lab.simulation.shapes import EllipsoidBody
from tests.support.pages import ellipsoid, session

CAMERA = ViewPoint(np.array([0.0, -4.0, 0.0]), np.zeros(3), np.radians(45.0), (240, 180))


def test_a_ball_is_as_large_as_geometry_says() -> None:
    """Its rim lies at tan(asin(r/d)) before the camera; a pixel for the rim of pixels that lie across it."""
    vertices, faces = EllipsoidBody((1.0, 1.0, 1.0)).mesh(5_000)
    ball = rendered(CAMERA, vertices, vertices, faces, np.full((len(vertices), 3), 200, np.uint8))
    rows, columns = np.nonzero(np.isfinite(ball.depth))
    radius = np.tan(np.arcsin(1 / 4.0)) * 90 / np.tan(np.radians(22.5))
    for pixels, middle in ((rows, 90), (columns, 120)):
        assert (np.ptp(pixels) + 1) / 2 == pytest.approx(radius, abs=1.0)
        assert pixels.mean() == pytest.approx(middle, abs=0.5)
    assert ball.depth.min() == pytest.approx(3.0, abs=0.01)
    before, behind = CAMERA.seen(np.array([[0.0, -1.1, 0.0], [0.0, 1.1, 0.0]]))
    assert ball.visible(np.stack([before, behind]), 0.0).tolist() == [True, False]


def test_up_is_up_and_right_is_right() -> None:
    """Looking along +y: x goes right, z goes up, rows go down."""
    right, up = CAMERA.seen(np.array([[0.5, 0.0, 0.0], [0.0, 0.0, 0.5]]))
    assert right[0] > 120 + 1
    assert right[1] == pytest.approx(90)
    assert up[1] < 90 - 1


def test_a_touch_is_drawn_while_it_lasts() -> None:
    """The arrow is the only thing of its blue above the curve; the same moment gives the same pixels."""
    pytest.importorskip("cv2")
    pictures = ScenePicture(prepare(ellipsoid(500), session(), "session"))
    assert len(pictures.times) == pytest.approx(4.0 * 25, abs=1)

    def blue(seconds: float) -> int:
        top = pictures.draw(seconds)[100:540].astype(int)
        return int(np.count_nonzero((top[..., 0] - top[..., 2] > 80) & (top[..., 2] < 40)))

    assert blue(0.2) == 0
    assert blue(2.0) > 200
    picture = pictures.draw(2.0)
    assert picture.shape == (SIZE[1], SIZE[0], 3)
    assert np.array_equal(picture, pictures.draw(2.0))


def test_a_video_that_is_closed_has_every_picture(tmp_path: Path) -> None:
    """As OpenCV reads it again while the `Video` still exists; colours are lossy."""
    cv2 = pytest.importorskip("cv2")
    video, shades = Video(tmp_path / "film.mp4", (64, 48), 10), [[40, 0, 200], [120, 90, 0], [200, 30, 60]]
    for shade in shades:
        video.add(np.full((48, 64, 3), shade, np.uint8))
    video.close()
    read = cv2.VideoCapture(str(tmp_path / "film.mp4"))
    found = np.array([read.read()[1] for _ in shades])
    assert (found.shape, read.read()[0]) == ((3, 48, 64, 3), False)
    assert np.abs(found.mean(axis=(1, 2)) - shades).max() < 12
