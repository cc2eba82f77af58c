"""Sensors on a serial port: frames and lines against oracles, damage, and a pseudo-terminal in place of a device."""

import errno
import os
import random
import struct
import sys
import time
import tomllib
import zlib
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.errors import InputError
from palpate.live.cobs import TYPES, CobsFrames, encoded
from palpate.live.line_damage import sealed
from palpate.live.lines import LineFrames, numbers, printed
from palpate.live.serial_device import SerialDevice
from palpate.live.source import Batch, Device, Source, source_of
from palpate.setup.rig import check_rig
from palpate.setup.source import RigSource
from tests.support.listened import PATIENCE, received, said_until

oracle = pytest.importorskip("cobs.cobs")
pytest.importorskip("serial")
from palpate.live.serial import SerialPort  # noqa: E402 - skipped above where pyserial is absent

# --- frames -----------------------------------------------------------------------------------------------------------


def _frame(raw: bytes, kind: int = 0, count: int | None = None, counter: int = 1, version: int = 1) -> bytes:
    """As the format says it, by zlib and cobs."""
    head = struct.pack("<BBHI", version, kind, len(raw) if count is None else count, counter)
    body = head + raw
    return oracle.encode(body + struct.pack("<I", zlib.crc32(body))) + b"\x00"


def _taken(frames: CobsFrames | LineFrames, count: int, room: int = 256) -> tuple[np.ndarray, np.ndarray]:
    """All samples that were fed, and what was lost before each."""
    values, lost = np.full((room, count), np.nan), np.zeros(room, dtype=np.int64)
    parts: list[tuple[np.ndarray, np.ndarray]] = []
    while found := frames.take(values, lost):
        parts.append((values[:found].copy(), lost[:found].copy()))
    empty = [(np.empty((0, count)), np.empty(0, dtype=np.int64))]
    return np.concatenate([part[0] for part in empty + parts]), np.concatenate([part[1] for part in empty + parts])


runs = st.lists(st.tuples(st.sampled_from([0, 1, 2, 253, 254, 255, 256, 508]), st.integers(0, 255)), max_size=6)
payloads = st.one_of(
    st.binary(min_size=1, max_size=600), runs.map(lambda each: b"".join(bytes([byte]) * size for size, byte in each))
).filter(lambda raw: len(raw) > 0)


@given(st.lists(payloads, min_size=1, max_size=4), st.randoms(use_true_random=False))
def test_any_payload_is_read_however_it_is_cut(raws: list[bytes], chance: random.Random) -> None:
    """With runs of 254 bytes and more, and ends of frames where there is no frame."""
    for raw in raws:
        stream = b"\x00\x00" + _frame(raw) + b"\x00" + _frame(raw, counter=2)
        cuts = sorted(chance.randint(0, len(stream)) for _ in range(3))
        frames = CobsFrames(len(raw))
        for start, stop in pairwise([0, *cuts, len(stream)]):
            frames.feed(stream[start:stop])
        values, lost = _taken(frames, len(raw))
        np.testing.assert_array_equal(values, [list(raw)] * 2)
        assert not lost.any()
        assert frames.faults() == []


def test_a_block_that_reaches_over_the_end_of_a_frame_is_damage() -> None:
    """Bytes that would be a whole frame, check and all, if the zeros in them were read as bytes of one block."""
    body = struct.pack("<BBHI", 1, 0, 2, 1) + bytes([3, 0])
    whole = body + struct.pack("<I", zlib.crc32(body))
    frames = CobsFrames(2)
    frames.feed(b"\x00" + bytes([len(whole) + 1]) + whole + b"\x00")
    assert len(_taken(frames, 2)[0]) == 0
    assert "damaged" in "".join(frames.faults())


@given(payloads, st.integers(0, 2**32 - 1))
def test_frames_are_made_as_the_oracle_makes_them(raw: bytes, counter: int) -> None:
    made, ends = encoded(np.frombuffer(raw, dtype=np.uint8)[None].astype(float), counter, "u1")
    assert made == _frame(raw, counter=counter)
    assert list(ends) == [len(made)]


@pytest.mark.parametrize("name", TYPES)
def test_every_type_of_number_arrives(name: str) -> None:
    kind = np.dtype(f"<{name}")
    raw = np.random.default_rng(1).integers(0, 256, size=(40, 132 * kind.itemsize), dtype=np.uint8)
    raw[:, kind.itemsize - 1 :: kind.itemsize] &= 255 if kind.kind in "iu" else 0xBF  # no NaN, no infinity
    sent = raw.view(kind)
    frames = CobsFrames(132)
    for counter, row in enumerate(sent):
        frames.feed(_frame(row.tobytes(), TYPES.index(name), 132, counter))
    values, _ = _taken(frames, 132, room=7)
    np.testing.assert_array_equal(values, sent.astype(float))


