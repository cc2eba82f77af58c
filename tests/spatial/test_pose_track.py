"""Between poses the sensor turns at constant speed; at a pose it is there; beyond a gap nobody knows.

Truth for the rotations is scipy's Slerp, for the positions numpy's interp.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from palpate.spatial.pose_track import PoseTrack, slerp

COUNT = 40
STAMPS = np.cumsum(np.random.default_rng(2).uniform(0.02, 0.2, COUNT))
TURNS = Rotation.random(COUNT, random_state=3).as_quat()  # of either sign
PLACES = np.random.default_rng(4).normal(size=(COUNT, 3))
TIMES = np.sort(np.append(np.random.default_rng(5).uniform(STAMPS[0], STAMPS[-1], 500), STAMPS))


def a_track(**settings: float) -> PoseTrack:
    track = PoseTrack(**settings)
    track.add(STAMPS, TURNS, PLACES)
    return track


def same(left: tuple[np.ndarray, np.ndarray], right: tuple[np.ndarray, np.ndarray]) -> None:
    """To the last bit."""
    np.testing.assert_array_equal(left[0], right[0])
    np.testing.assert_array_equal(left[1], right[1])


def test_between_poses_it_is_slerp_and_a_straight_line() -> None:
    quaternion, position = a_track().at(TIMES)
    off = Rotation.from_quat(quaternion) * Slerp(STAMPS, Rotation.from_quat(TURNS))(TIMES).inv()
    assert off.magnitude().max() < 1e-14  # rad: rounding of a few operations
    expected = np.column_stack([np.interp(TIMES, STAMPS, column) for column in PLACES.T])
    np.testing.assert_allclose(position, expected, atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-12, 1e-8, 1e-3, 1.0, 3.0, np.pi - 1e-9])
def test_slerp_of_any_angle_goes_the_share_of_the_way(angle: float) -> None:
    """Told by the closed form of a turn about one axis; the second quaternion with either sign."""
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    share = np.linspace(0.0, 1.0, 11)

    def turn(by: np.ndarray) -> np.ndarray:
        return np.column_stack([np.sin(by / 2)[:, None] * axis, np.cos(by / 2)])

    first, second = turn(np.zeros(11)), turn(np.full(11, angle))
    for sign in (1.0, -1.0):
        got = slerp(3.0 * first, 0.7 * sign * second, share)
        np.testing.assert_allclose(got, turn(share * angle), atol=1e-15, rtol=1e-13)


def test_at_its_own_stamp_a_pose_is_itself_whatever_its_length_and_neighbours() -> None:
    recorded = 1.005 * TURNS
    track = PoseTrack(max_gap=1e-9)  # every interval is a gap
    track.add(STAMPS, recorded, PLACES)
    same(track.at(STAMPS), (recorded, PLACES))


def test_a_pose_whose_neighbours_are_not_numbers_is_still_itself() -> None:
    track = PoseTrack()
    places = np.array([[np.nan] * 3, [1.0, 2.0, 3.0], [np.inf, 0.0, 0.0]])
    track.add(np.array([0.0, 0.1, 0.2]), TURNS[:3], places)
    same(track.at(np.array([0.0, 0.1, 0.2])), (TURNS[:3], places))
    quaternion, position = track.at(np.array([0.05, 0.15]))
    assert np.isfinite(quaternion).all()
    np.testing.assert_array_equal(np.isfinite(position), [[False] * 3, [False, True, True]])


def test_no_answer_beyond_the_ends_nor_in_a_gap_nor_at_no_time() -> None:
    track = PoseTrack(max_gap=0.25)
    track.add(np.array([0.0, 0.25, 0.51, 0.6]), TURNS[:4], PLACES[:4])
    times = np.array([-1e-9, 0.0, 0.1, 0.25, 0.26, 0.5, 0.51, 0.55, 0.6, 0.6 + 1e-9, np.nan, np.inf, -np.inf])
    known = np.array([0, 1, 1, 1, 0, 0, 1, 1, 1, 0, 0, 0, 0], dtype=bool)
    for answers in track.at(times):
        np.testing.assert_array_equal(np.isfinite(answers).all(axis=1), known)
        assert np.isnan(answers[~known]).all()


def test_an_empty_track_answers_nothing() -> None:
    quaternion, position = PoseTrack().at(np.arange(3.0))
    assert np.isnan(quaternion).all()
    assert np.isnan(position).all()


def test_ten_hertz_since_1970_leaves_no_gap_of_a_tenth_of_a_second() -> None:
    """Stamps of 2026 in seconds are rounded to 2.4e-7 s, so steps of 0.1 s come out longer or shorter."""
    stamps = 1.78e9 + np.arange(COUNT) * 0.1
    assert (np.diff(stamps) > 0.1).any()
    track = PoseTrack(max_gap=0.1)
    track.add(stamps, TURNS, PLACES)
    assert np.isfinite(track.at(np.linspace(stamps[0], stamps[-1], 999))[0]).all()


@pytest.mark.parametrize("offset", [0.04, -1.5])
def test_the_offset_is_added_to_the_stamps_of_the_poses(offset: float) -> None:
    same(a_track(offset=offset).at(STAMPS + offset), (TURNS, PLACES))


def test_old_repeated_and_unreadable_poses_are_left_out_and_counted() -> None:
    stamps = np.array([0.0, 0.1, 0.1, 0.05, np.nan, 0.2, 0.3, np.inf, 0.4, 0.5])
    turns = TURNS[:10].copy()
    turns[6], turns[8], turns[9, 2] = 0.0, 3.0 * turns[8], np.nan
    track = PoseTrack()
    track.add(stamps, turns, PLACES[:10])
    good = [0, 1, 5]
    same(track.at(stamps[good]), (turns[good], PLACES[good]))
    assert (track.late, track.unreadable) == (2, 5)
    assert len(track.notes()) == 2


def test_what_was_answerable_stays_and_forgetting_keeps_what_is_needed() -> None:
    """Poses and questions in step, as from a file: the answers are those of all poses at once, and memory is flat."""
    expected = a_track().at(TIMES)
    track, done, answers, kept = PoseTrack(), 0, [], []
    for k in range(COUNT):
        track.add(STAMPS[k : k + 1], TURNS[k : k + 1], PLACES[k : k + 1])
        ready = track.answerable(TIMES[done:])
        answers.append(track.at(TIMES[done : done + ready]))
        done += ready
        if done < len(TIMES):
            track.forget(TIMES[done])
        kept.append(len(track._rows))
    assert done == len(TIMES)
    same((np.concatenate([a[0] for a in answers]), np.concatenate([a[1] for a in answers])), expected)
    assert max(kept) <= 2


def test_answerable_counts_what_comes_first_and_all_once_it_is_complete() -> None:
    track, times = PoseTrack(), np.array([0.0, np.nan, 0.3, 0.1, 0.5])
    assert track.answerable(times) == 0
    track.add(np.array([0.2]), TURNS[:1], PLACES[:1])
    assert track.answerable(times) == 2
    track.add(np.array([0.4]), TURNS[1:2], PLACES[1:2])
    assert track.answerable(times) == 4
    track.complete()
    assert track.answerable(times) == 5
