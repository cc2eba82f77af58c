"""Intensity curves from two loggers on their own clocks, and from frames at known pressures."""

from pathlib import Path

import numpy as np
import pytest

from claims.evidence.skin_calibration import two_logs
from palpate.errors import InputError, NotIdentifiable
from palpate.files.models import read_model
from palpate.sensors.taxels.commands import CalibrateIntensity
from palpate.sensors.taxels.intensity import Intensity
from palpate.sensors.taxels.mat import identify_by_pressures, pressure_errors
from palpate.sensors.taxels.model import TaxelBody
from palpate.sensors.taxels.skin_map.model import flat_map
from palpate.sensors.taxels.two_loggers import joined, loggers_offset

PRESSURES = 1e3 * np.arange(0.0, 80.0, 10.0)  # Pa
NEAR = 0.005  # s: a quarter of what is claimed, for the creep and jitter of these logs


def _saved(path: Path, names: str, *columns: np.ndarray) -> Path:
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=names, comments="", fmt="%.5f")
    return path


@pytest.mark.parametrize("offset", [-2.7, 1.2])
@pytest.mark.parametrize("since", [0.0, 1.7e9])
def test_the_offset_of_two_loggers_is_found(offset: float, since: float) -> None:
    """Also where one of them counts from 1970."""
    time, reading, there, force = two_logs(np.random.default_rng(1), offset)
    found = loggers_offset(time + since, reading, there, force)
    assert found.offset - since == pytest.approx(offset, abs=NEAR)
    assert found.deviation < NEAR


def test_presses_that_do_not_determine_the_offset_are_refused() -> None:
    rng = np.random.default_rng(2)
    time, reading, there, force = two_logs(rng, 1.2)
    with pytest.raises(NotIdentifiable, match=r"two answers, 3\.0 s from each other"):
        loggers_offset(*two_logs(rng, 1.2, regular=True))
    with pytest.raises(NotIdentifiable, match="follows the force at no offset"):
        loggers_offset(time, rng.permutation(reading), there, force)
    with pytest.raises(InputError, match=r"cannot be compared.*Give"):
        loggers_offset(time[:3], reading[:3], there, force)


def test_a_force_is_joined_within_its_log_only() -> None:
    there = np.array([0.4, 0.0, 2.0, 2.2, 2.4, 2.6, 2.8])
    forces = joined(np.array([-0.1, 0.2, 1.0, 2.1, 2.9]), there, 10.0 * there)
    np.testing.assert_allclose(forces, [np.nan, 2.0, np.nan, 21.0, np.nan])


def test_two_loggers_are_joined_by_the_command(tmp_path: Path) -> None:
    """The curve is that of one table on one clock."""
    time, reading, there, force = two_logs(np.random.default_rng(3), 1.2)
    skin = _saved(tmp_path / "skin.csv", "time,intensity", time, reading)
    cell = _saved(tmp_path / "cell.csv", "time,force", there, force)
    one = _saved(tmp_path / "one.csv", "intensity,force", reading, joined(time - 1.2, there, force))
    found = CalibrateIntensity(log=skin, output=tmp_path / "two.toml", force=cell, kind="monotone").identify()
    known = CalibrateIntensity(log=one, output=tmp_path / "one.toml", kind="monotone").identify()
    assert ("clocks", "+1.2") in [(name, str(text)[:4]) for name, text in found.figures]
    forces = np.linspace(1.0, 8.0, 8)
    np.testing.assert_allclose(
        found.model.curves[0].intensity(forces), known.model.curves[0].intensity(forces), rtol=0.02
    )


def _mat(pressures: np.ndarray) -> np.ndarray:
    """Whole counts of 3 x 4 cells whose curve bends, and whose gains differ."""
    gain = np.linspace(0.7, 1.3, 12)
    return np.rint(40.0 + gain * 9000.0 * pressures[:, None] / (pressures[:, None] + 60e3))


def test_pressures_give_each_cell_its_gain() -> None:
    """Whether readings rise or fall; a dead cell has none, and four pressures are needed."""
    body, dead = TaxelBody.sheet(flat_map(3, 4, 0.01), bits=None, masked=[(0, 1)]), np.arange(12) == 5

    def frames(pressures: np.ndarray, sign: float = -1.0) -> np.ndarray:
        return 6000.0 + sign * np.where(dead, 0.0, _mat(pressures))

    errors = pressure_errors(PRESSURES, frames(PRESSURES), body)
    assert errors.shape == (6, 12)
    assert np.isnan(errors).all(axis=0).nonzero()[0].tolist() == [1, 5]
    assert np.nanmax(np.abs(errors)) < 1e3  # Pa, of 70 kPa: a bend that the other frames do not show
    others = np.array([25e3, 44e3])
    for sign in (1.0, -1.0):
        found = identify_by_pressures(PRESSURES, frames(PRESSURES, sign), body)
        assert "2 of 12 cells have no gain" in found.notes[-1]
        for cell, which in enumerate(found.numbers(body.shape).tolist()):
            if which:
                read = np.abs(frames(others) - frames(np.zeros(1)))[:, cell]
                np.testing.assert_allclose(found.curves[which].force(read) / body.areas[cell], others, rtol=0.01)
    with pytest.raises(NotIdentifiable, match="3 pressures are too few"):
        identify_by_pressures(PRESSURES[:3], frames(PRESSURES[:3]), body)
    anywhere = TaxelBody.placed(np.eye(3), np.eye(3))
    with pytest.raises(InputError, match=r"need a sheet.*State"):
        identify_by_pressures(PRESSURES, frames(PRESSURES)[:, :3], anywhere)


def test_a_mat_is_calibrated_by_the_command(tmp_path: Path) -> None:
    names = ",".join(f"r{row}c{column}" for row in range(2) for column in range(2))
    few = PRESSURES[:5]
    log, rig = _saved(tmp_path / "mat.csv", names, _mat(few)[:, :4]), tmp_path / "rig.toml"
    rig.write_text("[skin]\npitch = 0.01\nrows = 2\ncolumns = 2\nbits = 16\n", encoding="utf-8")
    command = CalibrateIntensity(log=log, output=tmp_path / "mat.toml", rig=rig, pressures=tuple(few / 1e3))
    command.run()
    assert read_model(tmp_path / "mat.toml", Intensity).numbers((2, 2)).min() == 1
    with pytest.raises(InputError, match=r"5 frames, and 2 pressures.*Write"):
        CalibrateIntensity(log=log, output=tmp_path / "mat.toml", rig=rig, pressures=(0.0, 10.0)).identify()
    with pytest.raises(InputError, match=r"no \[skin\].*Add"):
        CalibrateIntensity(log=log, output=tmp_path / "mat.toml", pressures=(0.0, 10.0)).identify()
