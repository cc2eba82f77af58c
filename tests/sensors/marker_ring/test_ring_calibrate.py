"""A ring that is calibrated from drawn images of a simulated barrel's presses: its model, its words and its view."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from palpate.sensors.marker_ring import view as views
from palpate.sensors.marker_ring.calibrate import RingTruth, calibrate_marker_ring
from palpate.sensors.marker_ring.estimator import RingEstimator
from palpate.sensors.marker_ring.files import of_marker_ring
from palpate.sensors.marker_ring.layer import RingLayer
from palpate.sensors.marker_ring.model import MarkerRing, RingBody
from palpate.signals.recording import IMAGE, Recording

pytest.importorskip("skfem")

from tests.support.drawn_markers import drawn, nominal_view
from tests.support.ring_presses import MARKERS, calibrated

STILL, TURN = 12, 0.4  # untouched images, and rad from the camera's frame to that of the truth's angles
Made = tuple[MarkerRing, np.ndarray]


@pytest.fixture(scope="module")
def made() -> Made:
    """The ring and its images."""
    rng, (_, pressed), view = np.random.default_rng(3), calibrated(), nominal_view()
    out = np.stack([np.cos(MARKERS), np.sin(MARKERS)], axis=1)
    along = out[:, ::-1] * [-1.0, 1.0]
    ways = pressed.displacements[..., :1] * out + pressed.displacements[..., 1:] * along
    ways = np.concatenate([np.zeros((STILL, 24, 2)), ways])
    places = [view.from_plane(view.rest + way) for way in ways]
    images = np.stack([drawn(each, noise=2.0, rng=rng if k < STILL else None) for k, each in enumerate(places)])
    each = (pressed.angle + TURN, pressed.depth, pressed.force, pressed.shear)
    truth = RingTruth(*(np.concatenate([np.full(STILL, np.nan), values]) for values in each))
    body = RingBody(0.055, 0.004, 24, camera=view.camera)
    blocks = [Recording(np.arange(len(images)) / 30.0, {IMAGE: images})]
    return calibrate_marker_ring(blocks, truth, body), images


def test_a_ring_is_turned_into_the_frame_of_the_truth_and_answers_as_from_exact_places(made: Made) -> None:
    ring, (response, pressed) = made[0], calibrated()
    off = np.exp(1j * (ring.view.angles[:, None] - MARKERS - TURN)).real.max(axis=0)
    assert np.degrees(np.arccos(np.minimum(off, 1.0))).max() < 0.5
    np.testing.assert_allclose(ring.response.largest, response.largest)
    np.testing.assert_allclose(ring.response.width, response.width, rtol=1e-3)
    words = dict(of_marker_ring(ring))
    assert words["ring"].startswith("24 red markers, radius 55.0 mm")
    assert words["calibrated"] == f"to {1e3 * pressed.depth.max():.3g} mm, {pressed.force.max():.3g} N; shear, too"


def test_a_stream_s_images_are_shown_four_times_a_second_while_somebody_looks(
    made: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    ring, images = made
    shown, now = list[tuple[float, np.ndarray]](), 0.0
    slots = np.zeros(2, dtype=[("values", np.uint8, images.shape[1:])])
    slots["values"] = images[:2]

    class Shown(RingLayer):
        def feed(self, frame: np.ndarray, pixels: np.ndarray) -> None:
            np.testing.assert_array_equal(frame, images[1])
            shown.append((now, pixels))

    feed = views._Frames(RingEstimator(ring), Shown(ring))
    monkeypatch.setattr(views, "time", SimpleNamespace(monotonic=lambda: now))
    for k in range(41):
        now = 0.05 * k
        feed(slots, k < 20)
    np.testing.assert_allclose([at for at, _ in shown], [0.0, 0.25, 0.5, 0.75])
    assert np.linalg.norm(shown[0][1] - ring.rest, axis=1).max() < 1.0
