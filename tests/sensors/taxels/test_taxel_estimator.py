"""Contacts of a sheet: laws that hold whatever the pressure, with cells counted by OpenCV and sums made by NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import CHI2_95, Status
from palpate.contact.taxel_settings import TaxelSettings
from palpate.errors import InputError
from palpate.sensors.taxels.estimator import TaxelEstimator
from palpate.sensors.taxels.health import Health
from palpate.sensors.taxels.intensity import Curve, Intensity
from palpate.sensors.taxels.model import TaxelBody
from palpate.sensors.taxels.skin_map.model import SkinMap
from palpate.signals.drift import Drift
from palpate.signals.filters import Butterworth, Filter, Kalman
from palpate.signals.recording import CELLS, Recording
from palpate_lab.simulation.drift import simulate_drift
from palpate_lab.simulation.skin_bench import Patch, Rolled, press

LINEAR = Intensity((Curve("polynomial", np.array([10.0]), np.zeros((1, 1)), largest=20.0),))  # counts per newton
RING, FLAT = Rolled(), Rolled(radius=np.inf)
REST = 5.0


def _health(noise: float = 0.1, rest: float = REST, cells: int = 132, **changes: object) -> Health:
    none = np.zeros(cells, dtype=bool)
    return replace(Health(np.full(cells, rest), np.full(cells, noise), none, none), **changes)


def _skin(sheet: Rolled = FLAT, settings: TaxelSettings | None = None, **changes: object) -> TaxelEstimator:
    """Whole counts do not matter here: the readings are floats, so that sums are exact."""
    return TaxelEstimator(TaxelBody.sheet(sheet.layout(), bits=None), LINEAR, _health(**changes), settings=settings)


def _recording(time: np.ndarray, cells: np.ndarray) -> Recording:
    return Recording(time, {CELLS: cells})


def _read(loads: np.ndarray) -> np.ndarray:
    return REST + 10.0 * loads


def test_place_and_force_are_sums_over_the_cells() -> None:
    """The twin: NumPy's centroid divided by the sum, and the sum of forces."""
    rng, skin = np.random.default_rng(1), _skin()
    for _ in range(30):
        loads = np.zeros((6, 22))
        row, column = rng.integers(1, 4), rng.integers(2, 18)
        loads[row : row + 2, column : column + 3] = rng.uniform(1.0, 3.0, (2, 3))
        skin.reset()
        found = skin.update(0.0, _read(loads))
        if len(found) > 1:
            continue  # a saddle of chance: another law's business
        rows, columns = np.indices(loads.shape)
        centre = (loads * rows).sum() / loads.sum(), (loads * columns).sum() / loads.sum()
        assert (found.features["row"][0], found.features["column"][0]) == pytest.approx(centre, abs=1e-9)
        assert found.features["load"][0] == pytest.approx(loads.sum(), rel=1e-9)
        np.testing.assert_allclose(found.estimate.force[0], [0.0, 0.0, -loads.sum()], atol=1e-9)
        assert found.estimate.force[0] @ found.estimate.normal[0] < 0  # pressing
        assert found.features["area"][0] == pytest.approx(6e-4)


def test_a_harder_press_of_the_same_shape_is_at_the_same_place() -> None:
    skin, one = _skin(RING), press(RING, [Patch(2.3, 7.7, 1.2, 4.0)])
    first, second = (skin.update(0.0, _read(scale * one.loads)) for scale in (1.0, 4.0))
    np.testing.assert_allclose(first.estimate.point, second.estimate.point, atol=1e-12)
    np.testing.assert_allclose(4.0 * first.estimate.force, second.estimate.force, rtol=1e-9)


def test_moving_the_press_by_a_cell_moves_the_touch_by_a_cell() -> None:
    """The whole body turns with it: around a cylinder a column is a rotation."""
    skin = _skin(RING)
    loads = press(RING, [Patch(2.3, 7.7, 1.2, 4.0)]).loads
    here, there = (skin.update(float(k), _read(np.roll(loads, k, axis=1))) for k in (0, 1))
    turn = RING.pitch / RING.radius
    cosine, sine = np.cos(turn), np.sin(turn)
    matrix = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(there.estimate.point[0], matrix @ here.estimate.point[0], atol=2e-6)
    np.testing.assert_allclose(there.estimate.force[0], matrix @ here.estimate.force[0], rtol=1e-6)


