"""Table I: twelve rows of errors, and the paper's figures beside them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from experiments.load_cells.study import LEAST, Answer, Study

__all__ = ["PAPER", "Errors", "errors", "rows"]

PAPER: dict[str, tuple[float, float, float, float]] = {  # mean, max, standard deviation, RMSE; mN and um
    "p_x": (1.2045, 158.0748, 29.2061, 29.2309),
    "p_y": (-1.1449, 108.6501, 22.3881, 22.4174),
    "p_z": (3.4771, 206.8778, 18.7274, 19.0474),
    "|p|": (37.7935, 240.5656, 17.0715, 41.4703),
    "c_x": (-0.6251968, 611.1280, 103.8326, 103.8344),
    "c_y": (2.3156, 520.0804, 94.6500, 94.6783),
    "c_z": (0.1361755, 79.0515, 13.9571, 13.9578),
    "|c|": (118.6432, 621.0372, 76.5780, 141.2105),
}
HEADER = ("mean", "max", "SD", "RMSE")


@dataclass(frozen=True)
class Errors:
    """Of one quantity: mean (of signed components, of sizes of vectors), largest size, deviation, RMSE."""

    mean: float
    most: float
    deviation: float
    rmse: float

    @classmethod
    def of(cls, error: Float[np.ndarray, " n"]) -> Errors:
        """Of errors of one component, or of sizes of errors."""
        square = float(np.sqrt(np.mean(error**2)))
        return cls(float(error.mean()), float(np.abs(error).max()), float(error.std()), square)

    def cells(self, scale: float) -> list[str]:
        """As text."""
        return [f"{scale * value:.4g}" for value in (self.mean, self.most, self.deviation, self.rmse)]


def errors(study: Study, answer: Answer, least: float = LEAST) -> dict[str, Errors]:
    """The twelve rows: force against the reference as the paper has it, against the truth, and position."""
    run, loaded = study.second, study.loaded(least)
    found: dict[str, Errors] = {}
    for name, difference in (
        ("p", answer.force - run.force),
        ("p, truth", answer.force - run.wrench[:, :3]),
        ("c", answer.point - run.point),
    ):
        used = difference[loaded]
        letter, _, rest = name.partition(",")
        for axis in range(3):
            found[f"{letter}_{'xyz'[axis]}{',' + rest if rest else ''}"] = Errors.of(used[:, axis])
        found[f"|{letter}|{',' + rest if rest else ''}"] = Errors.of(np.linalg.norm(used, axis=1))
    return found


def rows(found: dict[str, dict[str, Errors]]) -> list[list[str]]:
    """A row a quantity: its name with the unit, the paper's four figures, then four of each named column."""
    first = next(iter(found.values()))
    lines: list[list[str]] = []
    for name in first:
        scale, unit = (1e6, "um") if "c" in name.partition(",")[0] else (1e3, "mN")
        theirs = PAPER.get(name)
        paper = ["", "", "", ""] if theirs is None else [f"{value:.4g}" for value in theirs]
        lines.append([f"{name} [{unit}]", *paper, *(cell for one in found.values() for cell in one[name].cells(scale))])
    return lines
