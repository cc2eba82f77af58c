"""What a command says: as text, as one JSON object, or nothing but its warnings; seconds since 1970 as a date."""

import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.cli import main
from tests.follow import heard
from tests.support.pages import one_a_second

UNIX = 1.75e9 + 0.25  # s: 2025-06-15 15:06:40 UTC, and a quarter


def _truth(path: Path) -> Path:
    """1 mm off."""
    rows = "".join(f"{k},{k + 0.49},0.002,-0.002,0.003\n" for k in range(3))
    path.write_text(f"start,end,px,py,pz\n{rows}")
    return path


def _log(path: Path) -> Path:
    rng = np.random.default_rng(3)
    values = np.column_stack([np.arange(200) / 100, rng.normal(size=(200, 6))])
    np.savetxt(path, values, delimiter=",", header="time,fx,fy,fz,tx,ty,tz", comments="")
    return path


def _said(capsys: pytest.CaptureFixture[str], *words: str) -> Any:
    assert main([*words, "--json"]) == 0
    out, err = capsys.readouterr()
    assert not err
    return json.loads(out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))


def test_events_and_evaluate_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    contacts, truth = tmp_path / "contacts.csv", _truth(tmp_path / "truth.csv")
    one_a_second(3).save(contacts)
    said = _said(capsys, "events", str(contacts))
    (touches,) = said["tables"]
    assert [row["start [s]"] for row in touches] == [0.0, 1.0, 2.0]
    assert {row["peak [N]"] for row in touches} == {3.0}
    said = _said(capsys, "evaluate", str(contacts), str(truth))
    facts, (_, summary) = said["facts"], said["tables"]
    assert facts["contacts"]["answered"] == 150
    assert facts["contact"] == {"share": 1.0, "count": 150}
    assert summary[0]["mean"] == pytest.approx(1.0)


def test_inspect_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = _said(capsys, "inspect", str(_log(tmp_path / "log.csv")))
    assert said["facts"]["time"]["from_to"] == [0.0, 1.99]
    assert said["facts"]["time"]["rate"] == pytest.approx(100)
    (channels,) = said["tables"]
    assert [row["name"] for row in channels] == ["fx [N]", "fy [N]", "fz [N]", "tx [N m]", "ty [N m]", "tz [N m]"]
    assert all(row["least"] < row["median"] < row["most"] and row["missing"] == 0 for row in channels)
    one_a_second(3).save(tmp_path / "contacts.mcap")
    said = _said(capsys, "inspect", str(tmp_path / "contacts.mcap"))
    assert said["facts"]["contact"] == {"share": 0.5, "count": 150}


def test_a_wrong_input_says_one_sentence_and_no_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(tmp_path / "none.csv"), "--json"]) == 1
    out, err = capsys.readouterr()
    assert not out
    assert "none.csv: the file does not exist" in err


def test_quiet_says_warnings_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, rig = _log(tmp_path / "log.csv"), tmp_path / "rig.toml"
    assert main(["--quiet", "rig", "new", str(log), "-o", str(rig)]) == 0
    assert capsys.readouterr() == ("", "")
    assert rig.exists()
    rig.write_text(rig.read_text().replace("# payload =", "payload ="))
    assert main(["inspect", str(rig), "--quiet"]) == 0
    out, err = capsys.readouterr()
    assert not out
    assert "payload.toml does not exist yet" in err


def test_seconds_since_1970_are_counted_from_a_date(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    contacts = tmp_path / "contacts.csv"
    one_a_second(3, UNIX).save(contacts)
    assert main(["inspect", str(contacts)]) == 0
    assert "0.250 to 3.240 after 2025-06-15 15:06:40 UTC" in capsys.readouterr().out
    assert main(["events", str(contacts)]) == 0
    out = capsys.readouterr().out
    assert "after 2025-06-15 15:06:40 UTC" in out
    assert " 0.250" in out
    said = _said(capsys, "events", str(contacts))
    assert said["facts"]["time [s]"] + said["tables"][0][1]["start [s]"] == pytest.approx(UNIX + 1.0)


SILENT = """
import sys, time
from palpate.console import console
console._TICK, console._SILENT = 0.02, 0.05
with console.spoken(quiet={quiet}, json=False):
    console.wait("building")
    time.sleep(0.5)
    console.lines([("built", 1)])
    console.announce("served")
    time.sleep(0.5)
"""


@pytest.mark.parametrize("quiet", [False, True])
def test_on_a_terminal_silent_seconds_are_counted_until_something_is_served(quiet: bool, tmp_path: Path) -> None:
    """Between two printed lines, on stderr, and wiped before the next; ten times as long as a count needs."""
    done, _ = heard([sys.executable, "-c", SILENT.format(quiet=quiet)], tmp_path, os.environ)
    count = "\rpalpate: building, 0 s\x1b[K"
    assert done.returncode == 0
    assert (count in done.stderr) is not quiet
    assert done.stderr.count("working") == 0  # nobody waits for a page
    if not quiet:
        assert done.stderr.endswith("\r\x1b[K")
        assert done.stdout.split() == ["built", "1", "served"]
