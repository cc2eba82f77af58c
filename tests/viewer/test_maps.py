"""Maps over a surface: where values are, they are coloured; where none are, nothing is."""

import numpy as np
import pytest

from palpate.surfaces import EllipticCylinder
from palpate.viewer._style import inline, styled
from palpate.viewer.maps import error_over_force, surface_map

MESH = EllipticCylinder(a=14e-3, b=5e-3, half_length=16e-3, upper=True).mesh(200)
CELLS = np.array([[-6e-3, -10e-3, 0.0], [6e-3, 10e-3, 0.0], [np.nan] * 3])


def test_a_map_has_its_unit_axes_in_mm_and_the_cells_that_are_known() -> None:
    text = inline(surface_map(MESH.vertices, MESH.faces, MESH.vertices[:, 1], "error [mm]", cells=CELLS))
    assert "error [mm]" in text
    assert ">x [mm]<" in text
    assert ">y [mm]<" in text
    assert ">1<" in text
    assert ">2<" in text


@pytest.mark.parametrize("value", [0.0, 3.0])
def test_a_value_that_is_the_same_everywhere_is_one_colour(value: float) -> None:
    drawn = surface_map(MESH.vertices, MESH.faces, np.full(len(MESH.vertices), value), "x [m]")
    assert drawn.axes


def test_nothing_is_drawn_where_nothing_is_known() -> None:
    half = np.where(MESH.vertices[:, 1] > 0, 1.0 + MESH.vertices[:, 0], np.nan)
    filled = surface_map(MESH.vertices, MESH.faces, half, "x [m]").axes[0].collections[0]
    assert min(path.vertices[:, 1].min() for path in filled.get_paths() if len(path.vertices)) >= 0.0
    assert surface_map(MESH.vertices, MESH.faces, np.full(len(half), np.nan), "x [m]").axes


def test_seen_from_below_left_and_right_change_places() -> None:
    drawn = surface_map(MESH.vertices, MESH.faces, MESH.vertices[:, 0], "x [m]", view=(2, -1.0))
    left, right = drawn.axes[0].get_xlim()
    assert left > right


def test_curves_are_named_and_the_wanted_accuracy_is_marked() -> None:
    force = np.geomspace(0.01, 10, 20)
    with styled():
        drawn = error_over_force(force, {"best": 1e-5 / force, "worst": 3e-5 / force}, 2e-3)
    text = inline(drawn)
    assert all(words in text for words in ("best", "worst", "wanted", "force [N]"))
