"""What an arm's vibration adds to a free wrench is its covariance, in motion only, and touches add hardly anything."""

import weakref
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.signals import Butterworth
from palpate.signals.recording import FORCE, ORIENTATION, POSITION, TORQUE, VIBRATION, Recording
from palpate.signals.vibration import Vibration
from tests.support.streams import pieces, shaken

NOISE = np.repeat([0.02, 0.001], 3)  # N, N m
ALONG = np.array([1.0, -2.0, 2.0, 0.05, 0.1, 0.0]) / 3.0  # N, N m: of a vibration of 1 N


def a_recording(added: np.ndarray, rate: float = 500.0) -> Recording:
    """Noise and what is added; the arm rests, turns by 30 degrees a second from 1/3 to 2/3 of the log, and rests."""
    count = len(added)
    time = np.arange(count) / rate
    angle = np.radians(30.0) * np.clip(time - time[count // 3], 0.0, time[count // 3])
    read = added + np.random.default_rng(5).normal(size=(count, 6)) * NOISE
    channels = {FORCE: read[:, :3], TORQUE: read[:, 3:], POSITION: np.zeros((count, 3))}
    return Recording(time, {**channels, ORIENTATION: Rotation.from_rotvec(np.outer(angle, [0, 1, 0])).as_quat()})


def vibration(recording: Recording, **options: object) -> np.ndarray:
    made = Vibration(np.diag(NOISE**2), **options)
    numbers = [block.channels[VIBRATION][:, 0] for block in made.stream(iter([recording]), Recording.wrenches)]
    return np.stack(made.covariances)[np.concatenate(numbers).astype(int)]


def a_tone(hertz: float, count: int = 6000, rate: float = 500.0) -> np.ndarray:
    return np.outer(np.sin(2 * np.pi * hertz * np.arange(count) / rate + 0.3), ALONG)


@pytest.mark.parametrize("hertz", [10.0, 23.0, 60.0])
def test_a_tone_has_half_its_square(hertz: float) -> None:
    """To 30 %: a cubic takes a quarter of the square of 10 Hz in the worst phase."""
    made = vibration(a_recording(a_tone(hertz)))
    expected = 0.5 * np.outer(ALONG, ALONG)
    scale = np.outer(np.abs(ALONG) + NOISE, np.abs(ALONG) + NOISE)
    assert np.abs((made[2200:3800] - expected) / scale).max() < 0.5 * 0.3
    assert not made[:1700].any()
    assert not made[4400:].any()


@pytest.mark.parametrize("rate", [50.0, 500.0, 2000.0])
def test_noise_does_not_vibrate(rate: float) -> None:
    assert not vibration(a_recording(np.zeros((6000, 6)), rate)).any()


def test_a_steady_touch_does_not_vibrate() -> None:
    """5 N from 2.5 s into the motion on, with edges of 50 ms: 30 times more than what is added around the edges."""
    time = np.arange(6000) / 500.0
    shape = np.clip(np.minimum(time - 5.0, 7.0 - time) / 0.05, 0.0, 1.0)
    touch = 5.0 * np.outer(shape, [0, 0, -1.0, 0, 0, 0])
    made = vibration(a_recording(touch))
    assert np.sqrt(made[:, 2, 2].max()) < 5.0 / 30
    assert not made[2650:3350].any()
    both = vibration(a_recording(touch + a_tone(23.0)))[2800:3200]  # whose windows around have no edge
    np.testing.assert_allclose(both, vibration(a_recording(a_tone(23.0)))[2800:3200], rtol=1e-6, atol=1e-9)


def test_a_filter_lets_its_share_through() -> None:
    filter, recording = Butterworth(20.0), a_recording(a_tone(25.0))
    kept = filter.gain(25.0, 500.0) ** 2
    ratio = vibration(recording, filter=filter, rate=500.0)[2200:3800] / vibration(recording)[2200:3800]
    assert 0.7 < (np.median(ratio[:, 0, 0]) / kept) < 1.3


def test_samples_that_cannot_be_used_take_no_part() -> None:
    """A window with such a sample has the vibration of those around it; without poses the arm is at rest."""
    whole = a_recording(a_tone(23.0))
    force = whole.channels[FORCE].copy()
    force[3000] = np.nan
    made = vibration(replace(whole, channels={**whole.channels, FORCE: force}))
    assert np.isfinite(made).all()
    assert 0.3 < made[3000, 2, 2] / vibration(whole)[3000, 2, 2] < 3.0
    lost = {**whole.channels, ORIENTATION: np.full((6000, 4), np.nan), POSITION: np.full((6000, 3), np.nan)}
    assert not vibration(replace(whole, channels=lost)).any()


def test_blocks_that_are_answered_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate.signals.vibration.ENOUGH", 200)
    given, held = list[weakref.ref[Recording]](), list[int]()
    blocks = (given.append(weakref.ref(block)) or block for block in pieces(shaken(9000), 100))
    for _ in Vibration(np.eye(6)).stream(blocks, Recording.wrenches):
        held.append(sum(each() is not None for each in given))
    assert max(held) < 30
