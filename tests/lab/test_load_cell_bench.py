"""The bench of load cells: its apparatus does what the paper says, and its truth is in balance."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars
import pytest

from claims.evidence.load_cells import of_cell, spoilt
from palpate_lab.simulation.cell_array import LAYOUTS, in_line
from palpate_lab.simulation.load_cell_bench import BENCHES, CUTOFF, RATE, REST, Bench, BenchRun
from palpate_lab.simulation.load_cell_files import write_bench_log, write_voltage_log

SHORT = (((-9.0, -2.0), (-9.0, 2.0)), ((6.0, 3.0), (1.0, -3.0)))


@pytest.fixture(scope="module")
def rigid() -> BenchRun:
    return Bench(paths=SHORT, torsion=5e-3).run()


@pytest.fixture(scope="module")
def soft() -> BenchRun:
    return replace(BENCHES["soft layer"], paths=SHORT).run()


def _balance(run: BenchRun) -> np.ndarray:
    """What is left of the moment about the point [N m]; filtered signals are in balance but for the filter's 2 ms."""
    return run.wrench[:, 3:] - np.cross(run.point, run.wrench[:, :3]) - run.torque[:, None] * run.normal


def test_a_rigid_touch_is_a_force_at_the_point_and_a_torque_about_the_normal(rigid: BenchRun) -> None:
    assert np.abs(_balance(rigid)).max() < 1e-7  # N m: products of filtered signals, of some N x 10 mm
    assert 3e-3 < np.abs(rigid.torque).max() <= 5e-3


def test_the_ball_presses_from_one_newton_and_slides_within_the_friction(rigid: BenchRun) -> None:
    sliding = rigid.friction > 0.1
    pressing = -np.sum(rigid.wrench[:, :3] * rigid.normal, axis=1)
    across = np.linalg.norm(rigid.wrench[:, :3] + pressing[:, None] * rigid.normal, axis=1)
    assert -rigid.wrench[sliding, 2].max() == pytest.approx(1.0, abs=0.01)  # the lowest place of each path
    np.testing.assert_allclose(across[sliding], rigid.friction[sliding] * pressing[sliding], atol=1e-3)
    assert rigid.friction.max() < 0.6
    speed = np.linalg.norm(np.gradient(rigid.point[:, :2], 1 / RATE, axis=0), axis=1)
    assert np.median(speed[sliding]) == pytest.approx(2.5e-3, rel=1e-6)


def test_the_reference_stands_at_the_centre_of_the_ball(rigid: BenchRun, soft: BenchRun) -> None:
    for run in (rigid, soft):
        gap = np.linalg.norm(run.position - run.point, axis=1)[run.loaded] + run.indentation[run.loaded]
        assert np.abs(gap - 2e-3).max() < 1e-5  # five deviations of the rulers, and the filter


def test_the_log_starts_unloaded_every_time(rigid: BenchRun) -> None:
    for number in range(2):
        part = rigid[rigid.trajectory == number]
        rest = part.time - part.time[0] < REST
        assert not part.loaded[rest].any()
        assert np.abs(part.wrench[rest]).max() < 1e-9


def test_noise_is_what_was_asked_for_behind_the_filter() -> None:
    run = Bench(paths=SHORT).run()
    bench, rest = Bench(paths=SHORT), ~run.loaded & (run.trajectory == 0)
    assert run.force[rest].std() == pytest.approx(17e-3, rel=0.05)  # 2,250 correlated samples of three axes
    assert run.voltages[rest].std(axis=0).mean() == pytest.approx(bench.channel_noise(), rel=0.05)
    worth = np.einsum("iab,nib->na", bench.cells().sensitivity, run.voltages[rest].reshape(-1, 4, 3))
    assert np.sqrt(worth.var(axis=0).mean()) == pytest.approx(2e-3, rel=0.05)
    doubled = replace(bench, per_cell=True).channel_noise()
    assert doubled == pytest.approx(2 * bench.channel_noise())  # four cells


def test_the_filter_has_its_corner_where_the_paper_has_it() -> None:
    """White noise behind a second-order Butterworth: power falls to a half at the corner, to 1/17 at twice of it."""
    run = Bench(paths=(((0.0, -13.0), (0.0, 13.0)),) * 2, noise=1.0, reference_noise=0.0).run()
    noise = np.diff(run.voltages, axis=0)  # levels what the run itself does
    density = np.mean(np.abs(np.fft.rfft(noise[:8192], axis=0)) ** 2, axis=1)
    frequency = np.fft.rfftfreq(8192, 1 / RATE)[1:]
    density = density[1:] / (2 - 2 * np.cos(2 * np.pi * frequency / RATE))
    bilinear = np.tan(np.pi * frequency / RATE) / np.tan(np.pi * CUTOFF / RATE)
    expected = 1 / (1 + bilinear**4)
    for low, high in ((5, 50), (90, 110), (180, 220)):
        band = (frequency > low) & (frequency < high)
        ratio = density[band].mean() / density[(frequency > 5) & (frequency < 20)].mean()
        assert ratio == pytest.approx(expected[band].mean(), rel=0.1)  # some hundred periodograms' rows


