"""What a COLLADA file states of itself, its unit and its up axis, is used once, and never contradicted in silence."""

from pathlib import Path

import numpy as np
import pytest

from palpate import InputError, Mesh
from palpate.cli import main
from palpate.setup import load_rig
from tests.support.collada import CORNERS, write_collada

LENGTHS = {"0.0254": 0.0254, "1": 1.0, "0.001": 1e-3, "1e-3": 1e-3, "0.3048": 0.3048}
TURNED = {  # up axis -> where the file's x, y and z axes point with z up, by the COLLADA specification 1.4.1
    None: ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "Z_UP": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "Y_UP": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "X_UP": ((0, 0, 1), (-1, 0, 0), (0, -1, 0)),
}
LOG = "time,fx,fy,fz,tx,ty,tz\n" + "\n".join(f"{k / 10},{k % 3},1,2,0.1,0.2,0.{k % 7}" for k in range(60))


def _corners(mesh: Mesh) -> np.ndarray:
    return np.unique(mesh.vertices.round(12) + 0.0, axis=0)


@pytest.mark.parametrize("meter", LENGTHS)
@pytest.mark.parametrize("up", TURNED)
def test_vertices_are_in_metres_with_z_up(tmp_path: Path, meter: str, up: str | None) -> None:
    mesh = Mesh.load(write_collada(tmp_path / "a.dae", meter, up))
    expected = LENGTHS[meter] * np.array(CORNERS) @ np.array(TURNED[up], dtype=np.float64)
    assert np.allclose(_corners(mesh), np.unique(expected + 0.0, axis=0), atol=1e-7)
    outward = np.einsum("fk,fk->f", mesh.normals, mesh.vertices[mesh.faces].mean(axis=1) - mesh.vertices.mean(axis=0))
    assert (outward > 0).all()
    assert any("turned so that z points up" in note for note in mesh.notes) == (up in ("X_UP", "Y_UP"))


def test_a_unit_that_is_given_must_be_the_files_own(tmp_path: Path) -> None:
    file = write_collada(tmp_path / "a.dae", "0.0254")
    assert Mesh.load(file, "in").size == pytest.approx(0.0254 * 14**0.5)
    with pytest.raises(InputError, match=r"given as 'mm', but the file states its own, 'in'\. Leave the unit out"):
        Mesh.load(file, "mm")


def test_a_file_without_a_unit_needs_one(tmp_path: Path) -> None:
    file = write_collada(tmp_path / "a.dae")
    with pytest.raises(InputError, match=r"unit of the mesh's numbers is not given.*Write"):
        Mesh.load(file)
    assert Mesh.load(file, "cm").size == pytest.approx(0.01 * 14**0.5)


@pytest.mark.parametrize(
    ("meter", "up", "word"),
    [
        ("0", None, "not a positive number.*Correct"),
        ("mm", None, "'mm' metres.*Correct"),
        ("1", "UP", "states <up_axis> 'UP'.*Write"),
    ],
)
def test_a_statement_that_means_nothing_is_refused(tmp_path: Path, meter: str, up: str | None, word: str) -> None:
    with pytest.raises(InputError, match=word):
        Mesh.load(write_collada(tmp_path / "a.dae", meter, up))


def test_a_new_rig_and_inspect_state_the_files_unit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = write_collada(tmp_path / "a.dae", "0.0254", "Y_UP")
    (tmp_path / "log.csv").write_text(LOG, "utf-8")
    assert main(["inspect", str(file)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "unit in, as the file states" in said
    assert "size 95.04 mm across" in said
    assert main(["rig", "new", str(tmp_path / "log.csv"), str(file), "-o", str(tmp_path / "rig.toml")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "states its unit, 'in', which makes it 95.04 mm across" in said
    assert "turned so that z points up" in said
    assert "unit =" not in (tmp_path / "rig.toml").read_text().split("[time]")[0]
    size = load_rig(tmp_path / "rig.toml").resolve().link.surface().size
    assert size == pytest.approx(0.0254 * 14**0.5, rel=1e-6)


def test_an_estimate_needs_no_unit_of_such_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "log.csv").write_text(LOG, "utf-8")
    options = ["-o", str(tmp_path / "found.csv"), "--noise", "0.02", "0.001"]
    stated = write_collada(tmp_path / "a.dae", "0.0254")
    assert main(["estimate", str(tmp_path / "log.csv"), "--mesh", str(stated), *options]) in (0, 4)
    assert main(["estimate", str(tmp_path / "log.csv"), "--mesh", str(stated), "--unit", "mm", *options]) == 1
    assert "given as 'mm', but the file states its own, 'in'. Leave" in "".join(capsys.readouterr())
    bare = write_collada(tmp_path / "b.dae")
    assert main(["estimate", str(tmp_path / "log.csv"), "--mesh", str(bare), *options]) == 1
    assert "--unit mm" in "".join(capsys.readouterr())
