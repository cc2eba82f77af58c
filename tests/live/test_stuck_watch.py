"""A sensor that hangs in a live stream is reported, and its contacts are invalid until it measures again."""

from pathlib import Path

import numpy as np
from numpy.typing import DTypeLike

import palpate
from palpate.contact.estimate import ROW, Status
from palpate.live.live import Live
from palpate.live.source import Batch
from palpate.live.stuck_watch import EVERY, StuckWatch
from tests.support.live_rings import sphere_rig

RATE, COUNT = 1000.0, 6000


def test_a_hang_is_seen_within_two_looks_and_ends() -> None:
    wrenches = np.random.default_rng(1).normal(0.0, 0.01, (COUNT, 6))
    wrenches[3000:4000] = wrenches[3000]
    watch, stuck, events = StuckWatch(), np.zeros(COUNT, dtype=bool), dict[int, str]()
    for start in range(0, COUNT, 4):
        rows = slice(start, start + 4)
        if event := watch.add(np.arange(start, start + 4) / RATE, wrenches[rows]):
            events[start] = event
        stuck[rows] = bool(watch.stuck)
    found = np.flatnonzero(stuck)
    assert 3000 < found[0] < 3000 + 2 * EVERY * RATE + 20
    assert 4000 <= found[-1] < 4000 + EVERY * RATE + 4
    assert len(found) == found[-1] - found[0] + 1
    assert list(events.values()) == [
        "the wrench does not change: contacts are invalid until it does",
        "the wrench changes again",
    ]


def test_contacts_of_a_hanging_sensor_are_invalid(tmp_path: Path) -> None:
    wrenches = np.random.default_rng(1).normal(0.0, 0.01, (COUNT, 6))
    wrenches[3000:, 2] = 5.0  # at rest elsewhere, and pressed
    live = Live(palpate.load_rig(str(sphere_rig(tmp_path))), source=_Held(wrenches))
    status = np.concatenate([live.step(0.0).rows[:, ROW.status] for _ in range(COUNT // 100)])
    assert (status[:3000] != Status.INVALID).all()
    assert (status[3400:] == Status.INVALID).all()
    assert any("z of the force does not change" in event for event in live.events())


class _Held:
    """A source of given wrenches, a hundred at a time."""

    shape: tuple[int, ...] = (6,)
    dtype: DTypeLike = np.float64
    poses = False

    def __init__(self, wrenches: np.ndarray) -> None:
        self._wrenches, self._at = wrenches, 0

    def receive(self, batch: Batch, timeout: float) -> int:
        batch.values[:100] = self._wrenches[self._at : self._at + 100]
        batch.stamp[:100] = (self._at + np.arange(100)) * 1_000_000
        self._at += 100
        return 100

    def events(self) -> list[str]:
        return []

    def open(self) -> None: ...

    def close(self) -> None: ...
