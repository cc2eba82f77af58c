"""Identities: they stay through motion, gaps and meetings, and are never given twice."""

import numpy as np
import pytest

from palpate.contact import _track
from palpate.contact.taxel_settings import TaxelSettings
from palpate.errors import InputError


class Tracker:
    """The compiled tracker with its memory."""

    def __init__(self, reach: float = 0.012, speed: float = 0.5, patience: float = 0.3) -> None:
        self.limits = (reach, speed, patience)
        self.tracks = np.full((_track.TRACKS, _track.TRACK), -1.0)
        self.following = np.zeros(1, dtype=np.int64)

    def follow(self, time: float, points: np.ndarray) -> np.ndarray:
        """Identities of the contacts of one frame."""
        found = np.zeros(64, dtype=np.int64)
        _track.follow(time, points, len(points), self.tracks, self.following, *self.limits, found)
        return found[: len(points)]


def _place(x: float, y: float = 0.0) -> list[float]:
    return [x, y, 0.0]


def test_identities_stay_while_touches_cross_in_order_of_the_list() -> None:
    """Two touches pass each other 20 mm apart; the frames list them in turns."""
    tracker, seen = Tracker(), []
    for k in range(100):
        x = 0.001 * k
        points = np.array([_place(x), _place(0.1 - x, 0.02)])
        turn = points[::-1].copy() if k % 2 else points
        names = tracker.follow(0.02 * k, turn).copy()
        seen.append(names[::-1] if k % 2 else names)
    assert (np.array(seen) == seen[0]).all()
    assert seen[0][0] != seen[0][1]


def test_a_touch_lost_for_less_than_the_patience_keeps_its_name_and_a_new_one_gets_another() -> None:
    tracker = Tracker(patience=0.3)
    first = int(tracker.follow(0.0, np.array([_place(0.0)]))[0])
    tracker.follow(0.1, np.zeros((0, 3)))
    assert int(tracker.follow(0.2, np.array([_place(0.002)]))[0]) == first
    assert int(tracker.follow(1.0, np.array([_place(0.002)]))[0]) != first


def test_two_that_merge_for_a_moment_part_under_their_own_names() -> None:
    tracker = Tracker()
    apart = tracker.follow(0.0, np.array([_place(0.0), _place(0.03)])).copy()
    tracker.follow(0.02, np.array([_place(0.002), _place(0.028)]))
    merged = int(tracker.follow(0.04, np.array([_place(0.004)]))[0])
    assert merged == apart[0]
    again = tracker.follow(0.06, np.array([_place(0.006), _place(0.024)]))
    assert again.tolist() == apart.tolist()


def test_no_jump_further_than_reach_and_speed_allow() -> None:
    tracker = Tracker(reach=0.01, speed=0.5)
    first = int(tracker.follow(0.0, np.array([_place(0.0)]))[0])
    assert int(tracker.follow(0.02, np.array([_place(0.03)]))[0]) != first


def test_a_clock_that_runs_back_or_stops_names_anew_and_does_not_fail() -> None:
    tracker = Tracker()
    names = [int(tracker.follow(t, np.array([_place(0.0)]))[0]) for t in (0.0, float("nan"), 5.0, -3.0)]
    assert len(set(names)) == 4


@pytest.mark.parametrize(
    ("wrong", "right", "said"),
    [
        ({"on": 3.0, "off": 3.1}, {"on": 3.0, "off": 3.0}, r"off \(3\.1\) must be above 0 and at most on \(3\)"),
        ({"off": 0.0}, {"off": 1e-9}, r"off \(0\) must be above 0"),
        ({"on": np.inf}, {"on": 1e9}, "off .* must be"),
        ({"drift": 0.0}, {"drift": np.inf}, "drift must be positive"),
        ({"sure": -1e-9}, {"sure": 0.0}, "sure 0 or more"),
        ({"share": 1.0}, {"share": 0.0}, "share 0 or more and below 1"),
        ({"walk": -1.0}, {"walk": 0.0}, "walk must not be negative"),
        ({"walk": np.inf}, {"walk": 1.0}, "walk must not be negative"),
        ({"unequal": -1.0}, {"unequal": 0.0}, "unequal must not be negative"),
        ({"unequal": np.inf}, {"unequal": 1.0}, "unequal must not be negative"),
        ({"reach": 0.0}, {"reach": 1e-9}, "reach must be positive"),
        ({"speed": -1.0}, {"speed": 0.0}, "speed and patience 0 or more"),
        ({"patience": -1.0}, {"patience": 0.0}, "speed and patience 0 or more"),
    ],
)
def test_settings_are_bounded(wrong: dict[str, float], right: dict[str, float], said: str) -> None:
    assert TaxelSettings(**right)
    with pytest.raises(InputError, match=said):
        TaxelSettings(**wrong)
