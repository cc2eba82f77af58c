"""Times that state no unit are read by one rule, whatever reads them, and a stated unit is always used."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import trimesh

from palpate import InputError, estimate
from palpate.cli import main
from palpate.files.logs import LogLayout, read_recording
from palpate.files.tables.stated import judged_unit
from palpate.setup import load_rig

SI = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def _table(path: Path, times: Sequence[object], name: str = "time") -> Path:
    values = np.random.default_rng(3).normal(0, 0.02, (len(times), 6))
    rows = [f"{time},{','.join(f'{value:.5f}' for value in row)}" for time, row in zip(times, values, strict=True)]
    path.write_text("\n".join([f"{name},fx,fy,fz,tx,ty,tz", *rows]) + "\n", "utf-8")
    return path


@pytest.mark.parametrize(
    ("count", "step", "unit"),
    [
        (22, 1, "s"),  # a row a pose; in ms all of them would last 22 ms
        (60, 1, "s"),
        (400, 1, "ms"),
        (9000, 1, "ms"),  # more than one block
        (60, 10, "ms"),
        (400, 0.01, "s"),
        (400, 0.5, "s"),
        (400, 1000, "us"),
        (400, 1_000_000, "ns"),
    ],
)
def test_a_table_a_rig_and_every_command_agree(tmp_path: Path, count: int, step: float, unit: str) -> None:
    log, mesh = _table(tmp_path / "log.csv", [k * step for k in range(count)]), tmp_path / "box.stl"
    trimesh.creation.box((20, 20, 20)).export(mesh)
    expected = np.arange(count) * step * SI[unit]
    assert np.allclose(read_recording(log).time, expected, rtol=1e-12)
    assert np.allclose(estimate(log, mesh=mesh, unit="mm").time, expected, rtol=1e-12)
    rig = tmp_path / "rig.toml"
    assert main(["rig", "new", str(log), str(mesh), "-o", str(rig)]) == 0
    assert load_rig(rig).time.unit == unit
    assert np.allclose(estimate(log, rig).time, expected, rtol=1e-12)
    bare = rig.read_text().replace(f'unit = "{unit}"   ', "#")
    assert bare != rig.read_text()
    rig.write_text(bare)
    assert np.allclose(estimate(log, rig).time, expected, rtol=1e-12)
    rig.write_text(bare.replace("[time]", '[time]\nunit = "s"'))
    assert np.allclose(estimate(log, rig).time, np.arange(count) * step, rtol=1e-12)


def test_inspect_prints_the_times_that_are_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for count, said in {60: "0.000 to 59.000", 400: "0.000 to 0.399"}.items():
        assert main(["inspect", str(_table(tmp_path / f"{count}.csv", range(count)))]) == 0
        assert said in capsys.readouterr().out


def test_dates_are_seconds_whatever_their_step(tmp_path: Path) -> None:
    stamps = [f"2025-12-31 12:{k // 60:02d}:{k % 60:02d}" for k in range(300)]
    clocks = [stamp.split()[1] for stamp in stamps]
    for name, times in {"dates": stamps, "clocks": clocks, "epoch": [1767182400 + k for k in range(300)]}.items():
        time = read_recording(_table(tmp_path / f"{name}.csv", times)).time
        assert np.allclose(np.diff(time), 1.0)
    frame = pl.read_csv(tmp_path / "dates.csv", try_parse_dates=True)
    frame.write_parquet(tmp_path / "dates.parquet")
    assert np.allclose(np.diff(read_recording(tmp_path / "dates.parquet").time), 1.0)


@pytest.mark.parametrize(("name", "unit"), [("time [ms]", "ms"), ("ms", "ms"), ("time_us", "us"), ("seconds", "s")])
def test_a_stated_unit_is_used(tmp_path: Path, name: str, unit: str) -> None:
    log = _table(tmp_path / "log.csv", range(400), name)
    assert read_recording(log, LogLayout(time=name)).time[-1] == pytest.approx(399 * SI[unit])


def test_a_unit_of_time_that_is_not_read_is_refused(tmp_path: Path) -> None:
    log = _table(tmp_path / "log.csv", range(400), "time [min]")
    with pytest.raises(InputError, match=r"unknown unit 'min' of 'time \[min\]'.*Known"):
        read_recording(log, LogLayout(time="time [min]"))


def test_a_judged_unit_is_remarked_on() -> None:
    assert judged_unit(np.arange(400.0), "time")[1].startswith("'time' states no unit: its steps of 1 are taken for ms")
    assert judged_unit(np.arange(400) / 100, "time") == ("s", "")
