"""One session gives the same contacts to the last bit, whatever it was written as, read in and written to."""

import shutil
from pathlib import Path

import pytest

from claims.evidence.same import FORMATS, differing, estimated, written
from palpate.contact import Contacts, Status
from palpate.files.logs import columns, topic_log


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session with touches and 0.3 s without a pose, which is longer than the largest gap, in every format."""
    made = tmp_path_factory.mktemp("session")
    log = written(made, touches=5, facets=320, unposed=slice(300, 360))
    for name, write in FORMATS.items():
        write(made / name, log)
    return made


@pytest.fixture(autouse=True)
def _small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each reader cuts this short log where it likes."""
    monkeypatch.setattr(topic_log.TopicLog, "block_rows", 211)
    monkeypatch.setattr(columns, "BLOCK", 137)


@pytest.fixture(scope="module")
def expected(folder: Path) -> Contacts:
    """Of the table of text."""
    contacts = estimated(folder, "log.csv", "contacts.parquet")
    statuses = {Status(k) for k in contacts.estimate.status.tolist()}
    assert statuses >= {Status.CONTACT, Status.NO_CONTACT, Status.NO_POSE}
    return contacts


@pytest.mark.parametrize("name", list(FORMATS)[1:])
def test_what_the_log_was_written_as_does_not_matter(folder: Path, expected: Contacts, name: str) -> None:
    assert differing(expected, estimated(folder, name, "found.parquet")) == 0


def test_the_file_of_a_bag_is_its_folder(folder: Path, expected: Contacts) -> None:
    shutil.copy(next((folder / "ros2 bag (SQLite)").glob("*.db3")), folder / "log.db3")
    assert differing(expected, estimated(folder, "log.db3", "found.parquet")) == 0


@pytest.mark.parametrize("suffix", [".csv", ".mcap"])
@pytest.mark.parametrize("log", ["log.csv", "zstd.mcap"])
def test_what_contacts_are_written_to_does_not_matter(folder: Path, expected: Contacts, log: str, suffix: str) -> None:
    assert differing(expected, estimated(folder, log, f"found{suffix}")) == 0


def test_zero_phase_is_the_same_through_every_reader(folder: Path) -> None:
    logs = ("log.csv", "log.parquet", "lz4.mcap")
    first, *others = [estimated(folder, name, "found.mcap", "--filter", "zero_phase") for name in logs]
    assert [differing(first, other) for other in others] == [0, 0]
