"""Taxels with three axes: the model of their loads, the fit of touches to it, and what a calibration learns."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.contact.ground_truth import TrueSamples
from palpate.contact.taxel_settings import TaxelSettings
from palpate.errors import InputError, NotIdentifiable
from palpate.files.models import write_model
from palpate.sensors.taxels import _loads
from palpate.sensors.taxels.calibrate_response import _fitted, _thermal, _widening, identify_response
from palpate.sensors.taxels.estimator import TaxelEstimator
from palpate.sensors.taxels.health import Health
from palpate.sensors.taxels.model import TaxelBody
from palpate.sensors.taxels.presses import known_presses
from palpate.sensors.taxels.response import TaxelResponse
from palpate.setup.rig import check_rig
from palpate.signals.recording import CELLS, TEMPERATURE, Recording
from palpate_lab.simulation.three_axis_skins import CREEPS, FADES, ThreeAxisSkin, magnetic_skin, pillar_array
from palpate_lab.simulation.three_axis_touches import RATE, three_axis_touches

PITCH = 5e-3
SIX = ("xx", "xy", "xz", "yy", "yz", "zz")


def drawn_response(seed: int, count: int = 1) -> TaxelResponse:
    """Return a response with every profile, drawn at random."""
    guess = TaxelResponse.guessed(count, PITCH)
    return replace(guess, shares=np.random.default_rng(seed).normal(size=guess.shares.shape))


def load(response: TaxelResponse, place: np.ndarray, touch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the load at a place [pitches] by the compiled model, in plain Python, and its derivatives."""
    profiles, found, slopes = np.empty((_loads.PROFILES, 3)), np.empty(3), np.empty((3, _loads.UNKNOWN))
    _loads._load(*(place - touch[:2]), touch, response.numbers(), profiles, found, slopes)
    return found, slopes


@pytest.mark.parametrize("patch", [0.0, 0.3, -0.05])
def test_loads_are_those_of_the_numpy_model(patch: float) -> None:
    response, touch = drawn_response(1), np.array([0.1, -0.2, patch, 0.5, -0.3, 2.0, 0.0])
    place = np.array([0.5, 0.6])
    offset, force = (place - touch[:2])[None], touch[None, 3:6]
    wanted = response.spread_of(offset, force, np.array([patch]))[0]
    np.testing.assert_allclose(load(response, place, touch)[0], wanted, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("patch", [0.0, 0.3, -0.05])
def test_derivatives_are_finite_differences(patch: float) -> None:
    response, touch = drawn_response(2), np.array([0.1, -0.2, patch, 0.5, -0.3, 2.0, 0.8])
    place, step = np.array([0.5, 0.6]), 1e-6 * np.eye(_loads.UNKNOWN)
    found = [(load(response, place, touch + d)[0] - load(response, place, touch - d)[0]) / 2e-6 for d in step]
    np.testing.assert_allclose(load(response, place, touch)[1], np.transpose(found), rtol=1e-7, atol=1e-7)


def test_a_torque_is_the_limit_of_opposite_forces() -> None:
    response, place, arm = drawn_response(3), np.array([0.4, 0.7]), 1e-4
    twisted = load(response, place, np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0]))[0]
    wanted = np.zeros(3)
    for x, y in ((arm, 0.0), (-arm, 0.0), (0.0, arm), (0.0, -arm)):  # four forces round the place, each across its arm
        force = np.array([-y, x]) / (4.0 * arm**2)
        wanted += load(response, place, np.array([x, y, 0.1, *force, 0.0, 0.0]))[0]
    np.testing.assert_allclose(twisted, wanted, rtol=1e-5, atol=1e-6)


def body_of(response: TaxelResponse | None = None, rows: int = 5, columns: int = 6) -> TaxelBody:
    """Return taxels on a plane, with a response."""
    row, column = np.indices((rows, columns)).reshape(2, -1)
    places = PITCH * np.column_stack([column, row, 0 * row])
    body = TaxelBody.anywhere(places, np.tile([0.0, 0.0, 1.0], (len(row), 1)), along=(1.0, 0.0, 0.0))
    return replace(body, response=response or TaxelResponse.guessed(len(row), PITCH))


def still(body: TaxelBody, noise: float) -> Health:
    """Return the health of taxels that rest at 0."""
    bad, level = np.zeros(len(body), dtype=bool), np.full(len(body), noise)
    return Health(np.zeros(len(body)), level, bad, bad, sideways=np.stack([np.zeros((2, len(body))), [level, level]]))


