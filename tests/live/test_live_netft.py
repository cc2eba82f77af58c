"""ATI Net F/T: the source against a device written here by hand, and the stand-in against pynetft."""

import math
import socket
import struct
import threading
import time
import tomllib
from collections.abc import Callable, Generator, Iterator
from collections.abc import Sequence as Listed
from contextlib import closing, contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from palpate.errors import InputError
from palpate.live.netft import NetFt
from palpate.live.netft_device import NetFtDevice
from palpate.live.sequence import SequenceCounters
from palpate.live.source import Batch, Device, Source
from palpate.setup.rig import check_rig
from tests.support.listened import PATIENCE, received, said_until, until

HOST = "127.0.0.1"
ROUND = 2**32
PAGE = {"prodname": "Box", "cfgcalsn": "FT1", "cfgcpf": "1000000", "cfgcpt": "1000000", "scfgfu": "N", "scfgtu": "N-m"}


class Wire:
    """A Net F/T by the letter of its manual: it answers the first start with sample 1, then sends what it is told."""

    def __init__(self, **page: str) -> None:
        self.page = xml(**{**PAGE, **page})
        self.status, self.silent, self.eager = 200, False, False
        self.peer: tuple[str, int] | None = None
        self.asked: list[int] = []
        self.udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.udp.bind((HOST, 0))
        self.udp.settimeout(0.05)
        self.port = self.udp.getsockname()[1]
        wire = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                ending.wait(PATIENCE if wire.silent else 0.0)
                self.send_response(wire.status)
                self.end_headers()
                self.wfile.write(wire.page)

            def log_message(self, *_: object) -> None:
                pass

        ending = threading.Event()
        self.server = ThreadingHTTPServer((HOST, 0), Handler)
        self.server.daemon_threads = True
        self.web = self.server.server_address[1]
        self.ending = ending
        self.threads = [
            threading.Thread(target=self._commands, daemon=True),
            threading.Thread(target=self.server.serve_forever, args=(0.02,), daemon=True),
        ]
        for thread in self.threads:
            thread.start()

    def _commands(self) -> None:
        while not self.ending.is_set():
            try:
                request, peer = self.udp.recvfrom(64)
            except TimeoutError:
                continue
            header, command, count = struct.unpack(">HHI", request)
            assert (header, count) == (0x1234, 0)
            first = command == 2 and 2 not in self.asked
            self.asked.append(command)
            self.peer = peer
            if first or (command == 2 and self.eager):
                self.put(sample(1, 1))

    def put(self, *raw: bytes) -> None:
        """Send datagrams to who asked last."""
        assert self.peer is not None
        for each in raw:
            self.udp.sendto(each, self.peer)

    def close(self) -> None:
        """Stop."""
        self.ending.set()
        self.server.shutdown()
        for thread in self.threads:
            thread.join()
        self.server.server_close()
        self.udp.close()


def xml(**said: str) -> bytes:
    return ("<?xml version='1.0'?><netft>" + "".join(f"<{k}>{v}</{k}>" for k, v in said.items()) + "</netft>").encode()


def sample(rdt: int, ft: int, status: int = 0, counts: Listed[int] = (1, -2, 3, -4, 5, -6)) -> bytes:
    return struct.pack(">IIIiiiiii", rdt % ROUND, ft % ROUND, status, *counts)


@pytest.fixture
def wire() -> Iterator[Wire]:
    with closing(Wire()) as made:
        yield made


@contextmanager
def connected(wire: Wire | NetFtDevice) -> Generator[NetFt]:
    """The source, opened, its first sample and sentences taken."""
    with closing(NetFt(HOST, wire.port, wire.web)) as source:
        if isinstance(wire, Wire):
            source.open()
            received(source, 1)
        else:
            with sending(wire):
                source.open()
            while source.receive(Batch((6,)), 0.0):
                pass
        source.events()
        yield source


