"""Rigs, models, logs, contacts and live records that version 0.3 wrote, of each sensor: they are read for ever."""

from pathlib import Path

import numpy as np
import pytest

import palpate
from palpate.cli import main

HERE = Path(__file__).parent
SENSORS = sorted(folder.name for folder in HERE.iterdir() if (folder / "rig.toml").exists())
LOGGED = [name for name in SENSORS if (HERE / name / "log.csv").exists()]


@pytest.mark.parametrize("sensor", SENSORS)
def test_every_file_is_known(sensor: str, capsys: pytest.CaptureFixture[str]) -> None:
    files = [file for file in (HERE / sensor).rglob("*.*") if not file.name.endswith(".csv.toml")]
    assert len(files) >= 5
    for file in files:
        assert main(["inspect", str(file)]) == 0, capsys.readouterr().err


@pytest.mark.parametrize("sensor", SENSORS)
def test_contacts_of_all_formats_are_the_same(sensor: str) -> None:
    known, *others = (palpate.Contacts.load(HERE / sensor / f"contacts.{kind}") for kind in ("parquet", "csv", "mcap"))
    assert known
    for other in others:
        np.testing.assert_array_equal(other.sample, known.sample)
        for name in ("time", "status", "point", "normal", "force", "torque", "covariance"):
            np.testing.assert_array_equal(getattr(other, name), getattr(known, name))


@pytest.mark.parametrize("sensor", LOGGED)
def test_a_log_has_the_contacts_that_were_found_then(sensor: str) -> None:
    known = palpate.Contacts.load(HERE / sensor / "contacts.parquet")
    found = palpate.estimate(HERE / sensor / "log.csv", HERE / sensor / "rig.toml")
    np.testing.assert_array_equal(found.sample, known.sample)
    np.testing.assert_array_equal(found.status, known.status)
    for name in ("time", "point", "force", "torque", "covariance"):  # on another processor the last digits differ
        np.testing.assert_allclose(getattr(found, name), getattr(known, name), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("sensor", LOGGED)
def test_a_live_record_is_a_log_and_contacts(sensor: str) -> None:
    record = HERE / sensor / "live.mcap"
    then, now = palpate.Contacts.load(record), palpate.estimate(record, HERE / sensor / "rig.toml")
    assert then
    known = {key: row for row, key in enumerate(zip(then.sample.tolist(), then.identity.tolist(), strict=True))}
    pairs = [(known[key], row) for row, key in enumerate(zip(now.sample, now.identity, strict=True)) if key in known]
    was, found = then[np.array([one for one, _ in pairs])], now[np.array([other for _, other in pairs])]
    both = was.answered & found.answered
    assert np.count_nonzero(both) > 0.9 * np.count_nonzero(was.answered) > 0
    off = np.linalg.norm(found.point[both] - was.point[both], axis=1)
    assert np.median(off) < 2e-4  # m: live and offline differ where a touch begins and ends
