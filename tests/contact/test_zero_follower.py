"""A zero that is followed: what touches is not, every way through the estimator has the same bits, and what it says.

Truth is plain geometry: forces within a cone at points of an analytic body, 150 mm from the sensor, and a zero that is
stated sample by sample.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from claims.papers.drift.follow import follow
from claims.papers.drift.world import BODY, NOISE, PLACE, RATE, Touch, drift_of, wrenches
from palpate import Locator, Recording, Status, WrenchEstimator
from palpate.contact.contacts import Contacts
from palpate.contact.drift_gate import ContactShape
from palpate.contact.estimate import ContactEstimate
from palpate.errors import InputError
from palpate.sensors.force_torque.compensation import Compensation
from palpate.sensors.force_torque.model import ForceTorque
from palpate.sensors.load_cells.array import LoadCellArray
from palpate.sensors.load_cells.model import VOLTAGE, LoadCells
from palpate.sensors.load_cells.zero import Zero
from palpate.signals.drift import Drift
from palpate.signals.filters import Butterworth
from palpate.signals.payload import Payload
from palpate.signals.recording import ACCELERATION, FORCE, ORIENTATION, TEMPERATURE, TORQUE
from palpate.signals.wrench_sensor import Placement
from palpate.signals.zero_filter import ZeroState, ZeroStatus
from palpate.spatial.pose import Pose, rotation_from_quaternion
from palpate.surfaces import EllipticCylinder, Mesh
from palpate_lab.simulation.cell_array import LAYOUTS, random_cells
from palpate_lab.simulation.drift import simulate_drift
from tests.support.streams import pieces

HZ = 80.0
DRIFT = drift_of(5e-3, 1.0 / 60.0)
PAYLOAD = Payload(np.array([0.0, 0.0, -5.0]), np.zeros(3), np.array([0.01, 0.0, 0.05]), np.zeros(3))
WRONG = Payload(np.array([0.0, 0.0, -5.15]), center_of_mass=np.array([0.0105, -0.0003, 0.0502]))
NOTHING = Payload()


@cache
def _mesh() -> Mesh:
    vertices, faces = BODY.mesh(700)
    return Mesh.from_arrays(vertices + PLACE, faces, smooth=True)


def _log(seconds: float = 16.0, payload: Payload = PAYLOAD) -> tuple[Recording, np.ndarray]:
    """A zero that runs away at 8 mN/s, two touches, an arm that turns, and all that can be wrong with samples."""
    rng, time = np.random.default_rng(0), np.arange(0.0, seconds, 1.0 / HZ)
    zero = np.outer(time, [6e-3, -5e-3, 0.0, 2e-4, 0.0, 0.0])
    load = wrenches(time, [Touch(4.0, 7.0, 3.0, 0.2), Touch(11.0, 12.0, 1.0, 0.2)], rng)
    moves = np.clip(time - 1.0, 0.0, None)
    turn = np.stack([0.2 * np.sin(moves), 0 * time, 0.1 * np.sin(0.7 * moves), np.ones(len(time))], axis=1)
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    hung = np.einsum("nji,j->ni", rotation_from_quaternion(turn), payload.weight)
    hung = np.concatenate([hung, np.cross(payload.center_of_mass, hung)], axis=1)
    seen = zero + load + hung + NOISE * rng.standard_normal((len(time), 6))
    if seconds > 10.0:
        seen[[200, 201], 2], turn[[280, 600]], time[721] = np.nan, np.nan, np.nan
        seen[96:110] = np.nan
        time[1040:] += 3.0  # a gap
        time[1200:] -= 4.0  # time that runs back
    return Recording(time, {FORCE: seen[:, :3], TORQUE: seen[:, 3:], ORIENTATION: turn}), zero


def _estimator(
    drift: Drift | None = DRIFT, live: bool = True, filter: Butterworth | None = None, payload: Payload | None = PAYLOAD
) -> WrenchEstimator:
    sensor = Compensation(ForceTorque(NOISE, limits=[60.0] * 3 + [5.0] * 3), payload)
    made = WrenchEstimator(Locator(_mesh()), sensor, filter=filter, rate=HZ, live=live, drift=drift)
    log, _ = _log(1.0, payload or NOTHING)
    made.tare(log.picked(slice(0, 80)))
    return made


def _flat(found: Contacts) -> np.ndarray:
    """Every number of contacts, a sample a row."""
    one = found.estimate
    return np.column_stack([one.point, one.force, one.covariance.reshape(-1, 9), one.status])


def test_a_zero_that_runs_away_is_followed_and_touches_stay_whole() -> None:
    """8 mN/s for 16 s: without following, 0.13 N of it stand in the last touch; with it, what the last second hides."""
    log, zero = _log()
    true = log.wrenches() - zero
    true = true - np.concatenate([_hung(log), np.cross(PAYLOAD.center_of_mass, _hung(log))], axis=1)
    known = np.isfinite(true).all(axis=1) & np.isfinite(log.channels[ORIENTATION]).all(axis=1)
    late = known & (np.arange(len(log)) > 600) & (np.arange(len(log)) < 1040)
    off: dict[str, float] = {}
    for name, made in {"tare": _estimator(None), "live": _estimator(), "log": _estimator(live=False)}.items():
        found = np.concatenate([each.estimate.force for each in made.stream(pieces(log, 500))])
        off[name] = float(np.linalg.norm(np.nanmean((found - true[:, :3])[late], axis=0)))
    assert off["tare"] > 0.06
    assert off["live"] < 0.02
    assert off["log"] < 0.01


def _hung(log: Recording) -> np.ndarray:
    return np.einsum("nji,j->ni", rotation_from_quaternion(log.channels[ORIENTATION]), PAYLOAD.weight)


def test_what_is_unsure_of_the_zero_is_in_every_covariance_and_moves_the_threshold() -> None:
    """After an hour alone, a walk of 5 mN/sqrt(s) is 0.3 N: a force of 0.8 N is no contact any more, one of 3 N is."""
    drift, seconds = drift_of(5e-3), 3600.0
    made = _estimator(drift, payload=None)
    rest = np.zeros((20, 6))
    made.run(_wrenches_at(np.arange(20) / RATE, rest))
    at = np.array([seconds])
    _, covariance, _ = made.contact_wrenches(_wrenches_at(at, rest[:1]))
    made.update(seconds, np.zeros(6))
    _, later, _ = made.contact_wrenches(_wrenches_at(at, rest[:1]))
    assert covariance is not None
    assert later is not None
    grown = np.diag(later[0]) - np.diag(covariance[0])
    np.testing.assert_allclose(grown, drift.walk**2 * seconds, rtol=1e-3)  # the tenth of a second of the window
    for force, status in ((0.8, Status.NO_CONTACT), (3.0, Status.CONTACT)):
        push = np.array([-force, 0.0, 0.0])
        wrench = np.concatenate([push, np.cross(PLACE + np.array([0.03, 0.0, 0.0]), push)])
        assert made.update(seconds + 0.01, wrench).estimate.status[0] == status
        assert _estimator(None, payload=None).update(0.0, wrench).estimate.status[0] == Status.CONTACT


def _wrenches_at(time: np.ndarray, wrenches: np.ndarray) -> Recording:
    return Recording(time, {FORCE: wrenches[:, :3], TORQUE: wrenches[:, 3:]})


def _errors_of(payload: Payload) -> np.ndarray:
    """By which the weight [N] and the first moment [N m] of a payload differ from those of `PAYLOAD`."""
    newtons = np.linalg.norm(payload.weight)
    return np.r_[newtons - 5.0, newtons * (payload.center_of_mass - PAYLOAD.center_of_mass)]


@pytest.mark.parametrize("payload", [PAYLOAD, WRONG])
def test_a_payload_that_is_wrong_is_learnt_and_named(payload: Payload) -> None:
    """By 3 % and 0.6 mm, in ten seconds in which the arm turns and nothing touches."""
    hung, still = (_log(10.0, each)[0].wrenches() for each in (payload, NOTHING))
    seen = hung - still + NOISE * np.random.default_rng(1).standard_normal(hung.shape)  # neither zero nor touch
    log, _ = _log(10.0)
    log = replace(log, channels={**log.channels, FORCE: seen[:, :3], TORQUE: seen[:, 3:]})
    for live in (True, False):
        made = _estimator(drift_of(1e-3), live=live)
        made.tare(log.picked(slice(0, 80)))
        for _ in made.stream(pieces(log, 400)):
            pass
        history = made.zero_history()
        assert np.all(np.abs(history.coefficient[-1] - _errors_of(payload)) < [0.02, *[2e-3] * 3])
        assert np.mean(history.status == ZeroStatus.FREE) > 0.9
        assert any("(+3.0%) more than stated" in said for said in made.warnings()) == (payload is WRONG)
        assert any("more than stated" in said for said in made.notes()) == (payload is PAYLOAD)


def test_a_followed_payload_is_compensated_as_the_true_one() -> None:
    """Exactly, with accelerations too; and its regressors are what the stated payload misses."""
    rng = np.random.default_rng(0)
    turns = rng.standard_normal((20, 4))
    channels = {FORCE: rng.standard_normal((20, 3)), TORQUE: rng.standard_normal((20, 3)), ORIENTATION: turns}
    log = Recording(np.arange(20.0), {**channels, ACCELERATION: rng.standard_normal((20, 3))})
    sensor, true = Compensation(ForceTorque(NOISE), PAYLOAD), Compensation(ForceTorque(NOISE), WRONG)
    expected, free = true.measure(log).wrench, sensor.free(sensor.kept(log))
    np.testing.assert_allclose(free.value - free.regressor @ _errors_of(WRONG), expected, rtol=0, atol=1e-12)
    sensor.follow(ZeroState(np.zeros(6), _errors_of(WRONG), np.zeros((10, 10))))
    np.testing.assert_allclose(sensor.measure(log).wrench, expected, rtol=0, atol=1e-12)


def test_time_without_touch_in_which_the_zero_is_kept_is_named() -> None:
    """0.05 N that a contact could make are too little for one, and stay for most of a minute."""
    time, push = np.arange(0.0, 70.0, 1.0 / 40.0), np.array([-0.05, 0.0, 0.0])
    seen = NOISE * np.random.default_rng(6).standard_normal((len(time), 6))
    seen[time >= 4.0] += np.concatenate([push, np.cross(PLACE + np.array([0.03, 0.0, 0.0]), push)])
    made = _estimator(drift_of(1e-4), payload=None)
    found = made.run(_wrenches_at(time, seen))
    history = made.zero_history()
    assert history is not None
    assert np.mean(found.estimate.answered) < 1e-3
    assert np.mean(history.status == ZeroStatus.FAINT) > 0.9
    assert any("by less than a touch" in said for said in made.notes())
    assert any("payload has to be calibrated" in said for said in made.warnings())


def _free(seconds: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    time = np.arange(0.0, seconds, 1.0 / RATE)
    return time, NOISE * rng.standard_normal((len(time), 6))


ODD = np.array(
    [0.35, 0.0, 0.0, 0.0, 0.0, 0.03]
)  # N, N m: no contact of the body makes it, its line of action is far off


@pytest.mark.parametrize(
    ("skin", "alone", "followed"), [(None, False, False), (None, True, True), (False, False, True), (True, True, False)]
)
def test_a_jump_that_no_contact_explains_needs_a_witness(skin: bool | None, alone: bool, followed: bool) -> None:
    time, seen = _free(12.0, np.random.default_rng(2))
    seen[time >= 4.0] += ODD
    told = None if skin is None else np.full(len(time), skin) & (time > 3.0)
    found = follow(time, seen, drift_of(1e-3), touched=told, alone=alone)
    off = np.linalg.norm((found.zero[-1] - ODD)[:3])
    assert (off < 0.02) == followed
    if skin is not True:
        assert [jump.followed for jump in found.jumps] == [followed]
        assert found.jumps[0].time == pytest.approx(6.0, abs=0.2)
        assert found.jumps[0].force == pytest.approx(0.35, abs=0.02)


@pytest.mark.parametrize(("count", "onset"), [(1, 0.0), (1, 3.0), (2, 0.1), (2, 3.0)])
def test_touches_are_not_eaten(count: int, onset: float) -> None:
    """Ten seconds of 0.2 N and more, one or two at once; 0.02 N more than the walk and noise of 30 s explain."""
    rng = np.random.default_rng([7, count])
    time, noise = _free(24.0, rng)
    touches = [Touch(8.0, 18.0 + 2 * onset, 0.2 * k, onset) for k in range(1, count + 1)]
    found = follow(time, noise + wrenches(time, touches, rng), drift_of(1e-3))
    end = np.searchsorted(found.time, 17.5 + onset)
    assert np.linalg.norm(found.zero[end, :3]) < 0.02 + 2.8 * np.sqrt(found.covariance[end, 0, 0])
    assert found.status[end] != ZeroStatus.FREE
    assert found.status[-1] == ZeroStatus.FREE  # and is seen to end


def test_time_alone_does_not_make_a_light_touch_the_zero() -> None:
    """0.25 N stay for 30 s, after which a walk of 23 mN/sqrt(s) would explain them: 0.12 N an axis."""
    rng = np.random.default_rng(5)
    time = np.arange(0.0, 52.0, 1.0 / 20.0)
    seen = NOISE * rng.standard_normal((len(time), 6)) + wrenches(time, [Touch(12.0, 44.0, 0.25, 0.2)], rng)
    found = follow(time, seen, drift_of(23e-3))
    during = (found.time > 13.0) & (found.time < 43.0)
    assert np.all(found.status[during] != ZeroStatus.FREE)
    assert np.mean(found.status[found.time > 47.0] == ZeroStatus.FREE) > 0.9  # and its end is seen


SLOPE = np.array([0.02] * 3 + [7.5e-4] * 3)  # N/K, N m/K


def _warms(walk: float, unsure: float) -> Drift:
    plain = drift_of(walk)
    return Drift(plain.walk, thermal=SLOPE, thermal_deviation=unsure * SLOPE)


def test_what_temperature_does_in_contact_is_taken_off() -> None:
    """3 K in 40 s of contact are 0.06 N an axis; what is left is what a walk of 1 mN/sqrt(s) does: 6 mN an axis."""
    rng, time = np.random.default_rng(3), np.arange(0.0, 60.0, 1.0 / 40.0)
    kelvin = 25.0 + np.clip((time - 5.0) / 15.0, 0.0, 3.0)
    seen = kelvin[:, None] * SLOPE + wrenches(time, [Touch(12.0, 55.0, 3.0, 0.2)], rng)
    seen += NOISE * rng.standard_normal(seen.shape)
    end = (kelvin[-1] - kelvin[0]) * SLOPE
    for smooth in (False, True):
        found = follow(time, seen, _warms(1e-3, 0.0), smooth=smooth, temperature=kelvin)
        at = np.searchsorted(found.time, 54.0)
        assert np.abs(found.zero[at, :3] - kelvin[0] * SLOPE[:3] - end[:3]).max() < 0.02
        without = follow(time, seen, drift_of(1e-3), smooth=smooth)
        assert smooth or np.abs(without.zero[at, :3] - kelvin[0] * SLOPE[:3] - end[:3]).max() > 0.03


def test_what_is_unsure_of_the_slope_is_in_the_covariance_and_is_learnt() -> None:
    """Slopes that are 30 % off: in contact the band holds them; after 8 K without contact they are known."""
    time, inside = np.arange(0.0, 30.0, 1.0 / 80.0), list[np.ndarray]()
    kelvin = 20.0 + np.clip(time - 6.0, 0.0, 8.0)
    drift = _warms(1e-3, 0.3)
    for seed in range(8):
        rng = np.random.default_rng([9, seed])
        zero = simulate_drift(time, drift, rng, kelvin)
        noise = NOISE * rng.standard_normal(zero.shape)
        load = wrenches(time, [Touch(5.5, 28.0, 5.0, 0.2)], rng)
        found = follow(time, zero + noise + load, drift, temperature=kelvin)
        at = np.searchsorted(found.time, 26.0)
        off = found.zero[at] - zero[np.searchsorted(time, 26.0)]
        inside.append(np.abs(off) < 1.96 * np.sqrt(np.diag(found.covariance[at])[:6]))
        assert found.covariance[at, 0, 0] > (0.9 * 8.0 * 0.3 * SLOPE[0]) ** 2
    free = follow(time, zero + noise, drift, temperature=kelvin)
    assert free.covariance[at, 0, 0] < (0.2 * 8.0 * 0.3 * SLOPE[0]) ** 2
    assert 0.87 < np.mean(inside) <= 1.0  # of 48, 0.95 less two deviations and a half


def test_temperature_has_the_same_bits_live_and_in_blocks_and_its_lack_is_said() -> None:
    log, _ = _log(6.0)
    kelvin = 20.0 + 0.5 * np.sqrt(np.arange(len(log)))
    kelvin[100:160] = np.nan
    warm = replace(log, channels={**log.channels, TEMPERATURE: kelvin[:, None]})
    drift = Drift(DRIFT.walk, DRIFT.warm_up, DRIFT.settling, thermal=SLOPE, thermal_deviation=0.1 * SLOPE)
    one, two, three, none = (_estimator(drift) for _ in range(4))
    rows = one.empty(len(log))
    readings, turns = log.wrenches(), rotation_from_quaternion(log.channels[ORIENTATION])
    for k in range(len(log)):
        one.kelvin = kelvin[k]
        one.update_into(float(log.time[k]), readings[k], rows[k], turns[k])
    expected = _flat(Contacts.single(log.time, ContactEstimate.from_rows(rows)))
    blocks = np.concatenate([_flat(two.run(each)) for each in pieces(warm, 7, 1, 90)])
    np.testing.assert_array_equal(blocks, expected)
    beside = {name: warm.channels[name] for name in (ORIENTATION, TEMPERATURE)}
    again = three.empty(len(log))
    three.run_into(log.time, readings, again, np.zeros(len(log), np.int64), beside)
    np.testing.assert_array_equal(again, rows)
    assert not np.array_equal(_flat(none.run(log)), expected)
    assert any("no temperature" in said for said in none.notes())
    assert not any("no temperature" in said for said in two.notes())


def test_shape_tells_a_contact_of_the_body() -> None:
    """A force through a point of the surface is one, 0.1 m beside it is none; a small one says nothing."""
    shape = ContactShape(Locator(_mesh()), Placement(Pose.identity()))
    sure = np.diag(NOISE**2 / 20.0)
    point, push = PLACE + np.array([0.03, 0.0, 0.0]), np.array([-1.0, 0.2, 0.1])
    for force, away, seen in ((1.0, 0.0, True), (1.0, 0.1, False), (0.02, 0.1, True)):
        place = point + np.array([0.0, away, 0.0])
        assert shape.explains(force * np.concatenate([push, np.cross(place, push)]), sure) is seen


def test_voltages_are_followed_too() -> None:
    """Twelve cells whose zeros run away by 60 noises; a press in between is not taken for it."""
    rng, noise, time = np.random.default_rng(0), 1e-4, np.arange(0.0, 16.0, 5e-3)
    cells = random_cells(LAYOUTS[4], np.random.default_rng(1))
    surface = EllipticCylinder(a=14e-3, b=5e-3, half_length=16e-3, upper=True)
    model = LoadCells(cells.forward(), np.full(12, noise))
    ran = np.outer(time, rng.uniform(-1, 1, 12) * 4e-4)
    push = np.where((time > 6.0) & (time < 8.0), -0.5, 0.0)[:, None] * [0.0, 0.0, 1.0]
    load = np.concatenate([push, np.cross([0.0, 2e-3, 5e-3], push)], axis=1)
    volts = ran + cells.voltages(load) + noise * rng.standard_normal((len(time), 12))
    log = Recording(time, {VOLTAGE: volts})
    drift = Drift(np.full(12, 2e-4), np.full(12, 5e-4))
    ends: list[np.ndarray] = []
    for live in (True, False):
        sensor = LoadCellArray(model, zero=Zero(np.zeros(12), share=0.01))
        made = WrenchEstimator(Locator(surface, noise=sensor.noise), sensor, live=live, drift=drift)
        found = np.concatenate([each.estimate.force for each in made.stream(pieces(log, 400))])
        pressed = (time > 6.2) & (time < 7.8)
        assert np.abs(np.nanmean(found[pressed] - push[pressed], axis=0)).max() < 0.02
        history = made.zero_history()
        assert history is not None
        ends.append(history.zero[-1] - ran[-1])
        assert np.abs(history.zero[-1] - ran[-1]).max() < 10 * noise  # a second of rate, of which little is unknown
        assert ZeroStatus.HELD in history.status


def test_what_cannot_be_followed_is_refused() -> None:
    with pytest.raises(InputError, match=r"drift: .*not for 12"):
        WrenchEstimator(Locator(_mesh()), Compensation(ForceTorque(NOISE)), drift=Drift(np.ones(12)))
    with pytest.raises(InputError, match=r"noise.*State"):
        WrenchEstimator(Locator(_mesh()), Compensation(ForceTorque()), drift=DRIFT)
    assert _estimator(None).zero_history() is None


def test_it_says_how_far_it_went_and_what_it_did_not_follow() -> None:
    time, seen = _free(8.0, np.random.default_rng(2))
    seen[time >= 4.0] += ODD
    made = _estimator(drift_of(1e-3), payload=None)
    made.run(_wrenches_at(time, seen))
    assert any("the zero moved by" in said and "kept" in said for said in made.notes())
    assert any("0.35 N at 6" in said and "two touches" in said for said in made.warnings())
    made.reset()  # the tare's zero again
    assert made.update(0.0, np.zeros(6)).estimate.status[0] == Status.NO_CONTACT