def readings(body: TaxelBody, touches: np.ndarray) -> np.ndarray:
    """Return the readings (k, 3) under touches (c, 7): place [pitches], patch, force (3), torque [N pitches]."""
    assert body.response is not None
    places = body.positions[:, :2] / PITCH
    return np.array([sum(load(body.response, place, touch)[0] for touch in touches) for place in places])


def test_the_forces_of_two_touches_are_found_exactly() -> None:
    response = replace(TaxelResponse.guessed(30, PITCH), misfit=np.full(2, 1e-4))
    body = body_of(response)
    touches = np.array([[1.2, 1.1, 0.0, 0.5, -0.3, 2.0, 0.0], [3.6, 2.9, 0.0, -0.2, 0.3, 1.0, 0.0]])
    found = TaxelEstimator(body, health=still(body, 1e-4)).update(0.0, readings(body, touches))
    order = np.argsort(found.point[:, 0])
    np.testing.assert_allclose(found.point[order, :2], PITCH * touches[:, :2], atol=1e-6)
    np.testing.assert_allclose(found.force[order], touches[:, 3:6] * [1, 1, -1], atol=1e-3)


@pytest.mark.parametrize("light", [0.0, 0.8])
def test_a_light_touch_next_to_a_heavy_one_needs_no_peak(light: float) -> None:
    response = TaxelResponse.guessed(30, PITCH)
    shares = np.roll(response.shares, 1, axis=1)  # of a deviation of one pitch: the light touch lies on a slope
    body = body_of(replace(response, shares=shares, misfit=np.full(2, 1e-2)))
    touches = np.array([[1.2, 2.1, 0.0, 0.5, -0.3, 8.0, 0.0], [3.2, 2.3, 0.0, 0.0, 0.1, light, 0.0]])
    felt = readings(body, touches)
    assert light == 0.0 or (np.diff(felt[:, 2].reshape(5, 6)[2]) < 0.0)[1:].all()
    found = TaxelEstimator(body, health=still(body, 1e-3)).update(0.0, felt)
    many = 2 if light else 1
    np.testing.assert_allclose(found.point[:, :2], PITCH * touches[:many, :2], atol=0.1 * PITCH)
    np.testing.assert_allclose(found.force, touches[:many, 3:6] * [1, 1, -1], atol=0.08)  # the misfit, 1 %


def test_what_neighbours_read_of_each_other_is_taken_off() -> None:
    rng = np.random.default_rng(8)
    plain = body_of(replace(TaxelResponse.guessed(30, PITCH), misfit=np.full(2, 1e-3)))
    response = replace(plain.response, coupling=0.03 * rng.normal(size=(5, 4)))
    adds = np.eye(90).reshape(30, 3, 30, 3)
    for i, j in np.ndindex(30, 30):
        away = (plain.positions[i] - plain.positions[j])[None, :2] / PITCH
        if 0.0 < np.linalg.norm(away) < 1.5:
            for b, way in enumerate(np.eye(3)):
                spread = replace(response, shares=response.coupling).spread_of(away, way[None], np.zeros(1))
                adds[i, :, j, b] += spread[0]
    felt = readings(plain, np.array([[2.2, 2.1, 0.0, 0.5, -0.3, 2.0, 0.0]]))
    read = np.linalg.solve(adds.reshape(90, 90), felt.ravel()).reshape(30, 3)
    body = replace(plain, response=response)
    pairs = (plain, felt), (body, read)
    wanted, found = (TaxelEstimator(each, health=still(each, 1e-3)).update(0.0, cells) for each, cells in pairs)
    np.testing.assert_allclose(found.force, wanted.force, rtol=1e-9)
    np.testing.assert_allclose(found.point, wanted.point, rtol=1e-9)


@pytest.mark.parametrize(("stated", "own", "used"), [(10.0, 2.0, 2.0), (1.0, 2.0, 1.0), (np.inf, 2.0, np.inf)])
def test_the_rest_is_followed_within_the_shorter_time_or_never(stated: float, own: float, used: float) -> None:
    body = body_of(replace(TaxelResponse.guessed(30, PITCH), drift=own))
    estimator = TaxelEstimator(body, settings=TaxelSettings(drift=stated), health=still(body, 1.0))
    for k in range(31):
        estimator.update(0.1 * k, np.full((30, 3), 0.5))
    np.testing.assert_allclose(estimator.rest[0], 0.5 * (1.0 - np.exp(-3.0 / used)), rtol=1e-9)


