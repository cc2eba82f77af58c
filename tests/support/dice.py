"""Covariances against dice: errors drawn from a stated covariance, through the function, have the covariance it states.

The dice are even: of n correlated errors they show 2 n throws, whose mean is 0 and whose covariance is the stated one
to the last digit. So what comes out has J C J' but for squares of the errors, which are small, and no throw of luck
hides a sign or a term. The truth (`answer`) is of the test; what is under test only states.
"""

from collections.abc import Callable

import numpy as np

SMALL = 1e-3  # of the deviations: squares of the errors are a thousandth of a thousandth


def mixed(scales: np.ndarray, seed: int) -> np.ndarray:
    """A covariance (n, n) of deviations about `scales`, no two alike, of which any two correlate by 0.2 to 0.7."""
    rng, count = np.random.default_rng(seed), len(scales)
    common, size = rng.uniform(0.45, 0.85, count) * rng.choice([-1.0, 1.0], count), rng.uniform(0.5, 2.0, count)
    root = np.column_stack([common, np.diag(np.sqrt(1.0 - common**2))]) * (scales * size)[:, None]
    return root @ root.T


def even(covariance: np.ndarray, small: float = SMALL) -> np.ndarray:
    """Throws (2n, n) whose covariance is this one (n, n) times `small` squared; it may be singular."""
    size = np.sqrt(np.diag(covariance))
    size = np.where(size > 0.0, size, 1.0)  # of errors whose units are far apart
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    root = (vectors * np.sqrt(np.maximum(values, 0.0))).T * size * small * np.sqrt(len(values))
    return np.concatenate([root, -root])


def rolled(answer: Callable[[np.ndarray], np.ndarray], covariance: np.ndarray, small: float = SMALL) -> np.ndarray:
    """The covariance (m, m) of answers (m,) to errors (n,) of a covariance (n, n)."""
    ends = np.stack([np.ravel(answer(throw)) for throw in even(covariance, small)])
    half = (ends[: len(ends) // 2] - ends[len(ends) // 2 :]) / (2.0 * small)
    return half.T @ half / (len(ends) // 2)


def agree(stated: np.ndarray, found: np.ndarray, tolerance: float = 1e-5) -> None:
    """Every entry, over the deviations of its row and column: a wrong sign of one cross term is no rounding."""
    scale = np.sqrt(np.diag(found))
    scale = np.where(scale > 1e-9 * scale.max(), scale, scale.max())
    off = np.abs(stated - found) / np.outer(scale, scale)
    assert stated.shape == found.shape
    assert off.max() < tolerance, f"entry {np.unravel_index(off.argmax(), off.shape)} is {off.max():.2g} off"


def joint(*parts: np.ndarray) -> np.ndarray:
    """One covariance of errors that know nothing of each other."""
    ends = np.cumsum([0, *map(len, parts)])
    made = np.zeros((ends[-1], ends[-1]))
    for part, begin, end in zip(parts, ends[:-1], ends[1:], strict=True):
        made[begin:end, begin:end] = part
    return made