@contextmanager
def sending(device: NetFtDevice, value: float = 0.0) -> Generator[None]:
    """The stand-in sends a sample every 2 ms."""
    ending = threading.Event()

    def send() -> None:
        while not ending.wait(2e-3):
            device.send(np.zeros(1, dtype=np.int64), np.full((1, 6), value))

    thread = threading.Thread(target=send, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join()


def test_both_are_what_their_protocols_say() -> None:
    assert isinstance(NetFt(HOST), Source)
    assert isinstance(NetFtDevice(), Device)


@pytest.mark.parametrize("platform", ["linux", "other"])
def test_samples_arrive_as_counts_over_the_counts_of_a_unit_with_a_stamp_between_sending_and_reading(
    wire: Wire, monkeypatch: pytest.MonkeyPatch, platform: str
) -> None:
    if platform == "other":
        monkeypatch.setattr("palpate.live.datagrams.sys", SimpleNamespace(platform="darwin", byteorder="little"))
    rng = np.random.default_rng(1)
    counts = rng.integers(-(2**31), 2**31, (300, 6))
    with connected(wire) as source:
        before = time.time_ns()
        wire.put(*(sample(2 + k, 2 + k, 0, row.tolist()) for k, row in enumerate(counts)))
        got = received(source, 300)
        after = time.time_ns()
    np.testing.assert_array_equal(got.values, counts / 1e6)
    assert (got.lost == 0).all()
    assert (np.diff(got.stamp) >= 0).all()
    assert before <= got.stamp[0]
    assert got.stamp[-1] <= after


@pytest.mark.parametrize(
    ("force", "torque", "newton", "newton_metre"),
    [
        ("N", "N-m", 1.0, 1.0),
        ("N", "N-mm", 1.0, 1e-3),
        ("kN", "kN-m", 1e3, 1e3),
        ("lbf", "lbf-in", 4.4482216152605, 0.1129848290276167),
        ("klbf", "lbf-ft", 4448.2216152605, 1.3558179483314004),
        ("kgf", "kgf-cm", 9.80665, 0.0980665),
    ],
)
def test_units_of_the_device_become_newtons(force: str, torque: str, newton: float, newton_metre: float) -> None:
    page = {"scfgfu": force, "scfgtu": torque, "cfgcpf": "1000", "cfgcpt": "500"}
    with closing(Wire(**page)) as wire, closing(NetFt(HOST, wire.port, wire.web)) as source:
        source.open()
        got = received(source, 1)
    expected = [newton / 1000] * 3 + [newton_metre / 500] * 3
    np.testing.assert_allclose(got.values[0], np.array([1, -2, 3, -4, 5, -6]) * expected, rtol=1e-15)


def test_connection_is_said_with_what_the_device_is_and_what_the_buffer_holds() -> None:
    with closing(Wire(comrdtrate="7000")) as wire, closing(NetFt(HOST, wire.port, wire.web, rate=1000.0)) as source:
        source.open()
        what = "connected to Box, calibration FT1", "7000 samples/s, 1000000 counts per N"
        said_until(source, *what, "the rig states 1000", "KiB", "ms")


def test_missing_samples_are_counted_where_they_are_missing(wire: Wire) -> None:
    sent = [2, 3, 7, 8, 20, 21]
    with connected(wire) as source:
        wire.put(*(sample(k, k) for k in sent))
        got = received(source, len(sent))
        assert got.lost.tolist() == [0, 0, 3, 0, 11, 0]
        said_until(source, "missing samples: 14, gaps: 2")


def test_a_buffer_that_overflows_loses_what_is_said_and_no_count(wire: Wire) -> None:
    with connected(wire) as source:
        source._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 14)
        wire.put(*(sample(k, k) for k in range(2, 2002)))
        first = waiting(source)
        wire.put(sample(2002, 2002))
        last = received(source, 1)
        assert 0 < len(first) < 2000
        assert len(first) + 1 + first.sum() + last.lost.sum() == 2001
        said_until(source, f"which read too slowly: {last.lost.sum()}", f"missing samples: {last.lost.sum()}, gaps: 1")


