"""Check a calibration with data that its fit did not use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from palpate.errors import PalpateError
from palpate.spatial.arguments import takes_arrays

PARTS = 4
TELLING = 1e-4  # of the largest: of directions with smaller eigenvalues a part tells nothing but its noise
OFF = 1.5  # times the stated deviations: beyond it a person is told


@dataclass(frozen=True)
class Validation:
    """The errors of predicting data that a fit did not use, relative to what the fit expects.

    Attributes:
        ratio: mean squared distance over what the covariances expect: 1 where they hold; NaN: not checked.
        parts: number of parts that were omitted, one after the other; 0: not checked.
        freedom: number of values compared.
    """

    ratio: float = np.nan
    parts: int = 0
    freedom: int = 0

    @property
    def widening(self) -> float:
        """Factor for covariances: the ratio, or 1 where the excess may be chance (two sigma of a chi-square)."""
        return self.ratio if self.parts and self.ratio > 1.0 + 2.0 * (2.0 / self.freedom) ** 0.5 else 1.0

    def __str__(self) -> str:
        if not self.parts:
            return "no part could be left out: the deviations are not checked"
        times = self.ratio**0.5
        widened = "; the deviations are widened by it" if self.widening > 1.0 else ""
        parts = "1 part, predicted" if self.parts == 1 else f"{self.parts} parts, each predicted"
        return f"{parts} from the rest: {times:.2f} times as far off as expected{widened}"

    @property
    def notes(self) -> tuple[str, ...]:
        """Tuple of one sentence if predictions are over 1.5 times as far off as expected, beyond chance; else ()."""
        if self.widening <= OFF**2:
            return ()
        return (
            f"Parts of the log, each predicted from the rest, are {self.ratio**0.5:.1f} times as far off as expected: "
            "something that is not modelled changes in the log. The covariance is widened by it.",
        )


@takes_arrays
def cross_validate(
    count: int,
    predict: Callable[[Bool[np.ndarray, " n"]], tuple[Float[np.ndarray, " p"], Float[np.ndarray, "p p"]]],
    parts: int = PARTS,
    blocks: int | None = None,
) -> Validation:
    """Compare parts of the data with their predictions from the rest; return a `Validation`.

    A part for which `predict` raises a `PalpateError` or a `LinAlgError` is skipped.

    Args:
        count: number n of rows.
        predict: maps the mask (n,) of omitted rows to the error (p,) of their prediction, and to its covariance (p, p)
            by those of the fit and of the data.
        parts: number of parts, each of consecutive rows.
        blocks: number of blocks of consecutive rows that are dealt out to the parts in turn; None: one per part.

    Raises:
        InputError: predict has another shape.
    """
    part = np.arange(count) * (blocks or parts) // max(count, 1) % parts
    squares, ranks = list[float](), list[int]()
    for k in range(parts):
        try:
            error, covariance = predict(part == k)
        except (PalpateError, np.linalg.LinAlgError):
            continue
        inverse = pseudo_inverse(covariance, TELLING)
        if rank := round(float(np.sum(inverse * covariance))):  # the trace of their product
            squares.append(float(error @ inverse @ error))
            ranks.append(rank)
    return Validation(sum(squares) / sum(ranks), len(ranks), sum(ranks)) if ranks else Validation()


@takes_arrays
def pseudo_inverse(matrix: Float[np.ndarray, "p p"], least: float = 1e-12) -> Float[np.ndarray, "p p"]:
    """Return the pseudo-inverse (p, p) of a covariance or an information whose unknowns have different units.

    Args:
        matrix: (p, p), scaled to a diagonal of 1 first.
        least: eigenvalues below this share of the largest count as 0.

    Raises:
        InputError: matrix has another shape.
    """
    size = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    size[size == 0] = np.inf
    scaled = np.linalg.pinv(matrix / np.outer(size, size), rcond=least, hermitian=True)
    return np.asarray(scaled / np.outer(size, size), dtype=np.float64)