@pytest.mark.parametrize("radius", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("flat", [False, True])
def test_patches_are_found_where_geometry_puts_them(radius: float, flat: bool) -> None:
    """Noise-free: what is left is that a cell feels the sum over its square.

    For Hertz's patch one cell wide that is at most 0.096 cells along each axis, d - tail(d) of 3/4 (1 - x^2) at
    d = 0.21: 1.36 mm in the plane.
    """
    rng, skin = np.random.default_rng(2), _skin(RING)
    for _ in range(10):
        patch = Patch(rng.uniform(1.6, 3.4), rng.uniform(2, 19), radius, 5.0, flat)
        true = press(RING, [patch])
        found = skin.update(0.0, _read(true.loads))
        assert len(found) == 1
        assert np.linalg.norm(found.estimate.point[0] - true.point[0]) < (1.4e-3 if radius < 1 else 0.6e-3)
        np.testing.assert_allclose(found.estimate.force[0], true.force[0], atol=0.03 * 5.0)


def test_touches_cross_the_seam_of_a_closed_sheet() -> None:
    """A patch over the seam is one touch on a ring, whose columns go round in 22.3; on a flat sheet it would be two."""
    true = press(RING, [Patch(2.5, 21.65, 1.5, 6.0)])
    assert true.loads[:, 0].sum() > 0
    assert true.loads[:, 21].sum() > 0
    ring = _skin(RING)
    assert ring.body.turn == 22
    found = ring.update(0.0, _read(true.loads))
    assert len(found) == 1
    assert np.linalg.norm(found.estimate.point[0] - true.point[0]) < 1.0e-3
    assert len(_skin(FLAT).update(0.0, _read(true.loads))) == 2


def test_areas_are_those_that_opencv_connects() -> None:
    cv2 = pytest.importorskip("cv2")
    rng, skin = np.random.default_rng(3), _skin(FLAT, TaxelSettings(share=0.999, sure=1e9))
    for _ in range(20):
        mask = rng.random((6, 22)) < 0.25
        found = skin.update(0.0, _read(mask * 2.0))
        count, _, stats, centroids = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
        assert len(found) == count - 1
        ours = sorted(
            zip(
                found.features["row"].tolist(),
                found.features["column"].tolist(),
                found.features["cells"].tolist(),
                strict=True,
            )
        )
        theirs = sorted((y, x, float(n)) for (x, y), n in zip(centroids[1:], stats[1:, cv2.CC_STAT_AREA], strict=True))
        np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_two_touches_that_merge_are_split_at_their_saddle() -> None:
    both = press(FLAT, [Patch(2.0, 6.0, 1.0, 6.0), Patch(3.0, 8.6, 1.0, 4.0)])
    found = _skin().update(0.0, _read(both.loads))
    assert len(found) == 2
    order = np.argsort(found.features["column"])
    np.testing.assert_allclose(found.estimate.point[order], both.point, atol=1.2e-3)
    np.testing.assert_allclose(found.features["load"][order], [6.0, 4.0], rtol=0.1)
    assert found.features["load"].sum() == pytest.approx(10.0, rel=1e-3)  # a cell is shared out, not counted twice


def test_a_wide_flat_touch_stays_one() -> None:
    rng, skin = np.random.default_rng(4), _skin()
    for _ in range(20):
        loads = press(FLAT, [Patch(2.5, rng.uniform(4, 17), 2.5, 60.0, flat=True)]).loads
        noisy = _read(loads) + 0.1 * rng.standard_normal(loads.shape)
        assert len(skin.update(0.0, noisy)) == 1


def test_a_dead_cell_is_filled_from_its_neighbours() -> None:
    dead = np.arange(132) == 3 * 22 + 10
    true = press(FLAT, [Patch(2.6, 10.3, 2.0, 20.0)])
    lost = true.loads.copy()
    lost[3, 10] = 0.0
    found = _skin(dead=dead).update(0.0, _read(lost))
    assert len(found) == 1
    assert np.linalg.norm(found.estimate.point[0] - true.point[0]) < 1.0e-3
    assert found.features["load"][0] == pytest.approx(20.0, rel=0.1)


def test_a_cell_at_its_range_makes_the_touch_saturated_but_it_is_located() -> None:
    curve = replace(LINEAR.curves[0], saturation=40.0)
    skin = TaxelEstimator(TaxelBody.sheet(FLAT.layout(), bits=None), Intensity((curve,)), _health())
    true = press(FLAT, [Patch(2.5, 10.0, 1.0, 30.0)])
    found = skin.update(0.0, np.minimum(_read(true.loads), 40.0))
    assert found.estimate.status.tolist() == [Status.SATURATED]
    assert np.linalg.norm(found.estimate.point[0] - true.point[0]) < 2e-3
    assert found.features["load"][0] < 30.0


def test_a_frame_that_cannot_be_used_is_noted() -> None:
    skin, cells = _skin(), np.full((3, 6, 22), REST)
    cells[1] = np.nan
    skin.run(_recording(np.arange(3.0), cells))
    assert any("1 frames could not be used" in note for note in skin.notes())


FILTERS = (Kalman(1e-3, 2e-3), Butterworth(8.0, 3), Butterworth(8.0, zero_phase=True))


@pytest.mark.parametrize("filter", FILTERS, ids=["Kalman", "Butterworth", "zero phase"])
def test_a_filter_takes_its_share_of_the_noise_and_the_covariance_follows(filter: Filter) -> None:
    """A steady touch, read 400 times: its place scatters about as its covariance says, and less than without."""
    rng = np.random.default_rng(8)
    one = _read(press(FLAT, [Patch(2.4, 9.3, 2.0, 3.0)]).loads)
    log = _recording(np.arange(400) / 50, one + 0.3 * rng.standard_normal((400, 6, 22)))
    scatter = []
    for chosen in (None, filter):
        skin = TaxelEstimator(TaxelBody.sheet(FLAT.layout(), bits=None), LINEAR, _health(0.3), filter=chosen, rate=50.0)
        found = Contacts.joined(list(skin.stream([log])))
        touched = found[found.features["load"] > 1.0][100:-50]
        scatter.append(touched.features["column"].std())
    assert scatter[1] < 0.8 * scatter[0]


@pytest.mark.parametrize(
    ("force", "unequal"), [(2.0, 0.0), (60.0, 0.05)], ids=["rim below the threshold", "unequal gains"]
)
def test_ellipses_hold_the_middle_of_light_wide_touches_and_of_unequal_cells(force: float, unequal: float) -> None:
    """95 % of 120 touches within three binomial deviations (2 %): the cells' noise alone holds about 70 %."""
    rng, skin = (
        np.random.default_rng(18),
        _skin(noise=0.15 if unequal else 0.3, settings=TaxelSettings(unequal=unequal)),
    )
    held = 0
    for _ in range(120):
        pressed = press(FLAT, [Patch(rng.uniform(1.5, 3.5), rng.uniform(3.0, 18.0), 2.0, force)])
        gain = 1.0 + unequal * rng.standard_normal((6, 22))
        skin.reset()
        noise = skin.health.noise[0] if skin.health else np.nan
        reading = REST + 10.0 * gain * pressed.loads + noise * rng.standard_normal((6, 22))
        found = skin.update(0.0, reading)
        best = int(np.argmax(found.features["load"]))
        off = found.estimate.point[best] - pressed.point[0]
        held += off @ np.linalg.pinv(found.estimate.covariance[best], rcond=1e-6) @ off <= CHI2_95
    assert 0.89 <= held / 120 <= 1.0


def test_a_filter_of_zero_phase_answers_logs_only() -> None:
    skin = TaxelEstimator(
        TaxelBody.sheet(FLAT.layout()), LINEAR, _health(), filter=Butterworth(5.0, zero_phase=True), rate=50.0
    )
    with pytest.raises(InputError, match=r"needs later samples.*Give"):
        skin.update(0.0, np.zeros((6, 22)))
    with pytest.raises(InputError, match=r"needs later samples.*Give"):
        skin.run(_recording(np.arange(2.0), np.zeros((2, 6, 22))))
    with pytest.raises(InputError, match=r"needs the rate.*State"):
        TaxelEstimator(skin.body, LINEAR, _health(), filter=Kalman())


def test_a_tare_states_the_rest_and_one_that_moves_is_refused() -> None:
    rng = np.random.default_rng(9)
    still = np.rint(20.0 + rng.standard_normal((60, 6, 22)))
    skin, time = TaxelEstimator(TaxelBody.sheet(FLAT.layout()), LINEAR), np.arange(60) / 50
    told = skin.tare(_recording(time, still))
    assert "60 frames" in told.note
    assert not told.warning
    assert skin.health is not None
    np.testing.assert_allclose(skin.health.baseline, still.mean(axis=0).ravel(), atol=0.1)
    assert skin.update(0.0, still[0]).status.tolist() == [Status.NO_CONTACT]
    moving = still.copy()
    moving[30:, 2, 5] += 40.0
    with pytest.raises(InputError, match=r"not at rest during the tare: cell \(2, 5\).*Let"):
        skin.tare(_recording(time, moving))
    assert "(3, 7)" in skin.tare(_recording(time, still + 50.0 * (np.arange(132) == 73).reshape(6, 22))).warning


def test_rest_is_found_at_the_head_of_a_log_that_begins_with_a_touch() -> None:
    rng = np.random.default_rng(10)
    cells = np.rint(20.0 + rng.standard_normal((90, 6, 22)))
    cells[:20] += np.rint(10.0 * press(FLAT, [Patch(2.5, 9.0, 1.0, 6.0)]).loads)
    log = _recording(np.arange(90) / 50, cells)
    body = TaxelBody.sheet(FLAT.layout())
    whole, parts = (
        Contacts.joined(list(TaxelEstimator(body, LINEAR).stream(log.picked(slice(a, a + n)) for a in range(0, 90, n))))
        for n in (90, 4)
    )
    np.testing.assert_array_equal(whole.estimate.point, parts.estimate.point)
    assert whole.answered.tolist() == [True] * 20 + [False] * 70


def test_rest_follows_drift_where_nothing_touches() -> None:
    """A drift of ten deviations in 100 s, of which a follower of 10 s is one behind: no touch; without it there is."""
    time = np.arange(0.0, 100.0, 0.1)
    cells = REST + np.linspace(0.0, 1.0, len(time))[:, None, None] * np.ones((6, 22))
    assert not _skin().run(_recording(time, cells)).answered.any()
    assert _skin(settings=TaxelSettings(drift=np.inf)).run(_recording(time, cells)).answered.any()


WALK = TaxelSettings(walk=0.03)  # counts/sqrt(s), of cells whose noise is 0.1 counts


def _wandering(seconds: float, load: np.ndarray, begin: float, end: float, seed: int) -> tuple[Recording, np.ndarray]:
    """Frames at 25 Hz of zeros that walk, each its own, with a touch between two times; and the zeros."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, seconds, 0.04)
    zero = REST + simulate_drift(time, Drift(np.full(132, WALK.walk)), rng).reshape(-1, 6, 22)
    touched = (time >= begin) & (time < end)
    cells = zero + 10.0 * load * touched[:, None, None] + 0.1 * rng.standard_normal(zero.shape)
    return _recording(time, cells), zero


def test_a_minute_of_touch_is_not_eaten_and_the_variance_of_the_rest_holds() -> None:
    """Cells under the touch know their rest to the walk of a minute; free ones to the steady state of the filter."""
    load = press(FLAT, [Patch(2.4, 9.3, 2.0, 3.0)]).loads
    under, away = load > 0.1, np.s_[:, 14:]
    skin, inside = _skin(settings=WALK), {"under": list[bool](), "free": list[bool]()}
    left = list[float]()
    for seed in range(6):
        skin.reset()
        log, zero = _wandering(72.0, load, 10.0, 75.0, seed)
        found = skin.run(log)
        rest, sure = skin.rest
        off = (rest - zero[-1]) / sure
        inside["under"] += (np.abs(off[under]) < 1.96).tolist()
        inside["free"] += (np.abs(off[away]) < 1.96).ravel().tolist()
        np.testing.assert_allclose(sure[under], WALK.walk * 62.0**0.5, rtol=0.05)
        assert sure[away].max() < 0.042  # sqrt(walk noise sqrt(dt) + walk^2 1 s) is 0.039
        first, last = (float(found.features["load"][found.sample == k][0]) for k in (275, len(log) - 1))
        left.append(last - first)
    assert 0.92 < np.mean(inside["free"]) < 0.98
    assert 0.88 < np.mean(inside["under"]) < 0.99
    # N: the walks of a minute of some 25 cells, 10 counts a newton, are 0.12; cells at the edge leave the touch as the
    # thresholds rise
    assert np.abs(left).max() < 4.0 * 0.12
    assert abs(np.mean(left)) < 0.15


def test_what_is_not_known_of_a_rest_moves_the_thresholds_and_widens_the_ellipse() -> None:
    """After a minute of touch, in newtons 24 mN a cell; a lighter touch of 6 noises there is no longer one."""
    load = press(FLAT, [Patch(2.4, 9.3, 2.0, 3.0)]).loads
    log, _ = _wandering(70.0, load, 10.0, 75.0, 1)
    skin = _skin(settings=WALK)
    found = skin.run(log)
    ends = [found[found.sample == k].estimate.covariance[0] for k in (275, len(log) - 1)]
    assert np.trace(ends[1]) > 1.02 * np.trace(ends[0])
    cell = np.unravel_index(np.argmax(load), load.shape)
    light = skin.rest[0].copy()
    light[cell] += 0.1 * 7.0
    assert not skin.update(70.0, light).answered.any()
    fresh = _skin(settings=WALK)
    light = np.full((6, 22), REST)
    light[cell] += 0.1 * 7.0
    assert fresh.update(0.0, light).answered.any()


def test_a_light_touch_below_the_thresholds_is_no_rest() -> None:
    """Two noises for 20 s: a follower of 10 s takes 86 % of it, the walk explains nothing of the kind."""
    load = np.zeros((6, 22))
    load[2, 9] = 0.02  # N: 0.2 counts
    log, zero = _wandering(30.0, load, 10.0, 35.0, 2)
    eaten: list[float] = []
    for settings in (TaxelSettings(walk=0.005), TaxelSettings()):
        skin = _skin(settings=settings)
        skin.run(_recording(log.time, log.channels[CELLS] - zero + REST))
        eaten.append(float(skin.rest[0][2, 9] - REST) / 0.2)
    assert eaten[1] > 0.8
    assert eaten[0] < 0.15


@pytest.mark.parametrize("filter", [None, Butterworth(8.0, zero_phase=True)])
def test_rests_that_are_followed_are_the_same_however_the_log_is_cut(filter: Filter | None) -> None:
    load = press(FLAT, [Patch(2.4, 9.3, 2.0, 3.0)]).loads
    log, _ = _wandering(12.0, load, 3.0, 6.0, 3)
    time, cells = log.time.copy(), log.channels[CELLS].copy()
    time[200:] += 7.0  # a gap
    time[250:] -= 2.5  # and time that runs back
    time[120], cells[40, 1, 3], cells[60] = np.nan, np.nan, np.nan
    log, body = _recording(time, cells), TaxelBody.sheet(FLAT.layout(), bits=None)
    skin = TaxelEstimator(body, LINEAR, _health(), settings=WALK, filter=filter, rate=25.0)
    ends: list[tuple[np.ndarray, ...]] = []
    for size in (300, 11, 1):
        skin.reset()
        parts = list(skin.stream(log.picked(slice(a, a + size)) for a in range(0, 300, size)))
        ends.append((Contacts.joined(parts).estimate.point, skin.rest))
    for point, rest in ends[1:]:
        np.testing.assert_array_equal(point, ends[0][0])
        np.testing.assert_array_equal(rest, ends[0][1])


def test_eight_bits_that_wrap_are_put_right() -> None:
    """Counts rise past 255 in the middle of a touch whose neighbours stay pressed."""
    skin = TaxelEstimator(TaxelBody.sheet(FLAT.layout()), LINEAR, _health(1.0))
    loads = press(FLAT, [Patch(2.0, 10.0, 1.5, 100.0)]).loads
    rising = np.stack([np.rint(_read(share * loads)) for share in np.linspace(0.0, 1.3, 60)])
    assert rising.max() > 256
    found = skin.run(_recording(np.arange(60) / 50, np.mod(rising, 256.0)))
    assert found.estimate.status[-1] == Status.SATURATED
    said = f"readings of {(rising[-1] > 255).sum()} cells wrapped around from one end"
    assert any(said in note for note in skin.notes())


def test_a_fast_poke_from_rest_to_the_end_of_the_range_is_no_wrap() -> None:
    skin = TaxelEstimator(TaxelBody.sheet(FLAT.layout()), LINEAR, _health(1.0, 20.0))
    frames = np.full((3, 6, 22), 20.0)
    frames[1, 2, 5] = 255.0
    found = skin.run(_recording(np.arange(3) / 50, frames))
    assert [Status(code).name for code in found.estimate.status.tolist()] == ["NO_CONTACT", "SATURATED", "NO_CONTACT"]


def test_a_sheet_that_overlaps_itself_leaves_the_upper_columns_out() -> None:
    sheet = Rolled(radius=0.0335)  # 21 columns round
    over = np.zeros((6, 22), dtype=bool)
    over[:, [0, 21]] = True
    flat = sheet.layout()
    place = SkinMap(flat.centres, flat.normals, flat.areas, flat.pitch, over)
    skin = TaxelEstimator(TaxelBody.sheet(place, bits=None), LINEAR, _health())
    assert skin.body.turn == 21
    true = press(sheet, [Patch(2.5, 0.3, 1.2, 5.0)])  # felt by columns 0 and 21
    found = skin.update(0.0, _read(true.loads))
    assert len(found) == 1
    assert found.features["load"][0] == pytest.approx(5.0, rel=0.02)


def test_what_does_not_fit_together_is_refused() -> None:
    body, skin = TaxelBody.sheet(FLAT.layout(), bits=None), _skin()
    with pytest.raises(InputError, match=r"frames of 110 cells, but the body has 6 x 22 cells.*Examine"):
        TaxelEstimator(body, LINEAR, _health(cells=110))
    with pytest.raises(InputError, match=r"taxels: no cell can be used"):
        _skin(dead=np.ones(132, dtype=bool))
    with pytest.raises(InputError, match=r"has frames of 22 x 6 cells, but the body has 6 x 22 cells.*Correct"):
        skin.run(_recording(np.arange(2.0), np.zeros((2, 22, 6))))
    with pytest.raises(InputError, match=r"at rest are not known.*Give"):
        TaxelEstimator(body, LINEAR).update(0.0, np.zeros((6, 22)))
    for out in (np.zeros((2, 5)), skin.empty(4).astype(np.float32), skin.empty(4)[:, ::-1], skin.empty(0)):
        with pytest.raises(InputError, match=r"out must be rows of 33.*Make"):
            skin.update_into(0.0, np.zeros((6, 22)), out)


def test_a_filter_that_looks_ahead_finds_the_rest_in_the_log_itself() -> None:
    """Without health; and a recording that is refused leaves nothing behind."""
    body, smooth = TaxelBody.sheet(FLAT.layout(), bits=None), Butterworth(5.0, zero_phase=True)
    time = np.arange(200) / 50.0
    cells = 0.01 * np.random.default_rng(5).standard_normal((len(time), *body.shape))
    cells[100:150, 2, 3] += 1.0
    log = _recording(time, cells)
    first = TaxelEstimator(body, LINEAR, filter=smooth, rate=50.0)
    wanted = Contacts.joined(list(first.stream([log])))
    assert wanted.answered.any()
    again = TaxelEstimator(body, LINEAR, filter=smooth, rate=50.0)
    with pytest.raises(InputError, match=r"needs later samples.*Give"):
        again.run(_recording(time, cells + 5.0))
    assert again.health is None
    assert np.array_equal(Contacts.joined(list(again.stream([log]))).rows(), wanted.rows(), equal_nan=True)
