"""A rigid frame on springs: what it puts on the cells balances what is put on it."""

import numpy as np
import pytest

from palpate.errors import GeometryError
from palpate_lab.simulation.cell_array import LAYOUTS, CellArray, in_line, random_cells


def _wrenches(count: int = 50) -> np.ndarray:
    return np.random.default_rng(1).normal(size=(count, 6)) * [1, 1, 1, 0.01, 0.01, 0.01]


@pytest.mark.parametrize("count", LAYOUTS)
def test_forces_on_the_cells_balance_the_wrench(count: int) -> None:
    cells = random_cells(LAYOUTS[count], np.random.default_rng(count))
    wrench = _wrenches()
    force = cells.forces(wrench)
    np.testing.assert_allclose(force.sum(axis=1), wrench[:, :3], atol=1e-13)  # N: roundings of some newtons
    np.testing.assert_allclose(np.cross(cells.position, force).sum(axis=1), wrench[:, 3:], atol=1e-15)


def test_equal_cells_share_a_central_push_equally() -> None:
    cells = random_cells(LAYOUTS[4], np.random.default_rng(0))
    equal = CellArray(cells.position, cells.sensitivity, np.broadcast_to(np.diag([1e5, 1e5, 2e5]), (4, 3, 3)))
    np.testing.assert_allclose(equal.forces(np.array([0, 0, -2.0, 0, 0, 0])), np.tile([0, 0, -0.5], (4, 1)), atol=1e-13)


def test_the_share_of_forces_is_the_one_of_least_energy() -> None:
    """Castigliano: of all forces that balance, a frame on springs takes those with the least f K^-1 f."""
    cells = random_cells(LAYOUTS[4], np.random.default_rng(2))
    balance = np.concatenate(
        [np.tile(np.eye(3), 4), np.concatenate([np.cross(np.eye(3), place) for place in -cells.position]).T]
    )
    _, _, vectors = np.linalg.svd(balance)
    inner = vectors[6:].reshape(6, 4, 3)  # forces among the cells that nobody sees from outside
    force = cells.forces(_wrenches())
    strain = np.linalg.solve(cells.stiffness, force[..., None])[..., 0]  # m
    assert np.abs(np.einsum("jia,nia->nj", inner, strain)).max() < 1e-18  # of 1e-5 m x 1


def test_voltages_give_the_forces_back_through_the_sensitivities() -> None:
    cells = random_cells(LAYOUTS[5], np.random.default_rng(3))
    wrench = _wrenches()
    volts = cells.voltages(wrench).reshape(-1, 5, 3)
    np.testing.assert_allclose(np.einsum("iab,nib->nia", cells.sensitivity, volts), cells.forces(wrench), atol=1e-13)
    assert np.linalg.matrix_rank(cells.forward()) == 6


@pytest.mark.parametrize("array", [True, False])
def test_voltage_noise_is_worth_what_it_says(array: bool) -> None:
    cells = random_cells(LAYOUTS[4], np.random.default_rng(4))
    volts = np.random.default_rng(5).normal(size=(40_000, 4, 3)) * cells.voltage_noise(2e-3, array=array)
    force = np.einsum("iab,nib->nia", cells.sensitivity, volts)
    seen = force.sum(axis=1) if array else force
    assert np.sqrt(np.mean(seen**2)) == pytest.approx(2e-3, rel=0.02)  # 120,000 draws: 0.2 %, five times over


def test_cells_in_line_need_a_twist_to_hold_the_frame() -> None:
    free = random_cells(in_line(), np.random.default_rng(6))
    with pytest.raises(GeometryError, match="can turn freely"):
        free.shares()
    held = random_cells(in_line(), np.random.default_rng(6), twist=0.5)
    turning = np.array([0, 0, 0, 0, 0.01, 0.0])  # about their line
    assert np.abs(np.cross(held.position, held.forces(turning)).sum(axis=0)[1]) < 1e-4  # N m: nearly none measured
