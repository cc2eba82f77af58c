"""Damaged files end in a sentence or in a row for every sample: some as in the evidence, and what those found."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from claims.evidence.logs_written import WRENCH, session, write_csv
from claims.evidence.mcap_records import CHANNEL, MESSAGE, SCHEMA, counted, pack, unpack
from claims.evidence.mutated import KINDS, bench, try_one
from palpate.errors import InputError
from palpate.files.logs import read_recording

CASES = 6  # of each kind; `make claims ONLY=evidence.mutated` tries 10,000


@pytest.fixture(scope="module")
def good() -> Iterator[Path]:
    with bench() as folder:
        yield folder


@pytest.mark.parametrize("kind", KINDS)
def test_a_sentence_or_a_row_for_every_sample(kind: str, good: Path) -> None:
    outcomes = [try_one(kind, number) for number in range(10_000, 10_000 + CASES)]  # others than those of the evidence
    assert not [(outcome.number, outcome.command, outcome.fault) for outcome in outcomes if outcome.fault]


def test_numbers_that_no_sensor_gives_are_set_aside(tmp_path: Path) -> None:
    """Their sums and squares would overflow, which a warning would say."""
    log, path = session(50), tmp_path / "log.csv"
    write_csv(path, log)
    table = pl.read_csv(path)
    for row, (name, value) in enumerate((("time", np.inf), ("time", 1e300), ("x", 1e300), ("qx", -np.inf))):
        table[row, name] = value
    table.write_csv(path)
    recording = read_recording(path)
    assert np.flatnonzero(np.isnan(recording.time)).tolist() == [0, 1]
    assert np.flatnonzero(np.isnan(recording.channels["position"]).any(axis=1)).tolist() == [2]
    assert np.flatnonzero(np.isnan(recording.channels["orientation"]).any(axis=1)).tolist() == [3]
    assert "2 of 50 times are missing" in recording.notes
    assert "2 poses or accelerations are infinite or beyond 1e9 and were left out" in recording.notes


def test_rows_whose_ends_were_lost_are_no_header(tmp_path: Path) -> None:
    """It took minutes to name so many columns."""
    path = tmp_path / "log.csv"
    path.write_text("time,fx,fy,fz,tx,ty,tz\x0b" + "0,1,2,3,4,5,6\x0b" * 50_000)
    with pytest.raises(InputError, match=r"the first line has 300,007 fields.*Name"):
        read_recording(path)


def test_messages_before_what_declares_them_are_read(tmp_path: Path, good: Path) -> None:
    """The types at the end, and no index to look them up in."""
    records = unpack((good / "plain.mcap").read_bytes())[0]
    kinds = {kind: [record for record in records if record[0] == kind] for kind in (CHANNEL, MESSAGE, SCHEMA)}
    path = tmp_path / "log.mcap"
    path.write_bytes(pack([*kinds[CHANNEL][:2], *kinds[MESSAGE], *kinds[SCHEMA][:2]]))
    assert len(read_recording(path)) == len(read_recording(good / "plain.mcap")) == 300


def test_the_count_that_judges_is_that_of_the_mcap_library(good: Path) -> None:
    from mcap.reader import make_reader

    for name in ("plain", "stored", "lz4", "zstd", "touches"):
        path = good / f"{name}.mcap"
        with path.open("rb") as file:
            count = sum(1 for _ in make_reader(file).iter_messages(topics=["/ft_sensor/wrench"]))
        assert counted(path.read_bytes(), "/ft_sensor/wrench", ["geometry_msgs/WrenchStamped"]) == (count, count)
    assert counted((good / "plain.mcap").read_bytes(), WRENCH, ["geometry_msgs/WrenchStamped"]) == (0, 0)
