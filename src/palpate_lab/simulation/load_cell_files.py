"""Write runs of the load cells' bench as a laboratory would have them: tables, a rig, and separately the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate_lab.simulation.load_cell_bench import Bench, BenchRun

_AXES = ("x", "y", "z")
_DIGITS = 9  # behind the point: of V, N, m and s alike
_TRUTH = ("time", "px", "py", "pz", "nx", "ny", "nz", "fx", "fy", "fz")
_RIG = """# A fingertip on {cells} force cells of three axes each; voltages in, contacts out. Lengths in metres.
[surface]
kind = "elliptic_cylinder"      # x^2/a^2 + z^2/b^2 = 1, the axis along y
a = {a}
b = {b}
half_length = 0.016
upper = true

[load_cells]
model = "fingertip.toml"        # of `palpate calibrate load-cells`; not there yet while calibrating
columns = [{columns}]
{soft}
[estimate]
tare = 0.5                      # s at each start in which nothing touches
"""


def write_load_cell_session(bench: Bench, folder: Path, *, thin: int = 20) -> tuple[BenchRun, BenchRun]:
    """Write bench_log.csv (with the reference), log.csv (voltages of another run), truth.csv of that, and rig.toml.

    Args:
        bench: bench of both runs.
        folder: created if it does not exist.
        thin: write every `thin`-th sample of 1 kHz.

    Returns:
        The `BenchRun` with the reference, and the other one.
    """
    folder.mkdir(parents=True, exist_ok=True)
    known, used = bench.run(0, thin=thin), bench.run(1, thin=thin)
    write_bench_log(known, folder / "bench_log.csv")
    write_voltage_log(used, folder / "log.csv")
    true = used[used.loaded]
    rows: np.ndarray = np.concatenate([true.time[:, None], true.point, true.normal, true.wrench[:, :3]], axis=1)
    _write(folder / "truth.csv", _TRUTH, rows)
    (folder / "rig.toml").write_text(load_cell_rig(bench), encoding="utf-8")
    return known, used


def load_cell_rig(bench: Bench) -> str:
    """Return the text of a rig for a bench's fingertip, as `palpate estimate` and `calibrate load-cells` read it."""
    columns = voltage_columns(bench.cells().count)
    return _RIG.format(
        cells=bench.cells().count,
        a=bench.ellipse.a,
        b=bench.ellipse.b,
        columns=", ".join(f'"{name}"' for name in columns),
        soft="" if bench.layer is None else "indentation = true              # the surface is soft\n",
    )


def voltage_columns(cells: int) -> tuple[str, ...]:
    """Return the names of the columns of voltages, a tuple: u1x, u1y, u1z, u2x, ..."""
    return tuple(f"u{cell}{axis}" for cell in range(1, cells + 1) for axis in _AXES)


def write_bench_log(run: BenchRun, path: Path) -> None:
    """Write a CSV of time [s], voltages [V], ref_fx ... [N], and ref_x ... [m].

    ref_f is the force on the fingertip, ref_ the centre of the ball.
    """
    reference = [f"ref_f{axis}" for axis in _AXES] + [f"ref_{axis}" for axis in _AXES]
    _write_run(path, run, reference, np.concatenate([run.force, run.position], axis=1))


def write_voltage_log(run: BenchRun, path: Path) -> None:
    """Write a CSV of time [s] and voltages [V], as a fingertip in use would log them."""
    _write_run(path, run, [], np.empty((len(run), 0)))


def _write_run(path: Path, run: BenchRun, names: list[str], values: Float[np.ndarray, "n k"]) -> None:
    header = ("time", *voltage_columns(run.voltages.shape[1] // 3), *names)
    _write(path, header, np.concatenate([run.time[:, None], run.voltages, values], axis=1))


def _write(path: Path, header: tuple[str, ...], rows: Float[np.ndarray, "n k"]) -> None:
    import polars

    polars.DataFrame(rows, schema=list(header)).write_csv(path, float_precision=_DIGITS)