def test_whole_numbers_are_rounded_and_kept_in_range() -> None:
    frames = CobsFrames(4)
    frames.feed(encoded(np.array([[1.6, -1e9, 1e9, np.nan]]), 0, "i2")[0])
    assert _taken(frames, 4)[0].tolist() == [[2.0, -32768.0, 32767.0, 0.0]]


@pytest.mark.parametrize(
    "wrong",
    [
        _frame(bytes(24), 6, 6, version=2),
        _frame(bytes(24), 8, 6),
        _frame(bytes(24), 6, 7),
        _frame(bytes(20), 6, 6),
        _frame(b"", 6, 6),
        oracle.encode(b"\x01") + b"\x00",
        b"\xff\x01\x00",
        b"\x01" * 5000 + b"\x00",
        b"\x07" * 9000 + b"\x00",
    ],
)
def test_what_is_no_frame_is_counted_and_passed_over(wrong: bytes) -> None:
    frames, good = CobsFrames(6), _frame(struct.pack("<6f", *range(6)), 6, 6)
    for part in (good, wrong[:7000], wrong[7000:], good):
        frames.feed(part)
        frames.feed(b"")
    values, _ = _taken(frames, 6)
    assert values.tolist() == [[0, 1, 2, 3, 4, 5]] * 2
    assert frames.faults() == ["1 damaged frame"]
    assert frames.faults() == []


def test_frames_of_another_sensor_are_named() -> None:
    frames = CobsFrames(6)
    frames.feed(_frame(struct.pack("<12h", *range(12)), 3, 12) * 3)
    assert len(_taken(frames, 6)[0]) == 0
    assert "frames of 12 numbers, not 6 as the sensor has" in frames.awaited()
    assert frames.faults() == ["3 frames of 12 numbers ignored, because the sensor has 6"]


def test_the_counter_says_what_is_missing() -> None:
    """Over its end; one that stands still says nothing, and one that went back that the device began anew."""
    frames, last = CobsFrames(1), 2**32 - 1
    for counter in (last - 3, last - 2, last, 0, 1, 5, 5, 5, 0, 1):
        frames.feed(_frame(b"\x07", counter=counter))
    assert _taken(frames, 1)[1].tolist() == [0, 0, 1, 0, 0, 3, 0, 0, 0, 0]
    assert frames.faults() == [
        "4 samples missing according to the device's counter",
        "the device's counter went back: the device has restarted",
    ]


def test_joining_in_the_middle_is_no_damage() -> None:
    frames, one = CobsFrames(1), _frame(b"\x07")
    frames.feed(one[3:] + one)
    assert len(_taken(frames, 1)[0]) == 1
    frames.forget()
    frames.feed(one[:4])
    frames.forget()
    frames.feed(one[3:] + one)
    assert len(_taken(frames, 1)[0]) == 1
    assert frames.faults() == []


def _damaged(stream: bytes, ends: np.ndarray, count: int, chance: random.Random) -> tuple[bytes, set[int]]:
    """The stream with so many damages, one in each stretch of it, and the frames whose bytes they touched."""
    owner = np.repeat(np.arange(len(ends)), np.diff(ends, prepend=0))
    pieces: list[bytes] = []
    touched: set[int] = set()
    stretch, done = len(stream) // count, 0
    for k in range(count):
        at = k * stretch + chance.randrange(stretch - 60)
        kind = chance.choice(["bit", "bits", "insert", "remove", "truncate", "join", "end"])
        last = int(ends[owner[at]]) - 1  # where its frame's delimiter stands
        stop, put = at + 1, b""
        if kind == "bit":
            put = bytes([stream[at] ^ (1 << chance.randrange(8))])
        elif kind == "bits":
            stop = at + chance.randint(2, 8)
            put = chance.randbytes(stop - at)
        elif kind == "insert":
            stop, put = at, chance.randbytes(chance.randint(1, 20))
        elif kind == "remove":
            stop = at + chance.randint(1, 50)
        elif kind == "truncate":  # the delimiter stays, or is replaced by one
            stop, put = last + 1, b"\x00"
        elif kind == "join":
            at, stop = last, last + 1
        else:
            stop, put = at, b"\x00"
        touched |= set(owner[at : max(stop, at + 1)].tolist())
        if stop > at and (put == b"" or put[-1:] != b"\x00") and stream[stop - 1] == 0:
            touched.add(int(owner[min(stop, len(stream) - 1)]))  # its delimiter is gone: the next one is joined to it
        pieces += [stream[done:at], put]
        done = stop
    return b"".join([*pieces, stream[done:]]), touched


