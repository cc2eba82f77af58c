"""Pokes in a log: what is found is what was simulated, and what cannot be meant is said."""

from dataclasses import replace
from functools import cache
from itertools import pairwise, zip_longest

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.poking.activations import AnswerReader
from palpate.sensors.taxels.poking.plausibility import believed
from palpate.sensors.taxels.poking.pokes import Pokes
from palpate.sensors.taxels.poking.segmentation import PokeSearch, _most, _runs, find_pokes
from palpate.signals.recording import FORCE, ORIENTATION, POSITION, TORQUE, Recording
from palpate.spatial.pose import Pose, quaternion_from_rotation
from palpate_lab.simulation.forearm import Forearm
from palpate_lab.simulation.poke_bench import Elbow, PokeBench, PokeSession
from palpate_lab.simulation.poke_log import EVERY, PokeLog, Timing, simulate_poke_log

TABLE = ((94.0, 0.0, 1.0), (15.0, -90.0, 1.0), (94.0, 0.0, 1.0))  # the first pose comes back


@cache
def _log(pokes: int = 90) -> PokeLog:
    rng = np.random.default_rng(3)
    session = PokeBench.drawn(rng, skin=Forearm.of(), arm=Elbow(table=TABLE)).session(rng, pokes)
    timing = Timing(period=0.9, ramp=0.1, hold=0.3, rest=1.0, move=0.6)
    return simulate_poke_log(session, rng, timing)


def _recording(log: PokeLog, wrench: np.ndarray | None = None) -> Recording:
    pose = log.session.bench.arm.pose(log.joints[:, 0], log.joints[:, 1])
    wrench = log.wrench if wrench is None else wrench
    channels = {FORCE: wrench[:, :3], TORQUE: wrench[:, 3:]}
    channels |= {ORIENTATION: quaternion_from_rotation(pose.rotation), POSITION: pose.translation}
    return Recording(log.time, {name: np.ascontiguousarray(each) for name, each in channels.items()})


def _frames(log: PokeLog, taxels: np.ndarray | None = None) -> list[tuple[np.ndarray, np.ndarray]]:
    return [(log.time[::EVERY], log.taxels if taxels is None else taxels)]


def _session() -> PokeSession:
    return _log().session


def _matched(pokes: Pokes, log: PokeLog) -> np.ndarray:
    """Which true poke each is."""
    inside = (pokes.time[:, None] > log.start - 0.1) & (pokes.time[:, None] < log.end + 0.1)
    assert (inside.sum(axis=1) == 1).all()
    return inside.argmax(axis=1)


def test_wrenches_and_configurations_are_those_of_the_pokes() -> None:
    """What the sensor reads beside (weight, zero, bias) is gone; of the ramps a part is in, force and torque alike.

    The rest is white noise, 0.05 N and 2 N mm over 40 samples and more, less free motion over 60 and more: to five
    deviations.
    """
    log, session = _log(), _session()
    found = find_pokes([_recording(log), *_frames(log)])
    true = _matched(found, log)
    assert len(found) >= 0.95 * len(session.pokes)
    np.testing.assert_array_equal(found.configuration, session.pokes.configuration[true])
    wanted = (session.pokes.wrench - session.bench.bias[session.pokes.configuration])[true]
    assert (np.sqrt(np.diag(found.noise)) > np.repeat([0.1, 0.01], 3)).all()  # touches scatter 0.15 N, 15 N mm
    deviation = np.repeat([0.05, 0.002], 3) * np.sqrt(1 / 40 + 1 / 60)
    seen, told = found.wrench / deviation, wanted / deviation
    scale = (seen * told).sum(axis=1) / (told**2).sum(axis=1)
    assert (scale > 0.85).all()
    assert (scale < 1.05).all()
    assert (np.abs(seen - scale[:, None] * told) < 5).all()
    pose = session.bench.arm.pose(*session.bench.arm.joints[session.pokes.configuration[true]].T)
    np.testing.assert_allclose(found.rotation, pose.rotation, atol=1e-9)
    np.testing.assert_allclose(found.origin, pose.translation, atol=1e-9)


def test_answers_are_those_that_stand_above_the_threshold() -> None:
    """Steady parts hold a share of the whole answer, less by ramps and rounding: by half a count and 15 %."""
    log = _log()
    found = find_pokes([_recording(log), *_frames(log)])
    true = _matched(found, log)
    touches = log.session.touches
    table = np.zeros((len(log.start), found.taxels))
    table[touches.poke, touches.taxel] = touches.response
    exact = table[true[found.poke], found.taxel]
    clear = exact < 240  # below the end of the range
    assert (np.abs(found.response - exact)[clear] < 0.15 * exact[clear] + 0.6).all()
    heard = np.zeros((len(found), found.taxels), dtype=bool)
    heard[found.poke, found.taxel] = True
    assert heard[table[true] > 1.5 * found.threshold + 1.0].all()


