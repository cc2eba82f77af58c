"""The live page takes what it is fed: poses, an arrow that ends where the force acts, curves of bounded length."""

import re
import signal
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from palpate.spatial.pose import Pose
from palpate_lab.viewer.live_probe import ARROW, SCALE, SHOWN, LiveProbe
from tests.support.browser import PATIENCE, chromium, until
from tests.support.pages import ellipsoid
from tests.support.program import program

pytest.importorskip("viser")


def test_what_is_fed_is_drawn() -> None:
    body = ellipsoid(500)
    middle, force = np.array([0.4, 0.0, 0.15]), np.array([0.0, 0.0, 7.0])
    with LiveProbe(body.vertices, body.faces, (0.2, 0.1, 0.05), 7.0, port=0) as page:
        assert page.address.startswith("http://127.0.0.1:")
        probe = Pose(np.diag([1.0, -1.0, -1.0]), middle + np.array([0.0, 0.0, 0.15]))
        arm = np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, 0.3]], [[0.0, 0.0, 0.3], [0.4, 0.0, 0.3]]]), (0.05, 0.04)
        for tick in range(SHOWN + 5):
            push = np.stack([middle, force])
            page.show(0.1 * tick, probe, Pose(np.eye(3), middle), push, (0.01, -0.02), "hold: force is held", arm)
        np.testing.assert_allclose(page._probe.position, [0.0, 0.0, 0.15 * SCALE], atol=1e-12)
        np.testing.assert_allclose(np.abs(page._probe.wxyz), [0.0, 1.0, 0.0, 0.0], atol=1e-12)
        np.testing.assert_allclose(page._arrow.points[0], [[0.0, 0.0, -7.0 * ARROW], [0.0, 0.0, 0.0]], atol=1e-6)
        time, turned, across, straight = page._angle.data
        assert (straight == 0.0).all()
        assert (page._force.data[2] == 7.0).all()
        for words in ("7.00 N", "hold", "force is held", "0.57°", "-1.15°"):
            assert words in page._words.content
        np.testing.assert_allclose(page._links[1].position, SCALE * (np.array([0.2, 0.0, 0.3]) - middle), atol=1e-12)
        assert len(time) == SHOWN
        np.testing.assert_allclose([turned[-1], across[-1]], np.degrees([0.01, -0.02]))


def test_a_run_is_watched_in_a_browser_and_ends_by_ctrl_c(tmp_path: Path) -> None:
    """`simulate phantom --view`: probe and tissue are drawn, the words and the picture go on; no file is left."""
    import imageio.v3

    asked = ("simulate", "phantom", "--seconds", "600", "-o", str(tmp_path / "run.mcap"), "--view", "--port", "0")
    with chromium() as browser, program(*asked) as run:
        assert run.stdout is not None
        address = next(found[0] for line in run.stdout if (found := re.search(r"http://127\.0\.0\.1:\d+\S+", line)))
        page = browser.new_page(viewport={"width": 900, "height": 600}, device_scale_factor=0.5)
        page.set_default_timeout(1e3 * PATIENCE)
        page.goto(address)
        page.wait_for_selector("canvas")

        def drawn() -> np.ndarray:
            return imageio.v3.imread(BytesIO(page.screenshot()))[..., :3].astype(int)

        def painted() -> bool:
            """The blue probe over the pink tissue."""
            red, green, blue = np.moveaxis(drawn(), -1, 0)
            return int((blue - red > 50).sum()) > 200 and int(((red - green > 15) & (green - blue > 8)).sum()) > 200

        until(painted, "no blue probe on pink tissue")
        page.get_by_text("hold", exact=False).first.wait_for()
        before = drawn()
        until(lambda: np.abs(drawn() - before).max() > 50, "the picture stands still")
        run.send_signal(signal.SIGINT)
        _, errors = run.communicate(timeout=120)
    assert run.returncode == 130, errors
    assert list(tmp_path.iterdir()) == []
