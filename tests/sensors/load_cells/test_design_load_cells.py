"""`palpate design load-cells`: a page from a rig alone, with figures that are those of the closed forms."""

import re
from pathlib import Path

import numpy as np
import pytest

from palpate.cli import main
from palpate.sensors.load_cells.design_report import Design, compose, tiles, warnings
from palpate.sensors.load_cells.model import LoadCells
from palpate.sensors.load_cells.resolution import nominal_cells
from palpate.surfaces import EllipticCylinder, Sphere
from palpate_lab.simulation.cell_array import LAYOUTS

TIP = EllipticCylinder(a=14e-3, b=5e-3, half_length=16e-3, upper=True)
SURFACE = """[surface]
kind = "elliptic_cylinder"
a = 0.014
b = 0.005
half_length = 0.016
upper = true
"""
PLACES = "[[-0.0065, -0.0105, -0.0035], [0.0065, -0.0105, -0.0035], [0.0, 0.0105, -0.0035]]"
CELLS = f"""
[load_cells]
positions = {PLACES}
sensitivity = 10.0
noise = 1e-4
range = 0.5
"""


def _rig(folder: Path, text: str = SURFACE + CELLS) -> Path:
    (folder / "rig.toml").write_text(text, encoding="utf-8")
    return folder / "rig.toml"


def test_a_rig_becomes_a_page_with_maps(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "design.html"
    assert main(["design", "load-cells", str(_rig(tmp_path)), "-o", str(page)]) == 0
    said, text = capsys.readouterr().out, page.read_text(encoding="utf-8")
    assert re.search(r"smallest force +\d+(\.\d+)? mN for 2 mm", said)
    assert text.count("<svg") == 5  # place, smallest force, torque, largest force; and over the force
    for words in ("What rig.toml can resolve", "cell 2 dead", "The same everywhere: ", "25 % nearer", "half the noise"):
        assert words in text
    assert "://" not in re.sub(r'xmlns(:\w+)?="[^"]*"', "", text)


def test_more_accuracy_takes_more_force() -> None:
    """Without a calibration to doubt, in proportion."""
    drawn = nominal_cells(LAYOUTS[4], 10.0, 1e-4)
    found = [next(iter(tiles(Design("rig", drawn, TIP, accuracy)))) for accuracy in (2e-3, 1e-3)]
    least = [float(tile.value.removesuffix(" mN")) for tile in found]
    assert least[1] == pytest.approx(2 * least[0], rel=0.01)  # of three digits


def test_above_the_middle_without_friction_the_figures_are_closed_forms() -> None:
    """Equal cells: a push at the top errs by the moments' noise, s sqrt(sum y^2) and s sqrt(sum x^2), and by the lever.

    With h the height above the cells, the place across errs by (s_M + h s_F)/F along each axis, as the moment about the
    cells' plane is h F_x.
    """
    spread, force, height = 1e-3, 1.0, 8.5e-3  # N a cell; N; m
    design = Design("rig", nominal_cells(LAYOUTS[4], 10.0, 1e-4), TIP, force=force, friction=0.0, tared=1e12)
    points, _, _ = design.places
    top = int(np.argmin(np.linalg.norm(points - [0, 0, 5e-3], axis=1)))
    assert np.linalg.norm(points[top] - [0, 0, 5e-3]) < 1e-3
    x, y = (np.sqrt(np.sum(LAYOUTS[4][:, axis] ** 2)) for axis in (0, 1))
    expected = spread / force * np.sqrt(x**2 + y**2 + 2 * (2 * height) ** 2)
    assert design.found.position(force)[top] == pytest.approx(expected, rel=0.01)  # as near to the top as a corner is
    assert design.found.force[top] == pytest.approx(spread * np.sqrt(3 * 4))


def test_a_closed_body_is_seen_from_the_side_away_from_the_cells() -> None:
    design = Design("rig", nominal_cells(LAYOUTS[4], 10.0, 1e-4), Sphere(radius=8e-3))
    assert design.view == (2, 1.0)
    points, normals, _ = design.places
    assert np.all(points[design.seen, 2] > 0)
    assert np.isnan(design.found.noise[normals[:, 2] < 0]).all()


def test_a_calibration_that_is_not_sure_enough_is_warned_of() -> None:
    drawn = nominal_cells(LAYOUTS[4], 10.0, 1e-4)
    unsure = LoadCells(drawn.matrix, drawn.noise, positions=drawn.positions, covariance=0.05**2 * np.eye(36), samples=9)
    design = Design("rig", unsure, TIP, accuracy=1e-4)
    assert any("no force is located within 0.1 mm" in words for words in warnings(design))
    assert next(iter(tiles(design))).value == "none"
    assert any("calibrated" in value for _, value in compose(design).sections[-1].settings)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (SURFACE, "load cells"),
        (SURFACE + CELLS.replace("sensitivity = 10.0\n", ""), "sensitivity"),
        (SURFACE + CELLS.replace(PLACES, "[[0, -0.01, 0], [0, 0, 0], [0, 0.01, 0]]"), "in line"),
        (SURFACE + CELLS.replace("range = 0.5", "range = -0.5"), "range"),
    ],
)
def test_what_cannot_be_designed_is_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, words: str
) -> None:
    page = tmp_path / "design.html"
    assert main(["design", "load-cells", str(_rig(tmp_path, text)), "-o", str(page)]) != 0
    said = capsys.readouterr().err
    assert words in said
    assert "Traceback" not in said
    assert not page.exists()


def test_options_that_mean_nothing_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, value in (("accuracy", "0"), ("force", "-1"), ("tared", "nan"), ("friction", "-0.1")):
        call = ["design", "load-cells", str(_rig(tmp_path)), "-o", str(tmp_path / "d.html"), f"--{name}", value]
        assert main(call) != 0
        assert f"--{name}" in capsys.readouterr().err