def test_blocks_of_any_size_give_the_same_pokes_within_rounding() -> None:
    log = _log()
    frames, recording = _frames(log)[0], _recording(log)
    one = find_pokes([recording, frames])
    cut = [(frames[0][k : k + 700], frames[1][k : k + 700].astype(np.float64)) for k in range(0, len(frames[0]), 700)]
    pieces = [recording.picked(slice(k, k + 999)) for k in range(0, len(recording), 999)]
    turns = [part for pair in zip_longest(cut, pieces) for part in pair if part is not None]  # in turns
    other = find_pokes(turns)
    np.testing.assert_array_equal(one.starts, other.starts)
    np.testing.assert_allclose(one.wrench, other.wrench, atol=1e-9)
    np.testing.assert_allclose(one.response, other.response, rtol=0.05, atol=0.05)  # the rest follows by blocks


def test_falling_readings_and_a_drifting_rest_are_followed() -> None:
    log = _log()
    drift = np.linspace(0.0, 4.0, len(log.taxels))[:, None]
    rising = find_pokes([_recording(log), *_frames(log, np.rint(np.minimum(log.taxels + drift, 255.0)))])
    falling = find_pokes([_recording(log), *_frames(log, 255 - log.taxels)], PokeSearch(falling=True))
    assert abs(len(rising) - len(log.start)) <= 4
    assert abs(len(falling) - len(log.start)) <= 4


def test_two_pokers_at_once_are_rejected_with_places_and_without() -> None:
    """Of 200 pokes some are joined with a far one: nearly all of them are rejected, and hardly another.

    Without places, what answers together elsewhere tells: six answers a taxel are few.
    """
    log = _log(200)
    pokes, places = log.session.pokes, log.session.bench.skin.places
    at = [places.positions[pokes.taxel[slice(*pokes.starts[k : k + 2])]] for k in range(len(pokes))]
    middle = np.array([each.mean(axis=0) if len(each) else np.zeros(3) for each in at])
    doubled, table = list[int](), np.zeros((len(pokes), pokes.taxels))
    table[pokes.poke, pokes.taxel] = pokes.response
    strong = table.sum(axis=1)
    for k in range(0, 200, 20):
        away = np.linalg.norm(middle - middle[k], axis=1)
        far = np.flatnonzero((away > 0.035) & (strong > 0.5 * strong[k]) & (strong < 2 * strong[k]))
        if len(far) and strong[k] > 20:
            table[k] = np.maximum(table[k], table[far[k % len(far)]])
            doubled.append(k)
    made = Pokes.from_table(
        pokes.wrench, pokes.rotation, pokes.origin, pokes.configuration, table, noise=pokes.noise, threshold=1.5
    )
    assert len(doubled) >= 5
    for start in (None, places):
        found = believed(made, start=start)
        rejected = np.flatnonzero(found.weight == 0)
        assert len(set(doubled) - set(rejected.tolist())) <= (0 if start is not None else 1)
        assert len(rejected) <= len(doubled) + 4
        assert any("two separate areas" in said for said in found.notes)


def test_a_torque_along_the_force_weighs_a_poke_down() -> None:
    """Thirty millimetres of pitch, where friction leaves a few: the weight falls as its square."""
    pokes = _session().pokes
    force = pokes.wrench[:, :3]
    wrench = pokes.wrench.copy()
    wrench[7, 3:] += 0.1 * force[7]
    found = believed(replace(pokes, wrench=wrench))
    assert found.weight[7] < 0.3
    assert np.mean(found.weight == 1.0) > 0.8


@pytest.mark.parametrize("share", [0.0, 0.6])
def test_a_taxel_stuck_on_is_named_and_left_out(share: float) -> None:
    """From the start, or from the middle of the log on."""
    log = _log()
    taxels = log.taxels.copy()
    first = int(share * len(taxels))
    taxels[max(first, 60) :, 17] = 180
    found = find_pokes([_recording(log), *_frames(log, taxels)])
    assert 17 not in found.taxel
    assert any("taxel 17 answers nearly all the time, or never returns" in said for said in found.notes)
    assert len(found) >= 0.9 * len(log.start)


