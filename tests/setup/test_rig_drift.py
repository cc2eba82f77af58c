"""[drift] of a rig: what it says becomes a Drift, what it cannot mean is a sentence, and writing keeps every word."""

from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.files.logs import read_recording
from palpate.files.logs.layout import LogLayout
from palpate.setup import load_rig
from palpate.setup.drift import drift_table
from palpate.setup.edit import update_drift
from palpate.signals.drift import Drift
from palpate.signals.recording import TEMPERATURE

SURFACE = '[surface]\nkind = "plane"  # a table\n'
WRENCH = f"{SURFACE}\n[force_torque]\n"
CELLS = f'{SURFACE}\n[load_cells]\nmodel = "cells.toml"\n'
SKIN = '[skin]\ntaxels = "skin.toml"\n'
WALK = "[drift]\nwalk = { force = 0.003, torque = [1e-4, 1e-4, 2e-4] }\n"


def a_rig(folder: Path, text: str) -> Path:
    path = folder / "rig.toml"
    path.write_text(text)
    return path


def test_it_becomes_a_drift_of_six_channels_in_si(tmp_path: Path) -> None:
    text = WALK + (
        "warm_up = { force = 0.6, torque = 0.012 }\nsettle = 300\nweight = 0.05\n"
        "thermal = { force = -0.02, torque = 0.001 }\nthermal_deviation = { force = 0.01, torque = 0 }\n"
        'temperature = "T"\n'
    )
    rig = load_rig(a_rig(tmp_path, WRENCH + text))
    drift = rig.resolve().followed(6)
    np.testing.assert_array_equal(drift.walk, [0.003] * 3 + [1e-4, 1e-4, 2e-4])
    np.testing.assert_allclose(drift.warm_up, [0.01] * 3 + [2e-4] * 3, rtol=1e-15)  # a minute has 60 seconds
    np.testing.assert_array_equal(drift.thermal, [-0.02] * 3 + [0.001] * 3)
    np.testing.assert_array_equal(drift.thermal_deviation, [0.01] * 3 + [0.0] * 3)
    assert (drift.settling, drift.weight) == (300.0, 0.05)
    assert rig.layout().temperature == "T"


def test_what_is_not_said_is_none(tmp_path: Path) -> None:
    drift = load_rig(a_rig(tmp_path, WRENCH + WALK)).resolve().followed(6)
    assert not drift.warm_up.any()
    assert np.isinf(drift.settling)
    assert load_rig(a_rig(tmp_path, WRENCH)).resolve().followed(6) is None


@pytest.mark.parametrize(("walk", "expected"), [("1e-6", [1e-6] * 9), (str([k * 1e-6 for k in range(1, 10)]), None)])
def test_of_load_cells_it_is_a_number_or_a_list(tmp_path: Path, walk: str, expected: list[float] | None) -> None:
    rig = load_rig(a_rig(tmp_path, CELLS + f"[drift]\nwalk = {walk}\n"))
    drift = rig.resolve().followed(9)
    np.testing.assert_allclose(drift.walk, expected or 1e-6 * np.arange(1, 10), rtol=1e-12)
    with pytest.raises(InputError, match=r"12 channels.*Write") if expected is None else pytest.raises(InputError):
        rig.resolve().followed(12 if expected is None else 6)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (WRENCH + "[drift]\nwalk = 0.003\n", r"toml: .*walk of \[force_torque\] must be \{ force"),
        (CELLS + WALK, r"toml: .*walk of \[load_cells\] must be a number"),
        (
            SKIN + WALK,
            r"\[drift\] is for a force/torque sensor or for load cells, not for \[skin\].*drift in \[contacts\]",
        ),
        (
            WRENCH + "drift = { force = 0.002, torque = 0.0001 }\n" + WALK,
            r"\[force_torque\] drift and \[drift\] exclude.*Remove",
        ),
        (WRENCH + "[drift]\nsettle = 3\n", "toml: drift.walk is missing"),
        (WRENCH + "[drift]\nwalk = { force = 0, torque = 1 }\n", "walk: .*must be positive"),
        (CELLS + "[drift]\nwalk = [1e-6, -1e-6]\n", "drift: walk must not be negative"),
        (WRENCH + WALK + "settle = 0\n", "drift: settle must be a positive time"),
        (WRENCH + WALK + "weight = -1\n", "drift: weight must be a force"),
        (WRENCH + WALK + "warm_up = { force = -1, torque = 0 }\n", "warm_up: .*must not be negative"),
        (WRENCH + WALK + "thermal = { force = 1, torque = 0 }\n", "drift: thermal needs temperature"),
        (WRENCH + WALK + "warmup = 3\n", "Did you mean 'warm_up'"),
        (WRENCH + "[drift]\nwalk = 'a lot'\n", "drift.walk must be a table of force, torque or a number or a list"),
    ],
)
def test_what_cannot_be_meant_is_a_sentence(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        load_rig(a_rig(tmp_path, text))


FOUND = Drift(
    [0.0031234567] * 3 + [1e-4, 2e-4, 3e-4],
    [0.01] * 3 + [1e-5] * 3,
    123.456,
    0.02,
    thermal=[0.01] * 6,
    thermal_deviation=[1e-3] * 6,
)


@pytest.mark.parametrize(
    "before",
    [
        "",
        "[drift]  # ours\nwalk = { force = 1, torque = 1 } # a guess\nsettle = 3 # s\n\n[time]\nunit = 's' # seconds\n",
        "[time]\nunit = 's'\n[drift]\nwalk = { force = 1, torque = 1 }\ntemperature = 'T'  # of the body\n",
        "drift.walk = { force = 1, torque = 1 }\n",
        "drift = { walk = { force = 1, torque = 1 } }\n",
    ],
)
def test_it_finds_its_place_in_any_form_of_rig(tmp_path: Path, before: str) -> None:
    text = SURFACE + before if before.startswith("[") else before + SURFACE
    path = a_rig(tmp_path, text)
    update_drift(path, path, drift_table(FOUND, temperature="T"), {"walk": "from a log"})
    drift, written = load_rig(path).resolve().followed(6), path.read_text()
    for name in ("walk", "warm_up", "thermal", "thermal_deviation"):
        np.testing.assert_allclose(getattr(drift, name), getattr(FOUND, name), rtol=5e-4)  # four digits are written
    assert drift.settling == pytest.approx(123.456, rel=5e-4)
    assert drift.weight == 0.02
    for word in ("a table", "ours", "seconds", "of the body"):
        assert (word in written) == (word in text)
    assert "a guess" not in written
    again = tmp_path / "again.toml"
    update_drift(path, again, drift_table(Drift([1e-3] * 6)), {})
    assert load_rig(again).drift is not None
    assert "warm_up" not in again.read_text()  # what was not found again is not kept from the log before


def test_a_temperature_stands_in_a_column_of_any_name(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("time,fx,fy,fz,tx,ty,tz,celsius\n0,1,2,3,4,5,6,21.5\n1,1,2,3,4,5,6,\n")
    read = read_recording(log, LogLayout(temperature="celsius")).channels[TEMPERATURE]
    np.testing.assert_array_equal(read, [[21.5], [np.nan]])
    assert TEMPERATURE not in read_recording(log, LogLayout()).channels
    with pytest.raises(InputError, match=r"no column 'kelvin'.*Available"):
        read_recording(log, LogLayout(temperature="kelvin"))