def waiting(source: NetFt) -> np.ndarray:
    """The samples lost before each of those that wait."""
    batch, rows = Batch((6,)), list[np.ndarray]()
    while n := source.receive(batch, 0.0):
        rows.append(batch.lost[:n].copy())
    return np.concatenate(rows)


def test_a_sample_that_comes_twice_is_given_once_and_one_that_comes_late_is_given(wire: Wire) -> None:
    with connected(wire) as source:
        wire.put(*(sample(k, k, 0, [k] * 6) for k in (2, 3, 3, 2, 5, 4, 6, 4)))
        got = received(source, 5)
        assert (got.values[:, 0] * 1e6).round().tolist() == [2, 3, 5, 4, 6]
        said_until(source, "used once: 3", "first counted as missing: 1")


def test_a_stream_that_begins_anew_loses_what_the_other_counter_says(wire: Wire) -> None:
    with connected(wire) as source:
        wire.put(sample(2, 4), sample(3, 7), sample(1, 7 + 3 * 11), sample(2, 7 + 3 * 12))  # 3 measured for one sent
        assert received(source, 4).lost.tolist() == [0, 0, 10, 0]
        said_until(source, "sending began again")


def test_a_device_that_restarts_has_not_lost_four_billion(wire: Wire) -> None:
    with connected(wire) as source:
        wire.put(sample(4000, 4000), sample(8000, 8000), sample(1, 1), sample(2, 2), sample(4, 4))
        assert received(source, 5).lost.tolist() == [3998, 3999, 0, 0, 1]
        said_until(source, "the number of missing samples is unknown")


numbers = st.one_of(st.integers(0, ROUND - 1), st.integers(ROUND - 300, ROUND - 1))


@given(
    numbers,
    st.integers(1, 9),
    st.lists(st.sampled_from(["kept", "kept", "gone", "twice", "late"]), max_size=120),
    st.data(),
)
def test_counters_find_every_gap_and_repetition_in_blocks_of_any_size(
    first: int, ratio: int, fates: list[str], data: st.DataObject
) -> None:
    arrive: list[int] = [0]
    held: list[int] = []
    for k, fate in enumerate(["kept", *fates, "kept"], start=1):
        if fate == "late":
            held.append(k)
            continue
        arrive += [k] * {"kept": 1, "gone": 0, "twice": 2}[fate]
        if fate != "gone":
            arrive += held
            held.clear()
    order = np.array(arrive, dtype=np.int64)
    cuts = data.draw(st.lists(st.integers(0, len(order)), max_size=5).map(sorted))
    sequence, kept, lost = SequenceCounters(), list[int](), 0
    for block in np.split(order, cuts):
        if len(block):
            room = np.zeros(len(block), dtype=np.int64)
            rdt, ft = (first + block) % ROUND, (first + block * ratio) % ROUND
            chosen = sequence.follow(rdt.tolist(), ft.tolist(), (block * 1_000_000).tolist(), room)
            chosen = list(range(len(block))) if chosen is None else chosen
            kept += block[chosen].tolist()
            lost += int(room[: len(chosen)].sum())
    assert kept == list(dict.fromkeys(arrive))
    assert lost == sequence.missing
    assert lost - sequence.late == len(set(range(max(arrive) + 1)) - set(arrive))
    assert sequence.repeated == len(arrive) - len(set(arrive))
    assert sequence.restarts == 0


