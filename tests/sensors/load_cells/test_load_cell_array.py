"""Load cells as a sensor: the zero of every start, and which channel or cell is believed."""

from dataclasses import replace

import numpy as np
import pytest

from palpate import LoadCellArray, Locator, Recording, WrenchEstimator
from palpate.contact.contacts import Contacts
from palpate.errors import InputError
from palpate.sensors.load_cells.explanations import explanations
from palpate.sensors.load_cells.faults import find_faults
from palpate.sensors.load_cells.model import VOLTAGE, LoadCells, with_changes
from palpate.sensors.load_cells.zero import Zero
from palpate.surfaces import EllipticCylinder
from palpate_lab.simulation.cell_array import LAYOUTS, random_cells
from palpate_lab.simulation.load_cell_bench import REST, Bench, BenchRun

SURFACE = EllipticCylinder(a=14e-3, b=5e-3, half_length=16e-3, upper=True)
ARRAY = random_cells(LAYOUTS[4], np.random.default_rng(1))
NOISE = 1e-4  # V
CELLS = LoadCells(ARRAY.forward(), np.full(12, NOISE))
PUSH = ARRAY.voltages(np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0]))  # 1 N on the middle
CHI2_95 = 5.991464547107979


def sensor(cells: LoadCells = CELLS) -> LoadCellArray:
    return LoadCellArray(cells, zero=Zero(np.zeros(len(cells.matrix))))


def some_wrenches(count: int) -> np.ndarray:
    """Of some newtons at some millimetres."""
    return np.random.default_rng(5).normal(size=(count, 6)) * [1.0, 1.0, 2.0, 0.01, 0.01, 0.01]


# --- the zero of every start


