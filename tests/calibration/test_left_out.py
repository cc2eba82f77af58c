"""Data that are left out lie as far from a prediction as its covariance says, or the ratio says how much further."""

import numpy as np
import pytest

from palpate.calibration.validation import Validation, cross_validate
from palpate.errors import NotIdentifiable


def _line(rng: np.random.Generator, noise: float) -> Validation:
    """Leave parts of a straight line out whose points are stated to err by 1."""
    x = rng.uniform(size=60)
    columns = np.stack([np.ones(60), x], axis=1)
    y = columns @ [2.0, 3.0] + noise * rng.normal(size=60)

    def predict(left: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        inverse = np.linalg.inv(columns[~left].T @ columns[~left])
        found = inverse @ columns[~left].T @ y[~left]
        return y[left] - columns[left] @ found, np.eye(left.sum()) + columns[left] @ inverse @ columns[left].T

    return cross_validate(60, predict)


@pytest.mark.parametrize("noise", [1.0, 3.0])
def test_the_ratio_is_the_variance_over_what_is_stated(noise: float) -> None:
    """The mean of 30 x 60 squares of standard normal numbers has a deviation of sqrt(2 / 1800) = 0.033."""
    found = [_line(np.random.default_rng(seed), noise) for seed in range(30)]
    assert np.mean([each.ratio for each in found]) == pytest.approx(noise**2, rel=0.15)
    assert all(each.parts == 4 for each in found)
    assert all(bool(each.notes) == (noise > 2) for each in found)


def test_nothing_is_widened_where_nothing_can_be_left_out() -> None:
    def refuse(left: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        raise NotIdentifiable("too few", rank=0, missing=("all",))

    found = cross_validate(3, refuse)
    assert (found.parts, found.widening, found.notes) == (0, 1.0, ())
    assert "not checked" in str(found)
