"""Frames of the ring: OpenCV's own fisheye projects the same, and what is drawn is seen where it is."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float, UInt8

from palpate.errors import InputError
from palpate_lab.simulation.ring_camera import Look, RenderedCamera, RingCamera

cv2 = pytest.importorskip("cv2")

CLEAN = Look(noise=0.0, blur=0.0, vignette=0.0, shadow=0.0, quality=None)
TURN = 2.0 * np.pi * np.arange(24) / 24
RING = np.stack([0.051 * np.cos(TURN), 0.051 * np.sin(TURN), 0 * TURN], axis=-1)


def _discs(radius: float = 0.0015) -> Float[np.ndarray, "24 32 3"]:
    """Discs that lie on the cylinder."""
    around = 2.0 * np.pi * np.arange(32) / 32
    theta = TURN[:, None] + radius / 0.051 * np.cos(around)
    z = np.broadcast_to(radius * np.sin(around), theta.shape)
    return np.stack([0.051 * np.cos(theta), 0.051 * np.sin(theta), z], axis=-1)


def _seen(frame: UInt8[np.ndarray, "h w 3"], camera: RingCamera) -> Float[np.ndarray, "24 2"]:
    """The plain way: a threshold of hue, saturation and value, and the blobs' centroids, nearest to each marker."""
    hsv = cv2.cvtColor(frame, cv2.COLOR_BGR2HSV)
    mask = cv2.inRange(hsv, (0, 110, 60), (12, 255, 255)) | cv2.inRange(hsv, (168, 110, 60), (180, 255, 255))
    _, _, stats, centres = cv2.connectedComponentsWithStats(mask)
    kept = centres[1:][stats[1:, cv2.CC_STAT_AREA] >= 8]
    apart = np.linalg.norm(kept[None] - camera.project(RING)[:, None], axis=-1)
    found = kept[apart.argmin(axis=1)]
    found[apart.min(axis=1) > 5.0] = np.nan
    return found


@pytest.mark.parametrize("seed", range(3))
def test_opencv_s_fisheye_projects_to_the_same_pixels(seed: int) -> None:
    camera = RingCamera.drawn(np.random.default_rng(seed))
    a, b = camera.tilt
    about_x = cv2.Rodrigues(np.array([a, 0.0, 0.0]))[0]
    turn = cv2.Rodrigues(np.array([0.0, b, 0.0]))[0] @ about_x @ np.diag([1.0, -1.0, -1.0])
    place = np.array([0.0, 0.0, 0.04]) + camera.offset
    matrix = np.array([[camera.focal[0], 0, camera.middle[0]], [0, camera.focal[1], camera.middle[1]], [0, 0, 1]])
    seen, _ = cv2.fisheye.projectPoints(
        RING[:, None], cv2.Rodrigues(turn)[0], -turn @ place, matrix, np.array(camera.distortion)
    )
    np.testing.assert_allclose(camera.project(RING), seen[:, 0], atol=1e-6)


def test_the_nominal_camera_sees_the_ring_the_right_way_round() -> None:
    """From above, x points right and y up, and rows count down."""
    right, up = RingCamera().project(np.array([[0.05, 0.0, 0.0], [0.0, 0.05, 0.0]]))
    assert right[0] > 450
    assert right[1] == pytest.approx(239.5)
    assert up[1] < 100
    assert up[0] == pytest.approx(319.5)


def test_a_marker_is_drawn_where_it_is() -> None:
    """Without blur and noise, by the centroid of the light: to the eighth of a pixel of the finer mask's edge."""
    camera = RingCamera.drawn(np.random.default_rng(3))
    frame = RenderedCamera(camera, CLEAN, np.random.default_rng(0)).frame([_discs()], 0.0)
    light = frame[:, :, 2].astype(float) - frame[0, 0, 2]
    for outline in camera.project(_discs()):
        true = _area_centre(outline)
        column, row = np.rint(true).astype(int)
        part = light[row - 12 : row + 13, column - 12 : column + 13]
        across, down = part.sum(axis=0) @ np.arange(-12, 13), part.sum(axis=1) @ np.arange(-12, 13)
        assert np.abs(np.array([column + across / part.sum(), row + down / part.sum()]) - true).max() < 0.06


