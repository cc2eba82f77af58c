"""Load cells: the forward model, its subsets, zero and faults. Truth is the statics of a frame on springs."""

import numpy as np
import pytest

from palpate.contact.indentation import Indentation
from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.load_cells.faults import find_faults
from palpate.sensors.load_cells.model import LoadCells, require_layout, with_changes
from palpate.sensors.load_cells.zero import take_zero
from palpate.signals.correlation import correlation_time
from palpate_lab.simulation.cell_array import LAYOUTS, CellArray, in_line, random_cells

NOISE = 1e-4  # V


def array(count: int = 4) -> CellArray:
    return random_cells(LAYOUTS[count], np.random.default_rng(count))


def made(count: int = 4) -> LoadCells:
    return LoadCells(array(count).forward(), np.full(3 * count, NOISE), positions=LAYOUTS[count])


def some_wrenches(count: int = 500) -> np.ndarray:
    """Of some newtons at some millimetres."""
    return np.random.default_rng(5).normal(size=(count, 6)) * [1.0, 1.0, 2.0, 0.01, 0.01, 0.01]


@pytest.mark.parametrize("count", [3, 4, 6])
def test_wrench_comes_back(count: int) -> None:
    wrenches = some_wrenches()
    found, _ = made(count).wrenches(array(count).voltages(wrenches))
    np.testing.assert_allclose(found, wrenches, atol=1e-11)  # rounding, times the condition of the layout


def test_what_no_wrench_explains_is_chi_square() -> None:
    rng, cells = np.random.default_rng(11), made()
    readings = array().voltages(some_wrenches(20_000)) + NOISE * rng.normal(size=(20_000, 12))
    square = cells.chi_square(readings)
    assert abs(square.mean() - 6) < 5 * np.sqrt(12 / 20_000)
    assert abs(square.var() - 12) < 0.6  # five deviations
    assert with_changes(cells, drift=1.0).chi_square(readings).mean() == pytest.approx(square.mean() / 2)


def test_cells_in_line_are_refused_by_name() -> None:
    with pytest.raises(NotIdentifiable, match=r"in line along y.*torque about y") as refusal:
        require_layout(in_line(4))
    assert refusal.value.rank == 5
    matrix = random_cells(in_line(3), np.random.default_rng(3), twist=1.0).forward()
    with pytest.raises(NotIdentifiable, match="torque about y"):
        LoadCells(matrix, np.full(9, NOISE))
    with pytest.raises(NotIdentifiable, match="in line along y"):  # as seen along their axis
        require_layout(np.array([[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.3, 0.2, 0.0]]), ("x",))
    require_layout(np.full((4, 3), np.nan))  # nothing is known, nothing is said


def test_what_cannot_be_meant_is_refused() -> None:
    matrix = made().matrix
    with pytest.raises(InputError, match="3 rows for each"):
        LoadCells(matrix[:8], np.ones(8))
    with pytest.raises(InputError, match=r"load_cells: bias must be"):
        LoadCells(matrix, np.full(12, NOISE), bias=np.zeros(3))
    with pytest.raises(InputError, match=r"load_cells: .*positive definite covariance"):
        LoadCells(matrix, np.zeros(12))
    with pytest.raises(InputError, match=r"indentation.*Use"):
        Indentation(-1.0)


def test_values_are_frozen() -> None:
    with pytest.raises(ValueError, match="read-only"):
        made().matrix[0, 0] = 1.0


def test_correlation_time_of_a_first_order_process() -> None:
    rng, rho, count = np.random.default_rng(13), 0.8, 200_000
    from scipy.signal import lfilter

    white = rng.normal(size=(count, 2))
    white[:, 0] = lfilter([1.0], [1.0, -rho], white[:, 0])
    slow, fast = correlation_time(white)
    assert slow == pytest.approx((1 + rho) / (1 - rho), rel=0.05)  # [Geyer 1992]; scatters by 2 %
    assert fast == pytest.approx(1.0, abs=0.05)


def test_zero_is_the_mean_of_a_window_at_rest() -> None:
    rng, cells, zero = np.random.default_rng(17), made(), np.linspace(-0.1, 0.1, 12)
    window = zero + NOISE * rng.normal(size=(1000, 12))
    found = take_zero(cells, window)
    assert np.abs(found.voltage - zero).max() < 5 * NOISE / np.sqrt(1000)
    assert found.share == pytest.approx(1e-3, rel=0.3)  # correlation of white noise is found to be about 1
    with pytest.raises(InputError, match=r"20 samples.*Let"):
        take_zero(cells, window[:10])