def test_counters_that_wrap_go_on() -> None:
    """After 7 days at 7 kHz: two are missing over the end of the count, in a block and from one block to the next."""
    sequence, lost, end = SequenceCounters(), np.zeros(8, dtype=np.int64), 1 << 32
    assert sequence.follow([end - 3, end - 2], [end - 3, end - 2], [0, 1], lost) is None
    assert sequence.follow([1, 2], [1, 2], [2, 3], lost) == [0, 1]
    assert lost[:2].tolist() == [2, 0]
    assert (sequence.gaps, sequence.missing, sequence.restarts) == (1, 2, 0)


@pytest.mark.parametrize(
    ("product", "status", "believed", "word"),
    [
        ("Box", 0x80010000, True, "threshold"),
        ("Box", 0x80080000, True, "EtherNet/IP"),
        ("Box", 0x80020000, False, "saturated"),
        ("Box", 0x80030000, False, "saturated"),
        ("Box", 0x80000000, False, "without details"),
        ("ATI Axia80", 0xC0000000, False, "out of range"),
        ("ATI Axia80", 0x88000000, False, "strain gage"),
        ("ATI Axia80", 0x00010000, True, "threshold"),
        ("ATI Axia80", 0x80020000, False, "bit 17"),
    ],
)
def test_samples_that_the_device_does_not_stand_by_are_nan(
    product: str, status: int, believed: bool, word: str
) -> None:
    with closing(Wire(prodname=product)) as wire, connected(wire) as source:
        wire.put(sample(2, 2), sample(3, 3, status), sample(4, 4, status), sample(5, 5))
        got = received(source, 4)
        said = "\n".join(said_until(source, word, f"0x{status:08x}", "no error"))
    bad = np.isnan(got.values).all(axis=1)
    assert bad.tolist() == [False, not believed, not believed, False]
    assert np.isfinite(got.values[~bad]).all()
    assert said.count(f"0x{status:08x}") == 1
    assert ("NaN" in said) is not believed


def test_what_is_no_sample_or_of_another_sender_is_counted_and_not_believed(wire: Wire) -> None:
    with connected(wire) as source, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        assert wire.peer is not None
        stranger.sendto(sample(2, 2, 0, [9] * 6), (HOST, wire.peer[1]))
        wire.put(sample(2, 2)[:-1], sample(2, 2) + b"x", b"", sample(2, 2) * 30, sample(2, 2))
        got = received(source, 1)
        assert got.values[0, 0] == 1e-6
        assert got.lost[0] == 0
        said_until(source, "length of a sample, ignored: 4", "another sender, ignored: 1")


@pytest.fixture(scope="module")
def battered() -> Iterator[tuple[Wire, NetFt]]:
    with closing(Wire()) as wire, connected(wire) as source:
        yield wire, source


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150)
@given(st.lists(st.one_of(st.binary(max_size=80), st.binary(min_size=36, max_size=36)), max_size=30))
def test_damaged_datagrams_never_raise_and_only_those_as_long_as_a_sample_are_read(
    battered: tuple[Wire, NetFt], damaged: list[bytes]
) -> None:
    wire, source = battered
    wire.put(*damaged)
    batch, whole = Batch((6,), 7), [each for each in damaged if len(each) == 36]
    possible = {struct.unpack(">iiiiii", each[12:]) for each in whole}
    given_ = 0
    for _ in range(len(damaged) + 1):  # a batch of nothing but damaged ones has no sample, and others come after it
        n = source.receive(batch, 0.0)
        given_ += n
        assert (batch.lost[:n] >= 0).all()
        assert batch.lost[:n].max(initial=0) < ROUND / 2
        for row in batch.values[:n][~np.isnan(batch.values[:n]).any(axis=1)]:
            assert tuple((row * 1e6).round().astype(int).tolist()) in possible
    assert given_ <= len(whole)
    assert all(sentence.isprintable() for sentence in source.events())


BOMB = (
    b'<?xml version="1.0"?><!DOCTYPE n [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]><netft><cfgcpf>&b;</cfgcpf></netft>'
)


