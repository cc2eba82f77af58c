"""`palpate events` prints and writes touches that other commands read."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from palpate.cli import main
from palpate.contact.contacts import Contacts
from palpate.files.contacts import open_contacts, write_contacts
from tests.support.pages import one_a_second


def test_what_was_not_finished_is_read_and_many_touches_are_not_all_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with open_contacts(tmp_path / "contacts.mcap") as writer:
        writer.write(one_a_second(60))
        assert main(["events", str(tmp_path / "contacts.mcap.part")]) == 0
    printed = capsys.readouterr().out
    assert "60 touches" in printed
    assert "20 more" in printed
    assert "ends without its footer" in printed


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mcap"])
def test_two_touches_at_once_are_two_with_what_the_sensor_adds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], suffix: str
) -> None:
    one = one_a_second(1)
    moved = replace(one.estimate, point=one.point + np.array([0.02, 0.0, 0.0]))
    other = replace(one, identity=np.ones(100, dtype=np.int64), estimate=moved)
    both = [replace(each, features={"row": np.where(each.answered, k, np.nan)}) for k, each in ((2, one), (5, other))]
    joined = Contacts.joined(both)
    write_contacts(tmp_path / f"contacts{suffix}", joined[np.argsort(joined.sample, kind="stable")])
    assert main(["events", str(tmp_path / f"contacts{suffix}"), "-o", str(tmp_path / "touches.csv")]) == 0
    assert "2 touches in 200 rows" in capsys.readouterr().out
    found = pl.read_csv(tmp_path / "touches.csv")
    assert found["contact"].to_list() == [0, 1]
    assert found["row"].to_list() == [2.0, 5.0]
    np.testing.assert_allclose(found["px"], [0.001, 0.021])
    assert main(["evaluate", str(tmp_path / f"contacts{suffix}"), str(tmp_path / "touches.csv")]) == 0
    said = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [words[1] for words in said if words[:1] in (["1"], ["2"])] == ["0.000", "0.000"]


def test_without_touches(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_contacts(tmp_path / "contacts.csv", one_a_second(1)[50:])
    assert main(["events", str(tmp_path / "contacts.csv"), "-o", str(tmp_path / "touches.csv")]) == 0
    assert "no contact lasts" not in (shown := capsys.readouterr().out)
    assert "0 touches" in shown
    write_contacts(tmp_path / "contacts.csv", one_a_second(1)[:1])
    assert main(["events", str(tmp_path / "contacts.csv")]) == 0
    assert "no contact lasts 0.02 s (in 1 rows): check the times" in capsys.readouterr().out


def test_wrong_calls_are_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_contacts(tmp_path / "contacts.csv", one_a_second(1))
    assert main(["events", str(tmp_path / "contacts.csv"), "-o", str(tmp_path / "contacts.csv")]) == 1
    assert "would overwrite an input" in capsys.readouterr().err
    assert main(["events", str(tmp_path / "contacts.csv"), "--gap", "-1"]) == 1
    assert "speed: seconds and speed must not be negative" in capsys.readouterr().err
