"""Convert dates and times of day from text to seconds."""

from __future__ import annotations

import polars as pl

_DATE = r"(?:(?P<year>\d{4})[-/.](?P<month>\d\d)[-/.](?P<day>\d\d)[T ]|(?P<d>\d\d)\.(?P<m>\d\d)\.(?P<y>\d{4})[T ])?"
_CLOCK = r"(?P<hour>\d{1,2}):(?P<minute>\d\d):(?P<second>\d\d(?:[.,:]\d+)?)\s?(?P<half>[AaPp][Mm])?"
_ZONE = r"(?:Z|(?P<east>[-+])(?P<zh>\d\d):?(?P<zm>\d\d))?"
_STAMP = f"^{_DATE}{_CLOCK}{_ZONE}$"


def seconds(text: pl.Series) -> pl.Series:
    """Return stamps as seconds since 1970, or since midnight without a date; null where a text is no stamp.

    Read are ISO 8601 and looser forms, `31.12.2025 12:34:56,789`, `12:34:56.789` and `3:04:05 PM`; no dates whose day
    and month could be exchanged.
    """
    parts = text.to_frame("text").select(pl.col("text").str.extract_groups(_STAMP).alias("p")).unnest("p")
    number = {name: pl.col(name).cast(pl.Float64) for name in ("hour", "minute", "zh", "zm")}
    date = (pl.coalesce(long, short).cast(pl.Int32) for long, short in (("year", "y"), ("month", "m"), ("day", "d")))
    days = pl.date(*date).dt.epoch("d").cast(pl.Float64).fill_null(0.0)
    second = pl.col("second").str.replace("[,:]", ".").cast(pl.Float64)
    noon = pl.when(pl.col("half").str.to_lowercase() == "pm").then(12.0).otherwise(0.0)
    hour = pl.when(pl.col("half").is_null()).then(number["hour"]).otherwise(number["hour"] % 12.0 + noon)
    east = pl.when(pl.col("east") == "-").then(-1.0).otherwise(1.0)
    zone = (east * (3600.0 * number["zh"] + 60.0 * number["zm"])).fill_null(0.0)
    whole = 86400.0 * days + 3600.0 * hour + 60.0 * number["minute"] - zone
    return parts.select((whole + second).alias("seconds")).to_series()
