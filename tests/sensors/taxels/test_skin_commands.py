"""A user's way with a skin: calibrate, estimate, evaluate, from files that the bench wrote; wrong files are named."""

from pathlib import Path

import numpy as np
import pytest

from palpate.cli import main
from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ContactEstimate, Status
from palpate.errors import InputError
from palpate.files.contacts import read_contacts, write_contacts
from palpate.files.models import read_model, write_model
from palpate.sensors.taxels.intensity import Curve, Intensity
from palpate.sensors.taxels.section import SkinSection
from palpate.sensors.taxels.skin_map.files import read_skin_map
from palpate.setup import load_rig
from palpate_lab.simulation.skin_session import SkinSession
from tests.support.skin_session_files import estimated_skin_session


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, SkinSession]:
    folder = tmp_path_factory.mktemp("skin")
    return folder, estimated_skin_session(folder)


def test_touches_are_found_and_named(session: tuple[Path, SkinSession]) -> None:
    """To 1.2 mm: Hertz's patch two cells wide, noise of a count."""
    folder, made = session
    found = read_contacts(folder / "contacts.csv")
    assert len(np.unique(found.sample)) == len(made.frames)
    held = np.isfinite(found.features["row"])
    assert len(np.unique(found.identity[held])) == 6
    for start, end, point, force in zip(made.start, made.end, made.point, made.force, strict=True):
        rows = held & (found.time >= start) & (found.time <= end)
        off = np.median(found.estimate.point[rows], axis=0) - point
        assert np.linalg.norm(off) < 1.2e-3
        sizes = np.linalg.norm(found.estimate.force[rows], axis=1)
        assert np.median(sizes) == pytest.approx(np.linalg.norm(force), rel=0.1)
    assert read_model(folder / "intensity.toml", Intensity).numbers((6, 22)).max() == 132
    assert 'sensor = "skin"' in (folder / "contacts.csv.toml").read_text()