def _area_centre(outline: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, "2"]:
    """Centroid of a polygon (the shoelace formula)."""
    after = np.roll(outline, -1, axis=0)
    cross = outline[:, 0] * after[:, 1] - after[:, 0] * outline[:, 1]
    return ((outline + after) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum())


def test_a_plain_pipeline_has_the_noise_that_the_setting_promises() -> None:
    """0.3 px an axis at noise 1, from 16 frames of 24 markers: some 700 degrees of freedom, and blobs that differ."""
    camera = RingCamera()
    photographer = RenderedCamera(camera, Look(), np.random.default_rng(1))
    seen = np.stack([_seen(photographer.frame([_discs()], 0.0), camera) for _ in range(16)])
    assert np.isfinite(seen).mean() > 0.99
    assert np.sqrt(np.nanmean(np.nanvar(seen, axis=0, ddof=1))) == pytest.approx(0.3, abs=0.05)


def test_hidden_markers_are_gone_and_blobs_are_added() -> None:
    camera = RingCamera()
    photographer = RenderedCamera(camera, CLEAN, np.random.default_rng(0))
    frame = photographer.frame([_discs()], 0.0, hidden=[3, 7], blobs=np.array([[320.0, 240.0, 6.0]]))
    gone = np.flatnonzero(np.isnan(_seen(frame, camera)[:, 0]))
    assert gone.tolist() == [3, 7]
    assert frame[240, 320, 2] > 150
    assert photographer.black().max() == 0


def test_a_shutter_that_stays_open_smears() -> None:
    camera = RingCamera()
    moved = _discs() + np.array([0.002, 0.0, 0.0])
    frame = RenderedCamera(camera, CLEAN, np.random.default_rng(0)).frame([_discs(), moved], 0.0)
    assert 60 < int(frame[:, :, 2].max()) <= 190
    middle = camera.project(np.array([[0.052, 0.0, 0.0]]))[0]
    assert np.abs(_seen(frame, camera)[0] - middle).max() < 1.0


def test_brightness_and_colour_are_those_of_the_look() -> None:
    camera = RingCamera()
    skin = {
        name: RenderedCamera(camera, replace(CLEAN, **change), np.random.default_rng(0)).frame([_discs()], 0.0)[5, 5]
        for name, change in {"plain": {}, "bright": {"brightness": 2.0}, "blue": {"balance": (2.0, 1.0, 1.0)}}.items()
    }
    assert np.abs(skin["bright"].astype(int) - 2 * skin["plain"].astype(int)).max() <= 1
    assert abs(int(skin["blue"][0]) - 2 * int(skin["plain"][0])) <= 1
    assert skin["blue"][2] == skin["plain"][2]


def test_hue_turns_as_opencv_counts_it() -> None:
    """OpenCV's hue is half a degree a step; red turned by 20 degrees is orange, ten steps up."""
    camera = RingCamera()
    column, row = np.rint(camera.project(RING)[0]).astype(int)
    for degrees in (20.0, -20.0):
        frame = RenderedCamera(camera, replace(CLEAN, hue=degrees), np.random.default_rng(0)).frame(
            [_discs(0.003)], 0.0
        )
        hue = int(cv2.cvtColor(frame, cv2.COLOR_BGR2HSV)[row, column, 0])
        assert ((hue + 90) % 180 - 90) == pytest.approx(degrees / 2, abs=2.5)


def test_without_opencv_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(InputError, match=r"palpate\[camera\]"):
        RenderedCamera(RingCamera(), CLEAN, np.random.default_rng(0))
