"""Calibration of load cells from a simulated bench, whose truth is the statics of a frame on springs."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.load_cells._fit import ReferenceBlocks, residuals
from palpate.sensors.load_cells.calibrate import CalibrationOptions, LoadCellCalibration, identify_load_cells
from palpate.surfaces import EllipticCylinder
from palpate_lab.simulation.cell_array import in_line
from palpate_lab.simulation.load_cell_bench import BENCHES, Bench, BenchRun

SURFACE = EllipticCylinder(a=14e-3, b=5e-3, half_length=16e-3, upper=True)
RIGID, SOFT = BENCHES["rigid"], BENCHES["soft layer"]
USUAL = CalibrationOptions()


@cache
def log(bench: Bench = RIGID) -> BenchRun:
    return bench.run(0, thin=20)


@cache
def calibrated(bench: Bench = RIGID, indentation: bool = False) -> LoadCellCalibration:
    return fitted(log(bench), indentation=indentation)


def fitted(run: BenchRun, options: CalibrationOptions = USUAL, *, indentation: bool = False) -> LoadCellCalibration:
    arrays = run.time, run.voltages, run.force, run.position
    return identify_load_cells(*arrays, SURFACE, indentation=indentation, options=options)


def misses(bench: Bench, found: LoadCellCalibration) -> np.ndarray:
    """How far the line of action of each true wrench, read by the calibrated cells, passes from its contact [m]."""
    run = log(bench)[np.linalg.norm(log(bench).wrench[:, :3], axis=1) > 1.0]
    wrench, _ = found.cells.wrenches(bench.cells().voltages(run.wrench))
    force, moment = wrench[:, :3], wrench[:, 3:]
    pressing = np.sum(force * run.normal, axis=1)
    law = found.cells.indentation
    at = run.point if law is None else run.point - law(pressing)[:, None] * run.normal
    return np.linalg.norm(np.cross(run.normal, moment - np.cross(at, force)) / pressing[:, None], axis=1)


def test_the_true_matrix_lies_within_the_stated_covariance() -> None:
    found = calibrated()
    error = np.linalg.lstsq(found.cells.matrix, RIGID.cells().forward())[0] - np.eye(6)
    square = error.reshape(-1) @ np.linalg.solve(found.cells.covariance, error.reshape(-1))
    assert 10 < square < 85  # chi-square of 36: one in 10,000 beyond either bound
    assert misses(RIGID, found).max() < 30e-6  # without noise only the calibration errs: predicted to 6 um rms
    assert found.cells.drift < 0.5
    assert found.cells.misfit < 1e-3


def test_noise_is_that_of_the_cells() -> None:
    noise = np.sqrt(np.diag(calibrated().cells.noise))
    np.testing.assert_allclose(noise, RIGID.channel_noise(), rtol=0.12)  # 1,440 samples: five deviations


def test_a_soft_layer_needs_its_law() -> None:
    with_law, without = calibrated(SOFT, True), calibrated(SOFT)
    assert misses(SOFT, with_law).max() < 60e-6
    assert np.sqrt(np.mean(misses(SOFT, without) ** 2)) > 100e-6
    law = with_law.cells.indentation
    assert law is not None
    assert law.exponent == pytest.approx(0.5, abs=0.05)  # a ball on an elastic foundation: force grows as depth squared


def test_a_rigid_surface_shows_no_law() -> None:
    with pytest.raises(NotIdentifiable, match="the law of indentation is not determined"):
        fitted(BENCHES["drift"].run(0, thin=40), indentation=True)


def test_every_start_ends_at_one_place() -> None:
    rng, array = np.random.default_rng(1), RIGID.cells()
    ends = list[LoadCellCalibration]()
    for _ in range(2):
        gains = rng.uniform(2.0, 30.0, (4, 1, 1)) * (np.eye(3) + 0.2 * rng.standard_normal((4, 3, 3)))
        places = array.position + 1e-3 * rng.standard_normal((4, 3))
        maps = [np.concatenate([gain, np.cross(place, gain.T).T]) for gain, place in zip(gains, places, strict=True)]
        ends.append(fitted(log(), CalibrationOptions(start=np.concatenate(maps, axis=1))))
    for end in ends:
        assert end.fit.cost == pytest.approx(calibrated().fit.cost, rel=1e-6)
        np.testing.assert_allclose(end.cells.matrix, calibrated().cells.matrix, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("law", [np.zeros(0), np.array([3e-4, 0.6])])
def test_derivatives_are_those_of_differences(law: np.ndarray) -> None:
    rng, count = np.random.default_rng(2), 20
    turn = rng.uniform(-1.0, 1.0, count)
    point = np.stack([14e-3 * np.sin(turn), rng.uniform(-0.01, 0.01, count), 5e-3 * np.cos(turn)], axis=1)
    normal = point * [14e-3**-2, 0.0, 5e-3**-2]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    first = np.cross(normal, [0.0, 1.0, 0.0])
    force = -2.0 * normal + 0.5 * rng.normal(size=(count, 3))
    wrench = np.concatenate([force, np.cross(point, force)], axis=1) + 1e-3 * rng.normal(size=(count, 6))
    tangents = np.stack([first, np.cross(normal, first)], axis=1)
    torque, time = 1e-3 * rng.normal(size=count), np.arange(float(count))
    data = ReferenceBlocks(time, np.zeros(count, dtype=np.int64), wrench, force, point, normal, tangents, torque)
    matrix = np.eye(6) + 0.01 * rng.normal(size=(6, 6))
    found = np.concatenate([matrix.reshape(-1), law])
    _, by_wrench, by_law = residuals(data, found)
    for k in range(6):
        step = np.zeros_like(found)
        step[6 * k : 6 * k + 6] = 1e-6  # of every entry of a row: dw_k = 1e-6 sum of the signal
        change = residuals(data, found + step)[0] - residuals(data, found - step)[0]
        due = by_wrench[:, :, k] * (2e-6 * wrench.sum(axis=1))[:, None]
        np.testing.assert_allclose(change, due, rtol=1e-4, atol=1e-11)
    for k, size in enumerate([1e-8, 1e-5][: len(law)]):
        ends = [residuals(data, found + sign * size * np.eye(len(found))[36 + k])[0] for sign in (1, -1)]
        np.testing.assert_allclose(by_law[:, :, k], (ends[0] - ends[1]) / (2 * size), rtol=1e-4, atol=1e-8)


def test_missing_directions_and_starts_are_named() -> None:
    quiet = replace(RIGID, friction=(0.0, 0.0), paths=RIGID.paths[:2])
    with pytest.raises(NotIdentifiable, match=r"too few directions: .*force along y.* is missing"):
        fitted(quiet.run(0, thin=10))
    run = log()
    with pytest.raises(InputError, match=r"does not begin unloaded.*Record"):
        fitted(run[(run.trajectory == 0) & (run.time > 4.0)])
    with pytest.raises(InputError, match=r"blocks of 10 ms.*Slide"):
        fitted(run[run.time < 3.5])


def test_cells_in_line_are_refused() -> None:
    line = replace(RIGID, layout=in_line(3), twist=1.0)
    with pytest.raises(NotIdentifiable, match="do not respond to torque about y"):
        fitted(line.run(0, thin=10))
    with pytest.raises(NotIdentifiable, match="in line along y"):
        fitted(line.run(0, thin=10), CalibrationOptions(positions=in_line(3)))


def test_channels_are_named() -> None:
    run = log()
    dead, unit = run.voltages.copy(), run.voltages.copy()
    dead[:, 4] = 0.01
    with pytest.raises(InputError, match=r"'u2y' never changes.*Repair"):
        fitted(replace(run, voltages=dead))
    unit[:, 6:9] *= 1e3
    with pytest.raises(InputError, match=r"'u3x', 'u3y', 'u3z' moves .* another unit.*State"):
        fitted(replace(run, voltages=unit))
    with pytest.raises(InputError, match=r"at the end of its range.*Push"):
        fitted(run, CalibrationOptions(limits=np.tile([-0.1, 0.1], (12, 1))))


def test_a_corner_that_was_not_touched_is_named() -> None:
    run = log()
    part = run[~((run.point[:, 0] > 2e-3) & (run.point[:, 1] > 3e-3) & run.loaded)]
    assert any("Nothing was touched around x = " in note for note in fitted(part).cells.notes)
    assert calibrated().cells.notes == ()


def test_the_balls_centre_is_meant() -> None:
    run = log()
    with pytest.raises(InputError, match=r"ref_z: .*centre is .* off the surface"):  # millimetres for metres
        fitted(replace(run, position=run.position * 1e3))
    sunk = replace(run, position=run.position + np.array([0.0, 0.0, 2e-3]))
    assert any("the ball's centre is" in note for note in fitted(sunk).cells.notes)


def test_too_little_friction_to_show_the_torque_is_said() -> None:
    """The sideways share of the force is what tells the moment along it: 0.1 of the normal force is asked."""
    said = calibrated(replace(RIGID, friction=(0.02, 0.08))).coverage.notes
    assert any("Friction was small" in note and "torque about the normal" in note for note in said)
    assert not any("Friction" in note for note in calibrated().coverage.notes)


def test_a_reference_that_pulls_or_stands_inside_is_refused() -> None:
    run = log()
    with pytest.raises(InputError, match=r"points out of the surface.*Reverse"):
        identify_load_cells(run.time, run.voltages, -run.force, run.position, SURFACE)
    with pytest.raises(InputError, match=r"ref_z: .*off the surface on average"):
        identify_load_cells(run.time, run.voltages, run.force, run.position - [0.0, 0.0, 0.006], SURFACE)


def test_cells_that_change_places_are_refused() -> None:
    run = log()
    voltages, half = run.voltages.copy(), len(run.time) // 2
    voltages[half:, :6] = voltages[half:, [3, 4, 5, 0, 1, 2]]
    with pytest.raises(InputError, match=r"no wrench explains.*Check"):
        identify_load_cells(run.time, voltages, run.force, run.position, SURFACE)


def test_touches_left_out_lie_where_the_others_predict() -> None:
    """144 numbers: the ratio to 12 % by chance."""
    assert 0.4 < calibrated().validation.ratio < 1.6
