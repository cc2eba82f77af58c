"""`python -m experiments.load_cells [--small] [--seed N]`: run the benches, write README.md and its figures.

With --small every tenth sample is used; --seed takes other cells and other noise. Neither writes anything.
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from experiments.check import Check, table
from experiments.load_cells import figures
from experiments.load_cells.page import UNITS, page
from experiments.load_cells.study import PAPER, Answer, Study
from experiments.load_cells.table import HEADER, Errors, errors, rows
from palpate_lab.simulation.load_cell_bench import BENCHES

__all__ = ["checks", "figures_of", "main", "studies"]

FOLDER = Path(__file__).parent
SMALL = 10
TORSION = 5e-3  # N m


def studies(thin: int = 1, seed: int = 0) -> dict[str, Study]:
    """All benches, by the names of expected.toml."""
    rigid, soft, drift = (replace(BENCHES[name], seed=seed) for name in ("rigid", "soft layer", "drift"))
    return {
        "rigid": Study(rigid, thin=thin),
        "rigid_cell": Study(replace(rigid, per_cell=True), thin=thin),
        "soft": Study(soft, indentation=True, thin=thin),
        "drift": Study(drift, thin=thin),
        "torque": Study(rigid, replace(rigid, torsion=TORSION), thin=thin),
    }


def figures_of(study: Study, answer: Answer) -> dict[str, float]:
    """What expected.toml may ask of an answer [SI]."""
    found, loaded = errors(study, answer), study.loaded()
    torque = (answer.torque - study.second.torque)[loaded]
    return {
        "position_rmse": found["|c|"].rmse,
        "position_max": found["|c|"].most,
        "force_rmse": found["|p|, truth"].rmse,
        "torque_rmse": float(np.sqrt(np.mean(torque**2))),
    }


def checks(made: Mapping[str, Study]) -> list[Check]:
    """All that expected.toml asks for, measured."""
    got = {name: figures_of(study, study.ours) for name, study in made.items()}
    got["soft_theirs"] = figures_of(made["soft"], made["soft"].theirs)
    for name in ("drift", "torque"):
        got[name]["position_ratio"] = got[name]["position_rmse"] / got["rigid"]["position_rmse"]
    wanted = tomllib.loads((FOLDER / "expected.toml").read_text(encoding="utf-8"))
    return [
        _check(bench["what"], figure, want, got[name][figure])
        for name, bench in wanted.items()
        for figure, want in bench.items()
        if figure != "what"
    ]


def _check(bench: str, figure: str, want: Mapping[str, float], got: float) -> Check:
    scale, unit = UNITS[figure]
    what = f"{bench}: {figure.replace('_', ' ')}{f' [{unit}]' if unit else ''}"
    return Check.of(want, got, what, scale=scale)


def main() -> int:
    """0 when everything that is asked for is met."""
    parser = argparse.ArgumentParser(prog="python -m experiments.load_cells", description=__doc__)
    parser.add_argument("--small", action="store_true", help="every tenth sample; nothing is written")
    parser.add_argument("--seed", type=int, default=0, help="of the cells and of everything else; nothing is written")
    asked = parser.parse_args()
    made = studies(SMALL if asked.small else 1, asked.seed)
    found = checks(made)
    for check in found:
        print(" | ".join(check.cells()))
    if not (asked.small or asked.seed):
        _write(made, found)
    return 0 if all(check.met for check in found) else 1


def _write(made: Mapping[str, Study], found: list[Check]) -> None:
    soft, rigid, drift = made["soft"], made["rigid"], made["drift"]
    panels = {
        "rigid": (rigid, rigid.ours),
        "soft layer": (soft, soft.ours),
        "soft layer, the paper's (18)": (soft, soft.theirs),
        "drift": (drift, drift.ours),
    }
    figures.paths(panels, FOLDER / "paths.png")
    figures.forces(soft, soft.ours, FOLDER / "forces.png")
    (FOLDER / "README.md").write_text(page(found, _tables(made), _remarks(made)), encoding="utf-8")


def _remarks(made: Mapping[str, Study]) -> dict[str, str]:
    """Sentences with figures in them, by their places in the page."""
    rigid, soft = made["rigid"], made["soft"]
    law = soft.calibration.cells.indentation
    depth, exponent = (0.0, 0.0) if law is None else (law.depth, law.exponent)
    blind = replace(soft, indentation=False)
    light = {name: errors(made[name], made[name].ours, PAPER)["|c|"] for name in ("rigid", "soft", "drift")}
    figure = {
        "without": errors(blind, blind.ours)["|c|"].rmse,
        "rigid": errors(rigid, rigid.estimate("wrench_axis"))["|c|"].rmse,
        "soft": errors(soft, soft.estimate("wrench_axis"))["|c|"].rmse,
    }
    um = {name: f"{1e6 * value:.0f} um" for name, value in figure.items()}
    return {
        "law": f"Fitted with the cells, its law is a depth of {1e3 * depth:.3f} mm at 1 N that grows with force to the "
        f"power {exponent:.3f} (a flat foundation under a shallow ball has 1/2); without it ours errs {um['without']}.",
        "told": f"Told the same (`wrench_axis`), ours errs {um['rigid']} on the rigid bench and {um['soft']} on the "
        "soft one.",
        "lighter": "From the paper's 0.6 N on, the position errs "
        + ", ".join(f"{1e6 * e.rmse:.0f} um RMSE and {1e6 * e.most:.0f} um at worst ({k})" for k, e in light.items())
        + ".",
    }


def _tables(made: Mapping[str, Study]) -> str:
    """Table I once a bench: the paper, ours, and the paper's estimator."""
    parts: list[str] = []
    for name, title in (
        ("rigid", "Rigid, array noise 2 mN an axis"),
        ("rigid_cell", "Rigid, 2 mN a cell"),
        ("soft", "Soft layer"),
        ("drift", "Drift of 0.5 mV a run"),
    ):
        study = made[name]
        columns: dict[str, dict[str, Errors]] = {
            "ours": errors(study, study.ours),
            "(18)": errors(study, study.theirs),
        }
        header = ["", *(f"{who} {what}" for who in ("paper", *columns) for what in HEADER)]
        parts.append(f"### {title}\n\n{table(header, rows(columns))}")
    return "\n\n".join(parts)


if __name__ == "__main__":
    sys.exit(main())
