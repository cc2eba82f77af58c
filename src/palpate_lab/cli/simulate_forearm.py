"""`palpate simulate forearm`: record a skin and a force/torque sensor on one link, touched at several places."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from tyro.conf import FlagCreatePairsOff, arg

from palpate.console.console import Quantity, counting, lines, note, progress, title, wait
from palpate.console.options import Scalar
from palpate_lab.cli.simulate import complete_session, require_new, require_within

if TYPE_CHECKING:
    from palpate_lab.simulation.touched.run import ForearmRun
    from palpate_lab.simulation.touched.settings import ForearmSettings

Flag = Annotated[bool, FlagCreatePairsOff]
Folder = Annotated[Path, arg(aliases=["-o"], metavar="FOLDER")]
Count = Annotated[int, arg(metavar="N")]
Seconds = Annotated[float, arg(metavar="S")]


def simulate_forearm_command(
    *,
    output: Folder,
    seconds: Seconds = 60.0,
    touches: Count = 3,
    rows: Count = 10,
    seed: Count = 0,
    drift: Flag = False,
    still: Flag = False,
    unequal: Annotated[float, arg(metavar="SHARE")] = 0.02,
    clock_offset: Seconds = 0.0,
    free: Annotated[Scalar, arg(metavar="S")] = None,
) -> None:
    """Simulate a forearm with a skin and a force/torque sensor.

    Record a simulated forearm with a skin and a force/torque sensor at its base, touched at several places.

    Args:
        output: folder to make: both.mcap, both.toml, skin_map.toml, intensity.toml, payload.toml, link.stl, truth.csv,
            load_cell_log.csv, README.txt.
        seconds: duration to simulate; the first 3 s are untouched.
        touches: largest number of touches at once, 1 to 5.
        rows: number of rows of cells along the forearm, one every 10 mm, with 22 cells each.
        seed: seed of everything random.
        drift: the sensor's bias drifts as just after switching on, and its payload is known to 0.05 N.
        still: the arm does not move.
        unequal: standard deviation of the cells' gains, as a share.
        clock_offset: seconds added to the time stamps of the skin.
        free: seconds of free.mcap, a log without touch to calibrate by; otherwise 300 with --drift, else none.
    """
    free = (300.0 if drift else 0.0) if free is None else free
    require_new(output)
    require_within(
        seconds=(6.0, seconds, 3600.0), rows=(4, rows, 40), seed=(0, seed, 1 << 62), free=(0.0, free, 3600.0)
    )
    require_within(touches=(1, touches, 5), unequal=(0.0, unequal, 0.5), clock_offset=(-1.0, clock_offset, 1.0))
    from palpate_lab.simulation.skin_bench import Rolled  # here: with them come scipy and the engine
    from palpate_lab.simulation.touched.settings import MILD_DRIFT, ForearmSettings

    settings = ForearmSettings(
        sheet=Rolled(rows=rows),
        moving=not still,
        touches=touches,
        seconds=seconds,
        drift=MILD_DRIFT if drift else None,
        unequal=unequal,
        clock_offset=clock_offset,
    )
    wait("starting the physics engine")
    with complete_session(output) as part, counting():
        run = _record(settings, part, seed, free)
    title(f"forearm of {rows} x {settings.sheet.columns} cells, seed {seed} -> {output}")
    lines(_figures(run))
    note(_next(output))


def _record(settings: ForearmSettings, folder: Path, seed: int, free: float) -> ForearmRun:
    """Simulate a run and write its files."""
    from palpate_lab.simulation.touched.files import write_forearm
    from palpate_lab.simulation.touched.run import simulate_forearm, simulate_free

    run = simulate_forearm(np.random.default_rng(seed), settings, progress)
    log = simulate_free(np.random.default_rng([seed, 1]), settings, free, run.mass) if free > 0.0 else None
    write_forearm(run, folder, log)
    return run


def _figures(run: ForearmRun) -> list[tuple[str, object]]:
    truth, frames = run.truth, len(run.skin.time)
    at_once = np.bincount(truth.frame, minlength=frames)
    push = np.linalg.norm(truth.force, axis=1)
    strongest = float(push.max()) if len(push) else 0.0
    unseen = sum(1 for each in run.touches if each.off_sheet)
    touched = float((at_once > 0).mean())
    return [
        ("wrenches", f"{len(run.wrench.time)} at {run.settings.wrench_rate} Hz"),
        ("frames", f"{frames} at {run.settings.skin_rate} Hz"),
        ("touches", f"{len(run.touches)}, {unseen} of them beside the skin"),
        ("touched", Quantity(f"{touched:.0%} of the time, by {at_once.max()} at once at most", touched)),
        ("force", Quantity(f"up to {strongest:.1f} N", strongest)),
    ]


def _next(output: Path) -> list[str]:
    log, rig = output / "both.mcap", output / "both.toml"
    return [
        "truth.csv is of the engine's contacts; estimates never see it. Next:",
        f"palpate inspect {log} --rig {rig}",
        f"palpate estimate {log} --rig {rig} -o contacts.csv",
        f"palpate evaluate contacts.csv {output / 'truth.csv'}",
        f"palpate view {log} --rig {rig}",
    ]
