"""`palpate inspect --spectrum` draws what it says it draws, and proposes a filter for a log whose band is known."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from scipy.signal import butter, sosfilt

from palpate.cli import main
from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ROW, ContactEstimate
from palpate.files.contacts import write_contacts

RATE, EDGE, COUNT = 200.0, 8.0, 12_000
SIGNATURE = {".svg": b"<?xml", ".png": b"\x89PNG", ".html": b"<!DOCTYPE html>"}


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Forces that move below 8 Hz, pressed onto the plane z = 0 of a rig, and white noise of 0.02 N, 0.001 N m."""
    rng = np.random.default_rng(0)
    band = sosfilt(butter(8, EDGE, fs=RATE, output="sos"), rng.normal(size=(COUNT, 3)), axis=0)
    force = [0.0, 0.0, -10.0] + band / band.std(axis=0)
    point = np.column_stack([0.02 * np.sin(np.arange(COUNT) / 100), np.zeros(COUNT), np.zeros(COUNT)])
    wrench = np.hstack([force, np.cross(point, force)]) + rng.normal(size=(COUNT, 6)) * ([0.02] * 3 + [0.001] * 3)
    path = tmp_path_factory.mktemp("log") / "log.csv"
    names = ("fx", "fy", "fz", "tx", "ty", "tz")
    pl.DataFrame({"time": np.arange(COUNT) / RATE, **dict(zip(names, wrench.T, strict=True))}).write_csv(path)
    noise = "noise = { force = 0.02, torque = 0.001 }"
    (path.parent / "rig.toml").write_text(f'[surface]\nkind = "plane"\n[force_torque]\n{noise}\n')
    return path


def _cutoff(said: str) -> float:
    line = next(line for line in said.splitlines() if line.strip().startswith("cut-off"))
    return float(line.split("Above ")[1].split()[0])


@pytest.mark.parametrize("suffix", SIGNATURE)
def test_a_log_gets_the_cut_off_of_its_band(
    suffix: str, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The 8th-order skirt of a signal fifty times the noise meets it within a factor of 2.2 above the band's edge."""
    output = tmp_path / f"spectrum{suffix}"
    assert main(["inspect", str(log), "--spectrum", str(output)]) == 0
    said = capsys.readouterr().out
    assert EDGE < _cutoff(said) < 2.2 * EDGE
    assert "Butterworth" in said
    assert "Kalman" in said
    assert output.read_bytes().startswith(SIGNATURE[suffix])


def test_with_a_rig_the_place_is_drawn_too(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "spectrum.html"
    rig = str(log.parent / "rig.toml")
    assert main(["inspect", str(log), "--rig", rig, "--spectrum", str(output)]) == 0
    assert "place" in capsys.readouterr().out
    assert output.read_text().count("<svg") == 2


def test_contacts_have_a_spectrum_of_force_and_place(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = np.random.default_rng(1).normal(size=(2_000, ROW.length))
    rows[:, ROW.status] = rows[:, ROW.candidates] = 0
    made = Contacts.single(np.arange(2_000) / RATE, ContactEstimate.from_rows(rows))
    write_contacts(tmp_path / "contacts.csv", made)
    assert main(["inspect", str(tmp_path / "contacts.csv"), "--spectrum", str(tmp_path / "a.html")]) == 0
    said = capsys.readouterr().out
    assert said.count("the spectrum is white") == 2


@pytest.mark.parametrize(
    ("file", "output", "why"),
    [
        ("log.csv", "log.csv", "a picture cannot end in"),
        ("log.csv", "a.pdf", "a picture cannot end in"),
        ("rig.toml", "a.png", "has no spectrum"),
        ("short.csv", "a.png", "steady rate, and no 32 samples in a row (of 19) have one. Stamp"),
        ("points.csv", "a.png", "has no spectrum"),
    ],
)
def test_what_cannot_be_drawn_is_refused(
    file: str, output: str, why: str, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = log.parent
    (folder / "short.csv").write_text("\n".join(log.read_text().splitlines()[:20]))
    (folder / "points.csv").write_text("time,px,py,pz\n0,0,0,0\n")
    before = (folder / file).read_bytes()
    target = folder / output if output == file else tmp_path / output
    assert main(["inspect", str(folder / file), "--spectrum", str(target)]) == 1
    assert why in capsys.readouterr().err
    assert (folder / file).read_bytes() == before
    assert not (tmp_path / output).exists()