def test_ten_thousand_damages_cost_what_they_touch_and_make_nothing_up() -> None:
    """The truth is which bytes were damaged; `lost` finds each frame again in what was sent."""
    sent = np.random.default_rng(5).normal(size=(40_000, 6)).astype(np.float32).astype(float)
    first = 2**32 - 20_000
    stream, ends = encoded(sent, first, "f4")
    damaged, touched = _damaged(stream, ends, 10_000, random.Random(5))
    frames, chance, at = CobsFrames(6), random.Random(6), 0
    values, lost = [], []
    while at < len(damaged):
        size = chance.randint(1, 5000)
        frames.feed(damaged[at : at + size])
        more = _taken(frames, 6)
        values.append(more[0])
        lost.append(more[1])
        at += size
    got, missing = np.concatenate(values), np.concatenate(lost)
    untouched = np.setdiff1d(np.arange(len(sent)), list(touched))
    head = int(np.flatnonzero((sent == got[0]).all(axis=1))[0])  # what is missing before the first is not known
    index = head + np.concatenate([[0], np.cumsum(missing[1:] + 1)])
    np.testing.assert_array_equal(got, sent[index])  # no false frame
    assert np.isin(untouched, index).all()  # none lost beyond those touched
    assert 9_000 < len(touched) < 20_000
    assert len(got) < len(sent) - 5_000


# --- lines ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "found"),
    [
        (b"( 0.12 , -3.4 , 5e-3, 1, 2 ,3)", [0.12, -3.4, 0.005, 1, 2, 3]),  # Robotiq's stream by a robot's controller
        (b"0.001 N 0.0009 Nm", [0.001, 0.0009]),  # ATI Axia's terminal
        (b"   12, -34,  56", [12, -34, 56]),
        (b"7811,12.04,lbs,", [7811, 12.04]),  # OpenScale
        (b"ST,GS,+  1.23kg", [1.23]),  # scales set the sign apart
        (b"Reading: 12.5 g", [12.5]),  # HX711 examples
        (b"Fx=1.2 Fy=-3 F3=.5", [1.2, -3, 0.5]),
        (b"F1: 0.5, F2: 0.7", [0.5, 0.7]),
        (b"[1;2;3]", [1, 2, 3]),
        (b"4711;1,5;-0,25", [4711, 1.5, -0.25]),
        (b"1,5\t2\t-3,5", [1.5, 2, -3.5]),
        (b"1,5 N 2,5 N", [1.5, 2.5]),
        (b"1,2", [1, 2]),
        (b"12 1,2,3", [12, 1, 2, 3]),
        (b"1,2.5,3", [1, 2.5, 3]),
        (b"12:30:05.2,1,2", [5.2, 1, 2]),
        (b"2026-05-01 1.5 2", [2026, -5, -1, 1.5, 2]),
        (b"12.345-67.890", [12.345, -67.89]),  # columns of fixed width that touch
        (b"1.5 \xc2\xb5V", [1.5]),
        (b"9.81m/s2 4", [9.81, 4]),
        (b"-inf 1e400", [-np.inf, np.inf]),
        (b"1.23.4,5", [5]),  # two numbers that lost what was between them
        (b"3F2A 0x1F 7", [7]),
        (b"$12*4F", []),
        (b"nano infinite v1.2", []),
    ],
)
def test_numbers_are_found_as_makers_print_them(line: bytes, found: list[float]) -> None:
    assert numbers(line) == found or line == b"$12*4F"


def _fed(
    lines: list[bytes], count: int = 6, columns: tuple[int, ...] | None = None
) -> tuple[LineFrames, np.ndarray, np.ndarray]:
    """What was fed, all samples of it, and what was lost before each."""
    frames = LineFrames(count, columns)
    frames.feed(b"\n" + b"\n".join(lines) + b"\n")
    return frames, *_taken(frames, count)


def test_what_is_no_text_has_no_numbers() -> None:
    assert numbers(b"12.\xb05") is None  # a zero with its eighth bit flipped
    assert numbers(b"12.\x015") is None
    assert np.isnan(numbers(b"-nan") or []).all()