def _gone(log: PokeLog) -> tuple[Recording, list[tuple[np.ndarray, np.ndarray]], PokeSearch]:
    begun = log.start[0] + 0.02
    rows = log.time >= begun
    frames = log.time[::EVERY] >= begun
    return _recording(log).picked(rows), [(log.time[::EVERY][frames], log.taxels[frames])], PokeSearch()


def _silent(log: PokeLog) -> tuple[Recording, list[tuple[np.ndarray, np.ndarray]], PokeSearch]:
    return _recording(log), _frames(log, np.minimum(log.taxels, 9)), PokeSearch(threshold=20.0)


def _other_day(log: PokeLog) -> tuple[Recording, list[tuple[np.ndarray, np.ndarray]], PokeSearch]:
    return _recording(log), [(log.time[::EVERY] + 1e4, log.taxels)], PokeSearch()


def _no_pose(log: PokeLog) -> tuple[Recording, list[tuple[np.ndarray, np.ndarray]], PokeSearch]:
    recording = _recording(log)
    kept = {name: each for name, each in recording.channels.items() if name in (FORCE, TORQUE)}
    return replace(recording, channels=kept), _frames(log), PokeSearch()


def _joints_missing(log: PokeLog) -> tuple[Recording, list[tuple[np.ndarray, np.ndarray]], PokeSearch]:
    recording = _recording(log)
    nothing = {ORIENTATION: np.full((len(recording), 4), np.nan), POSITION: np.full((len(recording), 3), np.nan)}
    return replace(recording, channels={**recording.channels, **nothing}), _frames(log), PokeSearch()


def _another_skin(log: PokeLog) -> tuple[Recording, list[tuple[np.ndarray, np.ndarray]], PokeSearch]:
    places = log.session.bench.skin.places
    return _recording(log), _frames(log), PokeSearch(start=TaxelPlaces(places.positions[:72], places.normals[:72]))


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (_gone, "no free motion before the first poke.*Record"),
        (_silent, "no taxel ever answers.*Write"),
        (_other_day, "time: .*have no time in common"),
        (_no_pose, "does not state the pose of the link in the sensor's frame.*Write"),
        (_joints_missing, "no wrench has a pose of the link.*Check"),
        (_another_skin, "have 72 taxels, but the log has 84.*CAD file of this skin"),
    ],
)
def test_what_cannot_be_meant_is_a_sentence(made: object, said: str) -> None:
    recording, frames, search = made(_log())
    with pytest.raises(InputError, match=said):
        find_pokes([recording, *frames], search)


def test_a_clock_that_jumps_back_and_readings_that_are_none_lose_little() -> None:
    log = _log()
    recording = _recording(log)
    time = recording.time.copy()
    time[5000:5050] -= 3.0
    wrench = log.wrench.copy()
    wrench[8000:8100] = np.nan
    found = find_pokes([replace(_recording(log, wrench), time=time), *_frames(log)])
    assert len(found) >= len(log.start) - 4
    assert any("50 wrenches are not later" in said for said in found.notes)


def test_a_pose_that_stays_is_taken_as_given() -> None:
    log = _log()
    bare = {name: each for name, each in _recording(log).channels.items() if name in (FORCE, TORQUE)}
    pose = Pose.from_rotation_vector([0.1, 0.2, 0.3], [0.0, 0.01, 0.1])
    found = find_pokes([replace(_recording(log), channels=bare), *_frames(log)], PokeSearch(pose=pose))
    np.testing.assert_allclose(found.origin, np.tile(pose.translation, (len(found), 1)))
    assert found.configurations == 1


def test_noise_alone_hardly_answers() -> None:
    """Six deviations, half a million readings: a few at most."""
    rng = np.random.default_rng(0)
    frames = rng.normal(20.0, 0.7, (6000, 84))
    reader = AnswerReader()
    reader.take(np.arange(6000) / 50, frames)
    assert len(reader.finish().taxel) <= 3


def test_the_90th_percentile_of_each_run_is_that_of_numpy() -> None:
    rng = np.random.default_rng(1)
    first = np.array([2, 5, 6, 40, 90])
    last = np.array([2, 5, 31, 41, 99])  # runs of one number, of two, and longer ones
    values = rng.exponential(size=100).round(1)  # some are alike
    rows, owner, ends = _runs(first, last)
    wanted = [list(range(a, b + 1)) for a, b in zip(first.tolist(), last.tolist(), strict=True)]
    assert [rows[a:b].tolist() for a, b in pairwise(ends)] == wanted
    np.testing.assert_allclose(_most(values[rows], owner, ends), [np.quantile(values[each], 0.9) for each in wanted])
