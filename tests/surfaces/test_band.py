"""Band systems against the dense solver."""

import numpy as np
import pytest

from palpate.surfaces._band import solve_band


def _banded(n: int, width: int, shift: float) -> tuple[np.ndarray, np.ndarray]:
    """A symmetric matrix, dense and as bands below its diagonal."""
    rng = np.random.default_rng(n)
    dense = np.zeros((n, n))
    for k in range(width):
        dense += np.diag(rng.normal(size=n - k), -k)
    dense = np.tril(dense, -1) + np.tril(dense, -1).T + np.diag(np.full(n, shift))
    band = np.zeros((n, width))
    for k in range(width):
        band[: n - k, k] = np.diag(dense, -k)
    return dense, band


def test_it_solves_what_is_positive() -> None:
    dense, band = _banded(30, 4, 12.0)
    wanted = np.linspace(-1.0, 2.0, 30)
    vector = dense @ wanted
    assert solve_band(band, vector)
    np.testing.assert_allclose(vector, wanted, atol=1e-12)


@pytest.mark.parametrize("shift", [-12.0, 0.0, np.nan])
def test_it_refuses_what_is_not(shift: float) -> None:
    _, band = _banded(30, 4, shift)
    assert not solve_band(band, np.ones(30))
