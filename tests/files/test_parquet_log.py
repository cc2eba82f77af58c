"""A Parquet log: columns of any numbers, null is no number, and a file that is not whole is refused."""

import os
from pathlib import Path
from unittest import mock

import numpy as np
import polars as pl
import pytest

from claims.evidence.logs_written import session, write_parquet
from palpate.errors import InputError
from palpate.files.logs import contents, open_log, parquet, read_recording
from palpate.files.logs.layout import LogLayout

DAMAGED = Path(__file__).parents[2] / "fuzz/corpus/parquet"
NAMES = ("time", "fx", "fy", "fz", "tx", "ty", "tz")


def _frame(**columns: object) -> pl.DataFrame:
    return pl.DataFrame({name: [1, 2, 3] for name in NAMES} | columns)


def test_numbers_of_every_kind_are_numbers(tmp_path: Path) -> None:
    kinds = [pl.Int8, pl.UInt16, pl.Int64, pl.Float32, pl.Float64, pl.Decimal(10, 2), pl.UInt64]
    _frame().cast(dict(zip(NAMES, kinds, strict=True))).write_parquet(tmp_path / "log.parquet")
    recording = read_recording(tmp_path / "log.parquet")
    assert recording.time.tolist() == [1, 2, 3]
    assert recording.wrenches().tolist() == [[1] * 6, [2] * 6, [3] * 6]


def test_null_is_nan_and_said(tmp_path: Path) -> None:
    _frame(fx=[1, None, 3], tz=[None, None, float("nan")]).write_parquet(tmp_path / "log.parquet")
    recording = read_recording(tmp_path / "log.parquet")
    assert np.isnan(recording.wrenches()[:, 0]).tolist() == [False, True, False]
    assert recording.notes == ("3 of 3 rows have a field that is missing or not a number (first: row 1)",)


def test_a_time_in_nanoseconds_is_the_nearest_double(tmp_path: Path) -> None:
    _frame(time=[0, 235_000_000, 1_000_000_001]).write_parquet(tmp_path / "log.parquet")
    assert read_recording(tmp_path / "log.parquet", LogLayout(time_unit="ns")).time.tolist() == [0, 0.235, 1.000000001]


@pytest.mark.parametrize(
    ("frame", "word"),
    [
        (_frame().drop("tz"), "no column 'tz'.*Available"),
        (_frame().rename({"fx": "Fx"}), "'fx'.*Did you mean 'Fx'"),
        (_frame(fx=["a", "b", "c"]), "parquet: column 'fx' holds String, not numbers"),
        (_frame().clear(), "parquet: .*columns, but no rows"),
    ],
)
def test_columns_that_cannot_be_used_are_named(tmp_path: Path, frame: pl.DataFrame, word: str) -> None:
    frame.write_parquet(tmp_path / "log.parquet")
    with pytest.raises(InputError, match=word):
        read_recording(tmp_path / "log.parquet")


def test_a_file_that_was_cut_is_refused_wherever(tmp_path: Path) -> None:
    write_parquet(tmp_path / "whole.parquet", session(200))
    whole = (tmp_path / "whole.parquet").read_bytes()
    for kept in (4, 5, 100, len(whole) // 2, len(whole) - 1):
        (tmp_path / "log.parquet").write_bytes(whole[:kept])
        with pytest.raises(InputError, match=r"cannot be read as Parquet.*Copy"):
            list(open_log(tmp_path / "log.parquet").blocks())


@pytest.mark.parametrize("kept", ["run_length", "panic"])
def test_pages_that_abort_the_reader_are_a_sentence_of_their_own(
    kept: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The first ends the process of polars, the second makes it panic; the next files are read, though it is killed."""
    with pytest.raises(InputError, match=r"cannot be read as Parquet.*its pages are damaged.*Copy"):
        contents(DAMAGED / kept)
    assert capfd.readouterr().err == ""
    for name in ("first", "second"):
        _frame().write_parquet(tmp_path / name)
        parquet.require_pages(tmp_path / name)
        parquet._prober(os.getpid()).kill()


def test_the_answer_to_a_file_that_was_interrupted_is_not_that_to_the_next(tmp_path: Path) -> None:
    _frame().write_parquet(tmp_path / "whole.parquet")
    process = parquet._prober(os.getpid())
    process.stdout = mock.Mock(wraps=process.stdout, closed=False, readline=mock.Mock(side_effect=KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        parquet.require_pages(tmp_path / "whole.parquet")
    parquet._decodable.cache_clear()
    with pytest.raises(InputError, match=r"its pages are damaged.*Copy"):
        contents(DAMAGED / "run_length")


def test_a_file_whose_bytes_were_changed_is_no_traceback(tmp_path: Path) -> None:
    write_parquet(tmp_path / "whole.parquet", session(50))
    whole = bytearray((tmp_path / "whole.parquet").read_bytes())
    rng = np.random.default_rng(0)
    for _ in range(15):
        changed = whole.copy()
        for at in rng.integers(4, len(whole), 3):
            changed[at] = rng.integers(256)
        (tmp_path / "log.parquet").write_bytes(changed)
        try:
            recording = read_recording(tmp_path / "log.parquet")
        except InputError:
            continue
        assert len(recording) == 50


def test_dates_with_a_time_are_seconds_since_1970(tmp_path: Path) -> None:
    """As pandas writes them; 1,760,000,000.25 s is a double."""
    stamps = pl.Series([1_760_000_000_250_000_000, 1_760_000_001_000_000_000, None]).cast(pl.Datetime("ns"))
    _frame(time=stamps).write_parquet(tmp_path / "log.parquet")
    time = read_recording(tmp_path / "log.parquet").time
    assert time[:2].tolist() == [1_760_000_000.25, 1_760_000_001.0]
    assert np.isnan(time[2])