def test_voltages_are_the_filtered_wrench_through_the_cells() -> None:
    bench = Bench(paths=SHORT, noise=0.0)
    run = bench.run()
    first = run[run.trajectory == 0]
    bias = first.voltages[0]
    np.testing.assert_allclose(first.voltages - bias, bench.cells().voltages(first.wrench), atol=1e-12)
    np.testing.assert_array_equal(bench.run(thin=7).voltages[: len(first[::7])], first.voltages[::7])


def test_drift_creeps_from_nothing_to_its_size_by_the_end() -> None:
    calm, warm = (Bench(paths=SHORT, drift=drift).run().voltages for drift in (0.0, 0.5e-3))
    run = Bench(paths=SHORT).run()
    off = warm - calm
    ends = [np.flatnonzero(run.trajectory == k)[[0, -1]] for k in range(2)]
    assert all(np.abs(off[first]).max() == 0 for first, _ in ends)
    assert np.std([off[last] for _, last in ends]) == pytest.approx(0.5e-3, rel=0.4)  # of 24 draws


def test_a_soft_layer_carries_the_same_load_deeper_where_it_is_larger(soft: BenchRun, rigid: BenchRun) -> None:
    sliding = (soft.friction > 0.1) & (rigid.friction > 0.1)
    np.testing.assert_allclose(soft.wrench[sliding, 2], rigid.wrench[sliding, 2], rtol=2e-3)
    assert 0.5e-3 < soft.indentation[sliding].min() < soft.indentation.max() < 1.5e-3
    assert np.abs(soft.wrench[~soft.loaded]).max() < 1e-4


def test_a_twist_on_a_soft_layer_adds_to_the_moment_about_the_normal_alone(soft: BenchRun) -> None:
    twisted = replace(BENCHES["soft layer"], paths=SHORT, torsion=5e-3).run()
    added = twisted.wrench - soft.wrench
    np.testing.assert_allclose(added[:, :3], 0.0, atol=1e-12)
    np.testing.assert_allclose(
        added[:, 3:], twisted.torque[:, None] * twisted.normal, atol=1e-7
    )  # N m: the filter's lag


def test_faults_touch_only_the_cells_that_they_name(rigid: BenchRun) -> None:
    both = of_cell(0) + of_cell(3)
    for broken, cells in (
        (spoilt(rigid, of_cell(1), "dead", level=0.3), {1}),
        (spoilt(rigid, of_cell(2), "saturated", limit=0.01), {2}),
        (spoilt(rigid, both, "swapped"), {0, 3}),
        (spoilt(rigid, of_cell(3), "drifting by 1 mV/s"), {3}),
    ):
        changed = np.flatnonzero(np.abs(broken.voltages - rigid.voltages).max(axis=0)) // 3
        assert set(changed.tolist()) == cells
    again = spoilt(spoilt(rigid, both, "swapped"), both, "swapped")
    np.testing.assert_array_equal(again.voltages, rigid.voltages)


def test_logs_have_the_columns_of_the_issue(rigid: BenchRun, tmp_path: Path) -> None:
    some = rigid[::500]
    write_bench_log(some, tmp_path / "bench.csv")
    write_voltage_log(some, tmp_path / "log.csv")
    bench, log = (polars.read_csv(tmp_path / name) for name in ("bench.csv", "log.csv"))
    volts = [f"u{cell}{axis}" for cell in (1, 2, 3, 4) for axis in "xyz"]
    assert log.columns == ["time", *volts]
    assert bench.columns == ["time", *volts, "ref_fx", "ref_fy", "ref_fz", "ref_x", "ref_y", "ref_z"]
    np.testing.assert_allclose(bench[volts].to_numpy(), some.voltages, atol=1e-9)
    np.testing.assert_allclose(bench[["ref_x", "ref_y", "ref_z"]].to_numpy(), some.position, atol=1e-9)


@pytest.mark.parametrize("count", LAYOUTS)
def test_other_layouts_run_too(count: int) -> None:
    assert Bench(layout=in_line(count), twist=0.5, paths=SHORT[:1]).run(thin=50).voltages.shape[1] == 3 * count
    assert Bench(layout=LAYOUTS[count], paths=SHORT[:1]).run(thin=50).voltages.shape[1] == 3 * count
