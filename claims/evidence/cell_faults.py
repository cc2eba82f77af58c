"""What goes wrong with cells, done to a recording: the frame still puts its load on a cell that says nothing."""

from dataclasses import replace

import numpy as np

from palpate_lab.simulation.load_cell_bench import BenchRun


def dead(run: BenchRun, cell: int, *, since: float = 0.0, volts: float = 0.0) -> BenchRun:
    """A cell, counted from 0, that answers with one voltage from a time [s] on."""
    voltages = run.voltages.copy()
    voltages[int(np.searchsorted(run.time, since)) :, _channels(cell)] = volts
    return replace(run, voltages=voltages)


def saturated(run: BenchRun, cell: int, limit: float) -> BenchRun:
    """A cell whose amplifier goes no further than `limit` [V] to either side."""
    voltages = run.voltages.copy()
    voltages[:, _channels(cell)] = np.clip(voltages[:, _channels(cell)], -limit, limit)
    return replace(run, voltages=voltages)


def swapped(run: BenchRun, one: int, other: int) -> BenchRun:
    """Two cells that were plugged in the wrong way round."""
    voltages = run.voltages.copy()
    voltages[:, _channels(one) + _channels(other)] = run.voltages[:, _channels(other) + _channels(one)]
    return replace(run, voltages=voltages)


def drifting(run: BenchRun, cell: int, rate: float) -> BenchRun:
    """A cell whose channels move by `rate` [V/s] from the start of each trajectory on."""
    voltages = run.voltages.copy()
    first = np.searchsorted(run.trajectory, run.trajectory)  # of each sample's own trajectory
    voltages[:, _channels(cell)] += rate * (run.time - run.time[first])[:, None]
    return replace(run, voltages=voltages)


def _channels(cell: int) -> list[int]:
    return [3 * cell, 3 * cell + 1, 3 * cell + 2]
