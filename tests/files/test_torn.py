"""A file that was cut anywhere gives every whole message before the cut, none that was not there, and says so."""

from collections.abc import Callable
from pathlib import Path
from struct import pack

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader
from mcap.writer import CompressionType

from claims.evidence.logs_written import STAMPED, WRENCH, session, wrench_stamped, write_mcap
from claims.evidence.torn import PACKED, cut, read
from palpate.files.logs import open_log, read_recording
from palpate.files.mcap.chunks import inflate

CUTS = 100  # of each format: 400 in all; `make claims ONLY=evidence.torn` tries 3,000


@pytest.mark.parametrize("name", PACKED)
def test_every_whole_message_before_a_cut_is_there(tmp_path: Path, name: str) -> None:
    cuts = cut(tmp_path, session(60), name, CUTS)
    assert (cuts.lost, cuts.invented, cuts.silent) == (0, 0, 0)
    assert sum(cuts.found) > 0


@pytest.mark.parametrize("compression", [CompressionType.LZ4, CompressionType.ZSTD])
def test_a_packed_chunk_that_was_cut_gives_what_can_be_unpacked(tmp_path: Path, compression: CompressionType) -> None:
    """Blocks of lz4 are 64 KiB here and those of zstd at most 128 KiB: of 500 KiB half is more than one block."""
    log, path = session(5000), tmp_path / "log.mcap"
    messages = ((stamp, WRENCH, wrench_stamped(stamp, log.wrench[k])) for k, stamp in enumerate(log.stamp.tolist()))
    write_mcap(path, messages, {WRENCH: STAMPED[WRENCH]}, compression=compression, chunk_size=1 << 20)
    whole = path.read_bytes()
    counts: list[int] = []
    for share in (0.1, 0.4, 0.7):
        path.write_bytes(whole[: int(share * len(whole))])
        wrenches, said = read(path)
        assert np.array_equal(wrenches, log.wrench[: len(wrenches)])
        assert "it ends within a chunk" in said
        counts.append(len(wrenches))
    assert counts[0] < counts[1] < counts[2] < 5000
    assert counts[1] > 1000


@pytest.mark.parametrize(("name", "compress"), [(b"lz4", lz4.frame.compress), (b"zstd", zstandard.compress)])
def test_of_a_chunk_no_more_is_unpacked_than_it_states(name: bytes, compress: Callable[[bytes], bytes]) -> None:
    packed = compress(bytes(1 << 20))
    content = pack("<QQQII", 0, 0, 10, 0, len(name)) + name + pack("<Q", len(packed)) + packed
    assert inflate(memoryview(content)) == (bytes(10), "")


@pytest.mark.parametrize("name", PACKED)
def test_changed_bytes_are_no_traceback_and_no_more_rows(tmp_path: Path, name: str) -> None:
    log, path = session(60), tmp_path / "log.mcap"
    write_mcap(path, log.messages(), **PACKED[name])
    whole, rng = bytearray(path.read_bytes()), np.random.default_rng(1)
    for _ in range(60):
        changed = whole.copy()
        for at in rng.integers(len(whole), size=3):
            changed[at] = rng.integers(256)
        path.write_bytes(changed)
        wrenches, _ = read(path)
        assert len(wrenches) <= 60


def test_the_recording_of_a_torn_file_says_so_first(tmp_path: Path) -> None:
    log, path = session(60), tmp_path / "log.mcap"
    write_mcap(path, log.messages(), use_chunking=False)
    path.write_bytes(path.read_bytes()[:6000])
    assert read_recording(path).notes[0].startswith("the file is torn at byte")


def test_a_damaged_first_chunk_costs_its_messages_only(tmp_path: Path) -> None:
    """The topics are declared in it, but also in the index."""
    log, path = session(100), tmp_path / "log.mcap"
    write_mcap(path, log.messages(), chunk_size=4000, compression=CompressionType.ZSTD)
    raw = bytearray(path.read_bytes())
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    first = summary.chunk_indexes[0]
    raw[first.chunk_start_offset + 60] ^= 0xFF  # behind the head, in what is packed
    path.write_bytes(raw)
    wrenches, said = read(path)
    assert np.array_equal(wrenches, log.wrench[-len(wrenches) :])
    assert len(wrenches) >= np.count_nonzero(log.stamp > first.message_end_time)
    assert f"torn at byte {first.chunk_start_offset} of" in said


def test_a_table_that_ends_within_a_row_is_torn(tmp_path: Path) -> None:
    whole = "time,fx,fy,fz,tx,ty,tz\n" + "0.1,1,2,3,4,5,6\n" * 3
    path = tmp_path / "log.csv"
    for text, torn in ((whole, False), (whole.rstrip("\n"), False), (whole[:-6], True)):
        path.write_text(text, encoding="utf-8")
        log = open_log(path)
        assert sum(map(len, log.blocks())) == 3
        assert bool(log.torn) == torn
