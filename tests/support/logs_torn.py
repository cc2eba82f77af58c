"""A log that begins well and cannot be read to its end."""

from pathlib import Path

import numpy as np
import polars as pl


def torn_pages(csv: Path, path: Path) -> Path:
    """The rows of a CSV over and over as Parquet, its middle overwritten."""
    rows = pl.read_csv(csv)
    span = float(np.ptp(rows["time"].to_numpy())) + 1
    pl.concat([rows.with_columns(pl.col("time") + span * k) for k in range(30)]).write_parquet(
        path, row_group_size=5000
    )
    raw = path.read_bytes()
    third = len(raw) // 3
    path.write_bytes(raw[:third] + b"\xff" * third + raw[2 * third :])
    return path