def start(begin: float, zero: float, *, rest: bool = True, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """2 s at 1 kHz: at rest, then pushed."""
    time = begin + np.arange(2000) / 1000
    pushed = np.clip((time - begin - 1.0) / 0.2, 0, 1) if rest else np.linspace(0.5, 1.0, 2000)
    noise = NOISE * np.random.default_rng(seed).normal(size=(2000, 12))
    offset = zero * np.where(np.arange(12) % 5 < 2, 1.0, -1.0)  # no wrench
    return time, offset + pushed[:, None] * PUSH + noise


def recording(*parts: tuple[np.ndarray, np.ndarray]) -> Recording:
    times, volts = zip(*parts, strict=True)
    return Recording(np.concatenate(times), {VOLTAGE: np.concatenate(volts)}, source="log")


def answered(log: Recording) -> tuple[WrenchEstimator, Contacts]:
    estimator = WrenchEstimator(Locator(SURFACE), LoadCellArray(CELLS))
    estimator.tare(log.picked(log.time <= log.time[0] + 0.5))
    pairs = list(estimator.pairs([log]))
    np.testing.assert_array_equal(np.concatenate([block.time for block, _ in pairs]), log.time)
    return estimator, Contacts.joined([found for _, found in pairs])


def test_each_start_has_its_own_zero() -> None:
    log = recording(start(0.0, 0.02), start(40.0, -0.03, seed=1), start(10.0, 0.01, seed=2))  # a gap; time runs back
    estimator, found = answered(log)
    for end in (2000, 4000, 6000):
        last = slice(end - 500, end)
        assert found.answered[last].all()
        assert np.abs(found.force[last] - [0.0, 0.0, -1.0]).max() < 0.02  # 2 mN of noise
    assert not estimator.warnings()
    np.testing.assert_array_equal(found.sample, np.arange(6000))


def test_a_first_start_that_is_touched_is_refused_and_a_later_one_doubted() -> None:
    with pytest.raises(InputError, match=r"not at rest at the start.*Let"):
        answered(recording(start(0.0, 0.02, rest=False)))
    estimator, found = answered(recording(start(0.0, 0.02), start(40.0, 0.02, rest=False)))
    assert "the start at 40.000 s is not at rest" in estimator.warnings()[0]
    assert np.abs(found.force[-20:] - [0.0, 0.0, -1.0]).max() < 0.02


def test_without_a_tare_the_zero_of_the_calibration_is_doubted() -> None:
    with pytest.raises(InputError, match=r"needs 20 samples.*Let"):
        answered(recording(start(0.0, 0.0)).picked(slice(0, 10)))
    assert "no zero of the cells was taken" in LoadCellArray(CELLS).warnings()[0]


# --- which channel or cell is believed


@pytest.mark.parametrize("count", [3, 4, 6])
def test_an_explanation_is_the_wrench_without_its_channels(count: int) -> None:
    """Generalised least squares from what is left says the same wrench, covariance and chi-square."""
    cells = LoadCells(random_cells(LAYOUTS[count], np.random.default_rng(count)).forward(), np.full(3 * count, NOISE))
    made, readings = explanations(cells), NOISE * np.random.default_rng(0).normal(size=(20, 3 * count)) + 0.01
    left = np.sum((readings @ made.rest.T) ** 2, axis=1)
    told = np.flatnonzero(made.bounds[1:] >= 0)
    assert len(told) >= 3 * count - 3
    for e in told:
        inverse, spread, rest = cells.inverse(~made.channels(int(e)))
        wrench = made.wrenches(readings, int(e))
        scale = np.sqrt(np.diag(spread))
        assert np.abs((wrench - readings @ inverse.T) / scale).max() < 1e-6
        assert np.abs((made.covariances[1 + e] - spread) / np.outer(scale, scale)).max() < 1e-8
        explained = np.sum((readings @ made.rest.T @ made.directions[e].T) ** 2, axis=1)
        np.testing.assert_allclose(left - explained, np.sum((readings @ rest.T) ** 2, axis=1), rtol=1e-6, atol=1e-6)


def test_samples_are_judged_as_numpy_judges_them() -> None:
    """The compiled loop beside its twin, each sample on its own; several that fit are mixed with equal weights."""
    rng, cells = np.random.default_rng(3), with_changes(CELLS, drift=0.3, misfit=1e-3)
    readings = ARRAY.voltages(some_wrenches(400)) + NOISE * rng.normal(size=(400, 12))
    for k in range(100, 400):
        wrong = [rng.integers(12)] if k < 300 else 3 * rng.integers(4) + np.arange(3)
        readings[k, wrong] += rng.normal(size=len(wrong)) * 10.0 ** rng.uniform(-4, -1)
    made, array = explanations(cells), sensor(cells)
    agree, fits = made.fits(readings)
    fits = made.simplest(fits)
    kinds = set()
    for k, reading in enumerate(readings):
        array.reset()
        measured = array.single(0.0, reading)
        which = int(measured.which[0])
        kinds.add(min(which, 17) if which in (0, 17, -2) else 1)
        if agree[k]:
            assert which == 0
            continue
        fitting = np.flatnonzero(fits[k])
        assert which == (-2 if not len(fitting) else 1 + fitting[0] if len(fitting) == 1 else 17)
        if not len(fitting):
            continue
        each = np.array([made.wrenches(readings[k : k + 1], int(e))[0] for e in fitting])
        np.testing.assert_allclose(measured.wrench[0], each.mean(axis=0), atol=1e-10)
        if which == 17:
            scatter = np.cov(each.T, bias=True)
            wider = (1 + cells.drift**2) * (made.covariances[1 + fitting].mean(axis=0) - made.covariances[0])
            np.testing.assert_allclose(measured.extra[0], scatter + wider, atol=1e-9 * np.abs(scatter).max() + 1e-15)
    assert kinds == {0, 1, 17}


def test_a_dead_cell_is_left_out_from_its_first_sample_on() -> None:
    wrenches = some_wrenches(500)
    readings = ARRAY.voltages(wrenches)
    readings[250:, 6:9] = 0.0
    array = sensor()
    found = array.measure(Recording(np.zeros(500), {VOLTAGE: readings}))
    assert np.all(found.which[:250] == 0)
    assert np.all(found.which[250:] == 3)
    np.testing.assert_allclose(found.wrench, wrenches, atol=1e-10)


def test_a_channel_at_its_range_is_left_out() -> None:
    wrench = np.array([[0.0, 0.0, -1.0, 0.002, 0.001, 0.0]])
    readings = ARRAY.voltages(wrench)
    largest = np.sort(np.abs(readings[0]))
    limit = largest[-2:].mean()
    limited = with_changes(CELLS, limits=np.tile([-limit, limit], (12, 1)))
    found = sensor(limited).measure(Recording(np.zeros(1), {VOLTAGE: np.clip(readings, -limit, limit)}))
    assert found.which[0] == 1 + 4 + np.abs(readings[0]).argmax()
    np.testing.assert_allclose(found.wrench, wrench, atol=1e-10)


def test_of_three_cells_a_channel_may_be_spared_and_a_cell_may_not() -> None:
    cells = LoadCells(random_cells(LAYOUTS[3], np.random.default_rng(3)).forward(), np.full(9, NOISE))
    bounds = explanations(cells).bounds
    assert np.all(bounds[1:4] < 0)
    assert np.any(bounds[4:] > 0)


BENCH = Bench()
KINDS = ("drifting", "dead", "saturated")


@pytest.fixture(scope="module")
def bench() -> BenchRun:
    return BENCH.run(0, thin=20)


def faulty(run: BenchRun, kind: str, channel: int) -> BenchRun:
    volts, begun = run.voltages.copy(), run.time[np.searchsorted(run.trajectory, run.trajectory)]
    if kind == "drifting":
        volts[:, channel] += 1e-3 * (run.time - begun)  # 1 mV/s
    elif kind == "dead":
        volts[:, channel] = 0.01
    else:
        limit = 0.5 * np.abs(volts[:, channel]).max()
        volts[:, channel] = np.clip(volts[:, channel], -limit, limit)
    return replace(run, voltages=volts)


@pytest.mark.parametrize("kind", KINDS)
def test_with_any_one_channel_wrong_ellipses_hold_the_truth_and_it_is_named(bench: BenchRun, kind: str) -> None:
    cells = LoadCells(BENCH.cells().forward(), np.full(12, BENCH.channel_noise()))
    for channel in range(12):
        run = faulty(bench, kind, channel)
        array = LoadCellArray(cells)
        estimator = WrenchEstimator(Locator(SURFACE), array)
        points, covariances, located = [], [], []
        for number in np.unique(run.trajectory):
            part = run.trajectory == number
            log = Recording(run.time[part], {VOLTAGE: run.voltages[part]})
            estimator.tare(log.picked(log.time < log.time[0] + REST - 0.1))
            found = estimator.run(log)
            points.append(found.point)
            covariances.append(found.covariance)
            located.append(found.answered)
        loaded = np.linalg.norm(run.wrench[:, :3], axis=1) >= 1.0
        use = loaded & np.concatenate(located)
        assert use.sum() > 0.99 * loaded.sum(), channel
        values, vectors = np.linalg.eigh(np.concatenate(covariances)[use])
        off = np.einsum("nij,ni->nj", vectors, np.concatenate(points)[use] - run.point[use])
        inside = np.mean(np.sum(off[:, 1:] ** 2 / values[:, 1:], axis=1) <= CHI2_95)
        assert inside >= 0.9, channel
        (fault,) = array.faults() or [None]
        if fault is None:
            assert kind == "saturated", channel  # so rarely at its range that it is no fault
            continue
        assert channel in fault.channels, channel
        assert f"{'xyz'[channel % 3]} of" in fault.text


def test_vertical_channels_that_may_all_be_it_are_all_named() -> None:
    """Four vertical channels share one redundancy: a small offset of one is one of any."""
    readings = ARRAY.voltages(np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0])) * np.linspace(1.0, 2.0, 500)[:, None]
    readings = readings + NOISE * np.random.default_rng(7).normal(size=(500, 12))
    readings[:, 2] += 15 * NOISE
    (fault,) = find_faults(CELLS, readings)
    assert 2 in fault.channels
    assert fault.kind == "unclear"
    assert "their readings cannot tell which" in fault.text
