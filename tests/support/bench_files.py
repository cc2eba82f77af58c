"""Runs of the bench as a laboratory would have them on disk: CSV, with the reference or with voltages only."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate.simulation.load_cell_bench import BenchRun

__all__ = ["voltage_columns", "write_bench_log", "write_voltage_log"]

_AXES = ("x", "y", "z")
_DIGITS = 9  # behind the point: of V, N, m and s alike


def voltage_columns(cells: int) -> tuple[str, ...]:
    """u1x, u1y, u1z, u2x, ..."""
    return tuple(f"u{cell}{axis}" for cell in range(1, cells + 1) for axis in _AXES)


def write_bench_log(run: BenchRun, path: Path) -> None:
    """Time [s], voltages [V], ref_fx ... [N] on the fingertip, ref_x ... [m] of the centre of the ball."""
    reference = [f"ref_f{axis}" for axis in _AXES] + [f"ref_{axis}" for axis in _AXES]
    _write(path, run, reference, np.concatenate([run.force, run.position], axis=1))


def write_voltage_log(run: BenchRun, path: Path) -> None:
    """Time [s] and voltages [V]: what a fingertip in use would log."""
    _write(path, run, [], np.empty((len(run), 0)))


def _write(path: Path, run: BenchRun, names: list[str], values: np.ndarray) -> None:
    import polars

    header = ["time", *voltage_columns(run.voltages.shape[1] // 3), *names]
    table = np.concatenate([run.time[:, None], run.voltages, values], axis=1)
    polars.DataFrame(table, schema=header).write_csv(path, float_precision=_DIGITS)