def test_zero_of_a_window_that_is_touched_is_refused() -> None:
    rng, cells = np.random.default_rng(19), made()
    touch = np.linspace(0, 1, 1000)[:, None] * array().voltages(np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0]))
    window = touch + NOISE * rng.normal(size=(1000, 12))
    with pytest.raises(InputError, match=r"not at rest at the start: channel.*Let"):
        take_zero(cells, window)
    alone = NOISE * rng.normal(size=(1000, 12))
    alone[:, 3] += np.linspace(0, 0.1, 1000)
    assert "cell 2 alone" in take_zero(cells, alone).warning
    still = touch[-1] + NOISE * rng.normal(size=(1000, 12))  # a touch that stands still
    assert "as under a touch of 1 N" in take_zero(cells, still).warning


def sliding() -> np.ndarray:
    """Readings of a load that moves, with noise."""
    rng, t = np.random.default_rng(23), np.linspace(0, 6, 4000)
    x, y = 9e-3 * np.sin(t), 12e-3 * np.cos(1.3 * t)
    force = np.stack([0.4 * np.sin(3 * t), 0.4 * np.cos(2 * t), -1.5 + 0.3 * np.sin(5 * t)], axis=1)
    place = np.stack([x, y, np.full_like(t, 4e-3)], axis=1)
    wrench = np.concatenate([force, np.cross(place, force)], axis=1)
    return array().voltages(wrench) + NOISE * rng.normal(size=(4000, 12))


@pytest.mark.parametrize("cell", range(4))
@pytest.mark.parametrize("kind", ["dead", "stuck", "saturated", "drifting", "unit"])
def test_each_fault_of_each_cell_is_named(kind: str, cell: int) -> None:
    readings, rows = sliding(), slice(3 * cell, 3 * cell + 3)
    if kind == "dead":
        readings[:, rows] = 0.01
    elif kind == "stuck":
        readings[2500:, rows] = 1.2  # beyond all that it read before, and no load is
    elif kind == "saturated":
        limit = 0.7 * np.abs(readings[:, rows]).max()  # what is always at its range stands still, and is dead
        readings[:, rows] = np.clip(readings[:, rows], -limit, limit)
    elif kind == "drifting":
        readings[:, rows] += np.linspace(0, 0.02, len(readings))[:, None]
    else:
        readings[:, 3 * cell + 2] *= 1e3
    found = find_faults(made(), readings)
    assert [(fault.kind, fault.cells) for fault in found] == [(kind, (cell,))]


@pytest.mark.parametrize("level", ["last", "zero", "noise"])
def test_a_channel_that_dies_during_the_log_is_dead_from_then_on(level: str) -> None:
    rng, time = np.random.default_rng(31), 5.0 + np.arange(4000) / 100
    for channel in range(12):
        readings, died = sliding(), int(rng.integers(1000, 3000))
        readings[:100] = NOISE * rng.normal(size=(100, 12))  # it begins at rest
        others = {"last": readings[died, channel], "zero": -0.003, "noise": NOISE * rng.normal(size=4000 - died)}
        readings[died:, channel] = others[level]
        (fault,) = find_faults(made(), readings, time=time)
        if fault.kind == "unclear":  # one redundancy is shared by all vertical channels
            assert channel in fault.channels
            continue
        assert (fault.kind, fault.cells, fault.channels) == ("dead", (channel // 3,), (channel,))
        since = float(fault.text.split(" from ")[1].split(" s ")[0])
        assert since == pytest.approx(time[died], abs=0.05), channel


@pytest.mark.parametrize(("since", "until", "kind"), [(2500, 4000, "stuck"), (0, 0, "saturated")])
def test_of_three_cells_one_at_one_voltage_is_named(since: int, until: int, kind: str) -> None:
    """To the end of the log, or while the load is beyond it."""
    readings, cells = sliding()[:, :9], LoadCells(array().forward()[:9], np.full(9, NOISE))
    limit = 0.6 * np.abs(readings[:, :3]).max()
    readings[:, :3] = np.clip(readings[:, :3], -limit, limit) if kind == "saturated" else readings[:, :3]
    readings[since:until, :3] = 1.2
    assert [(fault.kind, fault.cells) for fault in find_faults(cells, readings)] == [(kind, (0,))]


def test_exchanged_cells_are_named_and_sound_ones_are_not() -> None:
    readings = sliding()
    assert find_faults(made(), readings) == []
    swapped = readings.copy()
    swapped[:, [0, 1, 2, 9, 10, 11]] = readings[:, [9, 10, 11, 0, 1, 2]]
    found = find_faults(made(), swapped)
    assert [(fault.kind, fault.cells) for fault in found] == [("swapped", (0, 3))]
    mixed = np.random.default_rng(29).permutation(12)
    assert find_faults(made(), readings[:, mixed])[0].kind == "several"
