"""Covariances of load cells: noise that is shared among channels, calibration, zero, mounting, and what is not felt."""

import numpy as np
import pytest

from palpate import LoadCellArray
from palpate.sensors.load_cells.model import LoadCells, with_changes
from palpate.sensors.load_cells.plate import plate_cells, with_gains
from palpate.sensors.load_cells.zero import Zero
from palpate.signals.recording import VOLTAGE, Recording
from palpate.signals.wrench_sensor import Placement
from palpate.signals.zero_filter import ZeroState
from palpate_lab.simulation.cell_array import LAYOUTS, random_cells
from tests.support.dice import agree, joint, mixed, rolled
from tests.support.payloads import MOUNT, MOUNTED, in_surface

WRENCH = np.array([0.7, -1.1, -3.0, 0.02, -0.03, 0.01])  # N, N m
HEIGHT, WAYS = 0.012, np.eye(3)  # m: of the cells of a plate


def array(**more: object) -> LoadCells:
    """Four cells of three axes whose channels share their noise."""
    matrix = random_cells(LAYOUTS[4], np.random.default_rng(4)).forward()
    return LoadCells(matrix, mixed(np.full(12, 1e-4), 1), positions=LAYOUTS[4], **more)


def plate(along: int) -> LoadCells:
    """Four unequal cells of one axis at a height."""
    places = np.insert([[0.03, 0.04], [-0.05, 0.02], [-0.02, -0.06], [0.07, -0.01]], along, HEIGHT, axis=1)
    made = plate_cells(places, np.array([1.0, 1.3, 0.8, 1.1]), mixed(np.full(4, 1e-3), 2), "xyz"[along])
    return with_changes(made, covariance=np.zeros((36, 36)))


@pytest.mark.parametrize("sound", [None, [True, True, False, True]])
@pytest.mark.parametrize("drift", [0.0, 0.7])
def test_a_wrench_is_as_sure_as_noise_drift_and_calibration(sound: list[bool] | None, drift: float) -> None:
    cells = array(covariance=mixed(np.full(36, 0.01), 3), drift=drift)
    used = None if sound is None else np.array(sound)

    def found(off: np.ndarray) -> np.ndarray:
        volts = cells.matrix @ (np.eye(6) + off[:36].reshape(6, 6)) @ WRENCH + off[36:]
        return cells.wrenches(volts, used)[0]

    stated = cells.wrenches(cells.matrix @ WRENCH, used)[1]
    agree(stated, rolled(found, joint(cells.covariance, (1 + drift**2) * cells.noise)))


@pytest.mark.parametrize("along", range(3))
def test_what_cells_of_one_axis_do_not_feel_is_a_share_of_what_they_do(along: int) -> None:
    """A force above their plane, sheared along both tangents: in their plane that is not felt, nor is torsion."""
    cells, axis = with_changes(plate(along), shear=0.2), WAYS[along]
    point, push = np.insert([0.02, -0.03], along, HEIGHT + 0.03), -4.0 * axis

    def truth(off: np.ndarray) -> np.ndarray:
        force = push + 4.0 * (off[0] * WAYS[(along + 1) % 3] + off[1] * WAYS[(along + 2) % 3])
        return np.concatenate([force, np.cross(point, force) + 4.0 * 0.01 * off[2] * axis])

    def error(off: np.ndarray) -> np.ndarray:
        return truth(off) - cells.wrenches(cells.matrix @ truth(off))[0]

    felt = np.concatenate([push, np.cross(point, push)])
    found, stated = cells.wrenches(cells.matrix @ felt)
    np.testing.assert_allclose(found, felt, atol=1e-12)
    noise = cells.inverse()[1]
    own = rolled(lambda off: cells.wrenches(cells.matrix @ felt + off)[0], cells.noise)
    for way, arm in ((1, 0.0), (2, 0.0), (0, 0.01)):
        across = WAYS[(along + way) % 3]
        more = np.r_[across, HEIGHT * np.cross(axis, across)] if not arm else arm * np.r_[np.zeros(3), axis]
        own = own + own[along, along] * np.outer(more, more)
    agree(noise, own)
    agree(stated - noise + own, rolled(error, 0.2**2 * np.eye(3)) + own)