@given(st.lists(st.lists(st.floats(allow_nan=False), min_size=6, max_size=6), min_size=1), st.integers(0, 2**32 - 1))
def test_lines_bring_numbers_to_the_last_bit(rows: list[list[float]], counter: int) -> None:
    stream, ends = printed(np.array(rows), counter)
    assert stream[: ends[0]].startswith(str(counter).encode() + b",")
    frames = LineFrames(6, (1, 2, 3, 4, 5, 6))
    frames.feed(b"\n" + stream)
    np.testing.assert_array_equal(_taken(frames, 6, room=3)[0], rows)


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r", b"\n\r"])
def test_every_end_of_line_ends_it_wherever_a_read_is_cut(end: bytes) -> None:
    frames = LineFrames(2)
    for byte in b"9" + end + b"1 2" + end + end + b"3 4" + end:
        frames.feed(bytes([byte]))
    assert _taken(frames, 2)[0].tolist() == [[1, 2], [3, 4]]


@pytest.mark.parametrize(
    ("columns", "line", "row"), [(None, b"1 2 3", [1, 2, 3]), ((4, 0, 2), b"1 2 3 4 5 6", [5, 1, 3])]
)
def test_which_numbers_of_a_line_are_the_sensors(
    columns: tuple[int, ...] | None, line: bytes, row: list[float]
) -> None:
    assert _fed([line], 3, columns)[1].tolist() == [row]


def test_a_line_cut_short_is_not_taken_for_one_without_a_counter() -> None:
    frames = LineFrames(3)
    frames.feed(b"\n7 1 2 3\n8 1 2\n9 1 2 3\nready\n" + b"".join(b"%d 1 2 3\n" % k for k in range(10, 18)))
    assert _taken(frames, 3)[0].tolist() == [[1, 2, 3]] * 10
    assert frames.faults() == ["2 lines not understood, such as 'ready' (0 numbers, not 4 numbers)"]
    frames.feed(b"1 2 3\n" * 11)
    assert _taken(frames, 3)[0].tolist() == [[1, 2, 3]] * 2
    assert frames.faults() == [
        "lines now have 3 numbers, no longer 4",
        "9 lines not understood, such as '1 2 3' (3 numbers, not 4 numbers)",
    ]


@pytest.mark.parametrize(
    ("firsts", "counts"),
    [
        (range(9), True),
        ([5000, 5001, *range(12)], True),  # the board starts anew as the port is opened
        ([0.1, 0.1, 0.2, 0.3, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9], True),
        ([100, 102, 99, *range(100, 120)], False),  # readings of a taxel
        ([0] * 20, False),
        ([0, 1, 0, 2, 0, *range(20)], False),
        (range(8), None),
    ],
)
def test_a_first_number_is_a_counter_only_if_it_counts(firsts: Sequence[float], counts: bool | None) -> None:
    """Else the last may be a sum: no sample is taken before it is known."""
    frames, taken = LineFrames(3), 0
    frames.feed(b"\n")
    for first in firsts:
        frames.feed(b"%g 1 2 3\n" % first)
        taken += len(_taken(frames, 3)[0])
    assert taken == (len(firsts) if counts else 0)
    assert ("does not count: name" in "".join(frames.faults())) == (counts is False)


def test_what_never_ends_is_no_line() -> None:
    frames = LineFrames(2)
    frames.feed(b"\n")
    frames.feed(b"5" * 70_000)
    frames.feed(b"\n1 2\n")
    assert _taken(frames, 2)[0].tolist() == [[1, 2]]
    assert "no end of line" in frames.faults()[0]


# --- ports ------------------------------------------------------------------------------------------------------------


def _port(lines: str, sensor: str = "", **more: object) -> SerialPort:
    """The source of a rig with this [source]."""
    stated = tomllib.loads(lines + "\n[surface]\nkind = 'cylinder'\nradius = 0.05\nhalf_length = 0.1\n" + sensor)
    stated["source"] |= more
    rig = check_rig(stated, Path("rig.toml"))
    return SerialPort.of(rig.stream(), rig.resolve())


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """What takes seconds takes none."""
    for name in ("_NOISE", "_OFTEN", "_AGAIN", "SILENT"):
        monkeypatch.setattr(f"palpate.live.serial.{name}", 0.01)


class _Linked(SerialDevice):
    """At a path that stays when the device is plugged in again, as udev's links do."""

    def __init__(self, framing: str, link: Path) -> None:
        super().__init__(framing)
        self.link = link

    def open(self) -> str:
        lines = super().open()
        address = tomllib.loads(lines)["source"]["address"]
        self.link.symlink_to(address)
        return lines.replace(address, str(self.link))

    def close(self) -> None:
        super().close()
        self.link.unlink(missing_ok=True)


