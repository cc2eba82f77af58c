"""Single sensitivities and places: determined by a prior, and refused by name where they are not."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.load_cells import LoadCells, single_wrench_map
from palpate.sensors.single_cells import single_cells
from palpate.simulation.cell_array import LAYOUTS, random_cells

ARRAY = random_cells(LAYOUTS[4], np.random.default_rng(1))


def made(positions: np.ndarray = LAYOUTS[4]) -> LoadCells:
    return LoadCells(ARRAY.forward(), np.full(12, 1e-4), positions=positions, covariance=1e-8 * np.eye(36))


def test_without_more_knowledge_they_are_not_determined() -> None:
    with pytest.raises(NotIdentifiable, match=r"of 48 combinations .* not determined: force along") as refusal:
        single_cells(made(), ARRAY.sensitivity)
    assert 20 < refusal.value.rank < 40
    assert refusal.value.missing


def test_what_is_found_reads_every_wrench() -> None:
    rng = np.random.default_rng(2)
    prior = ARRAY.sensitivity * (1 + 0.1 * rng.normal(size=(4, 1, 1)))
    found = single_cells(made(LAYOUTS[4] + 1e-3 * rng.normal(size=(4, 3))), prior, known=np.inf, near=np.inf)
    wrenches = rng.normal(size=(100, 6)) * [1, 1, 1, 0.01, 0.01, 0.01]
    forces = np.einsum("kab,nkb->nka", found.sensitivity, ARRAY.voltages(wrenches).reshape(-1, 4, 3))
    summed = sum(forces[:, k] @ single_wrench_map(found.position[k]).T for k in range(4))
    np.testing.assert_allclose(
        summed, wrenches, atol=2e-3, rtol=2e-3
    )  # the calibration is known to 1e-4, the prior pulls
    assert 0.3 < found.determined.mean() < 0.9  # 36 equations for 48 unknowns


def test_a_close_prior_determines_them() -> None:
    found = single_cells(made(), ARRAY.sensitivity, spread=0.01, place_spread=1e-4)
    np.testing.assert_allclose(found.sensitivity, ARRAY.sensitivity, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.position, ARRAY.position, atol=1e-9)


def test_the_covariance_holds_the_truth() -> None:
    rng, square = np.random.default_rng(3), list[float]()
    largest = np.repeat(np.abs(ARRAY.sensitivity).max(axis=(1, 2)), 9).reshape(4, 3, 3)
    for _ in range(40):
        prior = ARRAY.sensitivity + 0.02 * largest * rng.normal(size=(4, 3, 3))
        places = ARRAY.position + 5e-4 * rng.normal(size=(4, 3))
        found = single_cells(made(places), prior, spread=0.02, place_spread=5e-4, known=np.inf, near=np.inf)
        off = np.concatenate(
            [(found.sensitivity - ARRAY.sensitivity).reshape(-1), (found.position - ARRAY.position).reshape(-1)]
        )
        values, vectors = np.linalg.eigh(found.covariance / np.outer(*[np.sqrt(np.diag(found.covariance))] * 2))
        loose = values > 1e-6  # what the calibration determines errs by nothing here
        along = vectors[:, loose].T @ (off / np.sqrt(np.diag(found.covariance)))
        square.append(float(np.mean(along**2 / values[loose])))
    assert 0.7 < np.mean(square) < 1.3


def test_places_must_be_known_roughly() -> None:
    with pytest.raises(InputError, match="places of all cells"):
        single_cells(made(np.full((4, 3), np.nan)), ARRAY.sensitivity)
    with pytest.raises(InputError, match="sensitivities must be"):
        single_cells(made(), np.zeros((3, 3, 3)))