def test_the_gains_of_a_plate_may_all_be_off_together() -> None:
    """Of a reading that is there, the wrench is -(a; l x a) g u: with errors of the gains."""
    cells = plate(2)
    own = mixed(np.full(4, 0.02), 5)
    known = with_gains(cells, own)
    felt = np.array([0.0, 0.0, *WRENCH[2:5], 0.0])
    volts = cells.matrix @ felt
    units = -np.concatenate([np.tile(WAYS[2], (4, 1)), np.cross(cells.positions, WAYS[2])], axis=1)

    def found(off: np.ndarray) -> np.ndarray:
        return units.T @ (off * volts)

    flat = np.einsum("iajb,a,b->ij", known.covariance.reshape(6, 6, 6, 6), felt, felt)
    agree(flat, rolled(found, own))


@pytest.mark.parametrize("wrong", [None, 4])
@pytest.mark.parametrize("followed", [False, True])
@pytest.mark.parametrize("share", [1.0, 0.3])
def test_a_wrench_in_the_surface_has_the_errors_of_zero_and_mounting_too(
    wrong: int | None, followed: bool, share: float
) -> None:
    """A filter takes its share of the noise only; a channel that contradicts the others is not used."""
    cells = array(covariance=mixed(np.full(36, 0.01), 3), drift=0.5)
    sensor, slow = LoadCellArray(cells, zero=Zero(np.full(12, 0.2), 0.04)), (0.04 + 0.5**2) * cells.noise
    sensor.smoothed_by(None, None, share)
    if followed:
        slow = mixed(np.full(12, 2e-4), 6)
        sensor.follow(ZeroState(np.full(12, 0.2), np.zeros(0), slow))
    volts = cells.matrix @ WRENCH + 0.2
    if wrong is not None:
        volts[wrong] += 0.5
    sensor.reset()
    measured = sensor.measure(Recording(np.array([1.0]), {VOLTAGE: volts[None].copy()}))
    wrench, stated = sensor.place(measured, measured.wrench, np.array([share]), Placement(MOUNT, MOUNTED))
    np.testing.assert_allclose(wrench[0], in_surface(WRENCH), atol=1e-9)
    kept = np.arange(12) != wrong

    def error(off: np.ndarray) -> np.ndarray:
        read = cells.matrix @ (np.eye(6) + off[:36].reshape(6, 6)) @ WRENCH + off[36:48] + off[48:60]
        return in_surface(cells.wrenches(read, kept)[0], off[60:])

    agree(stated[0], rolled(error, joint(cells.covariance, share * cells.noise, slow, MOUNTED)), 1e-4)


def test_a_change_of_voltages_as_a_wrench_has_its_own_errors_and_the_calibration_s() -> None:
    cells = array(covariance=mixed(np.full(36, 0.01), 3))
    sensor, own, change = LoadCellArray(cells), mixed(np.full(12, 1e-3), 7), cells.matrix @ WRENCH

    def found(off: np.ndarray) -> np.ndarray:
        return cells.wrenches(cells.matrix @ (np.eye(6) + off[:36].reshape(6, 6)) @ WRENCH + off[36:])[0]

    wrench, stated = sensor.as_wrench(np.stack([-change, change]), own)
    np.testing.assert_allclose(wrench, [-WRENCH, WRENCH], atol=1e-9)
    agree(stated, rolled(found, joint(cells.covariance, own)))
    agree(sensor.as_wrench(np.zeros((0, 12)), own)[1], rolled(lambda off: cells.wrenches(off)[0], own))
    noise, stays = sensor.window_noise(np.zeros((9, 12)), np.arange(9) < 4)
    agree(noise, cells.noise / 4)
    assert not stays.any()
