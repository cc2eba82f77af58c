"""Write the first episode of a data set as a table whose columns bear the names that the features state."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import polars as pl

from palpate.files.datasets.dataset import Dataset
from palpate.files.logs.parquet import reading_parquet, scan_rows


def write_named(data: Dataset, path: Path) -> dict[str, str]:
    """Write the first episode, each list of named numbers as a column a name; return column -> its name in the data.

    Raises:
        InputError: the rows cannot be read.
    """
    first = data.episodes[0]
    data.require_rows(first)
    with reading_parquet(data.root / first.file):
        rows = scan_rows(data.root / first.file, first.index).collect()
    made = dict[str, str]()
    for name, names in _named(data):
        if isinstance(rows.schema.get(name), pl.List | pl.Array):
            values = pl.col(name).cast(pl.List(pl.Float64)).list
            rows = rows.with_columns(values.get(k).alias(f"{name}.{each}") for k, each in enumerate(names)).drop(name)
            made |= {f"{name}.{each}": f"{name}[{k}]" for k, each in enumerate(names)}
    rows.write_parquet(path)
    return made


def _named(data: Dataset) -> Iterator[tuple[str, list[str]]]:
    """Yield the features of one axis with a name for each number, and these names."""
    for name, feature in data.features.items():
        names: Any = feature.get("names")
        if isinstance(names, dict):  # {"motors": [...]}
            names = next(iter(cast("dict[str, Any]", names).values()), None)
        texts = [str(each) for each in cast("list[object]", names)] if isinstance(names, list) else []
        if len(texts) > 1 and [len(set(texts))] == feature.get("shape"):
            yield name, texts
