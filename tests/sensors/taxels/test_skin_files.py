"""Files of a skin: rigs that say what is wrong, maps by rows, contacts with their cells."""

from pathlib import Path

import numpy as np
import pytest

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ContactEstimate, Status
from palpate.errors import InputError
from palpate.files.contacts import read_contacts, write_contacts
from palpate.files.models import read_model, write_model
from palpate.sensors.taxels.intensity import Curve, Intensity
from palpate.sensors.taxels.section import SkinSection
from palpate.sensors.taxels.skin_map.files import read_skin_map
from palpate.setup import load_rig


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