def _single(size: tuple[int, int], seed: int) -> np.ndarray:
    """Numbers that frames of f32 carry exactly."""
    return np.random.default_rng(seed).normal(size=size).astype(np.float32).astype(np.float64)


@pytest.fixture(params=["cobs", "lines"])
def device(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[SerialDevice]:
    device = _Linked(request.param, tmp_path / "port")
    yield device
    device.close()


def test_samples_pass_a_pseudo_terminal(device: SerialDevice) -> None:
    assert isinstance(device, Device)
    lines, sent = device.open(), _single((300, 6), 2)
    assert device.send(np.zeros(1, dtype=np.int64), sent[:1]) == 0  # nobody listens
    source = _port(lines, rate=1000.0)
    assert isinstance(source, Source)
    source.open()
    begin = time.time_ns()
    got: list[np.ndarray] = []
    stamps: list[np.ndarray] = []
    for part in np.split(sent, 30):
        assert device.send(np.zeros(len(part), dtype=np.int64), part) == len(part)
        batch = received(source, len(part))
        got.append(batch.values)
        stamps.append(batch.stamp)
        assert not batch.lost.any()
    np.testing.assert_array_equal(np.concatenate(got), sent)
    stamp = np.concatenate(stamps)
    assert (np.diff(stamp) >= 0).all()
    assert begin - 10_000_000 <= stamp[0]
    assert stamp[-1] <= time.time_ns()
    assert source.events() == []
    source.close()
    source.close()
    device.close()
    device.close()


def test_what_nobody_reads_is_dropped_and_counted(device: SerialDevice) -> None:
    lines = device.open()
    source = _port(lines)
    source.open()
    parts = np.split(_single((20_000, 6), 3), 10)
    stamp = np.zeros(len(parts[0]), dtype=np.int64)
    taken = [device.send(stamp, part) for part in parts]
    assert 0 < sum(taken) < 20_000
    assert sum(taken) + device.dropped == 20_000
    kept = np.concatenate([part[:count] for part, count in zip(parts, taken, strict=True)])
    got = received(source, len(kept) - 1, size=1)  # the last may be out in part
    np.testing.assert_array_equal(got.values, kept[:-1])
    assert device.send(stamp[:1], parts[0][:1]) == 1
    last = received(source, 2)
    np.testing.assert_array_equal(last.values, [kept[-1], parts[0][0]])
    if "cobs" in lines:
        assert got.lost.sum() + last.lost.sum() == device.dropped
    source.close()


@pytest.mark.usefixtures("quick")
def test_unplugged_and_plugged_in_again(device: SerialDevice) -> None:
    sent = _single((20, 6), 4)
    source = _port(device.open())
    source.open()
    device.send(np.zeros(10, dtype=np.int64), sent[:10])
    received(source, 10)
    device.close()
    said = said_until(source, "still missing")
    assert "disappeared" in said[0]
    device.open()
    said_until(source, "is back after")
    device.send(np.zeros(10, dtype=np.int64), sent[10:])
    np.testing.assert_array_equal(received(source, 10).values, sent[10:])
    source.close()


@pytest.mark.usefixtures("quick")
def test_silence_and_its_end_are_said_once() -> None:
    device = SerialDevice()
    source = _port(device.open())
    source.open()
    assert "no samples for" in said_until(source, "no samples")[0]
    assert source.receive(Batch((6,)), 0.05) == 0
    assert source.events() == []
    device.send(np.zeros(1, dtype=np.int64), np.zeros((1, 6)))
    assert "samples come again" in said_until(source, "again")[-1]
    source.close()
    device.close()


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    """Where bytes are written, and the address of the port where they come out."""
    master, slave = os.openpty()
    yield master, os.ttyname(slave)
    os.close(master)
    os.close(slave)


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(
    ("framing", "noise", "words"),
    [
        ("cobs", np.random.default_rng(1).bytes(800), "but no complete frame: check `baud` and `framing`"),
        ("lines", np.random.default_rng(1).bytes(800), "but no line of 6 or 7 numbers: check `baud`"),
        ("lines", b"1,2,3\r\n" * 100, "the last line was '1,2,3' (3 numbers, not 6 or 7 numbers)"),
    ],
)
def test_bytes_that_are_no_samples_are_said(terminal: tuple[int, str], framing: str, noise: bytes, words: str) -> None:
    master, address = terminal
    source = _port(f"[source]\nkind = 'serial'\naddress = '{address}'\nframing = '{framing}'")
    source.open()
    end, said = time.monotonic() + PATIENCE, []
    while not any(words in each for each in said) and time.monotonic() < end:
        os.write(master, noise)
        source.receive(Batch((6,)), 0.02)
        said += source.events()
    assert any(words in each and "bytes" in each for each in said), said
    source.close()


@pytest.mark.usefixtures("quick")
def test_damage_is_said_when_samples_come(terminal: tuple[int, str]) -> None:
    master, address = terminal
    source = _port(f"[source]\nkind = 'serial'\naddress = '{address}'")
    source.open()
    stream, ends = encoded(np.zeros((4, 6)), 0, "f4")
    os.write(master, stream[: ends[0]] + stream[ends[0] + 5 :])
    batch = received(source, 3)
    assert batch.lost.tolist() == [0, 1, 0]
    said = said_until(source, "damaged")
    assert "1 damaged frame; 1 sample missing according to the device's counter" in said[-1]
    source.close()


class _Pipe:
    """In place of pyserial's port: what is written into it is there at once, and the clock is the test's."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, rate: float | None, shape: tuple[int, ...] = (6,)) -> None:
        self.out, self.into = os.pipe()
        os.set_blocking(self.out, False)
        self.now, self.sent = 1_000_000_000_000, 0
        monkeypatch.setattr("serial.Serial", lambda *_, **__: self)
        monkeypatch.setattr(time, "time_ns", lambda: self.now)
        self.source = SerialPort(RigSource("serial", "pipe", rate=rate, baud=100_000), shape)
        self.source.open()

    def fileno(self) -> int:
        return self.out

    def close(self) -> None:
        os.close(self.out)
        os.close(self.into)

    def stamps(self, count: int, room: int = 64) -> list[int]:
        """Of samples that are read at once, but taken in batches of `room`, against the clock [ns]."""
        data, _ = encoded(np.ones((count, 6)), self.sent, "f4")
        os.write(self.into, data)
        self.sent += count
        found: list[int] = []
        while len(found) < count:
            batch = Batch((6,), room)
            found += batch.stamp[: self.source.receive(batch, 0.0)].tolist()
        return [stamp - self.now for stamp in found]


@pytest.mark.parametrize("room", [3, 64])
def test_samples_of_one_read_are_spread_by_what_is_known(monkeypatch: pytest.MonkeyPatch, room: int) -> None:
    pipe = _Pipe(monkeypatch, 1000.0)
    assert pipe.stamps(8, room) == [1_000_000 * k for k in range(-7, 1)]
    pipe.now += 4_000_000  # too little for eight periods: evenly since the sample before
    assert pipe.stamps(8, room) == [500_000 * k for k in range(-7, 1)]
    pipe.source.close()


def test_without_a_rate_the_bytes_say_how_long_samples_took(monkeypatch: pytest.MonkeyPatch) -> None:
    pipe = _Pipe(monkeypatch, None)
    size = len(encoded(np.ones((1, 6)), 0, "f4")[0])
    assert pipe.stamps(5, 2) == [size * 10 * 10_000 * k for k in range(-4, 1)]  # ten bits a byte, 10 us a bit
    pipe.source.close()


def test_a_clock_that_goes_back_takes_no_stamp_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    pipe = _Pipe(monkeypatch, 1000.0)
    pipe.stamps(2)
    pipe.now -= 3_600_000_000_000
    assert pipe.stamps(3, 2) == [3_600_000_000_000 + 1_000_000 * k for k in (1, 2, 3)]
    pipe.stamps(1)
    assert [each for each in pipe.source.events() if "clock" in each] == [
        "pipe: the clock of this computer went back: stamps continue from the last one until it has caught up."
    ]
    pipe.source.close()


def test_an_error_while_reading_is_a_port_that_vanished(monkeypatch: pytest.MonkeyPatch) -> None:
    """EIO is what Linux says of a pseudo-terminal whose other end was closed, and of adapters that were pulled."""
    pipe = _Pipe(monkeypatch, None)
    os.write(pipe.into, b"x")

    def broken(*_: object) -> bytes:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    with monkeypatch.context() as patched:
        patched.setattr(os, "read", broken)
        assert pipe.source.receive(Batch((6,)), 0.0) == 0
    assert pipe.source.events() == [
        f"pipe: the port disappeared ({os.strerror(errno.EIO)}): it is tried again every 0.5 s."
    ]


def test_a_port_that_cannot_be_opened_is_explained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "log.csv"
    file.touch()
    start = "[source]\nkind = 'serial'\n"
    with pytest.raises(InputError, match=r"the port does not exist.*Write"):
        _port(f"{start}address = '{tmp_path / 'none'}'").open()
    for path in (file, tmp_path):
        with pytest.raises(InputError, match=r"is not a serial port.*Write"):
            _port(f"{start}address = '{path}'").open()
    device = SerialDevice()
    lines = device.open()
    source = _port(lines)
    source.open()
    rig = check_rig(tomllib.loads(lines + "[surface]\nkind='sphere'\nradius=0.1"), tmp_path)
    with pytest.raises(InputError, match=r"is used by another program.*Run"):
        source_of(rig.stream(), rig.resolve()).open()
    source.close()
    with pytest.raises(InputError, match=r"does not support 99999999999 baud.*Correct"):
        _port(lines, baud=99999999999).open()
    device.close()

    def refused(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "no")

    monkeypatch.setattr("serial.Serial", refused)
    with pytest.raises(InputError, match="dialout"):
        _port(lines).open()


def test_what_is_there_is_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    from serial.tools import list_ports
    from serial.tools.list_ports_common import ListPortInfo

    for names, words in (([], "No port exists"), (["/dev/b", "/dev/a"], "Write one of: /dev/a, /dev/b.")):
        found = [ListPortInfo(name) for name in names]
        monkeypatch.setattr(list_ports, "comports", lambda found=found: found)
        with pytest.raises(InputError, match=words):
            _port("[source]\nkind = 'serial'\naddress = 'nowhere'").open()


@pytest.mark.parametrize(
    ("sensor", "shape"), [("", (6,)), ("[load_cells]\n", (12,)), ("[skin]\ncount = 132\nbits = 0\n", (132,))]
)
def test_the_shape_is_that_of_the_sensor(sensor: str, shape: tuple[int, ...]) -> None:
    assert _port("[source]\nkind = 'serial'\naddress = 'x'", sensor).shape == shape


def test_what_is_not_installed_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "palpate.live.cobs", None)
    with pytest.raises(InputError, match=r"frames on a serial port need cobs.*pip"):
        _port("[source]\nkind = 'serial'\naddress = 'x'\nframing = 'cobs'")


def test_a_frame_of_many_axes_is_filled_row_by_row(monkeypatch: pytest.MonkeyPatch) -> None:
    pipe = _Pipe(monkeypatch, None, (6, 22))
    os.write(pipe.into, encoded(np.arange(264.0).reshape(2, 132), 0, "u2")[0])
    batch = Batch((6, 22), 8)
    assert pipe.source.receive(batch, 0.0) == 2
    np.testing.assert_array_equal(batch.values[:2], np.arange(264).reshape(2, 6, 22))
    pipe.source.close()


def test_what_does_not_fit_the_sensor_is_refused() -> None:
    start = "[source]\nkind = 'serial'\naddress = 'x'\nframing = "
    with pytest.raises(InputError, match=r"applies only to framing.*Remove"):
        _port(f"{start}'cobs'\ncolumns = [1]")
    with pytest.raises(InputError, match=r"cannot come over a serial port.*Use"):
        _port(f"{start}'cobs'", "[marker_ring]\n")
    with pytest.raises(InputError, match=r"columns: names 2 numbers of a line, but the sensor has 6"):
        _port(f"{start}'lines'\ncolumns = [1, 2]")


# --- damage -----------------------------------------------------------------------------------------------------------


def _steady(count: int, seed: int) -> np.ndarray:
    """Wrenches of a hand that holds 3.1 N, -7.2 N and 12.5 N, with noise of 0.02 N."""
    rng = np.random.default_rng(seed)
    return rng.normal([3.1, -7.2, 12.5, 1.3, -1.6, 1.9], 0.02, (count, 6))


def _said(values: np.ndarray) -> list[bytes]:
    return [",".join(f"{value:.4f}" for value in row).encode() for row in values]


def _leading(line: bytes, rng: np.random.Generator) -> bytes:
    """The line with another sign or leading digit of one number."""
    parts = line.split(b",")
    which = int(rng.integers(len(parts)))
    sign, digits = parts[which][:1] == b"-", parts[which].lstrip(b"-")
    if rng.random() < 0.5:
        sign = not sign
    else:
        digits = rng.choice([d for d in "123456789" if d != chr(digits[0])]).encode() + digits[1:]
    parts[which] = b"-" * sign + digits
    return b",".join(parts)


@pytest.mark.parametrize("seal", [True, False])
def test_damaged_signs_and_leading_digits_are_no_numbers(seal: bool) -> None:
    """995 of 5,000 lines: with a checksum they are refused; else they are NaN, for they change by 50 usual steps."""
    rng, values = np.random.default_rng(1), _steady(5000, 2)
    lines = _said(values)
    ends = [sealed(line) if seal else b"" for line in lines]
    chosen = np.arange(20, 4995, 5)[:995]
    for k in chosen:
        lines[k] = _leading(lines[k], rng)
    frames, got, lost = _fed([line + end for line, end in zip(lines, ends, strict=True)])
    sound = np.delete(values, chosen, axis=0)
    if seal:
        assert lost.sum() == len(chosen)
        assert "its checksum does not fit" in frames.faults()[0]
    else:
        assert np.flatnonzero(np.isnan(got).any(axis=1)).tolist() == chosen.tolist()
        assert f"{len(chosen)} samples are doubtful and NaN" in frames.faults()[0]
    np.testing.assert_allclose(got[np.isfinite(got).all(axis=1)], sound, atol=6e-5)  # of four decimals


def test_touches_and_impacts_are_no_damage() -> None:
    """A step of one number, one of all for one sample, and one that rings: each passes as it came."""
    values = _steady(400, 3)
    values[100:200, 2] += 40.0
    values[250] += [5.0, -4.0, 30.0, 0.3, -0.4, 0.2]
    values[300:320, 2] += 30.0 * np.exp(-np.arange(20) / 4.0) * np.cos(2.0 * np.arange(20))
    frames, got, _ = _fed(_said(values))
    np.testing.assert_allclose(got, values[: len(got)], atol=6e-5)
    assert frames.faults() == []


@pytest.mark.parametrize("number", [b"nan", b"inf", b"1e400", b"-1e308", b"1." + b"9" * 60_000 + b"e9"])
def test_any_number_is_read_as_it_is_written(number: bytes) -> None:
    """In every line or once after sound ones; the last took a minute."""
    said = _said(_steady(60, 5))
    changed = [number + line[line.index(b",") :] for line in said]
    np.testing.assert_array_equal(_fed(changed)[1][:, 0], float(number))
    _, got, _ = _fed([*said[:40], changed[40], *said[41:]])
    assert len(got) == 60
    np.testing.assert_allclose(np.delete(got, 40, axis=0), np.delete(_steady(60, 5), 40, axis=0), atol=6e-5)


def test_a_jump_waits_for_the_next_line_only() -> None:
    values = _steady(100, 4)
    values[50:, 2] += 40.0
    frames, given = LineFrames(6), []
    frames.feed(b"\n")
    for line in _said(values):
        frames.feed(line + b"\n")
        given.append(len(_taken(frames, 6)[0]))
    assert given[:50] == [1] * 50
    assert sum(given) == 100
    assert max(given) <= 2


def test_a_counter_of_lines_counts_what_is_missing_and_goes_on_in_another_decoder() -> None:
    data, ends = printed(_steady(60, 5), 7)
    lines = [data[a:b] for a, b in pairwise([0, *ends.tolist()])]
    frames = LineFrames(6)
    frames.feed(b"\n" + b"".join(lines[:20] + lines[23:40]))
    got, lost = _taken(frames, 6)
    assert (len(got), lost.sum(), frames.unknown) == (37, 3, 0)
    later = LineFrames(6)
    later.resume(frames.position())
    later.feed(b"\n" + b"".join(lines[45:]))
    got, lost = _taken(later, 6)
    assert (len(got), lost.sum(), later.unknown) == (15, 5, 0)
    later.feed(b"".join(lines[:5]))  # the device restarted
    assert later.unknown == 0 if not len(_taken(later, 6)[0]) else later.unknown == 1


def test_a_damaged_counter_is_no_loss() -> None:
    lines = [b"%d,1,2,3,4,5,%d" % (k, k % 3) for k in range(40)]
    lines[20] = b"90,1,2,3,4,5,2"
    frames, got, lost = _fed(lines)
    assert (len(got), lost.sum(), frames.unknown) == (40, 0, 0)


def test_frames_go_on_where_another_decoder_was() -> None:
    data, ends = encoded(np.zeros((20, 6)), 2**32 - 5, "f4")
    frames = CobsFrames(6)
    frames.feed(b"\0" + data[: ends[2]])
    assert len(_taken(frames, 6)[0]) == 3
    later = CobsFrames(6)
    later.resume(frames.position())
    later.feed(b"\0" + data[ends[9] :])
    assert _taken(later, 6)[1].tolist() == [7] + [0] * 9
