"""The rig's table of load cells, and what it says beyond their model."""

from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.files.models import write_model
from palpate.sensors.load_cells.resolution import nominal_cells
from palpate.sensors.load_cells.section import LoadCellSection
from palpate.setup import check_rig
from palpate_lab.simulation.cell_array import LAYOUTS

SURFACE = {"kind": "elliptic_cylinder", "a": 0.014, "b": 0.005, "half_length": 0.016}


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"columns": ["a", "b"]}, "load_cells: .*three for each of at least three cells"),
        ({"columns": ["a"] * 9}, "load_cells: .*named twice"),
        ({"units": "kV"}, "load_cells: .*'kV' is not one of V, mV, uV"),
        ({"noise": -1.0}, "load_cells: noise must be positive"),
        ({"colums": ["a"]}, "unknown key 'colums'.*Did"),
        ({"reference": ["fx"]}, "load_cells: reference must be"),
    ],
)
def test_a_table_that_cannot_be_meant_is_refused(table: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        check_rig({"surface": SURFACE, "load_cells": table}, Path("rig.toml"))


def test_the_rig_says_more_than_the_model(tmp_path: Path) -> None:
    write_model(tmp_path / "tip.toml", nominal_cells(LAYOUTS[4], 10.0, 1e-4))
    table = {"model": "tip.toml", "range": 2.0, "drift": 1e-3, "noise": 2e-4, "without": [2]}
    rig = check_rig({"surface": SURFACE, "load_cells": table}, tmp_path / "rig.toml")
    cells = rig.resolve().of(LoadCellSection).cells
    assert np.all(np.abs(cells.limits) == 2.0)
    np.testing.assert_allclose(np.diag(cells.noise), 4e-8)
    (voltage,) = rig.layout().arrays
    assert voltage.shape == (12,)
    assert voltage.columns is not None
    assert voltage.columns[:4] == ("u1x", "u1y", "u1z", "u2x")


def test_a_rig_without_a_model_says_what_to_do() -> None:
    rig = check_rig({"surface": SURFACE, "load_cells": {}}, Path("rig.toml"))
    with pytest.raises(InputError, match="palpate calibrate load-cells"):
        _ = rig.resolve().of(LoadCellSection).cells
    with pytest.raises(InputError, match=r"positions, sensitivity and noise.*Write"):
        rig.resolve().of(LoadCellSection).nominal()
    places = [[float(x) for x in place] for place in LAYOUTS[4]]
    table = {"positions": places, "sensitivity": 10.0, "noise": 1e-4}
    rig = check_rig({"surface": SURFACE, "load_cells": table}, Path("rig.toml"))
    nominal = rig.resolve().of(LoadCellSection).nominal()
    down = nominal.matrix @ [0.0, 0.0, -1.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(down[2::3], -0.25 / 10.0)  # four alike, around the middle, share a push alike
    with pytest.raises(InputError, match=r"no \[load_cells.*Add"):
        check_rig({"surface": SURFACE}, Path("rig.toml")).resolve().of(LoadCellSection)
