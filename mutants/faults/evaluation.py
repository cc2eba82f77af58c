"""Estimates against what is known."""

from mutants.fault import Fault, of

__all__ = ["FAULTS"]

FAULTS: list[Fault] = [
    *of(
        "evaluation/errors.py",
        "tests/evaluation",
        ("chi-square of one degree of freedom", "square <= CHI2_95", "square <= 3.84"),
        ("along the normal instead of across it", "vectors[:, :, 1:]", "vectors[:, :, :2]"),
        ("a line counts as an ellipse", "values[:, 1] <= _FLAT * values[:, 2]", "values[:, 2] < 0.0"),
        ("no direction has an angle", "np.where(zero, np.nan, np.arctan2(sine, cosine))", "np.arctan2(sine, cosine)"),
    ),
    *of(
        "evaluation/matching.py",
        "tests/evaluation",
        ("matched beyond the tolerance", "tolerance + 1e-6", "2.0 * tolerance"),
        ("only the next known time, never the one before", "(right - 1).clip(min=0)", "right"),
    ),
]
