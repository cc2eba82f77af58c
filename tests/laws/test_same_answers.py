"""One session gives the same contacts to the last bit, whatever it was written as, read in, cut into and written to."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import logs_written
import numpy as np
import pytest
from logs_written import POSE, WRENCH, cdr, write_csv, write_mcap, write_parquet, write_ros2
from mcap.writer import CompressionType
from rosbags.rosbag2 import StoragePlugin

from palpate.cli import main
from palpate.contact import WrenchEstimator
from palpate.contact.estimate import ContactEstimate, Status
from palpate.io.contacts import Contacts, read_contacts
from palpate.io.logs import parquet, read_recording, topic_log
from palpate.io.models import write_payload
from palpate.io.rig import build, load_rig
from palpate.sensors.compensation import Compensation
from palpate.sensors.filters import Butterworth, Filter, Kalman
from palpate.sensors.force_torque import Payload
from palpate.sensors.motion import Motion
from palpate.sensors.recording import ORIENTATION, Recording
from palpate.simulation.session import GRAVITY, simulate_session
from palpate.simulation.session_files import POSE_TOPIC, WRENCH_TOPIC, write_session

RATE = 200
CHUNK = 80_000  # bytes: some 20 chunks
FORMATS = ("log.csv", "log.parquet", "plain.mcap", "lz4.mcap", "zstd.mcap", "bag")
FILTERS: dict[str, Filter] = {
    "butterworth": Butterworth(15.0),
    "kalman": Kalman(1e-4, 2e-4),
    "zero phase": Butterworth(15.0, zero_phase=True),
}


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session with touches, moments without a pose, and numbers of all their bits, in every format."""
    folder = tmp_path_factory.mktemp("session")
    made = simulate_session(6, touches=10, facets=320)
    write_session(made, folder)
    load = made.load
    payload = Payload(load.mass * GRAVITY, load.force_bias, load.center_of_mass, load.torque_bias, 1e-8 * np.eye(12))
    write_payload(folder / "payload.toml", payload)
    rig = (folder / "rig.toml").read_text().replace(WRENCH_TOPIC, WRENCH).replace(POSE_TOPIC, POSE)
    (folder / "rig.toml").write_text(rig)
    recording = made.touches
    stamp = 1_600_000_000 * 10**9 + np.arange(len(recording), dtype=np.int64) * (10**9 // RATE)
    position = np.cumsum(np.random.default_rng(0).normal(0.0, 1e-4, (len(stamp), 3)), axis=0)
    quaternion = recording.channels[ORIENTATION].copy()
    quaternion[300:360] = 0.0  # none for 0.3 s, which is longer than the largest gap
    log = logs_written.Session(stamp, recording.wrenches(), quaternion, position)
    write_csv(folder / "log.csv", log)
    write_parquet(folder / "log.parquet", log)
    write_ros2(folder / "bag", log.messages(), StoragePlugin.SQLITE3)
    messages = [(at, topic, cdr(message)) for at, topic, message in log.messages()]
    write_mcap(folder / "plain.mcap", messages, use_chunking=False)
    write_mcap(folder / "lz4.mcap", messages, compression=CompressionType.LZ4, chunk_size=CHUNK)
    write_mcap(folder / "zstd.mcap", messages, compression=CompressionType.ZSTD, chunk_size=CHUNK)
    return folder


@pytest.fixture(autouse=True)
def _small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each reader cuts this short log where it likes."""
    monkeypatch.setattr(topic_log, "BLOCK", 211)
    monkeypatch.setattr(parquet, "BLOCK", 137)


def _estimated(folder: Path, log: str, output: Path, *options: str) -> Contacts:
    call = ["estimate", str(folder / log), "--rig", str(folder / "rig.toml"), "-o", str(output), *options]
    assert main(call) == 0
    return read_contacts(output)


def _assert_same(found: Contacts, expected: Contacts) -> None:
    assert np.array_equal(found.sample, expected.sample)
    assert np.array_equal(found.time, expected.time)
    _assert_same_bits(found.estimate, expected.estimate)


def _assert_same_bits(found: ContactEstimate, expected: ContactEstimate) -> None:
    for field in fields(expected):
        left, right = getattr(found, field.name), getattr(expected, field.name)
        assert np.array_equal(left, right, equal_nan=True), field.name


@pytest.fixture(scope="module")
def expected(written: Path, tmp_path_factory: pytest.TempPathFactory) -> Contacts:
    """Of the table of text."""
    contacts = _estimated(written, "log.csv", tmp_path_factory.mktemp("contacts") / "contacts.csv")
    statuses = {Status(k) for k in contacts.estimate.status.tolist()}
    assert statuses >= {Status.CONTACT, Status.NO_CONTACT, Status.NO_POSE}
    return contacts


@pytest.mark.parametrize("name", FORMATS[1:])
def test_what_the_log_was_written_as_does_not_matter(
    written: Path, expected: Contacts, tmp_path: Path, name: str
) -> None:
    _assert_same(_estimated(written, name, tmp_path / "contacts.csv"), expected)


def test_the_file_of_a_bag_is_its_folder(written: Path, expected: Contacts, tmp_path: Path) -> None:
    shutil.copy(next((written / "bag").glob("*.db3")), tmp_path / "log.db3")
    _assert_same(_estimated(written, str(tmp_path / "log.db3"), tmp_path / "contacts.csv"), expected)


@pytest.mark.parametrize("suffix", [".parquet", ".mcap"])
@pytest.mark.parametrize("log", ["log.csv", "zstd.mcap"])
def test_what_contacts_are_written_to_does_not_matter(
    written: Path, expected: Contacts, tmp_path: Path, log: str, suffix: str
) -> None:
    _assert_same(_estimated(written, log, tmp_path / f"contacts{suffix}"), expected)


def test_zero_phase_is_the_same_through_every_reader(written: Path, tmp_path: Path) -> None:
    found = [
        _estimated(written, name, tmp_path / "contacts.mcap", "--filter", "zero_phase")
        for name in ("log.csv", "log.parquet", "lz4.mcap")
    ]
    for contacts in found[1:]:
        _assert_same(contacts, found[0])


def _cut(recording: Recording, size: int) -> Iterator[Recording]:
    for start in range(0, len(recording), size):
        yield recording.picked(slice(start, start + size))


def _streamed(folder: Path, recording: Recording, made: Filter, source: str, size: int) -> ContactEstimate:
    """Through inertia and the whole chain, in blocks of a size."""
    estimator = build(load_rig(folder / "rig.toml"), rate=float(RATE))
    assert isinstance(estimator.sensor, Compensation)
    payload = estimator.sensor.payload
    assert payload is not None
    motion = Motion(source, gravity=payload.gravity, lever=payload.center_of_mass)
    sensor = Compensation(estimator.sensor.sensor, payload, motion)
    chain = WrenchEstimator(estimator.locator, sensor, estimator.mount, filter=made, rate=float(RATE))
    return ContactEstimate.joined([found.estimate for found in chain.stream(_cut(recording, size))])


@pytest.mark.parametrize(
    ("kind", "source"), [("butterworth", "none"), ("kalman", "poses"), ("zero phase", "none"), ("zero phase", "poses")]
)
def test_how_the_log_is_cut_does_not_matter(written: Path, kind: str, source: str) -> None:
    recording = read_recording(written / "zstd.mcap", load_rig(written / "rig.toml").layout())
    whole = _streamed(written, recording, FILTERS[kind], source, 10**6)
    assert np.count_nonzero(whole.status == Status.CONTACT) > 100
    for size in (17, 4096):
        _assert_same_bits(_streamed(written, recording, FILTERS[kind], source, size), whole)
    start = recording.picked(slice(0, 700))  # one by one takes a while
    one, all_at_once = (_streamed(written, start, FILTERS[kind], source, size) for size in (1, 700))
    _assert_same_bits(one, all_at_once)