def test_what_cannot_be_meant_is_refused_with_a_sentence(
    session: tuple[Path, SkinSession], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, _ = session
    monkeypatch.chdir(folder)
    Path("other.toml").write_text('[skin]\nmap = "map.csv"\nrows = 5\n')
    Path("short.csv").write_text("time,c0,c1\n0,1,2\n")
    Path("flat.csv").write_text("force,intensity\n" + "1,5\n" * 20)
    for command, said in (
        (["estimate", "skin_log.csv", "--rig", "other.toml", "-o", "x.csv"], "states 5 x 22"),
        (["estimate", "short.csv", "--rig", "rig.toml", "-o", "x.csv"], "132 cells"),
        (["calibrate", "intensity", "flat.csv", "-o", "x.toml"], "same force"),
        (["calibrate", "intensity", "wrench.csv", "-o", "x.toml"], "no column 'force'"),
        (["calibrate", "intensity", "load_cell_log.csv", "-o", "x.toml", "--sheet", "6by22"], "be rows and columns"),
    ):
        assert main(command) == 1
        assert said in capsys.readouterr().err
    assert not Path("x.csv").exists()


def test_a_resistive_taxel_is_calibrated_as_a_divider(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    force = np.linspace(0.05, 8.0, 80)
    reading = 1024.0 * (1.0 - 10.0 / (2 * 20.0 / force + 0.5))
    rows = [f"{f},{r}" for f, r in zip(force.tolist(), reading.tolist(), strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["force,intensity", *rows]))
    command = ["calibrate", "intensity", f"{tmp_path}/log.csv", "-o", f"{tmp_path}/i.toml", "--kind", "resistive"]
    assert main(command) == 1
    assert "--scale" in capsys.readouterr().err
    assert main([*command, "--scale", "1024", "--reference", "10"]) == 0
    curve = read_model(tmp_path / "i.toml", Intensity).curves[0]
    np.testing.assert_allclose(curve.parameters, [20.0, 0.5], rtol=1e-3)
    assert curve.falling


def test_a_log_that_ends_within_a_row_is_read_to_there(
    session: tuple[Path, SkinSession], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, made = session
    text = (folder / "skin_log.csv").read_bytes()
    (folder / "torn.csv").write_bytes(text[:-100])
    code = main(["estimate", f"{folder}/torn.csv", "--rig", f"{folder}/rig.toml", "-o", f"{folder}/torn_out.csv"])
    assert code == 3
    assert "torn" in capsys.readouterr().out
    assert len(np.unique(read_contacts(folder / "torn_out.csv").sample)) == len(made.frames)


def test_the_deviation_of_a_taxel_that_saturates_is_of_forces_that_it_tells(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    force = np.linspace(0.0, 20.0, 400)
    reading = 7.0 + 40.0 * np.minimum(force, 5.0) + np.random.default_rng(1).standard_normal(400)
    rows = [f"{f},{r}" for f, r in zip(force.tolist(), reading.tolist(), strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["force,intensity", *rows]))
    command = ["calibrate", "intensity", f"{tmp_path}/log.csv", "-o", f"{tmp_path}/i.toml", "--kind", "polynomial"]
    assert main(command) == 0
    said = capsys.readouterr().out
    assert "readings there are saturated" in said
    assert float(said.split("by the fit, ")[1].split(" mN")[0]) < 100.0  # noise over slope is 25 mN
    assert main(["inspect", f"{tmp_path}/i.toml"]) == 0
    assert "polynomial of degree" in capsys.readouterr().out


def test_a_curve_whose_covariance_has_another_size_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "i.toml"
    write_model(path, Intensity((Curve("polynomial", np.array([10.0]), np.eye(1), 20.0),)))
    path.write_text(path.read_text().replace("parameters = [10.0]", "parameters = [10.0, 0.1]"))
    with pytest.raises(InputError, match=r"toml: .*covariance must be 2 x 2"):
        read_model(path, Intensity)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[skin]\nbits = 8\n", "skin: map, pitch or taxels is missing"),
        ("[skin]\nmap = 'm.csv'\nbits = 40\n", "skin: bits"),
        ("[skin]\nmap = 'm.csv'\n[contacts]\non = 2\noff = 3\n", "contacts: off"),
        ("[skin]\nmap = 'm.csv'\n[contacts]\nunequal = -0.1\n", "contacts: unequal"),
        ("[skin]\nmap = 'm.csv'\ncolums = 3\n", "columns"),
        ("[surface]\nkind = 'plane'\n", r"no \[skin\].*Add"),
    ],
)
def test_what_is_wrong_with_a_rig_is_said(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=said):
        load_rig(path).resolve().of(SkinSection)


def test_a_map_as_rows_of_cells_is_read_whatever_their_order(tmp_path: Path) -> None:
    rows = [f"{r},{c},{0.01 * c},{0.01 * r},0,0,0,1,1e-4" for r in (1, 0) for c in (2, 0, 1)]
    path = tmp_path / "map.csv"
    path.write_text("\n".join(["row,column,x,y,z,nx,ny,nz,area", *rows]))
    place = read_skin_map(path)
    assert (place.rows, place.columns) == (2, 3)
    np.testing.assert_allclose(place.centres[1, 2], [0.02, 0.01, 0.0])
    np.testing.assert_allclose(place.pitch, (0.01, 0.01))
    path.write_text("\n".join(["row,column,x,y,z,nx,ny,nz,area", *rows[1:]]))
    with pytest.raises(InputError, match=r"csv: has 5 rows, but needs one for each of 2 x 3"):
        read_skin_map(path)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mcap"])
def test_contacts_keep_their_cells_in_every_format(tmp_path: Path, suffix: str) -> None:
    rng = np.random.default_rng(1)
    values = [rng.standard_normal((5, 3)) for _ in range(3)]
    covariance = np.tile(np.eye(3) * 1e-6, (5, 1, 1))
    found = ContactEstimate(
        *values, np.full(5, np.nan), covariance, np.zeros(5), np.ones(5, np.int64), np.full(5, Status.CONTACT, np.int8)
    )
    names = ("row", "column", "area")
    cell = rng.random((3, 5))
    cell[:, 3] = np.nan
    sample, identity = np.array([0, 0, 1, 2, 2]), np.array([3, 4, 3, 0, 5])
    written = Contacts(sample, np.arange(5.0), identity, found, dict(zip(names, cell, strict=True)))
    write_contacts(tmp_path / f"contacts{suffix}", written)
    read = read_contacts(tmp_path / f"contacts{suffix}")
    assert tuple(read.features) == names
    for name, values in zip(names, cell, strict=True):
        np.testing.assert_array_equal(read.features[name], values)
    assert read.identity.tolist() == identity.tolist()
    assert read.sample.tolist() == sample.tolist()