@pytest.mark.parametrize(
    ("page", "words"),
    [
        (b"<html><body>A printer<br></body></html>", "is not XML"),
        (b"<status><ink>3</ink></status>", "does not state cfgcpf.*Check"),
        (BOMB, "is not XML"),
        (b"<?xml version='1.0' encoding='klingon'?><netft/>", "is not XML"),
        (b"\xff\xfe<\0n\0/\0>\0", "is not XML"),
        (b"", "is not XML"),
        (b" " * 400_000, "longer than 256 KiB.*Check"),
        (xml(**{**PAGE, "cfgcpf": "0"}), "which is not a number of counts"),
        (xml(**{**PAGE, "cfgcpt": "nan"}), "which is not a number of counts"),
        (xml(**{**PAGE, "scfgfu": "stone"}), "units that cannot be converted.*Choose"),
        (xml(**PAGE, comrdte="Disabled"), "RDT is disabled.*Open"),
    ],
)
def test_another_device_is_told_by_its_page(wire: Wire, page: bytes, words: str) -> None:
    wire.page = page
    with pytest.raises(InputError, match=words):
        NetFt(HOST, wire.port, wire.web).open()
    assert wire.asked == []


def test_a_device_without_the_page_is_another(wire: Wire) -> None:
    wire.status = 404
    with pytest.raises(InputError, match=r"it answers 404.*Check"):
        NetFt(HOST, wire.port, wire.web).open()


def test_a_device_that_does_not_speak_http_is_another() -> None:
    with socket.create_server((HOST, 0)) as server:

        def greet() -> None:
            link, _ = server.accept()
            with link:
                link.recv(4096)
                link.sendall(b"220 ftp ready\r\n")

        thread = threading.Thread(target=greet, daemon=True)
        thread.start()
        with pytest.raises(InputError, match=r"not that of a web server.*Check"):
            NetFt(HOST, 1, server.getsockname()[1]).open()
        thread.join()


