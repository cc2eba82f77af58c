"""`palpate simulate load-cells`: record a fingertip on force cells, as a bench does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from tyro.conf import FlagCreatePairsOff, arg

from palpate.console.console import Quantity, lines, note, title, wait
from palpate.errors import InputError
from palpate_lab.cli.simulate import complete_session, require_new


def simulate_load_cells(
    *,
    output: Annotated[Path, arg(aliases=["-o"], metavar="FOLDER")],
    seed: Annotated[int, arg(metavar="N")] = 0,
    soft: Annotated[bool, FlagCreatePairsOff] = False,
    plate: Annotated[bool, FlagCreatePairsOff] = False,
) -> None:
    """Simulate a fingertip or a plate on load cells.

    Record a simulated fingertip on four force cells: a run of the bench to calibrate by, and one to estimate.

    Args:
        output: folder to make: bench_log.csv, log.csv, truth.csv, rig.toml.
        seed: seed of the fingertip; gains, cross-talk and stiffness of the cells differ from one to the next.
        soft: the surface is a soft layer, into which the ball sinks.
        plate: a plate on four single-axis cells instead, calibrated by weights.
    """
    require_new(output)
    if seed < 0:
        raise InputError("must not be negative.", where="--seed")
    if plate:
        _simulate_plate(output, seed)
        return
    from palpate_lab.simulation.load_cell_bench import BENCHES  # here: not to be waited for by other commands
    from palpate_lab.simulation.load_cell_files import write_load_cell_session

    wait("sliding the ball")
    with complete_session(output) as part:
        bench = replace(BENCHES["soft layer" if soft else "rigid"], seed=seed)
        known, used = write_load_cell_session(bench, part)
    strongest = float(np.linalg.norm(used.wrench[:, :3], axis=1).max())
    title(f"fingertip on {bench.cells().count} force cells, seed {seed} -> {output}")
    lines(
        [
            ("bench_log.csv", f"{len(known):,} samples: voltages, and force and place of a ball of 4 mm"),
            ("log.csv", f"{len(used):,} samples: voltages alone"),
            ("force", Quantity(f"up to {strongest:.1f} N", strongest)),
        ]
    )
    note(["truth.csv is of log.csv, as simulated; estimates never see it"])


def _simulate_plate(output: Path, seed: int) -> None:
    from palpate_lab.simulation.plate import Plate, write_plate_session

    rng = np.random.default_rng(seed)
    with complete_session(output) as part:
        weights, touches = write_plate_session(Plate.drawn(rng), rng, part)
    title(f"plate on four single-axis cells, seed {seed} -> {output}")
    lines(
        [
            (
                "bench_log.csv",
                f"{len(weights.time):,} samples: voltages, {len(weights.force)} weights and places",
            ),
            ("log.csv", f"{len(touches.time):,} samples: voltages alone, of {len(touches.force)} touches"),
        ]
    )
    note(["truth.csv is of log.csv, as simulated; estimates never see it"])
