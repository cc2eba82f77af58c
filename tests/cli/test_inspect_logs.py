"""`palpate inspect` reads logs and contacts of every format, whole or torn, draws spectra and proposes filters."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import butter, sosfilt

from palpate.cli import main
from palpate.cli.inspect_log import Excerpt
from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ROW, ContactEstimate
from palpate.files.contacts import open_contacts, write_contacts
from palpate.signals.recording import FORCE, TORQUE, Recording
from palpate_lab.simulation.session import Session, simulate_session
from palpate_lab.simulation.session_mcap import write_session_mcap


@pytest.fixture(scope="module")
def session() -> Session:
    return simulate_session(3, touches=4, facets=500)


@pytest.fixture(scope="module")
def mcap(session: Session, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mcap")
    write_session_mcap(session, folder)
    return folder / "touches.mcap"


def _columns(session: Session) -> pl.DataFrame:
    wrenches = session.touches.wrenches()
    names = ("fx", "fy", "fz", "tx", "ty", "tz")
    return pl.DataFrame({"time": session.touches.time, **dict(zip(names, wrenches.T, strict=True))})


def _fail_after(output: Path, time: np.ndarray) -> None:
    with open_contacts(output) as writer:
        writer.write(Contacts.single(time, ContactEstimate.from_rows(np.zeros((len(time), ROW.length)))))
        raise RuntimeError


def _inspect(file: Path, capsys: pytest.CaptureFixture[str], *options: str) -> tuple[int, str]:
    capsys.readouterr()
    code = main(["inspect", str(file), *options])
    return code, capsys.readouterr().out


def _ranges(said: str) -> list[list[str]]:
    return [line.split() for line in said.splitlines() if line.strip().startswith(("fx [N]", "fy [N]", "tz [N m]"))]


def test_a_log_says_the_same_in_every_format(
    session: Session, mcap: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ranges are those that polars finds, and the formats agree on every line of the table."""
    table = _columns(session)
    table.write_csv(tmp_path / "log.csv")
    table.write_parquet(tmp_path / "log.parquet")
    found = []
    for file in (tmp_path / "log.csv", tmp_path / "log.parquet", mcap):
        code, said = _inspect(file, capsys)
        assert code == 0
        assert f"{len(table):,}" in said
        found.append(_ranges(said))
    assert found[0] == found[1] == found[2]
    fx = table["fx"].to_numpy()
    assert found[0][0][2:5] == [f"{value:.4g}" for value in (fx.min(), np.median(fx), fx.max())]


def test_topics_are_listed(mcap: Path, session: Session, capsys: pytest.CaptureFixture[str]) -> None:
    _, said = _inspect(mcap, capsys)
    rows = [line.split() for line in said.splitlines()]
    wrench = next(row for row in rows if row[0] == "/ft_sensor/wrench")
    assert wrench[1:3] == ["geometry_msgs/WrenchStamped", f"{len(session.touches):,}"]
    assert float(wrench[3]) == pytest.approx(session.touches.rate(), rel=0.01)
    assert any(row[:2] == ["/arm/sensor_pose", "geometry_msgs/PoseStamped"] for row in rows)


def test_a_torn_log_is_said_and_has_an_exit_code_of_its_own(
    mcap: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(mcap.read_bytes()[: mcap.stat().st_size // 2])
    code, said = _inspect(torn, capsys)
    assert code == 3
    assert "warning: " in said
    assert len(_ranges(said)) == 3


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mcap"])
@pytest.mark.parametrize("named", ["part", "output"])
def test_contacts_that_were_not_finished_are_read_to_their_last_block(
    suffix: str, named: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As a kill leaves them; whether one names OUTPUT.part, or OUTPUT, which is not there."""
    output = tmp_path / f"contacts{suffix}"
    with pytest.raises(RuntimeError):
        _fail_after(output, np.arange(300.0))
    code, said = _inspect(output if named == "output" else output.with_name(f"{output.name}.part"), capsys)
    assert code == 0
    assert "rows             300" in said
    assert "writing was interrupted" in said


def test_what_no_guess_fits_is_still_described(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "other.csv").write_text("alpha,beta\n1,2\n")
    code, said = _inspect(tmp_path / "other.csv", capsys)
    assert code == 0
    assert "alpha, beta" in said
    assert "it has no recognisable wrenches" in said


def test_a_rig_says_where_the_log_keeps_what(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Columns that no guess would find, in kN and ms."""
    names = list("abcdef")
    values = np.random.default_rng(1).normal(size=(50, 6))
    pl.DataFrame({"clock": np.arange(50.0), **dict(zip(names, values.T, strict=True))}).write_csv(tmp_path / "log.csv")
    (tmp_path / "rig.toml").write_text(
        f'[surface]\nkind = "plane"\n[time]\ncolumn = "clock"\nunit = "ms"\n'
        f'[force_torque]\ncolumns = {names}\nunits = {{ force = "kN" }}\n'
    )
    code, said = _inspect(tmp_path / "log.csv", capsys, "--rig", str(tmp_path / "rig.toml"))
    assert code == 0
    assert "0.000 to 0.049" in said
    assert _ranges(said)[0][2] == f"{1e3 * values[:, 0].min():.4g}"


@settings(max_examples=30)
@given(sizes=st.lists(st.integers(0, 700), min_size=1, max_size=10))
def test_an_excerpt_is_long_pieces_evenly_spread(sizes: list[int]) -> None:
    """Of a log of any length, in blocks of any size: whole pieces of 50 neighbours, at most 400 samples in all."""
    excerpt, total = Excerpt(most=400, piece=50), sum(sizes)
    start = 0
    for size in sizes:
        time = np.arange(start, start + size, dtype=float)
        excerpt.add(Recording(time, {FORCE: np.zeros((size, 3)), TORQUE: np.zeros((size, 3))}))
        start += size
    assert excerpt.count == total
    if total:
        kept = excerpt.recording().time
        expected = np.arange(total)
        assert np.array_equal(kept, expected[expected // 50 % excerpt.stride == 0])
        assert len(kept) <= 400
        assert excerpt.stride == 1 or len(kept) > 400 // 4


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
