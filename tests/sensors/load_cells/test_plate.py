"""A plate on cells of one axis: closed forms of its model, gains by weights, faults, and a log of somebody's plate."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from palpate.cli import main
from palpate.errors import InputError, NotIdentifiable
from palpate.files.contacts import read_contacts
from palpate.sensors.load_cells.array import LoadCellArray
from palpate.sensors.load_cells.calibrate_plate import NAMED, Gains, PlateCalibration, _odd, identify_plate
from palpate.sensors.load_cells.faults import find_faults
from palpate.sensors.load_cells.model import VOLTAGE, LoadCells, unmeasured
from palpate.sensors.load_cells.plate import TOLERANCE, plate_cells, uneven
from palpate.sensors.load_cells.resolution import nominal_cells
from palpate.sensors.load_cells.section import RigLoadCells
from palpate.sensors.load_cells.zero import Zero
from palpate.signals.recording import Recording
from palpate_lab.simulation.plate import Plate, plate_run, write_plate_session

WEIGHTS = np.repeat([2.0, 5.0, 10.0], 4)


def plate_of(count: int, axis: str = "z") -> LoadCells:
    places = np.roll(Plate.drawn(np.random.default_rng(count), count).position, "zxy".index(axis), axis=1)
    return plate_cells(places, np.linspace(9.0, 11.0, count), 1e-6 * np.eye(count), axis)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("count", [3, 4, 6])
def test_the_wrench_is_the_balance_of_any_division_of_the_load(count: int, axis: str) -> None:
    cells, rng = plate_of(count, axis), np.random.default_rng(1)
    loads = rng.uniform(-1.0, 5.0, (20, count))
    along = np.eye(3)["xyz".index(axis)]
    pushes = -loads[..., None] * along
    forces = np.concatenate([pushes, np.cross(cells.positions, pushes)], axis=2).sum(axis=1)
    found, _ = cells.wrenches(loads / np.linspace(9.0, 11.0, count))
    np.testing.assert_allclose(found, forces, atol=1e-12)


@pytest.mark.parametrize("count", [3, 4, 6])
def test_cells_do_not_answer_to_what_they_do_not_measure(count: int) -> None:
    cells = plate_of(count)
    np.testing.assert_allclose(cells.matrix @ unmeasured(cells.axes, cells.positions), 0.0, atol=1e-12)
    assert cells.inverse()[2].shape == (count - 3, count)


def test_cells_on_a_line_are_no_plate() -> None:
    line = np.outer([0.0, 0.05, 0.2], [1.0, 2.0, 0.0])
    for places in (line, line + np.diag([0.0, 0.0, 0.1]), 0.0 * line):
        with pytest.raises(NotIdentifiable, match="cells are "):
            plate_cells(places, np.ones(3), np.eye(3))


def test_an_uneven_plate_is_read_by_the_same_balance_and_leaves_nothing_over() -> None:
    cells = plate_of(6)
    made = uneven(cells, np.random.default_rng(2).normal(size=(3, 3)))
    np.testing.assert_allclose(made.inverse()[0], cells.inverse()[0], atol=1e-9)
    np.testing.assert_allclose(made.inverse()[1], cells.inverse()[1], atol=1e-15)
    np.testing.assert_allclose(made.inverse()[2] @ made.matrix @ made.measured, 0.0, atol=1e-9)


def calibrated(
    plate: Plate, *, known: bool, seed: int = 0, stated: np.ndarray = WEIGHTS, moved: float = 0.0
) -> PlateCalibration:
    run = plate_run(plate, np.random.default_rng(seed), WEIGHTS, 0.0)
    none = run.touch < 0
    places = np.where(none[:, None] | (not known), np.nan, run.point[run.touch, :2])
    places[run.touch == 3] += moved
    return identify_plate(run.time, run.voltages, np.where(none, 0.0, stated[run.touch]), places, plate.position)


def exact(count: int) -> Plate:
    return replace(
        Plate.drawn(np.random.default_rng(count), count, error=0.0), crossed=np.zeros((count, 2)), noise=1e-6
    )


@pytest.mark.parametrize("count", [3, 4, 6])
def test_weights_at_known_places_show_every_gain(count: int) -> None:
    plate = exact(count)
    found = calibrated(plate, known=True).found
    off = (found.gains - 1.0 / plate.gain) / np.sqrt(np.diag(found.covariance))
    assert np.all(np.abs(off) < 3.0)
    if count == 4:
        np.testing.assert_allclose(found.gains * plate.gain, 1.0, atol=2e-3)  # places are taken as known to 0.5 mm


def test_weights_at_unknown_places_show_the_gains_of_three_cells_and_three_combinations_of_four() -> None:
    plate = exact(3)
    found = calibrated(plate, known=False)
    np.testing.assert_allclose(found.found.gains * plate.gain, 1.0, atol=1e-4)
    assert "combinations" not in "".join(found.cells.notes)
    four = calibrated(exact(4), known=False)
    assert four.found.shown == 3
    assert "3 combinations of the 4 gains" in four.cells.notes[0]
    deviation = np.sqrt(np.diag(four.found.covariance)) / four.found.gains
    assert np.all((deviation > 0.003) & (deviation < 0.011))  # half of 1 % in each


@pytest.mark.parametrize("known", [True, False])
def test_a_weight_that_is_stated_wrongly_is_named(known: bool) -> None:
    plate, stated = Plate.drawn(np.random.default_rng(4)), np.append([2.0, 2.0, 2.0, 2.4], WEIGHTS[4:])
    words = calibrated(plate, known=known, stated=stated).cells.notes[0]
    assert re.match(r"Weight 4 of 12, stated as 2\.4 N.*, is (2|2\.00\d|1\.99\d) N.* by the others", words)
    if known:
        with pytest.raises(InputError, match="Weight 4 of 12, stated as 2 N"):
            calibrated(plate, known=True, moved=0.2)


def test_a_cell_that_is_off_is_named_by_the_calibration_and_by_touches_after_it() -> None:
    plate = Plate.drawn(np.random.default_rng(4))
    off = replace(plate, gain=plate.gain * [1.0, 1.0, 1.05, 1.0])
    assert "Cell 3 reads" in calibrated(off, known=True).cells.notes[0]
    found = calibrated(plate, known=True)
    assert not found.odd
    run = plate_run(off, np.random.default_rng(5), np.linspace(2.0, 15.0, 20), 0.0)
    readings = run.voltages - run.voltages[:45].mean(axis=0)
    for factor, kind, said in ((1.0, "gain", "% more than"), (-1.0, "gain", "with the other sign"), (0.0, "dead", "")):
        (fault,) = find_faults(found.cells, readings * [1.0, 1.0, factor, 1.0])
        assert (fault.cells, fault.kind) == ((2,), kind)
        assert said in fault.text


def test_a_plate_that_is_pulled_or_hangs_is_warned_of() -> None:
    plate = Plate.drawn(np.random.default_rng(4))
    cells = calibrated(plate, known=True).cells
    run = plate_run(plate, np.random.default_rng(5), np.linspace(2.0, 15.0, 20), 0.0)
    hangs = np.where(run.time[:, None] < run.time[200], run.voltages, run.voltages[200])
    warned = [(run.voltages, ""), (-run.voltages, "pull at the plate"), (hangs, "readings repeat from")]
    for voltages, words in warned:
        array = LoadCellArray(cells, zero=Zero(voltages[:45].mean(axis=0)))
        array.measure(Recording(run.time, {VOLTAGE: voltages}))
        said = [each for each in array.warnings() if "no zero" not in each]
        assert (words in " ".join(said)) if words else not said


@pytest.mark.parametrize("count", [3, 4, 6])
def test_a_cell_of_a_sound_plate_is_named_as_often_as_stated(count: int) -> None:
    rng, spread = np.random.default_rng(count), np.diag(np.full(count, 0.004**2))
    gains = 1.0 + np.hypot(TOLERANCE, 0.004) * rng.standard_normal((4000, count))
    named = np.mean([bool(_odd(Gains(each, spread, 1e-3, count))) for each in gains])
    assert 0.4 * NAMED < named < 1.5 * NAMED


def test_what_is_no_calibration_is_refused() -> None:
    plate = Plate.drawn(np.random.default_rng(6))
    run = plate_run(plate, np.random.default_rng(6), WEIGHTS[:2], 0.0)
    weight, places = np.where(run.touch < 0, 0.0, 2.0), np.full((len(run.time), 2), np.nan)
    with pytest.raises(NotIdentifiable, match="only 2 weights"):
        identify_plate(run.time, run.voltages, weight, places, plate.position)
    with pytest.raises(InputError, match=r"no weight.*Write"):
        identify_plate(run.time, run.voltages, 0.0 * weight, places, plate.position)
    with pytest.raises(NotIdentifiable, match="in line"):
        identify_plate(run.time, run.voltages, weight, places, plate.position * [1.0, 0.0, 1.0])
    with pytest.raises(ValueError, match="axes must be"):
        RigLoadCells(axes=("z", "z"))
    with pytest.raises(InputError, match=r"load_cells: .*need positions"):
        LoadCells(np.ones((3, 6)), np.ones(3), axes=("z",))


@pytest.mark.parametrize("count", [3, 4, 5, 6])
def test_compiled_wrenches_are_those_of_the_model_for_any_number_of_cells(count: int) -> None:
    rng = np.random.default_rng(count)
    places = rng.normal(0.0, 0.01, (count, 3))
    for cells in (nominal_cells(places, 10.0, 1e-4), plate_of(max(3, count - 1))):
        readings = rng.normal(size=(5, 6)) @ cells.matrix.T
        array = LoadCellArray(cells)
        found = array.measure(Recording(np.arange(5.0), {VOLTAGE: readings})).wrench
        np.testing.assert_allclose(found, cells.wrenches(readings)[0], atol=1e-12)


RIG = """[time]
column = "millis"
unit = "ms"
[surface]
mesh = "plate.stl"
unit = "m"
[load_cells]
axes = ["z"]
columns = ["LC1_kg", "LC2_kg", "LC3_kg", "LC4_kg"]
units = "kg"
positions = [[-0.14, -0.14, -0.01], [0.14, -0.14, -0.01], [0.14, 0.14, -0.01], [-0.14, 0.14, -0.01]]
noise = 0.02
[estimate]
tare = 4
"""


def test_times_in_another_unit_than_the_rig_states_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_plate_session(Plate.drawn(np.random.default_rng(4)), np.random.default_rng(5), tmp_path)
    log, rig = tmp_path / "log.csv", tmp_path / "rig.toml"
    newtons = rig.read_text().replace("[load_cells]", '[time]\nunit = "s"\n[load_cells]\nunits = "N"\nnoise = 0.003')
    lines = [line for line in newtons.splitlines() if not line.startswith("model")]
    rig.write_text("\n".join([*lines, '[filter]\nkind = "butterworth"\ncutoff = 10']))
    given = ["estimate", str(log), "--rig", str(rig), "-o", str(tmp_path / "c.csv")]
    assert main(given) == 0
    assert re.search(r"zero of the cells from \d+ samples at the start, known to \S+ mN", capsys.readouterr().out)
    pl.read_csv(log).with_columns(pl.col("time") * 1e3).write_csv(log)
    assert main(given) == 1
    assert 'is 20 s, so times look like ms: unit = "ms" in [time].' in capsys.readouterr().err


def test_a_plate_that_reads_kilograms(shared: Path, tmp_path: Path) -> None:
    import trimesh

    trimesh.creation.box((0.3, 0.3, 1e-3)).export(tmp_path / "plate.stl")
    (tmp_path / "rig.toml").write_text(RIG)
    log, out = shared / "cases/skin/plate4.csv", tmp_path / "c.csv"
    assert main(["estimate", str(log), "--rig", str(tmp_path / "rig.toml"), "-o", str(out)]) == 0
    contacts = read_contacts(out)
    for time, weight, x, y in ((7.5, 0.5, 0.0, 0.0), (17.5, 1.0, 0.07, 0.03), (27.5, 2.0, -0.1, 0.1)):
        row = int(np.argmin(np.abs(contacts.time - time)))
        np.testing.assert_allclose(contacts.estimate.point[row, :2], [x, y], atol=2e-3)
        np.testing.assert_allclose(-contacts.estimate.force[row, 2], weight * 9.80665, rtol=0.02)
