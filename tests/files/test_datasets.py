"""Data sets of LeRobot: contacts as columns with their statistics, and columns that bear the names of the features."""

from __future__ import annotations

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
    """Of two contacts at once, the first one and the second one is larger; one is found and not answered."""
    one = {"time": 0.0, "contact": 1, "status": "contact", "candidates": 1, "px": 1.0, "py": 0.0, "pz": 0.0}
    one |= dict.fromkeys(("fx", "fy"), 0.0) | dict.fromkeys(("var_xy", "var_xz", "var_yz"), 0.5)
    forces = [(0, 1.0), (0, 3.0), (1, 2.0), (1, 1.0)]
    rows = [{**one, "sample": sample, "fz": force, "px": force} for sample, force in forces]
    rows += [{**one, "sample": 2, "fz": 9.0, "status": "off_surface"}]
    contacts = from_frame(pl.DataFrame(rows, schema=schema()))
    made = columns.contact_columns(contacts, 3, "contacts.csv")
    assert made["count"].tolist() == [[2], [2], [0]]
    assert made["status"].tolist() == [[0], [0], [Status.OFF_SURFACE]]
    assert made["force"].tolist() == [[0, 0, 3], [0, 0, 2], [0, 0, 0]]
    assert made["point"].tolist() == [[3, 0, 0], [2, 0, 0], [0, 0, 0]]
    assert made["covariance"].shape == (3, 6)
    for count, numbers in ((4, contacts.sample), (3, contacts.sample + 1)):
        with pytest.raises(InputError, match=rf"contacts\.csv: holds contacts of 3 samples.*episode has {count} rows"):
            columns.contact_columns(replace(contacts, sample=numbers), count, "contacts.csv")


def test_statistics_of_all_rows_are_those_of_the_parts_together() -> None:
    """Of the rows that are known, but for the count; quantiles are means, weighted by the rows of each part."""
    values = np.random.default_rng(5).normal(size=(30, 2))
    parts = np.split(values, [7, 18])
    made = columns.joined([columns.statistics({"point": part}) for part in parts])[f"{columns.PREFIX}point"]
    for name in ("min", "max", "mean", "std"):
        np.testing.assert_allclose(made[name], getattr(values, name)(axis=0))
    assert made["count"].tolist() == [30]
    for name, share in (("q01", 0.01), ("q90", 0.9)):
        expected = sum(len(part) * np.quantile(part, share, axis=0) for part in parts) / 30
        np.testing.assert_allclose(made[name], expected)
    lost = columns.statistics({"point": np.array([[1.0], [np.nan], [3.0]])})[f"{columns.PREFIX}point"]
    assert (lost["mean"].tolist(), lost["count"].tolist()) == ([2.0], [3])


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_the_first_episode_has_a_column_for_each_name(version: str, tmp_path: Path) -> None:
    write_dataset(tmp_path / "data_set", version, episodes=2)
    data = read_dataset(tmp_path / "data_set")
    made = write_named(data, tmp_path / "named.parquet")
    first = pl.read_parquet(data.root / data.episodes[0].file).filter(pl.col("episode_index") == 0)
    named = pl.read_parquet(tmp_path / "named.parquet")
    lists = {"observation.state": NAMES, "action": NAMES[:2]}
    known = {f"{list_}.{name}": (list_, k) for list_, names in lists.items() for k, name in enumerate(names)}
    assert made == {name: f"{list_}[{k}]" for name, (list_, k) in known.items()}
    assert set(named.columns) == {*first.columns, *made} - lists.keys()
    for name, (list_, k) in known.items():
        np.testing.assert_array_equal(named[name], np.array(first[list_].to_list())[:, k])
