"""The `load cells` paper, run again on a simulated bench: its table I and its figure 7, theirs beside ours."""

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from claims.page import asked, fill, table
from claims.papers.load_cells import figures
from claims.papers.load_cells.study import LEAST, PAPER, Answer, Study
from claims.row import Row
from palpate_lab.simulation.load_cell_bench import BENCHES

FOLDER = Path(__file__).parent
SMALL = 10  # every how manieth sample
TORSION = 5e-3  # N m
UNITS = {
    "position_rmse": (1e6, "um"),
    "position_max": (1e6, "um"),
    "force_rmse": (1e3, "mN"),
    "torque_rmse": (1e3, "N mm"),
    "position_ratio": (1.0, ""),
}
HEADER = ("mean", "max", "SD", "RMSE")
TABLE_1 = {  # as `HEADER` says; mN and um
    "p_x": (1.2045, 158.0748, 29.2061, 29.2309),
    "p_y": (-1.1449, 108.6501, 22.3881, 22.4174),
    "p_z": (3.4771, 206.8778, 18.7274, 19.0474),
    "|p|": (37.7935, 240.5656, 17.0715, 41.4703),
    "c_x": (-0.6251968, 611.1280, 103.8326, 103.8344),
    "c_y": (2.3156, 520.0804, 94.6500, 94.6783),
    "c_z": (0.1361755, 79.0515, 13.9571, 13.9578),
    "|c|": (118.6432, 621.0372, 76.5780, 141.2105),
}


def studies(thin: int = 1, seed: int = 0) -> dict[str, Study]:
    """Return all benches, by the names of expected.toml; another seed has other cells and other noise."""
    rigid, soft, drift = (replace(BENCHES[name], seed=seed) for name in ("rigid", "soft layer", "drift"))
    return {
        "rigid": Study(rigid, thin=thin),
        "rigid_cell": Study(replace(rigid, per_cell=True), thin=thin),
        "soft": Study(soft, indentation=True, thin=thin),
        "drift": Study(drift, thin=thin),
        "torque": Study(rigid, replace(rigid, torsion=TORSION), thin=thin),
    }


def sizes(error: np.ndarray) -> np.ndarray:
    """Return the figures of `HEADER` for errors (n,) of a component, or sizes of errors: the largest is a size."""
    return np.array([error.mean(), np.abs(error).max(), error.std(), np.sqrt(np.mean(error**2))])


def errors(study: Study, answer: Answer, least: float = LEAST) -> dict[str, np.ndarray]:
    """Return table I: force against the reference as the paper has it, against the truth, and position."""
    run, loaded, found = study.second, study.loaded(least), dict[str, np.ndarray]()
    for letter, end, off in (
        ("p", "", answer.force - run.force),
        ("p", ", truth", answer.force - run.wrench[:, :3]),
        ("c", "", answer.point - run.point),
    ):
        found |= {f"{letter}_{axis}{end}": sizes(each) for axis, each in zip("xyz", off[loaded].T, strict=True)}
        found[f"|{letter}|{end}"] = sizes(np.linalg.norm(off[loaded], axis=1))
    return found


def table_1(*columns: dict[str, np.ndarray]) -> list[list[str]]:
    """Return a row a quantity: its name with the unit, the paper's four figures, then four of each column."""
    lines = list[list[str]]()
    for name in columns[0]:
        scale, unit = (1e6, "um") if "c" in name.partition(",")[0] else (1e3, "mN")
        figures = [*TABLE_1.get(name, [""] * 4), *np.concatenate([scale * one[name] for one in columns])]
        lines.append([f"{name} [{unit}]", *(f"{each:.4g}" if each != "" else "" for each in figures)])
    return lines


def figures_of(study: Study, answer: Answer) -> dict[str, float]:
    """Return what expected.toml may ask of an answer [SI]."""
    found, torque = errors(study, answer), (answer.torque - study.second.torque)[study.loaded()]
    return {
        "position_rmse": found["|c|"][3],
        "position_max": found["|c|"][1],
        "force_rmse": found["|p|, truth"][3],
        "torque_rmse": float(np.sqrt(np.mean(torque**2))),
    }


def checks(made: Mapping[str, Study]) -> Iterator[Row]:
    got = {name: figures_of(study, study.ours) for name, study in made.items()}
    got["soft_theirs"] = figures_of(made["soft"], made["soft"].theirs)
    for name in ("drift", "torque"):
        got[name]["position_ratio"] = got[name]["position_rmse"] / got["rigid"]["position_rmse"]
    for name, bench in tomllib.loads((FOLDER / "expected.toml").read_text(encoding="utf-8")).items():
        said = bench.pop("what")
        for figure, want in bench.items():
            scale, unit = UNITS[figure]
            what = f"{said}: {figure.replace('_', ' ')}{f' [{unit}]' if unit else ''}"
            yield Row.bounded(want, got[name][figure], what, scale=scale)


def parts(made: Mapping[str, Study]) -> dict[str, object]:
    """Return what stands in the page, by its place there."""
    rigid, soft = made["rigid"], made["soft"]
    law, blind = soft.calibration.cells.indentation, replace(soft, indentation=False)
    light = {name: 1e6 * errors(made[name], made[name].ours, PAPER)["|c|"] for name in ("rigid", "soft", "drift")}
    columns = ["", *(f"{who} {what}" for who in ("paper", "ours", "(18)") for what in HEADER)]
    tables = {
        name: table(columns, table_1(errors(made[name], made[name].ours), errors(made[name], made[name].theirs)))
        for name in ("rigid", "rigid_cell", "soft", "drift")
    }
    return {
        **tables,
        "lighter": ", ".join(f"{e[3]:.0f} um RMSE and {e[1]:.0f} um at worst ({name})" for name, e in light.items()),
        "depth": 0.0 if law is None else 1e3 * law.depth,
        "exponent": 0.0 if law is None else law.exponent,
        "blind": 1e6 * errors(blind, blind.ours)["|c|"][3],
        "told_rigid": 1e6 * errors(rigid, rigid.estimate("wrench_axis"))["|c|"][3],
        "told_soft": 1e6 * errors(soft, soft.estimate("wrench_axis"))["|c|"][3],
    }


def rows(small: bool) -> Iterator[Row]:
    made = studies(SMALL if small else 1)
    found = list(checks(made))
    if not small:
        figures.draw(made, FOLDER)
        fill(FOLDER, asked=asked(found, "paper"), **parts(made))
    yield from found