def test_covariances_hold_with_patches_torques_and_noise_drawn() -> None:
    """Everything is drawn from what the fit assumes: the squared errors are those of chi-square."""
    rng, noise = np.random.default_rng(5), 0.004
    known = {"misfit": np.full(2, 1e-6), "patch": np.array([0.0, 0.0, 0.03])}
    body = body_of(replace(TaxelResponse.guessed(30, PITCH), **known))
    estimator = TaxelEstimator(body, health=still(body, noise))
    place, force, torque = list[float](), list[float](), list[float]()
    for _ in range(150):
        size = rng.uniform(1.0, 3.0)
        touch = np.array([*rng.uniform(0.5, 3.5, 2), 0.03 * rng.normal(), *rng.uniform(-0.5, 0.5, 2) * size, size, 0.0])
        touch[6] = _loads._TWIST * size * rng.normal()
        felt = readings(body, touch[None]) + noise * rng.normal(size=(30, 3))
        estimator.reset()
        found = estimator.update(0.0, felt)
        assert len(found) == 1
        off = found.point[0, :2] - PITCH * touch[:2]
        place.append(off @ np.linalg.solve(found.covariance[0, :2, :2], off))
        six = np.array([found.features[f"force_{name}"][0] for name in SIX])
        miss = found.force[0] - touch[3:6] * [1, 1, -1]
        force.append(miss @ np.linalg.solve(six[[0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3), miss))
        torque.append((found.torque[0] - PITCH * touch[6]) / found.features["torque_sd"][0])
    for squares, freedom in ((place, 2), (force, 3), (np.square(torque), 1)):
        assert np.mean(squares) == pytest.approx(freedom, rel=0.35)


def test_what_follows_late_of_a_heavy_touch_is_taken_off_a_light_one() -> None:
    span, share = 0.5, 0.04
    touches = {
        "heavy": np.array([2.2, 2.1, 0.0, 3.0, -2.0, 8.0, 0.0]),
        "light": np.array([2.4, 1.9, 0, 0, 0.1, 0.4, 0]),
    }
    off = dict[bool, float]()
    for known in (False, True):
        late = np.array([span, share if known else 0.0, 0.0])
        body = body_of(replace(TaxelResponse.guessed(30, PITCH), misfit=np.full(2, 1e-4), late=late))
        heavy, light = (readings(body, touch[None]) for touch in touches.values())
        estimator, slow = TaxelEstimator(body, health=still(body, 1e-3)), np.zeros((30, 3))
        for i in range(90):
            now = heavy if 5 <= i < 45 else light if i >= 70 else np.zeros((30, 3))
            found = estimator.update(i / RATE, now + share * slow)
            slow += (1.0 - np.exp(-1.0 / RATE / span)) * (now - slow)
        off[known] = float(np.linalg.norm(found.force[0] - touches["light"][3:6] * [1, 1, -1]))
    assert off[True] < 1e-4
    assert np.isnan(off[False]) or off[False] > 0.02  # the light touch passes for what remains


@pytest.mark.parametrize(("make", "sums"), [(magnetic_skin, False), (pillar_array, True)])
def test_a_calibration_knows_pillars_that_bear_all_of_a_force(
    make: Callable[[int, int, int], ThreeAxisSkin], sums: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    skin = make(4, 4, 1)
    loads = three_axis_touches(skin.positions, np.random.default_rng(2), 44)
    cells, truth = skin.readings(loads, 3)
    body = TaxelBody.anywhere(skin.positions, skin.normals, along=(1.0, 0.0, 0.0))
    recording = Recording(np.arange(len(cells)) / RATE, {CELLS: cells})
    known = TrueSamples(truth.frame / RATE, truth.place, force=truth.force)
    monkeypatch.setattr("palpate.sensors.taxels.calibrate_response.FOLDS", 3)
    found = identify_response(body, recording, known)
    assert found.sums == sums
    assert "left_out" in found.provenance
    assert found.late[:2] == pytest.approx([0.5, 0.025], rel=0.1)  # the laboratory's, of which it knows nothing
    assert np.isinf(found.limits).all()
    if not sums:  # a force on a pillar shows at no other, in whichever order they are
        one = (np.arange(48) == 3 * 5 + 2).reshape(16, 3)  # z of taxel 5
        wrong = [
            ("", cells),
            ("order of the taxels", cells[:, ::-1]),
            ("order of the taxels", cells[..., [1, 0, 2]]),
            ("order of the taxels", cells * [-1, 1, 1]),
            ("the sign of z", cells * [1, 1, -1]),
            ("1 of 16 cells dead: .* never changes: cell 5", cells * ~one),
            ("1 of 16 cells reversed along z: .*: cell 5", cells * np.where(one, -1, 1)),
        ]
        for words, order in wrong:
            estimator = TaxelEstimator(replace(body, response=found))
            list(estimator.answers([replace(recording, channels={CELLS: order})]))
            doubts = [estimator.unbelievable, *estimator.warnings()]
            assert re.search(words, " ".join(doubts)) if words else not doubts[0]
        return  # the end of a range and wrong truths have nothing to do with the kind of skin
    end = 0.7 * cells.max()
    clipped = replace(recording, channels={CELLS: np.minimum(cells, end)})
    full = identify_response(body, clipped, known)
    assert full.limits.tolist() == [-np.inf, end]
    estimator = TaxelEstimator(replace(body, response=full))
    estimator.run(clipped)
    (said,) = [each for each in estimator.warnings() if "end of their range" in each]
    ended = np.flatnonzero((cells >= end).any(axis=(0, 2)))
    assert f"{len(ended)} taxels ({ended[0]}" in said
    with pytest.raises(InputError, match=r"pull at the skin\..*change the sign"):
        identify_response(body, recording, replace(known, force=-truth.force))
    with pytest.raises(InputError, match=r"from the nearest taxel.*in m, in the surface's frame"):
        identify_response(body, recording, replace(known, point=truth.place + 0.1 * np.eye(3)[0]))
    with pytest.raises(NotIdentifiable, match="no shear in some direction"):
        identify_response(body, recording, replace(known, force=truth.force * [0.0, 1.0, 1.0]))
    with pytest.raises(InputError, match="better with fx and fy exchanged"):
        identify_response(body, recording, replace(known, force=truth.force[:, [1, 0, 2]]))
    with pytest.raises(NotIdentifiable, match=r"do not follow the true points and forces.*order of the taxels"):
        identify_response(body, recording, replace(known, point=truth.place[:, [1, 0, 2]]))
    steady = TrueSamples(known.time[truth.full], truth.place[truth.full], force=truth.force[truth.full])
    for wrong in (replace(known, time=known.time + 0.3), steady):
        with pytest.raises(InputError, match=r"readings move in \d+% of.*as it rises and falls, too, on the clock"):
            identify_response(body, recording, wrong)


@pytest.mark.parametrize(
    ("named", "known", "live", "words"),
    [
        (True, True, False, ""),
        (False, False, False, ""),
        (True, False, False, "calibrate while it changes"),
        (False, True, False, "a temperature of 20, but .skin. names none"),
        (True, True, True, "a temperature of 20, but live sources have none"),
    ],
)
def test_readings_that_are_not_corrected_are_noted(
    named: bool, known: bool, live: bool, words: str, tmp_path: Path
) -> None:
    response = replace(body_of().response, temperature=20.0, thermal=np.ones((30 if known else 0, 3)))
    write_model(tmp_path / "response.toml", response)
    places = [f"{x},{y},0,0,0,1" for x, y in body_of().positions[:, :2].tolist()]
    (tmp_path / "places.csv").write_text("\n".join(["x,y,z,nx,ny,nz", *places]))
    skin = {"taxels": "places.csv", "axes": ["x", "y", "z"], "response": "response.toml", "tare": 0.2}
    rig = check_rig({"skin": skin | ({"temperature": "celsius"} if named else {})}, tmp_path / "rig.toml")
    rest = np.random.default_rng(0).normal(size=(30, 30, 3))
    channels = {CELLS: rest} | ({TEMPERATURE: np.full((30, 1), 21.0)} if named else {})
    notes = rig.resolve("skin", None if live else Recording(np.arange(30) / 50.0, channels)).prepared().notes
    corrected = [each for each in notes if "temperature" in each]
    assert re.search(words, corrected[0]) if words else not corrected


def test_what_a_temperature_does_is_learned_and_taken_off() -> None:
    """The laboratory's fades and creeps; a reading at its limit, and one without a temperature, have no correction."""
    skin = pillar_array(4, 4, 1)
    loads = three_axis_touches(skin.positions, np.random.default_rng(2), 60)
    warmer = 8.0 * np.sin(np.linspace(0.0, 6.0, loads.count))
    (cool, truth), (warm, _) = skin.readings(loads, 3), skin.readings(loads, 3, warmer)
    body = TaxelBody.anywhere(skin.positions, skin.normals, along=(1.0, 0.0, 0.0))
    recording = Recording(np.arange(len(warm)) / RATE, {CELLS: warm, TEMPERATURE: 25.0 + warmer[:, None]})
    known = TrueSamples(truth.frame / RATE, truth.place, force=truth.force)
    presses = known_presses(body, recording, known)
    found = _fitted(presses, True)[0]
    assert found.temperature == pytest.approx(25.0 + warmer.mean())
    np.testing.assert_allclose(found.thermal, CREEPS, rtol=0.03)
    assert 0.0 < found.fade < 2.0 * FADES  # 60 presses leave the gains free to take some of it
    short = presses.force * (1.0 - FADES * presses.warmer[:, None])
    assert _thermal(presses, short, presses.force)["fade"] == pytest.approx(FADES, rel=0.01)
    assert np.abs(presses.unfaded(FADES).readings - (cool[presses.frame] - cool[0])).max() < 60.0  # of 10,000
    exact = {"fade": FADES, "thermal": found.thermal + (FADES - found.fade) * presses.level}
    found = replace(found, **exact, limits=np.array([-np.inf, warm.max()]))
    usual = replace(body, response=found).raw(recording)
    off = usual - cool - (CREEPS * (found.temperature - 25.0))
    assert np.abs(off[warm < warm.max()]).max() < 0.01 * warm.max()
    assert (usual[warm == warm.max()] == warm.max()).all()
    assert np.isnan(found.corrected(warm[:2], np.array([np.nan, 25.0]))[0]).all()
    with pytest.raises(InputError, match=r"temperature is 298, and was 2\d.* in the calibration\..*in the same unit"):
        found.corrected(warm[:2], np.array([298.0, 298.0]))
    steady = replace(recording, channels={CELLS: warm, TEMPERATURE: 25.0 + 0.1 * warmer[:, None]})
    assert not len(_fitted(known_presses(body, steady, known), True)[0].thermal)


@pytest.mark.parametrize("known", [(1.5, 0.002, 0.0), (0.5, 0.03, 0.0), (0.7, 0.001, 0.3)])
def test_deviations_of_errors_are_found_by_what_they_grow_with(known: tuple[float, float, float]) -> None:
    """Errors drawn by a factor of their stated deviation, a share of their size, and a share by their shape."""
    rng, count = np.random.default_rng(7), 4000
    stated, size = 0.02 * np.exp(rng.normal(size=count)), rng.uniform(0.5, 10.0, count)
    shape = np.where(rng.uniform(size=count) < 0.3, 0.3, -0.05)
    variance = (known[0] * stated) ** 2 + (size * known[1]) ** 2 + (size * shape * known[2]) ** 2
    error = np.sqrt(variance)[:, None] * rng.normal(size=(count, 1))
    factor, beside, unusual = _widening(error, stated[:, None, None] ** 2, size, shape)
    found = (factor * stated) ** 2 + (size * beside) ** 2 + (size * shape * unusual) ** 2
    for some in (shape > 0.0, shape < 0.0, size < 3.0, stated > 0.02):
        assert np.mean(found[some] / variance[some]) == pytest.approx(1.0, abs=0.35)  # the search has steps


def test_few_presses_and_truths_without_forces_are_refused() -> None:
    body, time = replace(body_of(), response=None), np.arange(100) / RATE
    recording = Recording(time, {CELLS: np.zeros((100, 30, 3))})
    point = np.zeros((20, 3))
    with pytest.raises(InputError, match=r"have no forces.*Add"):
        identify_response(body, recording, TrueSamples(time[40:60], point))
    with pytest.raises(NotIdentifiable, match="1 presses are too few"):
        identify_response(body, recording, TrueSamples(time[40:60], point, force=np.tile([0.0, 0.0, -1.0], (20, 1))))
    with pytest.raises(InputError, match=r"taxels: .*of 4 taxels, but the body has 30 taxels"):
        replace(body, response=TaxelResponse.guessed(4, PITCH))