def test_a_page_that_is_silent_or_not_there_or_of_no_known_name_is_said(
    wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    wire.silent = True
    monkeypatch.setattr("palpate.live.netft._PAGE", 0.1)
    with pytest.raises(InputError, match=r"does not answer at port.*Check"):
        NetFt(HOST, wire.port, wire.web).open()
    with socket.create_server((HOST, 0)) as server:
        free = server.getsockname()[1]
    with pytest.raises(InputError, match=r"refuses connections to port.*Check"):
        NetFt(HOST, wire.port, free).open()
    with pytest.raises(InputError, match=r"no device named.*Check"):
        NetFt("no such name", wire.port, wire.web).open()


def test_a_device_that_sends_nothing_is_said(wire: Wire, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate.live.netft._FIRST", 0.1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as deaf:
        deaf.bind((HOST, 0))
        with pytest.raises(InputError, match=r"sends no samples.*Check"):
            NetFt(HOST, deaf.getsockname()[1], wire.web).open()


def test_a_device_that_falls_silent_is_asked_again_and_what_it_lost_is_said(
    wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("palpate.live.netft._ASK", 0.05)
    monkeypatch.setattr("palpate.live.netft.SILENT", 0.3)
    with connected(wire) as source:
        said_until(source, "no samples for 0.", "requesting them again", "check its power")
        assert wire.asked.count(2) >= 3
        wire.put(sample(12, 12))
        assert received(source, 1).lost.tolist() == [10]
        said_until(source, "samples come again after", "10 missing")
        said_until(source, "no samples for 0.", "requesting them again")


def test_another_calibration_is_noticed_when_the_device_comes_back(wire: Wire, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate.live.netft._RETRY", 0.02)
    with connected(wire) as source:
        wire.status = 503  # its web server starts after the samples do
        wire.put(sample(2, 2), sample(1, 13, 0, [8] * 6))
        assert received(source, 2).values[1].tolist() == [8e-6] * 6
        said_until(source, "page cannot be read again", "503")
        wire.page, wire.status = xml(**{**PAGE, "cfgcpf": "500000", "cfgcalsn": "FT2"}), 200
        time.sleep(0.03)
        wire.put(sample(2, 14, 0, [8] * 6))
        assert received(source, 1).values[0].tolist() == [16e-6] * 3 + [8e-6] * 3
        said_until(source, "calibration changed: now Box, calibration FT2, 500000 counts per N")


def test_the_page_is_not_waited_for_longer_than_the_buffer_holds(wire: Wire) -> None:
    """A page that never answers costs nothing but its time: the samples that came meanwhile are all there."""
    with connected(wire) as source:
        wire.silent = True
        wire.put(sample(1, 13))
        ending = threading.Timer(0.05, lambda: wire.put(*(sample(k, 12 + k) for k in range(2, 400))))
        ending.start()
        assert received(source, 399).lost.tolist() == [11] + [0] * 398
        said_until(source, "page cannot be read again")


def test_closing_asks_the_device_to_stop_and_may_be_done_twice(wire: Wire) -> None:
    with connected(wire) as source:
        source.close()
        source.close()
    until(lambda: 0 in wire.asked)
    assert wire.asked == [2, 0]
    NetFt(HOST).close()


SPHERE = {"surface": {"kind": "sphere", "radius": 0.1}}
CELLS = {"load_cells": {"columns": [f"u{k}" for k in range(9)]}}


def _device(table: dict[str, Any]) -> NetFt:
    rig = check_rig(table, Path("rig.toml"))
    return NetFt.of(rig.stream(), rig.resolve())


def test_a_rig_of_other_units_or_another_sensor_is_refused() -> None:
    table = {**SPHERE, "source": {"kind": "netft", "address": HOST}}
    imperial = {"force_torque": {"units": {"force": "lbf", "torque": "lbf in"}}}
    with pytest.raises(InputError, match=r"must be N and N m, not lbf and lbf in.*Write units"):
        _device({**table, **imperial})
    with pytest.raises(InputError, match=r"has no \[force_torque\].*Add"):
        _device({**table, **CELLS})
    spelled = {"force_torque": {"units": {"force": "newton", "torque": "Nm"}}}
    _device({**table, **spelled})


# --- the stand-in


@pytest.fixture
def device() -> Iterator[NetFtDevice]:
    with closing(NetFtDevice()) as made:
        made.open()
        yield made


def send(device: NetFtDevice, *rows: Listed[float]) -> int:
    return device.send(np.zeros(len(rows), dtype=np.int64), np.array(rows, dtype=np.float64))


def test_the_real_client_takes_the_stand_in_for_a_net_ft(device: NetFtDevice) -> None:
    pynetft = pytest.importorskip("pynetft", reason="pynetft has no wheel for this machine")
    config = pynetft.Config(sensor_host=HOST, rdt_port=device.port, http_port=device.web, receive_timeout=1.0)
    rng = np.random.default_rng(2)
    values = rng.integers(-(10**9), 10**9, (50, 6)) / 1e6
    with pynetft.Client(config, queue_size=1000) as client:
        got = taken(device, client, values, lambda each: each.wrench == tuple(values[-1]))
        assert [each.wrench for each in got[-50:]] == [tuple(row) for row in values.tolist()]
        assert {(each.force_unit.value, each.torque_unit.value, each.status) for each in got} == {("N", "N-m", 0)}
        assert client.health().lost_count == client.health().malformed_count == 0
        client.bias()
        taken(device, client, values[-1:], lambda each: not any(each.wrench))


def taken(device: NetFtDevice, client: Any, values: np.ndarray, done: Callable[[Any], bool]) -> list[Any]:
    """Send the same again, for a client on a busy machine may begin anew, until it has what is awaited."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        send(device, *values.tolist())
        got: list[Any] = []
        try:
            for each in client.samples(timeout=0.3):
                got.append(each)
                if done(each):
                    return got
        except TimeoutError:
            continue
    pytest.fail("the client never had it")


def test_the_stand_in_gives_back_what_was_sent_through_it(device: NetFtDevice) -> None:
    values = np.random.default_rng(3).integers(-(10**8), 10**8, (500, 6)) / 1e6
    values[7, 2], values[9, 0] = math.nan, 2148.0
    with connected(device) as source:
        assert send(device, *values.tolist()) == 500
        got = received(source, 500)
        said_until(source, "transducer saturated")
    believed = np.delete(values, [7, 9], axis=0)
    np.testing.assert_array_equal(np.delete(got.values, [7, 9], axis=0), believed)
    assert np.isnan(got.values[[7, 9]]).all()
    assert not got.lost.any()


def test_the_stand_in_unplugged_and_plugged_in_again_is_found_again(device: NetFtDevice) -> None:
    send(device, *np.zeros((100_000, 6)).tolist())  # it has run for long, and nobody listened
    with connected(device) as source:
        device.close()
        said_until(source, "requesting them again")
        again = NetFtDevice(device.port, device.web)
        again.open()
        with sending(again):
            said_until(source, "samples come again after", "the number of missing samples is unknown")
        again.close()


def test_the_stand_in_sends_as_many_as_asked_to_each_who_asks_and_passes_over_what_it_does_not_know(
    device: NetFtDevice,
) -> None:
    row, start = [1.0, 2.0, 3.0, 0.1, 0.2, 0.3], struct.pack(">HHI", 0x1234, 2, 0)
    assert send(device, row) == 0
    with udp() as three, udp() as ever:
        for strange in (b"", b"x" * 64, struct.pack(">HHI", 0x4321, 2, 0), struct.pack(">HHI", 0x1234, 99, 0)):
            three.sendto(strange, (HOST, device.port))
        three.sendto(struct.pack(">HHI", 0x1234, 2, 3), (HOST, device.port))
        until(lambda: send(device, [0.0] * 6))
        assert [send(device, row, row), send(device, row)] == [2, 0]
        assert numbers_of(three) == [1, 2, 3]
        for listener in (ever, three):
            listener.sendto(start, (HOST, device.port))
        with sending(device):
            ever.recv(64), three.recv(64)
        numbers_of(ever), numbers_of(three)
        assert send(device, row, row) == 2
        assert np.diff(numbers_of(ever)).tolist() == np.diff(numbers_of(three)).tolist() == [1]
        ever.sendto(struct.pack(">HHI", 0x1234, 0, 0), (HOST, device.port))
        three.sendto(struct.pack(">HHI", 0x1234, 0, 0), (HOST, device.port))
        until(lambda: send(device, row) == 0)


def numbers_of(listener: socket.socket) -> list[int]:
    """The counters of all samples that wait."""
    numbers = list[int]()
    listener.setblocking(False)
    try:
        while True:
            numbers.append(struct.unpack(">I", listener.recv(64)[:4])[0])
    except BlockingIOError:
        listener.settimeout(PATIENCE)
    return numbers


@contextmanager
def udp() -> Generator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.settimeout(PATIENCE)
        yield made


def test_a_port_that_is_taken_is_said(device: NetFtDevice) -> None:
    for port, web, kind in ((device.port, 0, "UDP"), (0, device.web, "TCP")):
        other = NetFtDevice(port, web)
        with pytest.raises(InputError, match=rf"{kind} port {port or web} cannot be used.*Name"):
            other.open()
        other.close()


def test_the_source_that_the_stand_in_names_reaches_it(device: NetFtDevice) -> None:
    told_source = tomllib.loads(device.open())  # again: it listens anew, on the same ports
    source = _device({**SPHERE, "force_torque": {}, **told_source})
    with sending(device, 2.5):
        source.open()
        got = received(source, 1, size=1)
    source.close()
    assert (got.values == 2.5).all()
