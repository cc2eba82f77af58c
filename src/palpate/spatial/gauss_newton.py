"""Minimise sums of squares, robust or not, by damped Gauss-Newton steps [Marquardt 1963]."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError

# damping, in squares of an unknown: always, after a step that fails, and at most
LEAST, FIRST, MOST = 1e-9, 0.1, 1e6

Place = TypeVar("Place")


@dataclass(frozen=True)
class Minimum(Generic[Place]):
    """The place of the least cost, its cost, the number of steps, and whether they ended before the limit."""

    place: Place
    cost: float
    rounds: int
    converged: bool


def damped(
    normal: Float[np.ndarray, "p p"], right: Float[np.ndarray, " p"], damping: float = 0.0
) -> Float[np.ndarray, " p"]:
    """Return the step (p,) of J' W J (p, p) and J' W r (p,); 0 for an unknown that changes no residual."""
    idle = np.diag(normal) == 0
    size = np.where(idle, 1.0, np.sqrt(np.diag(normal)))
    return np.linalg.solve(normal / np.outer(size, size) + np.diag(damping + idle), right / size) / size


def huber(size: Float[np.ndarray, "*n"], limit: float) -> tuple[Float[np.ndarray, "*n"], float]:
    """Return the weights of residuals by their size, and their cost, of which each grows as |r| beyond the limit."""
    cost = np.where(size > limit, limit * (2.0 * size - limit), size**2)
    return 1.0 / np.maximum(size / limit, 1.0), float(np.sum(cost))


def gauss_newton(
    start: Place,
    look: Callable[[Place], tuple[float, Callable[[], tuple[Any, Any]]]],
    move: Callable[[Place, Any], Place] = np.add,
    solve: Callable[[Any, Any, float], Any] = damped,
    *,
    rounds: int = 100,
    enough: float = 1e-13,
) -> Minimum[Place]:
    """Step down from `start` and return the `Minimum`; a step that raises the cost, or makes it NaN, is damped.

    Args:
        start: unknowns, of any type.
        look: returns the cost at a place, and a function that returns the matrix and the right side of a step there.
        move: returns the place after a step.
        solve: returns the step of matrix and right side with a damping.
        rounds: largest number of steps.
        enough: it ends with the step that gains less than this share of the cost.

    Raises:
        InputError: the cost at the start is not finite.
        LinAlgError: matrix and damping are singular.
    """
    place, damping = start, LEAST
    cost, equations = look(start)
    if not np.isfinite(cost):
        raise InputError("the residuals at the start of a fit are not finite.", hint="Look for NaN in the data.")
    for done in range(rounds):
        matrix, right = equations()
        while not (fresh := look(trial := move(place, solve(matrix, right, damping))))[0] <= cost:  # NaN too
            damping = max(10.0 * damping, FIRST)
            if damping > MOST:
                return Minimum(place, cost, done, True)
        gain, place, damping = cost - fresh[0], trial, max(damping / 10.0, LEAST)
        cost, equations = fresh
        if gain <= enough * cost:
            return Minimum(place, cost, done + 1, True)
    return Minimum(place, cost, rounds, False)
