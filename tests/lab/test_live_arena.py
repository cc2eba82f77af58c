"""The arena's page takes what it is fed, runs no faster than it should, and stands still while somebody wants it."""

import threading

import numpy as np
import pytest

from palpate_lab.viewer import live_arena
from palpate_lab.viewer.live_arena import ARROW, LiveArena
from tests.support.arena_scenes import arena, scene

pytest.importorskip("viser")
pytest.importorskip("cv2")


def test_what_is_fed_is_drawn() -> None:
    with LiveArena(arena(), port=0) as page:
        assert page.address.startswith("http://127.0.0.1:")
        page.show(scene(0.0), now=True)
        page.show(scene(10.0, force=3.0, blind=True), now=True)
        first, second = page._robots
        np.testing.assert_allclose(first._frame.position, [0.9, 1.0, 0.0])
        np.testing.assert_allclose(second._frame.wxyz, [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
        tail, tip = first._arrows[0].points[0]
        np.testing.assert_allclose(tip[:2], [0.9, 1.0 + 0.055], atol=1e-6)  # at its left
        np.testing.assert_allclose(np.linalg.norm(tail - tip), 3.0 * ARROW, rtol=1e-5)
        assert not any(arrow.visible for arrow in (*first._arrows[1:], *second._arrows))
        assert first._trail.visible
        assert not second._trail.visible
        assert "1 of 2 arrived" in page._words.content
        assert "10.0 s" in page._words.content
        assert "blind" in page._words.content
        (pushed,) = page._blocks  # fixed ones stand for good
        np.testing.assert_allclose(pushed.position[:2], [2.0, 1.0])


def test_the_clock_of_the_run_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a clock that only sleep moves: ten seconds of the run at five times real time take two."""
    now = [100.0]
    monkeypatch.setattr(live_arena, "monotonic", lambda: now[0])
    monkeypatch.setattr(live_arena, "sleep", lambda seconds: now.__setitem__(0, now[0] + seconds + 1e-6))
    with LiveArena(arena(), port=0) as page:
        page._speed.value = 5.0
        for time in np.arange(1, 301) / 30:
            page.wait(float(time))
        assert now[0] - 100.0 == pytest.approx(2.0, abs=0.02)
        now[0] += 30.0  # the computer was busy: it does not hurry afterwards
        page.wait(10.5)
        before = now[0]
        page.wait(11.0)
        assert now[0] - before == pytest.approx(0.1, abs=0.06)


def test_it_stands_still_while_it_pauses() -> None:
    with LiveArena(arena(), port=0) as page:
        page.pause(True)
        assert page._button.label == "Resume"
        waiting = threading.Thread(target=page.wait, args=(0.01,))
        waiting.start()
        waiting.join(0.3)
        assert waiting.is_alive()
        page.pause(False)
        waiting.join(10.0)
        assert not waiting.is_alive()
