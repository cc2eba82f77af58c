"""The live page takes what it is fed: poses, an arrow that ends where the force acts, curves of bounded length."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.spatial.pose import Pose
from palpate.viewer.live_probe import ARROW, SCALE, SHOWN, LiveProbe
from tests.support.pages import ellipsoid

pytest.importorskip("viser")


def test_what_is_fed_is_drawn() -> None:
    body = ellipsoid(500)
    middle, force = np.array([0.4, 0.0, 0.15]), np.array([0.0, 0.0, 7.0])
    with LiveProbe(body.vertices, body.faces, (0.2, 0.1, 0.05), port=0) as page:
        assert page.address.startswith("http://127.0.0.1:")
        probe = Pose(np.diag([1.0, -1.0, -1.0]), middle + np.array([0.0, 0.0, 0.15]))
        for tick in range(SHOWN + 5):
            push = np.stack([middle, force])
            page.show(0.1 * tick, probe, Pose(np.eye(3), middle), push, (0.01, -0.02), "hold")
        np.testing.assert_allclose(page._probe.position, [0.0, 0.0, 0.15 * SCALE], atol=1e-12)
        np.testing.assert_allclose(np.abs(page._probe.wxyz), [0.0, 1.0, 0.0, 0.0], atol=1e-12)
        np.testing.assert_allclose(page._arrow.points[0], [[0.0, 0.0, -7.0 * ARROW], [0.0, 0.0, 0.0]], atol=1e-6)
        time, turned, across = page._angle.data
        assert len(time) == SHOWN
        np.testing.assert_allclose([turned[-1], across[-1]], np.degrees([0.01, -0.02]))
