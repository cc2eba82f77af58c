"""Law 3: whatever states a covariance states that of its errors, with everything correlated, unequal and moving.

Rows of the law stand in their rooms (`test_*covariances.py` there), on the dice of `tests.support.dice`; here is the
list of all that states one, walked from the source, and which test holds it against dice.
"""

from __future__ import annotations

import numpy as np

from tests.support.dice import agree, even, mixed


def test_throws_of_dice_are_what_they_are_called() -> None:
    own = mixed(np.array([1.0, 1e-3, 5.0]), 7)
    throws = even(own, 1.0)
    np.testing.assert_allclose(throws.mean(axis=0), 0.0, atol=1e-12)
    agree(throws.T @ throws / len(throws), own, 1e-9)
    assert np.abs(np.corrcoef(throws.T)[np.triu_indices(3, 1)]).min() > 0.2
