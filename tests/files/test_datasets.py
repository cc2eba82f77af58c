"""Data sets of LeRobot: contacts as columns, and columns that bear the names that the features state."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from claims.evidence.datasets_written import NAMES, write_dataset
from palpate.contact.estimate import Status
from palpate.contact.table import from_frame, schema
from palpate.errors import InputError
from palpate.files.datasets import columns
from palpate.files.datasets.dataset import read_dataset
from palpate.files.datasets.named import write_named


def test_a_row_has_its_largest_contact() -> None:
    """Of two contacts at once, the first one and the second one is larger; two are found and not answered."""
    one = {"time": 0.0, "contact": 1, "status": "contact", "candidates": 1, "px": 1.0, "py": 0.0, "pz": 0.0}
    one |= dict.fromkeys(("fx", "fy"), 0.0) | dict.fromkeys(("var_xy", "var_xz", "var_yz"), 0.5)
    forces = [(0, 1.0), (0, 3.0), (1, 0.5), (1, 0.2)]
    rows = [{**one, "sample": sample, "fz": force, "px": force} for sample, force in forces]
    rows += [{**one, "sample": sample, "fz": 9.0, "status": "off_surface"} for sample in (1, 2)]
    contacts = from_frame(pl.DataFrame(rows, schema=schema()))
    made = columns.contact_columns(contacts, 3, "contacts.csv")
    assert made["count"].tolist() == [[2], [2], [0]]
    assert made["status"].tolist() == [[0], [0], [Status.OFF_SURFACE]]
    assert made["force"].tolist() == [[0, 0, 3], [0, 0, 0.5], [0, 0, 0]]
    assert made["point"].tolist() == [[3, 0, 0], [0.5, 0, 0], [0, 0, 0]]
    assert made["covariance"].shape == (3, 6)
    lost = columns.statistics({"point": np.array([[1.0], [np.nan], [3.0]])})[f"{columns.PREFIX}point"]
    assert (lost["mean"].tolist(), lost["count"].tolist()) == ([2.0], [3])
    for count, numbers in ((4, contacts.sample), (3, contacts.sample + 1)):
        with pytest.raises(InputError, match=rf"contacts\.csv: holds contacts of 3 samples.*episode has {count} rows"):
            columns.contact_columns(replace(contacts, sample=numbers), count, "contacts.csv")


def test_the_first_episode_has_a_column_for_each_name(tmp_path: Path) -> None:
    write_dataset(tmp_path, "v3.0", episodes=2)
    data = read_dataset(tmp_path)
    made = write_named(data, tmp_path / "named.parquet")
    named, rows = (pl.read_parquet(tmp_path / name) for name in ("named.parquet", data.episodes[0].file))
    lists = {"observation.state": NAMES, "action": NAMES[:2]}
    assert made == {f"{of}.{name}": f"{of}[{k}]" for of, names in lists.items() for k, name in enumerate(names)}
    assert set(named.columns) == {*rows.columns, *made} - lists.keys()
    for of, names in lists.items():
        np.testing.assert_array_equal(named[[f"{of}.{name}" for name in names]].to_numpy(), rows[of].to_numpy()[:60])
