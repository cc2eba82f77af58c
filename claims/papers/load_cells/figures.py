"""Figure 7, drawn: the eight paths as they were found, and force components over time."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from claims.papers.load_cells.study import Answer, Study
from palpate.viewer._style import AXES, INK, MUTED, RULE, figure, save, styled

TIMES = 20  # by which errors are drawn larger than they are
POINTS = 250  # of a path
DIGITS = 3  # of a millimetre and of a newton


def draw(made: Mapping[str, Study], folder: Path) -> None:
    rigid, soft, drift = made["rigid"], made["soft"], made["drift"]
    panels = {
        "rigid": (rigid, rigid.ours),
        "soft layer": (soft, soft.ours),
        "soft layer, the paper's (18)": (soft, soft.theirs),
        "drift": (drift, drift.ours),
    }
    paths(panels, folder / "paths.png")
    forces(soft, soft.ours, folder / "forces.png")


def paths(panels: Mapping[str, tuple[Study, Answer]], path: Path) -> None:
    """From above: where the ball went, and where it was found, errors drawn larger."""
    with styled():
        drawn = figure(5.2)
        axes: Any = drawn.subplots(2, 2, sharex=True, sharey=True).ravel()
        for part, (title, (study, answer)) in zip(axes, panels.items(), strict=True):
            run, loaded = study.second, study.loaded()
            for number in np.unique(run.trajectory):
                rows = np.flatnonzero(loaded & (run.trajectory == number))
                rows = rows[:: max(1, len(rows) // POINTS)]
                true = 1e3 * run.point[rows, :2]
                found = true + TIMES * (1e3 * answer.point[rows, :2] - true)
                part.plot(*np.round(found.T, DIGITS), color=AXES[0], linewidth=0.5)
                part.plot(*np.round(true.T, DIGITS), color=INK, linewidth=0.7)
            error = np.linalg.norm(answer.point - run.point, axis=1)[loaded]
            part.set_title(f"{title}\n{1e6 * np.sqrt(np.mean(error**2)):.0f} µm rms", color=MUTED)
            part.set_aspect("equal")
            part.set_xlim(-15, 15)
            part.set_ylim(-17, 17)
        for part in axes[2:]:
            part.set_xlabel("x [mm]")
        for part in axes[::2]:
            part.set_ylabel("y [mm]")
        save(drawn, path, "png")


def forces(study: Study, answer: Answer, path: Path, trajectory: int = 6) -> None:
    """Over one path: the force that was found, and how far it, and the reference, were from the truth."""
    run = study.second
    rows = np.flatnonzero(run.trajectory == trajectory)
    rows = rows[:: max(1, len(rows) // POINTS)]
    time = np.round(run.time[rows] - run.time[rows[0]], DIGITS)
    with styled():
        drawn = figure(4.2)
        parts: Any = drawn.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        for axis in range(3):
            noisy = 1e3 * (run.force - run.wrench[:, :3])[rows, axis]
            parts[1].plot(time, np.round(noisy, DIGITS), color=RULE, linewidth=0.5)
            parts[0].plot(time, np.round(answer.force[rows, axis], DIGITS), color=AXES[axis], label=f"p{'xyz'[axis]}")
        for axis in range(3):
            error = 1e3 * (answer.force - run.wrench[:, :3])[rows, axis]
            parts[1].plot(time, np.round(error, DIGITS), color=AXES[axis], linewidth=0.5)
        parts[0].set_ylabel("force [N]")
        parts[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.1)
        parts[1].set_ylabel("error [mN]")
        parts[1].set_xlabel("time [s]")
        drawn.align_ylabels()
        save(drawn, path, "png")
