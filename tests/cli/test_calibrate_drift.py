"""`palpate calibrate drift`: from the log of an untouched sensor to the rig, and what it says of other logs."""

import json
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.cli import main
from palpate.setup import load_rig
from palpate.signals.drift import Drift
from palpate_lab.simulation.bags import Stamped, header, nanoseconds, wrenches, write_bag
from palpate_lab.simulation.drift import simulate_drift

RATE, SECONDS = 50.0, 100.0  # Hz, s
WALK = np.array([4e-3] * 3 + [2e-4] * 3)
NOISE = np.array([0.02] * 3 + [1e-3] * 3)
KELVIN = np.array([0.1] * 3 + [0.005] * 3)
TIME = np.arange(round(SECONDS * RATE)) / RATE
CELSIUS = 30.0 - 5.0 * np.exp(-TIME / 20.0) + np.sin(TIME / 3.0)
RIG = """# my rig
[surface]
kind = "plane"  # a table

[force_torque]
noise = { force = 0.02, torque = 0.001 }  # by hand
"""


@cache
def a_zero(*, warm: bool = False) -> np.ndarray:
    """Readings [N, N m] of an untouched sensor, with what the temperature does."""
    rng = np.random.default_rng(2)
    zero = simulate_drift(TIME, Drift(WALK, thermal=KELVIN), rng, CELSIUS if warm else None)
    return zero + rng.normal(size=zero.shape) * NOISE


def drift(folder: Path, log: str, rig: str = RIG, *options: str) -> tuple[int, Path]:
    (folder / "rig.toml").write_text(rig)
    words = ["calibrate", "drift", str(folder / log), "--rig", str(folder / "rig.toml"), "--window", "0.4"]
    return main([*words, "-o", str(folder / "out.toml"), *options]), folder / "out.toml"


def columns(path: Path, names: str, *values: np.ndarray) -> None:
    np.savetxt(path, np.column_stack([TIME, *values]), delimiter=",", header=f"time,{names}", comments="", fmt="%.7g")


def found_in(rig: Path, channels: int = 6) -> Drift:
    found = load_rig(rig).resolve().followed(channels)
    assert found is not None
    return found


def test_from_columns_it_is_written_beside_what_a_person_wrote(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    columns(tmp_path / "free.csv", "fx,fy,fz,tx,ty,tz", a_zero())
    code, out = drift(tmp_path, "free.csv")
    assert code == 0
    np.testing.assert_allclose(found_in(out).walk, WALK, rtol=0.35)  # three deviations of 100 s
    text = out.read_text()
    assert all(line in text.splitlines() for line in RIG.splitlines())
    assert "N/sqrt(s), N m/sqrt(s), from free.csv (sha256:" in text
    said = capsys.readouterr().out
    for words in ("walk  ", "mN, torque", "warm-up", "after 60 s unsure (95 %): force by 0.", "names no payload"):
        assert words in said


def test_as_json_it_has_numbers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    columns(tmp_path / "free.csv", "fx,fy,fz,tx,ty,tz", a_zero())
    assert drift(tmp_path, "free.csv", RIG, "--json")[0] == 0
    facts = json.loads(capsys.readouterr().out)["facts"]
    np.testing.assert_allclose(facts["walk"], WALK, rtol=0.35)


def test_from_topics_with_a_temperature(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of 2 Hz, between whose readings the samples are."""

    def made(types: Any) -> Iterable[Iterable[Stamped]]:
        stamped = types["sensor_msgs/msg/Temperature"]
        stamps = zip(nanoseconds(TIME[::25]), CELSIUS[::25].tolist(), strict=True)
        warmth = ((stamp, "/warm", stamped(header(types, stamp, "ft"), value, 0.0)) for stamp, value in stamps)
        return wrenches(types, "/ft", TIME, a_zero(warm=True)), warmth

    kinds = {"/ft": "geometry_msgs/msg/WrenchStamped", "/warm": "sensor_msgs/msg/Temperature"}
    write_bag(tmp_path / "free.mcap", kinds, made)
    rig = RIG + '\n[drift]\nwalk = { force = 1, torque = 1 }  # a guess\ntemperature = "/warm"\n'
    code, out = drift(tmp_path, "free.mcap", rig)
    assert code == 0
    found = found_in(out)
    assert np.all(np.abs(found.thermal - KELVIN) < 4.0 * found.thermal_deviation)
    assert found.thermal_deviation[0] < 0.02
    np.testing.assert_allclose(found.walk, WALK, rtol=0.4)
    assert "a guess" not in out.read_text()
    assert "temperature      force" in capsys.readouterr().out


def spoil(values: np.ndarray, kind: str) -> np.ndarray:
    made = values.copy()
    if kind == "short":
        return made[:1000]
    if kind == "dead":
        made[:, 2] = 0.0
    if kind == "jump":
        made[2500:] += 1.0
    if kind == "swing":
        made += np.sin(TIME)[:, None]
    return made


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("short", "at least 60 s are needed to find the drift. Record"),
        ("dead", "z of the force is 0 in all rows"),
        ("jump", "the zero jumped. Record"),
        ("swing", "the arm moves, or something touches the sensor. Record"),
    ],
)
def test_what_is_no_free_log_is_refused_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str, said: str
) -> None:
    rows = spoil(a_zero(), kind)
    table = np.column_stack([TIME[: len(rows)], rows])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="time,fx,fy,fz,tx,ty,tz", comments="")
    code, out = drift(tmp_path, "log.csv")
    assert code == 1
    assert said in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize(
    ("rig", "options", "said"),
    [
        (RIG + "drift = { force = 0.002, torque = 0.0001 }\n", (), "[force_torque] already states a drift"),
        (RIG, ("--window", "0"), "--window"),
        (RIG + '[drift]\nwalk = { force = 1, torque = 1 }\ntemperature = "celsius"\n', (), "no column 'celsius'"),
        ('[surface]\nkind = "plane"\n[skin]\ncount = 6\n[time]\nrate = 50\n', (), "only force/torque sensors"),
    ],
)
def test_calls_that_cannot_be_meant(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], rig: str, options: tuple[str, ...], said: str
) -> None:
    columns(tmp_path / "free.csv", "fx,fy,fz,tx,ty,tz", a_zero())
    assert drift(tmp_path, "free.csv", rig, *options)[0] in (1, 2)
    assert said in capsys.readouterr().err
